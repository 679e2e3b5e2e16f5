"""The seed of each run: derived from the seed of the sweep and a number, never from who runs it."""

from __future__ import annotations

from numpy.random import SeedSequence


def seed_of(sweep_seed: int, key: int) -> int:
    """Return the seed of a run, from 0 to 2^63 - 1.

    Args:
        sweep_seed: The seed of the sweep.
        key: The number of the run among all; where variants are paired, the number that they share.
    """
    words = SeedSequence(sweep_seed, spawn_key=(key,)).generate_state(2)
    return (int(words[0]) << 32 | int(words[1])) >> 1
