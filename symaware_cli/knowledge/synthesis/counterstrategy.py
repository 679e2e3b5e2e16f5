"""Counterstrategies: how the environment keeps all assumptions and prevents the agent from meeting its guarantees.

The states that the agent does not win from are those that the environment wins from (Piterman, Pnueli and Sa'ar, VMCAI
2006, by complement): the least set Z that grows, for one goal j of the agent after the other, by the greatest set Y
such that from each of its states the environment can, for each of its own goals i, force play into Z, or reach i within
Y while avoiding j. States enter Z in stages. In the states of a stage the environment meets its own goals in turn
and prevents the goal of that stage, until it can force play into an earlier stage; so at last it stays in one stage.

Reasons: docs/decisions/0045-counterstrategies.md
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.game import Game
from symaware_cli.knowledge.synthesis.game_solver import solve
from symaware_cli.knowledge.synthesis.move_graph import MoveGraph

Truth = NDArray[np.bool_]
Indices = NDArray[np.int32]


@dataclass(frozen=True)
class Counterstrategy:
    """A counterstrategy; its memory is the number of the goal that the environment pursues.

    Attributes:
        game: The game.
        stages: The stage of each state that the environment wins from, and -1 of the others; shape (size,).
        prevented: The goal of the agent that each stage prevents.
        ranks: For each goal of the environment and each state, the maximum number of steps within its stage until that
            goal is met; shape (goals, size).
    """

    game: Game
    stages: Indices
    prevented: tuple[int, ...]
    ranks: Indices

    def covers(self, state: int) -> bool:
        """Whether the environment wins from a state."""
        return bool(self.stages[state] >= 0)

    def answer(self, state: int, goal: int, following: int) -> tuple[int | None, int]:
        """Return the move of the environment after the agent chose a cell in a state that is covered.

        Args:
            state: The state.
            goal: The goal that the environment pursues, 0 at the beginning.
            following: The cell that the agent chose.

        Returns:
            The next state, None if the agent breaks a guarantee by its choice; and the goal to pursue then.
        """
        game = self.game
        own = game.vocabulary.cell.following[int(game.values["cell"][state])]
        answers = game.moves[own.index(following), :, state]
        if (answers == game.size + 1).any():
            return None, goal
        after = answers[answers < game.size]
        stages, now = self.stages[after], self.stages[state]
        if (earlier := after[(stages >= 0) & (stages < now)]).size:
            return int(earlier[0]), 0
        staying = after[stages == now]
        if self.ranks[goal, state] <= 1:
            return int(staying[0]), (goal + 1) % len(self.ranks)
        ranks = self.ranks[goal, staying]
        return int(staying[ranks.argmin()]), goal

    def beginning(self, cell: int) -> int | None:
        """Return the first state of play if the agent begins in a cell.

        Returns:
            A state that the environment wins from if there is one, otherwise any that meets the assumptions; None if
            the agent has broken a guarantee at once, or no state meets the assumptions.
        """
        values, possible = self.game.starts([cell])
        states = np.asarray(self.game.starting(values))
        if (possible & ~self.game.holds_at_start(self.game.guarantees, values)).any():
            return None
        best = np.flatnonzero(possible & (self.stages[states] >= 0))
        first = best if len(best) else np.flatnonzero(possible)
        return int(states[first[0]]) if len(first) else None


def oppose(game: Game) -> Counterstrategy:
    """Make the counterstrategy of the environment, for all states that the agent does not win from."""
    return _Opposition(game).made()


class _Opposition:
    def __init__(self, game: Game) -> None:
        self._game = game
        self._graph = MoveGraph(game)
        always = np.ones(game.size, bool)
        self._agents = game.goals(game.guarantees) or (always,)
        self._own = game.goals(game.assumptions) or (always,)

    def made(self) -> Counterstrategy:
        game = self._game
        lost = ~solve(game).winning
        stages = np.full(game.size, -1, np.int32)
        ranks = np.full((len(self._own), game.size), -1, np.int32)
        prevented: list[int] = []
        while (lost & (stages < 0)).any():
            before = len(prevented)
            for number, goal in enumerate(self._agents):
                earlier = stages >= 0
                within, found = self._stage(lost, earlier, ~goal)
                if (fresh := within & ~earlier).any():
                    stages[fresh] = len(prevented)
                    ranks[:, fresh] = found[:, fresh]
                    prevented.append(number)
            if len(prevented) == before:  # a defect, which must not go unnoticed
                raise RuntimeError("neither the agent nor the environment wins from some states")
        return Counterstrategy(game, stages, tuple(prevented), ranks)

    def _stage(self, lost: Truth, earlier: Truth, preventing: Truth) -> tuple[Truth, Indices]:
        """Return the states, with ranks, from which the environment prevents a goal or reaches an earlier stage."""
        within = lost
        while True:
            before, ranks = within, []
            for own in self._own:
                within, rank = self._meeting(own, within, earlier, preventing)
                ranks.append(rank)
            if (within == before).all():
                return within, np.stack(ranks)

    def _meeting(self, own: Truth, within: Truth, earlier: Truth, preventing: Truth) -> tuple[Truth, Indices]:
        """Return the states from which the environment forces a goal of its own within a set, with their ranks."""
        graph, size = self._graph, self._game.size
        rank = np.full(size, -1, np.int32)
        reached = earlier.copy()
        directly = graph.prevented(np.flatnonzero(within & ~earlier), earlier)
        meets = graph.prevented(np.flatnonzero(within & ~earlier & preventing & own), within | earlier)
        fresh, count = np.union1d(directly, meets), 1
        while len(fresh):
            rank[fresh] = count
            reached[fresh] = True
            candidates = graph.preceding(fresh, within & preventing & ~reached)
            fresh, count = graph.prevented(candidates, reached), count + 1
        return reached & (within | earlier), rank
