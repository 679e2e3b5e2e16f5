"""The moves of a game as a graph: from which states the agent can force the next one into a set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.game import Game

Truth = NDArray[np.bool_]
Indices = NDArray[np.int32]

#: The approximate number of moves processed together, to limit memory use.
_BLOCK = 2**21


class BudgetError(Exception):
    """Solving a game takes more than the allowed effort."""


class MoveGraph:
    """The moves of a game, forwards and backwards.

    Attributes:
        size: The number of states.
        effort: The number of states processed so far, with repetitions. It depends only on the game.
    """

    def __init__(self, game: Game, budget: int | None = None) -> None:
        """Find the moves of each state; this counts as the effort of one pass over all states.

        Args:
            game: The game.
            budget: The maximum effort; None for no limit.

        Raises:
            BudgetError: There are more states than that.
        """
        self.effort = 0
        self._budget = budget
        self._spend(game.size)
        # SciPy takes as long to import as a short run does.
        from scipy.sparse import csr_array

        self.size = game.size
        self._moves = game.moves
        table = np.full((game.vocabulary.cell.size, len(self._moves)), -1, np.int32)
        for cell, after in enumerate(game.vocabulary.cell.following):
            table[cell, : len(after)] = after
        self._chosen = table[game.values["cell"]]  # the cell of each choice in each state; shape (size, choices)
        flat = self._moves.reshape(-1, self.size)
        inner = flat < self.size
        sources = np.broadcast_to(np.arange(self.size, dtype=np.int32), flat.shape)[inner]
        shape = (self.size, self.size)
        self._before = csr_array((np.ones(len(sources), np.bool_), (flat[inner], sources)), shape=shape)

    def _spend(self, states: int) -> None:
        self.effort += states
        if self._budget is not None and self.effort > self._budget:
            raise BudgetError(f"more than {self._budget:,} states were to be looked at")

    def preceding(self, states: NDArray[np.intp], among: Truth) -> NDArray[np.intp]:
        """Return the states among some from which a move may lead to any of these states, ascending."""
        if not len(states):
            return states
        self._spend(len(states))
        marked = np.zeros(self.size, bool)
        marked[self._before[states].indices] = True
        return np.flatnonzero(marked & among)

    def forced(self, states: NDArray[np.intp], target: Truth, choices: Indices | None = None) -> NDArray[np.intp]:
        """Return those states from which the agent has a choice after which every move leads to a target.

        An answer that the environment must not give leads to every target, a move that breaks a guarantee to none. The
        first such choice is noted in `choices`.
        """
        self._spend(len(states))
        extended = np.append(target, [True, False])
        found = []
        block = max(1, _BLOCK // self._moves.shape[1])
        for start in range(0, len(states), block):
            some = states[start : start + block]
            good = np.array([extended[answers[:, some]].all(axis=0) for answers in self._moves])
            forced = good.any(axis=0)
            if choices is not None:
                choices[some[forced]] = self._chosen[some[forced], good[:, forced].argmax(axis=0)]
            found.append(some[forced])
        return np.concatenate(found) if found else states

    def prevented(self, states: NDArray[np.intp], target: Truth) -> NDArray[np.intp]:
        """Return those states from which the environment can answer every choice with a move into a target."""
        return np.setdiff1d(states, self.forced(states, ~target), assume_unique=True)
