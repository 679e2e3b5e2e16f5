"""Explains why a game cannot be won: guarantees that contradict each other or what the environment may do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from symaware_cli.synthesis.game import Game, Statement
from symaware_cli.synthesis.strategy import is_realisable


@dataclass(frozen=True)
class Conflict:
    """Statements that leave no strategy.

    Attributes:
        guarantees: Guarantees that cannot be met together under all assumptions; all but any one of them can. Empty if
            no beginning meets the assumptions, or if the game is lost without any guarantee.
        assumptions: Assumptions that take the way to meet these from the agent: under all but any one of them they can
            be met. Seldom any: what is assumed makes a game easier, unless it is about the agent, which must not make
            it impossible to keep.
    """

    guarantees: tuple[Statement, ...]
    assumptions: tuple[Statement, ...]


def conflict(game: Game, cells: Sequence[int]) -> Conflict:
    """Return an irreducible conflict, by deletion.

    Each guarantee is left out in turn, under all assumptions, and stays out if the others still cannot be met. One pass
    suffices, since fewer guarantees are never harder to meet. Then each assumption is left out in turn, again and again
    until all that are left are needed: without one assumption another may be needed no longer.

    Args:
        game: A game that is not realisable.
        cells: The cells in which the agent may begin.
    """
    guarantees, assumptions = list(game.guarantees), list(game.assumptions)
    for each in game.guarantees:
        rest = [other for other in guarantees if other is not each]
        if not is_realisable(Game(game.vocabulary, assumptions, rest), cells):
            guarantees = rest
    count = len(assumptions) + 1
    while len(assumptions) < count:
        count = len(assumptions)
        for each in tuple(assumptions):
            rest = [other for other in assumptions if other is not each]
            if not is_realisable(Game(game.vocabulary, rest, guarantees), cells):
                assumptions = rest
    return Conflict(tuple(guarantees), tuple(assumptions))
