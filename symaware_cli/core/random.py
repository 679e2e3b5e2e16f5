"""Chance that can be repeated: a generator for every path, keyed by the seed of the run.

The key is the path itself (such as ``agents.robot.2.sense``), never a position in a list, so that adding
an agent or reordering the scenario changes nobody else's draws.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def generator(seed: int, path: str) -> np.random.Generator:
    """Return the generator of a path.

    The hash is BLAKE2b because Python's own differs between processes.
    """
    words = np.frombuffer(hashlib.blake2b(path.encode(), digest_size=16).digest(), "<u4")
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(int(word) for word in words))
    return np.random.Generator(np.random.PCG64(sequence))


class RowGenerators:
    """One generator for each agent of a group, drawn from in blocks.

    Drawing from a thousand generators one by one would cost a millisecond a step. So each fills a block of its own
    ahead, and a step reads across all blocks. What an agent draws is always the next part of its own stream: it
    depends neither on who else draws nor on the size of the blocks.
    """

    def __init__(self, seed: int, paths: Sequence[str], block: int = 256) -> None:
        self._seed = seed
        self._paths = paths
        self._block = block
        self._streams: dict[str, _Stream] = {}

    def standard_normal(self, width: int) -> NDArray[np.float64]:
        """Draw ``width`` standard normal numbers for every agent; shape (n, width)."""
        return self._stream("standard_normal").take(np.full(len(self._paths), width)).reshape(-1, width)

    def uniform(self, width: int) -> NDArray[np.float64]:
        """Draw ``width`` numbers from [0, 1) for every agent; shape (n, width)."""
        return self._stream("random").take(np.full(len(self._paths), width)).reshape(-1, width)

    def standard_normal_of(self, counts: NDArray[np.integer]) -> NDArray[np.float64]:
        """Draw as many standard normal numbers as each agent needs.

        Args:
            counts: How many for each agent; shape (n,).

        Returns:
            Those of the first agent, then those of the second, and so on; shape (sum of counts,).
        """
        return self._stream("standard_normal").take(counts)

    def uniform_of(self, counts: NDArray[np.integer]) -> NDArray[np.float64]:
        """Draw as many numbers from [0, 1) as each agent needs; see `standard_normal_of`."""
        return self._stream("random").take(counts)

    def _stream(self, method: str) -> _Stream:
        stream = self._streams.get(method)
        if stream is None:
            generators = [generator(self._seed, f"{path}/{method}") for path in self._paths]
            stream = self._streams[method] = _Stream(generators, method, self._block)
        return stream


class _Stream:
    """The blocks of one kind of draw: a row for each agent, and how far it was used."""

    def __init__(self, generators: list[np.random.Generator], method: str, block: int) -> None:
        self._draws = [getattr(each, method) for each in generators]
        self._values = np.empty((len(generators), block))
        self._used = np.full(len(generators), block)

    def take(self, counts: NDArray[np.integer]) -> NDArray[np.float64]:
        most = int(counts.max(initial=0))
        if most == 0:
            return np.empty(0)
        if most > self._values.shape[1]:
            self._widen(most)
        for row in np.flatnonzero(self._used + counts > self._values.shape[1]).tolist():
            self._refill(row)
        if (counts == most).all():
            columns = self._used[:, None] + np.arange(most)
            taken: NDArray[np.float64] = np.take_along_axis(self._values, columns, 1).reshape(-1)
        else:
            rows = np.repeat(np.arange(len(counts)), counts)
            ends = np.cumsum(counts)
            within = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
            taken = self._values[rows, self._used[rows] + within]
        self._used += counts
        return taken

    def _refill(self, row: int) -> None:
        """Move what is left to the front and draw the rest: the stream has no gap."""
        used, values = int(self._used[row]), self._values[row]
        left = len(values) - used
        values[:left] = values[used:].copy()
        values[left:] = self._draws[row](used)
        self._used[row] = 0

    def _widen(self, most: int) -> None:
        """Make room for bigger draws; what was drawn ahead stays at the end of each row."""
        block = 2 * most
        wider = np.empty((len(self._draws), block))
        wider[:, block - self._values.shape[1] :] = self._values
        self._used += block - self._values.shape[1]
        self._values = wider
