"""Explains why a game cannot be won: finds guarantees that contradict each other or moves of the environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.strategy import is_realisable


@dataclass(frozen=True)
class Conflict:
    """A minimal set of statements for which there is no strategy.

    The guarantees cannot be met together under the assumptions, but each smaller set of them can. Each assumption is
    needed for this: it is `helpful` or `opposing`.

    Attributes:
        guarantees: The guarantees. Empty if no beginning meets the assumptions, or if the game is lost without any
            guarantee.
        helpful: Assumptions each of which is needed to meet some smaller set of the guarantees.
        opposing: Assumptions each of which prevents the guarantees: without it they could be met. This is rare, because
            assumptions make a game easier, except one that the agent must not make impossible to keep.
    """

    guarantees: tuple[Statement, ...]
    helpful: tuple[Statement, ...]
    opposing: tuple[Statement, ...]

    def __str__(self) -> str:
        """Return the conflict in words."""
        words = f"{_quoted(self.guarantees)} cannot be met"
        if len(self.guarantees) > 1:
            words += " together, though each part of them can"
        if self.helpful:
            words += f" given {_quoted(self.helpful)}, without which a part would be in conflict already"
        if self.opposing:
            begun = "; the agent" if self.helpful else ": the agent"
            words += f"{begun} must not make it impossible to keep {_quoted(self.opposing)}"
        return words


def conflict(game: Game, cells: Sequence[int]) -> Conflict:
    """Return an irreducible conflict, by deletion.

    Each guarantee is left out in turn, under all assumptions, and stays out if the others still cannot be met. One pass
    suffices, since fewer guarantees are never harder to meet. Then each assumption is left out in turn, and stays out
    if without it the guarantees still cannot be met, and all but any one of them still can. This is repeated until all
    remaining assumptions are needed, since without one assumption another may no longer be needed.

    Args:
        game: A game that is not realisable.
        cells: The cells in which the agent may begin.
    """

    def is_met(assumptions: Sequence[Statement], guarantees: Sequence[Statement]) -> bool:
        return is_realisable(Game(game.vocabulary, assumptions, guarantees), cells)

    guarantees, assumptions = list(game.guarantees), list(game.assumptions)
    for each in game.guarantees:
        rest = _without(guarantees, each)
        if not is_met(assumptions, rest):
            guarantees = rest
    count = len(assumptions) + 1
    while len(assumptions) < count:
        count = len(assumptions)
        opposing = []
        for each in tuple(assumptions):
            rest = _without(assumptions, each)
            if is_met(rest, guarantees):
                opposing.append(each)
            elif all(is_met(rest, _without(guarantees, one)) for one in guarantees):
                assumptions = rest
    helpful = [each for each in assumptions if not any(each is one for one in opposing)]
    return Conflict(tuple(guarantees), tuple(helpful), tuple(opposing))


def _without(statements: Sequence[Statement], left_out: Statement) -> list[Statement]:
    return [each for each in statements if each is not left_out]


def _quoted(statements: Sequence[Statement]) -> str:
    return " and ".join(f"`{each.text}`" for each in statements)
