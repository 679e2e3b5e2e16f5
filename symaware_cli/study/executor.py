"""Who makes the runs: the interface, and the simplest executor, which is this process."""

from __future__ import annotations

import gc
import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from symaware_cli.study.row import Row
from symaware_cli.study.runner import Runner

#: The wall time that a block of runs is to take [s], and the most runs of a block.
_WORTH, _MOST = 1.0, 1000


@dataclass(frozen=True, slots=True)
class Block:
    """Runs that are given away together.

    Attributes:
        indices: Their numbers.
        is_recorded: Whether their logs are written.
    """

    indices: tuple[int, ...]
    is_recorded: bool = False


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
    ) -> None:
        """Prepare.

        Args:
            indices: The numbers of the runs.
            count: How many they are.
            is_recorded: Whether their logs are to be written.
            run_time: How long a run takes [s], as far as that is known already.
            least: The fewest runs of a block, however long one takes: several where together they take less.
        """
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
        return Block(tuple(taken), self._is_recorded) if taken else None

    def give_back(self, indices: Iterable[int]) -> None:
        """Take back runs that were not made."""
        returned = list(indices)
        self._returned.extend(returned)
        self._left += len(returned)

    def learn(self, wall_time: float) -> None:
        """Take note of how long a run took [s]."""
        self._mean = wall_time if self._mean is None else self._mean + 0.2 * (wall_time - self._mean)


class Executor(Protocol):
    """Makes runs, wherever; knows nothing of journals and tables."""

    def rows(self, blocks: Blocks) -> Iterator[Row]:
        """Make runs until there are no more, and yield their rows as they come, in any order."""

    def close(self) -> None:
        """End what makes runs."""


class LocalExecutor:
    """Makes all runs in this process, one after the other."""

    def __init__(self, runner: Runner, logs: Path) -> None:
        self._runner = runner
        self._logs = logs
        # What is imported by now need not be searched whenever the objects of past runs are collected.
        gc.freeze()

    def rows(self, blocks: Blocks) -> Iterator[Row]:
        """See `Executor`."""
        while (block := blocks.take()) is not None:
            for row in self._runner.rows(block.indices, self._logs if block.is_recorded else None):
                blocks.learn(row.wall_time)
                yield row

    def close(self) -> None:
        """See `Executor`."""
        gc.unfreeze()
