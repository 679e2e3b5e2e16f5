"""Solves games with GR(1) objectives: which states the agent wins from, and how.

The winning states are the greatest Z that is, for each goal j of the agent, the least Y with: the states where j holds
and from which the agent can go on in Z; those from which it can reach Y; and, for any goal i of the environment, those
where i does not hold and the agent can wait within them, or reach Y (Piterman, Pnueli and Sa'ar, Synthesis of
Reactive(1) Designs, VMCAI 2006; Bloem et al., JCSS 78, 2012). States are bits of arrays, and a state is looked at again
only if one that may follow it has changed. Of several choices that do equally well the first one of the transition
system is taken, so that a strategy depends on nothing but the game.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.move_graph import MoveGraph

Truth = NDArray[np.bool_]
Indices = NDArray[np.int32]


@dataclass(frozen=True)
class GameSolution:
    """The solution of a game.

    Attributes:
        winning: Whether the agent wins from each state; shape (size,).
        choices: For each goal of the agent and each state, the cell to choose; -1 where it does not win.
        reached: For each goal of the agent and each state, whether the goal is reached, so that the next one comes.
        effort: How many states were looked at, each as often as it was.
    """

    winning: Truth
    choices: Indices
    reached: Truth
    effort: int


def solve(game: Game, budget: int | None = None) -> GameSolution:
    """Solve a game.

    Args:
        game: The game.
        budget: The greatest effort; None for any.

    Raises:
        BudgetError: It would take more.
    """
    return _Solver(game, budget).solve()


class _Solver:
    def __init__(self, game: Game, budget: int | None) -> None:
        self._size = game.size
        self._graph = MoveGraph(game, budget)
        self._goals = game.goals(game.guarantees) or (np.ones(self._size, bool),)
        # An assumption that holds everywhere never lets the agent wait.
        self._waiting = [~goal for goal in game.goals(game.assumptions) if not goal.all()]

    def solve(self) -> GameSolution:
        winning = np.ones(self._size, bool)
        choices = np.full((len(self._goals), self._size), -1, np.int32)
        while True:
            before = winning
            for number, goal in enumerate(self._goals):
                reached, choices[number] = self._reaching(goal, winning)
                winning = reached
            if (winning == before).all():
                break
        return GameSolution(winning, choices, np.array(self._goals) & winning, self._graph.effort)

    def _reaching(self, goal: Truth, winning: Truth) -> tuple[Truth, Indices]:
        """Return from which states the agent reaches a goal within `winning`, or waits for ever; and its choices."""
        choices = np.full(self._size, -1, np.int32)
        reached = np.zeros(self._size, bool)
        fresh = self._graph.forced(np.flatnonzero(goal & winning), winning, choices)
        reached[fresh] = True
        # Where the environment has no answer, nothing is to be done.
        stuck = self._graph.forced(np.flatnonzero(winning & ~reached), np.zeros_like(reached), choices)
        reached[stuck] = True
        fresh = np.concatenate([fresh, stuck])
        while True:
            while len(fresh):
                fresh = self._graph.forced(self._graph.preceding(fresh, winning & ~reached), reached, choices)
                reached[fresh] = True
            waiting = np.zeros(self._size, bool)
            for idle in self._waiting:
                within = self._kept(idle & winning & ~reached, reached)
                new = np.flatnonzero(within & ~reached & ~waiting)
                self._graph.forced(new, within, choices)
                waiting[new] = True
            fresh = np.flatnonzero(waiting)
            if not len(fresh):
                return reached, choices
            reached |= waiting

    def _kept(self, candidates: Truth, reached: Truth) -> Truth:
        """Return the greatest set of candidates, with `reached`, that the agent can stay within until it is there."""
        within = candidates | reached
        suspects = np.flatnonzero(candidates)
        while len(suspects):
            good = self._graph.forced(suspects, within)
            lost = np.setdiff1d(suspects, good, assume_unique=True)
            within[lost] = False
            suspects = self._graph.preceding(lost, candidates & within)
        return within
