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

    Drawing from a thousand generators one by one would cost a millisecond a step. Each fills a block of
    its own ahead, and a step reads one slice across all blocks; what an agent draws still depends on
    nothing but its own path.
    """

    def __init__(self, seed: int, paths: Sequence[str], block: int = 128) -> None:
        self._seed = seed
        self._paths = paths
        self._block = block
        self._streams: dict[tuple[str, int], _Stream] = {}

    def standard_normal(self, width: int) -> NDArray[np.float64]:
        """Draw ``width`` standard normal numbers for every agent; shape (n, width)."""
        return self._stream("standard_normal", width).take()

    def uniform(self, width: int) -> NDArray[np.float64]:
        """Draw ``width`` numbers from [0, 1) for every agent; shape (n, width)."""
        return self._stream("random", width).take()

    def _stream(self, method: str, width: int) -> _Stream:
        stream = self._streams.get((method, width))
        if stream is None:
            paths = [f"{path}/{method}/{width}" for path in self._paths]
            stream = _Stream([generator(self._seed, path) for path in paths], method, self._block, width)
            self._streams[method, width] = stream
        return stream


class _Stream:
    """The blocks of one kind of draw."""

    def __init__(self, generators: list[np.random.Generator], method: str, block: int, width: int) -> None:
        self._draws = [getattr(each, method) for each in generators]
        self._block = block
        self._values = np.empty((block, len(generators), width))
        self._next = block

    def take(self) -> NDArray[np.float64]:
        if self._next == self._block:
            self._values = np.empty_like(self._values)
            for row, draw in enumerate(self._draws):
                self._values[:, row] = draw((self._block, self._values.shape[2]))
            self._next = 0
        values: NDArray[np.float64] = self._values[self._next]
        self._next += 1
        return values
