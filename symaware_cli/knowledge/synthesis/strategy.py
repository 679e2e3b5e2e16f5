"""Strategies: the cell that an agent chooses in each state of a game, for each of its goals in turn.

Reasons: docs/decisions/0066-no-cache-of-strategies.md
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.game_solver import GameSolution, solve
from symaware_cli.knowledge.synthesis.strategy_check import Check


class UnrealisableError(ValueError):
    """No strategy meets the guarantees against all behaviour of the environment that the assumptions allow."""


@dataclass(frozen=True)
class Strategy:
    """A strategy; its memory is the number of the goal that it pursues.

    Attributes:
        game: The game.
        choices: The cell to choose, for each goal and state; -1 where there is none; shape (goals, size).
        reached: Whether the goal is reached, so that the next one is pursued; shape (goals, size).
        effort: The number of states processed to make it, with repetitions; 0 if that is not known.
    """

    game: Game
    choices: NDArray[np.int32]
    reached: NDArray[np.bool_]
    effort: int = 0

    def covers(self, state: int) -> bool:
        """Whether the strategy has a choice in a state."""
        return bool(self.choices[0, state] >= 0)

    def choice(self, state: int, goal: int) -> tuple[int, int]:
        """Return the cell to go to, and the goal to pursue then."""
        following = (goal + 1) % len(self.choices) if self.reached[goal, state] else goal
        return int(self.choices[goal, state]), following

    @cached_property
    def digest(self) -> str:
        """The SHA-256 of the strategy, in hexadecimal."""
        content = hashlib.sha256(repr((self.game.shape, self.choices.shape)).encode())
        content.update(np.ascontiguousarray(self.choices, "<i4").tobytes())
        content.update(np.packbits(self.reached).tobytes())
        return content.hexdigest()


def synthesise(game: Game, cells: Sequence[int]) -> Strategy:
    """Make a strategy, and check it with the model checker.

    Args:
        game: The game.
        cells: The cells in which the agent may begin.

    Raises:
        UnrealisableError: There is no strategy.
    """
    if not game.starts(cells)[1].any():
        raise UnrealisableError("no beginning meets the assumptions")
    solution = solve(game)
    _check_realisable(game, solution, cells)
    _require_sound(Check(game, solution.choices, solution.reached).fault(cells))
    return Strategy(game, solution.choices, solution.reached, solution.effort)


def synthesise_anywhere(game: Game, budget: int | None = None) -> Strategy:
    """Make a strategy for all states from which the agent can win, which may be none, and check it.

    Args:
        game: The game.
        budget: The greatest effort, as in `Strategy.effort`; None for any.

    Raises:
        BudgetError: It would take more.
    """
    if not any(game.vocabulary.cell.following):  # there is no way anywhere
        shape = (max(len(game.goals(game.guarantees)), 1), game.size)
        return Strategy(game, np.full(shape, -1, np.int32), np.zeros(shape, bool))
    solution = solve(game, budget)
    _require_sound(Check(game, solution.choices, solution.reached).fault_anywhere())
    return Strategy(game, solution.choices, solution.reached, solution.effort)


def _require_sound(fault: str | None) -> None:
    if fault is not None:  # a defect of the solver, which must not go unnoticed
        raise RuntimeError(f"the strategy that was made is wrong: {fault}")


def is_realisable(game: Game, cells: Sequence[int]) -> bool:
    """Whether there is a strategy from every start that the assumptions allow."""
    try:
        _check_realisable(game, solve(game), cells)
    except UnrealisableError:
        return False
    return True


def _check_realisable(game: Game, solution: GameSolution, cells: Sequence[int]) -> None:
    values, possible = game.starts(cells)
    if not possible.any():
        raise UnrealisableError("no beginning meets the assumptions")
    good = solution.winning[game.starting(values)] & game.holds_at_start(game.guarantees, values)
    lost = np.flatnonzero(possible & ~good)
    if len(lost):
        raise UnrealisableError(game.described({name: int(each[lost[0]]) for name, each in values.items()}))
