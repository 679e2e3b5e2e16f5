"""Work for worker processes, and who does it: the interface, and the simplest executor, which is this process."""

from __future__ import annotations

import gc
import math
import signal
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from types import FrameType
from typing import Any, Generic, Protocol, TypeVar

from symaware_cli.engine import signals_handled

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
        """Return the work as plain data."""

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Work[ResultT_co]:
        """Return the work of which another process sent `to_json`."""

    def received(self, content: dict[str, Any]) -> ResultT_co:
        """Return the result that another process sent as `Result.to_json`."""

    def lost(self, index: int, why: str) -> ResultT_co:
        """Return the substitute for a result whose process died or exceeded its time.

        Raises:
            LostResultError: There is no substitute: the work cannot continue without the result.
        """


def description(work: Work[Any]) -> dict[str, Any]:
    """Describe work for another process, as plain data."""
    return {"module": type(work).__module__, "class": type(work).__qualname__, "content": work.to_json()}


def described_work(found: dict[str, Any]) -> Work[Any]:
    """Return the work of a `description`; its class is found among the package's own modules.

    Raises:
        ValueError: It is of another package.
    """
    if found["module"].partition(".")[0] != __name__.partition(".")[0]:
        raise ValueError(f"no work of {found['module']}")
    kind: type[Work[Any]] = getattr(import_module(found["module"]), found["class"])
    return kind.from_json(found["content"])


@contextmanager
def signals_raised() -> Iterator[None]:
    """Make SIGTERM what Ctrl-C is; in other threads than the main one neither is."""

    def raised(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    with signals_handled(raised):
        yield


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the block has ended, such as for a process to be known to whoever ends it."""
    waiting: list[int] = []
    try:
        with signals_handled(lambda number, frame: waiting.append(number)):
            yield
    finally:
        if waiting:
            signal.raise_signal(waiting[0])


#: The wall time that a block of runs is to take [s], and the most runs of a block.
_WORTH, _MOST = 1.0, 1000


class Blocks:
    """The runs that are still to be made, in blocks worth about a second; what a run takes is learnt meanwhile."""

    def __init__(
        self,
        indices: Iterable[int],
        count: int,
        *,
        is_recorded: bool = False,
        run_time: float | None = None,
        least: int = 1,
        values: Mapping[int, Mapping[str, Any]] | None = None,
    ) -> None:
        """Prepare.

        Args:
            indices: The numbers of the runs.
            count: How many they are.
            is_recorded: Whether their logs are to be written.
            run_time: How long a run takes [s], as far as that is known already.
            least: The fewest runs of a block, however long one takes: several where together they take less.
            values: See `Block`, by the numbers of the runs.
        """
        self._values = values
        self._indices = iter(indices)
        self._left = count
        self._returned: deque[int] = deque()
        self._is_recorded = is_recorded
        self._mean = run_time
        self._least = least

    def take(self, share: int = 1) -> Block | None:
        """Return the next block; None if there is none.

        Args:
            share: Among how many the rest is to be shared.
        """
        worth = 0 if self._mean is None else int(_WORTH / max(self._mean, 1e-6))
        size = min(_MOST, max(worth, self._least), math.ceil(self._left / share))
        taken: list[int] = []
        while len(taken) < size:
            index = self._returned.popleft() if self._returned else next(self._indices, None)
            if index is None:
                break
            taken.append(index)
        self._left -= len(taken)
        if not taken:
            return None
        values = () if self._values is None else tuple(self._values[index] for index in taken)
        return Block(tuple(taken), self._is_recorded, values)

    def give_back(self, indices: Iterable[int]) -> None:
        """Take back runs that were not made."""
        returned = list(indices)
        self._returned.extend(returned)
        self._left += len(returned)

    @property
    def run_time(self) -> float | None:
        """How long a run takes [s], as far as that is known."""
        return self._mean

    def learn(self, wall_time: float) -> None:
        """Take note of how long a run took [s]."""
        self._mean = wall_time if self._mean is None else self._mean + 0.2 * (wall_time - self._mean)


class Executor(Protocol[ResultT_co]):
    """Has work done, wherever; knows nothing of journals and tables."""

    def results(self, blocks: Blocks) -> Iterator[ResultT_co]:
        """Have results made until there are no more, and yield them as they come, in any order."""

    def close(self) -> None:
        """End what makes them."""


class LocalExecutor(Generic[ResultT]):
    """Does all work in this process, one block after the other."""

    def __init__(self, work: Work[ResultT]) -> None:
        self._work = work
        work.open()
        # What is imported by now need not be searched whenever the objects of past runs are collected.
        gc.freeze()

    def results(self, blocks: Blocks) -> Iterator[ResultT]:
        """See `Executor`."""
        while (block := blocks.take()) is not None:
            for result in self._work.results(block):
                blocks.learn(result.wall_time)
                yield result

    def close(self) -> None:
        """See `Executor`."""
        gc.unfreeze()
