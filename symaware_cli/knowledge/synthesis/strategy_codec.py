"""Strategies as bytes, for the attachment of a log and for the result of a process that makes a strategy."""

from __future__ import annotations

import numpy as np

from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.strategy import Strategy


def encoded(strategy: Strategy) -> bytes:
    """Return a strategy as bytes: `choices` as little-endian 32-bit integers, then `reached` as bits."""
    choices = np.ascontiguousarray(strategy.choices, "<i4").tobytes()
    return choices + np.packbits(strategy.reached).tobytes()


def decoded(content: bytes, game: Game) -> Strategy:
    """Return the strategy for a game from its bytes.

    Raises:
        ValueError: They are not those of a strategy for this game.
    """
    shape = (max(len(game.goals(game.guarantees)), 1), game.size)
    count = shape[0] * shape[1]
    if len(content) != 4 * count + (count + 7) // 8:
        raise ValueError("the bytes do not have the size of a strategy for this game")
    choices = np.frombuffer(content, "<i4", count).astype(np.int32).reshape(shape)
    if choices.min() < -1 or choices.max() >= game.vocabulary.cell.size:
        raise ValueError("the bytes have cells that are none of this game")
    reached = np.unpackbits(np.frombuffer(content, np.uint8, offset=4 * count), count=count).astype(bool)
    return Strategy(game, choices, reached.reshape(shape))
