"""What worker processes make: numbered results, each of which depends on its number and on what it is made of alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

ResultT = TypeVar("ResultT", bound="Result")
ResultT_co = TypeVar("ResultT_co", bound="Result", covariant=True)


class Result(Protocol):
    """What came of one number; data that JSON can carry."""

    @property
    def index(self) -> int:
        """Its number."""

    @property
    def wall_time(self) -> float:
        """How long it took [s]."""

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""


@dataclass(frozen=True, slots=True)
class Block:
    """Numbers that are given away together.

    Attributes:
        indices: The numbers.
        is_recorded: Whether the logs of their runs are written.
        values: For each of them the values that it is made with, by their paths, if they do not follow from its number.
    """

    indices: tuple[int, ...]
    is_recorded: bool = False
    values: tuple[Mapping[str, Any], ...] = ()


class Work(Protocol[ResultT_co]):
    """Makes results in the process that it is in; another process makes it again of `to_json`."""

    def open(self) -> None:
        """Read and import what all results need, before the first one."""

    def prepare(self) -> None:
        """Import all that is used for the first result, so that the code of two machines can be compared."""

    def results(self, block: Block) -> Iterator[ResultT_co]:
        """Make the results of a block, in any order.

        Raises:
            KeyboardInterrupt: A signal ended one.
        """

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data; its ``kind`` is what `pool_worker` knows it by."""

    def received(self, content: dict[str, Any]) -> ResultT_co:
        """Return the result of which another process sent `Result.to_json`."""

    def lost(self, index: int, why: str) -> ResultT_co:
        """Return what stands for a result whose process died, or that took too long.

        Raises:
            SweepError: There is nothing that could stand for it.
        """
