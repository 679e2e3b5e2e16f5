"""Numbered work for worker processes: each result depends only on its number and on the definition of the work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

ResultT = TypeVar("ResultT", bound="Result")
ResultT_co = TypeVar("ResultT_co", bound="Result", covariant=True)


class Result(Protocol):
    """The result of one number, as data that JSON can represent."""

    @property
    def index(self) -> int:
        """The number."""

    @property
    def wall_time(self) -> float:
        """The wall time that it took [s]."""

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""


@dataclass(frozen=True, slots=True)
class Block:
    """Numbers that one process takes together.

    Attributes:
        indices: The numbers.
        is_recorded: Whether the logs of their runs are written.
        values: For each number, the values of its run by their paths, if these do not follow from the number.
    """

    indices: tuple[int, ...]
    is_recorded: bool = False
    values: tuple[Mapping[str, Any], ...] = ()


class Work(Protocol[ResultT_co]):
    """Computes results in the present process; other processes create the same work from `to_json`."""

    def open(self) -> None:
        """Read and import what all results need; called before the first one."""

    def prepare(self) -> None:
        """Import everything that a result uses, so that the code of two machines can be compared."""

    def results(self, block: Block) -> Iterator[ResultT_co]:
        """Compute the results of a block, in any order.

        Raises:
            KeyboardInterrupt: A signal interrupted the computation.
        """

    def to_json(self) -> dict[str, Any]:
        """Return the work as plain data; `pool_worker` selects the class by ``kind``."""

    def received(self, content: dict[str, Any]) -> ResultT_co:
        """Return the result that another process sent as `Result.to_json`."""

    def lost(self, index: int, why: str) -> ResultT_co:
        """Return the substitute for a result whose process died or exceeded its time.

        Raises:
            SweepError: There is no substitute: the work cannot continue without the result.
        """
