"""Interfaces of work and of the executors that perform it, and the simplest executor: the present process."""

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
    """A result, identified by a number and representable in JSON."""

    @property
    def index(self) -> int:
        """The number."""

    @property
    def wall_time(self) -> float:
        """The wall time spent on it [s]."""

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""


@dataclass(frozen=True, slots=True)
class Block:
    """A block of numbers that one process works on together.

    Attributes:
        indices: The numbers.
        is_recorded: Whether logs of the runs are written.
        values: The values of each run by path, if the number of the run does not determine them.
    """

    indices: tuple[int, ...]
    is_recorded: bool = False
    values: tuple[Mapping[str, Any], ...] = ()


class Work(Protocol[ResultT_co]):
    """Computes results in the present process; other processes create the same work from `to_json`."""

    def open(self) -> None:
        """Read and import the prerequisites of all results; called before the first one."""

    def prepare(self) -> None:
        """Import all code that results use, so that the code of two machines can be compared."""

    def results(self, block: Block) -> Iterator[ResultT_co]:
        """Compute the results of a block, in any order.

        Raises:
            KeyboardInterrupt: A signal interrupted the computation.
        """

    def to_json(self) -> dict[str, Any]:
        """Return the work as plain data."""

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Work[ResultT_co]:
        """Create the work from the `to_json` of another process."""

    def received(self, content: dict[str, Any]) -> ResultT_co:
        """Return the result that another process sent as `Result.to_json`."""

    def lost(self, index: int, why: str) -> ResultT_co:
        """Return the substitute for a result whose process died or exceeded its time.

        Raises:
            LostResultError: There is no substitute: the work cannot continue without the result.
        """


def description(work: Work[Any]) -> dict[str, Any]:
    """Return a description of work for another process, as plain data."""
    return {"module": type(work).__module__, "class": type(work).__qualname__, "content": work.to_json()}


def described_work(found: dict[str, Any]) -> Work[Any]:
    """Return the work of a `description`; only classes of this package are accepted.

    Raises:
        ValueError: The class belongs to another package.
    """
    if found["module"].partition(".")[0] != __name__.partition(".")[0]:
        raise ValueError(f"no work of {found['module']}")
    kind: type[Work[Any]] = getattr(import_module(found["module"]), found["class"])
    return kind.from_json(found["content"])


@contextmanager
def signals_raised() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGTERM as on Ctrl-C; in threads other than the main one, neither is handled."""

    def raised(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    with signals_handled(raised):
        yield


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Defer SIGINT and SIGTERM to the end of the block, such as until a new process is registered for cleanup."""
    waiting: list[int] = []
    try:
        with signals_handled(lambda number, frame: waiting.append(number)):
            yield
    finally:
        if waiting:
            signal.raise_signal(waiting[0])


#: The intended wall time of a block of runs [s], and the maximum number of runs of a block.
_WORTH, _MOST = 1.0, 1000


class Blocks:
    """The remaining runs, in blocks of about a second; the duration of a run is estimated along the way."""

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
            count: The number of runs.
            is_recorded: Whether to write their logs.
            run_time: The duration of a run [s], if already known.
            least: The minimum number of runs in a block, regardless of duration; above 1 if batched runs are faster.
            values: The values of each run by its number; see `Block`.
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
            share: The number of workers that share the rest.
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
        """Return runs that were not executed."""
        returned = list(indices)
        self._returned.extend(returned)
        self._left += len(returned)

    @property
    def run_time(self) -> float | None:
        """The estimated duration of a run [s]; None if unknown."""
        return self._mean

    def learn(self, wall_time: float) -> None:
        """Update the estimated duration of a run with a measured one [s]."""
        self._mean = wall_time if self._mean is None else self._mean + 0.2 * (wall_time - self._mean)


class Executor(Protocol[ResultT_co]):
    """Performs work at some place; independent of journals and tables."""

    def results(self, blocks: Blocks) -> Iterator[ResultT_co]:
        """Compute the results of all blocks, and yield them as they become available, in any order."""

    def close(self) -> None:
        """Release the resources of the executor, such as processes."""


class LocalExecutor(Generic[ResultT]):
    """Performs all work in the present process, block by block."""

    def __init__(self, work: Work[ResultT]) -> None:
        self._work = work
        work.open()
        # Keeps modules that are already imported out of later garbage collections.
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
