"""Explains why a game cannot be won: guarantees that contradict each other or what the environment may do."""

from __future__ import annotations

from collections.abc import Sequence

from symaware_cli.synthesis.game import Game, Statement
from symaware_cli.synthesis.strategy import is_realisable


def conflict(game: Game, cells: Sequence[int]) -> tuple[Statement, ...]:
    """Return guarantees that cannot be met together under the assumptions, none of which can be left out.

    Each is deleted in turn, and stays out if the others still cannot be met. Fewer assumptions would make it no easier,
    so they are not part of the conflict.

    Args:
        game: A game that is not realisable.
        cells: The cells in which the agent may begin.

    Returns:
        The guarantees; empty if no beginning meets the assumptions, or if the game is lost without any guarantee.
    """
    kept = list(game.guarantees)
    for each in game.guarantees:
        rest = [other for other in kept if other is not each]
        if not is_realisable(Game(game.vocabulary, game.assumptions, rest), cells):
            kept = rest
    return tuple(kept)
