"""Who does the work: the interface, and the simplest executor, which is this process."""

from __future__ import annotations

import gc
import math
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Generic, Protocol

from symaware_cli.study.work import Block, ResultT, ResultT_co, Work

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
