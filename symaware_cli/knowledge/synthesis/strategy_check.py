"""A model checker of strategies, which shares nothing with the solver but the formulas.

It explores the states that are reachable with a strategy, checks safety at each step, and looks for behaviours that
meet all goals of the environment again and again but not all of the agent's: there is one exactly if, without the
states in which a goal of the agent holds, a strongly connected part of the graph meets every goal of the environment.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.synthesis.game import Game, padded
from symaware_cli.knowledge.synthesis.vocabulary import CELL

Array = NDArray[np.intp]
Truth = NDArray[np.bool_]

#: About how many answers of the environment are evaluated at once.
_AT_ONCE = 2**18


class Check:
    """Checks a strategy for a game."""

    def __init__(self, game: Game, choices: NDArray[np.int32], reached: Truth) -> None:
        """Prepare.

        Args:
            game: The game.
            choices: The cell to choose, for each goal and state; shape (goals, size).
            reached: Whether the next goal comes; shape (goals, size).
        """
        self._game = game
        self._choices = choices
        self._reached = reached
        self._safety = {
            "assumed": game.safety(game.assumptions),
            "guaranteed": game.safety(game.guarantees),
        }

    def fault(self, cells: Sequence[int]) -> str | None:
        """Return why the strategy is wrong, in one sentence; None if it is right.

        Args:
            cells: The cells in which the agent may begin.
        """
        game = self._game
        values, possible = game.starts(cells)
        if not game.holds_at_start(game.guarantees, values)[possible].all():
            return "a guarantee does not hold at the beginning"
        return self._explored(np.unique(np.asarray(game.starting(values), np.intp)[possible]))  # goal 0 comes first

    def fault_anywhere(self) -> str | None:
        """Return why the strategy is wrong where it has choices, with any goal; None if it is right."""
        return self._explored(np.flatnonzero(self._choices.ravel() >= 0))

    def _explored(self, frontier: Array) -> str | None:
        """Return why the strategy is wrong from nodes on, each the number of a goal times the size plus a state."""
        size = self._game.size
        known = np.zeros(len(self._choices) * size, bool)
        known[frontier] = True
        starts, ends = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
        while len(frontier):
            try:
                one, other = self._steps(frontier)
            except _FaultError as error:
                return str(error)
            starts.append(one)
            ends.append(other)
            fresh = np.unique(other)
            frontier = fresh[~known[fresh]]
            known[frontier] = True
        return self._unfair(np.concatenate(starts), np.concatenate(ends), np.flatnonzero(known))

    def _steps(self, nodes: Array) -> tuple[Array, Array]:
        """Return all steps from nodes, each the number of a goal times the size plus a state, as starts and ends."""
        game = self._game
        goal, state = np.divmod(nodes, game.size)
        now = {name: each[state] for name, each in game.values.items()}
        chosen = self._choices[goal, state].astype(np.intp)
        own = game.vocabulary.cell.following
        for cell, following in zip(now[CELL].tolist(), chosen.tolist(), strict=True):
            if following not in own[cell]:
                raise _FaultError("the agent has no such move, or no choice at all")
        goal_after = np.where(self._reached[goal, state], (goal + 1) % len(self._choices), goal)
        if (self._reached[goal, state] & ~self._goal_holds(goal, state)).any():
            raise _FaultError("a goal is given up that is not reached")
        starts, ends, answered = [], [], np.zeros(len(nodes), bool)
        for rows, after, legal in self._answers(now, chosen):
            if (legal & ~self._keeps("guaranteed", {name: each[rows] for name, each in now.items()}, after)).any():
                raise _FaultError("a step breaks a guarantee")
            rows, after = rows[legal], {name: each[legal] for name, each in after.items()}
            answered[rows] = True
            bits = [bit.updated(each[state[rows]], after) for bit, each in zip(game.bits, game.bit_values, strict=True)]
            starts.append(nodes[rows])
            ends.append(goal_after[rows] * game.size + game.index(after, bits))
        self._check_answered({name: each[~answered] for name, each in now.items()})
        return np.concatenate(starts), np.concatenate(ends)

    def _answers(self, now: dict[str, Array], chosen: Array) -> Iterator[tuple[Array, dict[str, Array], Truth]]:
        """Yield the answers of the environment to choices, some at a time.

        Args:
            now: The values before.
            chosen: The cells that the agent chooses; shape (n,).

        Yields:
            The number of the choice that is answered, the values after the answer, and whether the environment keeps
            the assumptions; shape (m,) each.
        """
        variables = self._game.vocabulary.environment
        following = [each.following for each in variables]
        slots = np.array(list(itertools.product(*(range(max(map(len, each))) for each in following))), np.intp)
        at_once = max(1, _AT_ONCE // max(1, len(chosen)))
        for first in range(0, len(slots), at_once):
            options = slots[first : first + at_once]
            rows = np.tile(np.arange(len(chosen)), len(options))
            before = {name: each[rows] for name, each in now.items()}
            after, exists = {CELL: chosen[rows]}, np.ones(len(rows), bool)
            for place, (variable, lists) in enumerate(zip(variables, following, strict=True)):
                option = np.repeat(options[:, place], len(chosen))
                after[variable.name] = padded(lists)[before[variable.name], option]
                exists &= after[variable.name] >= 0
            yield rows, after, exists & self._keeps("assumed", before, after)

    def _check_answered(self, now: dict[str, Array]) -> None:
        """Check that if the environment has no answer to the choice in a state, it has none to any other choice."""
        lists = padded(self._game.vocabulary.cell.following)
        for option in range(lists.shape[1]):
            chosen = lists[now[CELL], option]
            for rows, _, legal in self._answers(now, np.maximum(chosen, 0)):
                if (legal & (chosen[rows] >= 0)).any():
                    raise _FaultError("a choice makes it impossible for the environment to keep the assumptions")

    def _goal_holds(self, goal: Array, state: Array) -> Truth:
        goals = self._game.goals(self._game.guarantees)
        return np.array(goals)[goal, state] if goals else np.ones(len(state), bool)

    def _keeps(self, which: str, now: dict[str, Array], after: dict[str, Array]) -> Truth:
        kept = np.ones(len(now[CELL]), bool)
        for evaluate, ahead in self._safety[which]:
            kept &= evaluate(now, after) if ahead else evaluate(after, None)
        return kept

    def _unfair(self, starts: Array, ends: Array, nodes: Array) -> str | None:
        """Return which goal a fair environment can prevent for ever; None if there is none."""
        # SciPy takes as long to import as a short run does.
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        game = self._game
        place = np.full(len(self._choices) * game.size, -1, np.intp)
        place[nodes] = np.arange(len(nodes))
        one, other = place[starts], place[ends]
        state = nodes % game.size
        fair = [goal[state] for goal in game.goals(game.assumptions)]
        for number, goal in enumerate(game.goals(game.guarantees)):
            missed = ~goal[state]
            inner = missed[one] & missed[other]
            graph = coo_array((np.ones(inner.sum(), bool), (one[inner], other[inner])), (len(nodes), len(nodes)))
            count, part = connected_components(graph, connection="strong")
            cyclic = np.zeros(count, bool)
            cyclic[part[one[inner]][part[one[inner]] == part[other[inner]]]] = True
            for each in fair:
                meets = np.zeros(count, bool)
                meets[part[each]] = True
                cyclic &= meets
            if cyclic.any():
                return f"goal {number} of the agent can be prevented for ever, although all assumptions are kept"
        return None


class _FaultError(Exception):
    """A step is not as it should be."""
