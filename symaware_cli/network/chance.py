"""Chance for links: numbers that depend on the link and the number of the message alone, for thousands at a time.

A generator of its own for each of a hundred thousand links would cost seconds and hundreds of megabytes. One based on
counters has no state: it scrambles a key, here the link's, and a counter, here which message on the link it is. So
every link has its own stream, whoever else sends and in whatever order, and all are drawn from in one call.

Philox-4x32-10: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel Random Numbers: As Easy as 1, 2, 3",
SC 2011.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Words = NDArray[np.uint64]

_MULTIPLIERS = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_ROUNDS = 10


def philox(counter: Sequence[Words], key: Sequence[Words]) -> tuple[Words, Words, Words, Words]:
    """Scramble counters with keys.

    Args:
        counter: Four words of 32 bits for each number, as unsigned 64-bit integers; shapes broadcast.
        key: Two words.

    Returns:
        Four words.
    """
    first, second, third, fourth = counter
    one, other = key
    for _ in range(_ROUNDS):
        left, right = _MULTIPLIERS[0] * first, _MULTIPLIERS[1] * third
        first, second, third, fourth = (
            (right >> _HALF) ^ second ^ one,
            right & _LOW,
            (left >> _HALF) ^ fourth ^ other,
            left & _LOW,
        )
        one, other = (one + _WEYL[0]) & _LOW, (other + _WEYL[1]) & _LOW
    return first, second, third, fourth


def agent_keys(seed: int, ids: Sequence[str], purpose: str) -> Words:
    """A number for each agent that its id, the seed and the purpose determine; shape (n,)."""
    salt = hashlib.blake2b(f"{seed}/{purpose}".encode(), digest_size=16).digest()
    words = [hashlib.blake2b(id.encode(), digest_size=8, key=salt).digest() for id in ids]
    return np.frombuffer(b"".join(words), "<u8").astype(np.uint64)


def link_keys(senders: Words, receivers: Words) -> Words:
    """A key for each link, made of the numbers of both ends; shape (m,)."""
    nothing = np.zeros_like(receivers)
    low, high, _, _ = philox(
        (receivers & _LOW, receivers >> _HALF, nothing, nothing), (senders & _LOW, senders >> _HALF)
    )
    return low | (high << _HALF)


def uniforms(keys: Words, numbers: NDArray[np.int64], page: int) -> Array:
    """Draw four numbers from the open interval (0, 1) for each message.

    Args:
        keys: Of the links; shape (m,).
        numbers: Which message on its link each is; shape (m,).
        page: Which four of those that each message has.

    Returns:
        Shape (4, m).
    """
    counts = numbers.astype(np.uint64)
    pages, nothing = np.full_like(counts, page), np.zeros_like(counts)
    words = philox((counts & _LOW, counts >> _HALF, pages, nothing), (keys & _LOW, keys >> _HALF))
    drawn: Array = (np.stack(words).astype(float) + 0.5) / 4294967296.0
    return drawn
