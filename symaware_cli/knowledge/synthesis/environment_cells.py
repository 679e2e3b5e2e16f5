"""Which cells the environment of an agent takes or closes, as far as the agent knows, for the replay."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.synthesis.game import Game, Statement
from symaware_cli.knowledge.synthesis.vocabulary import CELL, names_in_formula

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class EnvironmentCells:
    """The cells of others, and those that the guarantees close to the agent, in each state of a game."""

    def __init__(self, game: Game, model: KnowledgeModel) -> None:
        """Prepare.

        Args:
            game: The game.
            model: The cells.
        """
        self._game = game
        self._bounds = model.bounds.reshape(-1, 4)
        self._places, self._place_of = np.unique(self._bounds, axis=0, return_inverse=True)
        following = game.vocabulary.cell.following
        place = self._place_of
        pairs = [(one, after) for one, each in enumerate(following) for after in each if place[after] != place[one]]
        self._from, self._to = np.array(pairs, np.intp).reshape(-1, 2).T
        others = {each.name for each in game.vocabulary.environment}
        # What is closed whatever the environment does is no news.
        about = [
            Statement(each.text, clauses)
            for each in game.guarantees
            if (clauses := tuple(one for one in each.clauses if names_in_formula(one.node) & others))
        ]
        self._safety = game.safety(about), game.safety(game.assumptions)
        self._closed: dict[tuple[int, ...], Array] = {}

    def table(self, state: int) -> Array:
        """Return the boxes to draw in a state, shape (m, 5): four coordinates [m], and 1 for a closed cell."""
        game = self._game
        values = tuple(int(game.values[each.name][state]) for each in game.vocabulary.environment)
        if values not in self._closed:
            self._closed[values] = self._places[self._closed_places(values)]
        closed = self._closed[values]
        taken = [
            self._bounds[value]
            for each, value in zip(game.vocabulary.environment, values, strict=True)
            if each.system is not None
        ]
        boxes = np.concatenate([closed, np.reshape(taken, (-1, 4))])
        return np.column_stack([boxes, np.arange(len(boxes)) < len(closed)])

    def _closed_places(self, values: tuple[int, ...]) -> NDArray[np.bool_]:
        """Return which places can be entered from none of the cells beside them, in the next step.

        A move is closed if the environment has an answer within the assumptions that makes it break a guarantee.
        """
        variables = self._game.vocabulary.environment
        now = {each.name: np.full(len(self._from), value) for each, value in zip(variables, values, strict=True)}
        now[CELL] = self._from
        broken = np.zeros(len(self._from), bool)
        answers = [each.following[value] for each, value in zip(variables, values, strict=True)]
        for answer in itertools.product(*answers):
            after = {each.name: np.full(len(self._to), value) for each, value in zip(variables, answer, strict=True)}
            after[CELL] = self._to
            kept, assumed = (self._keeps(number, now, after) for number in (0, 1))
            broken |= assumed & ~kept
        enterable = np.zeros(len(self._places), bool)
        enterable[self._place_of[self._to[~broken]]] = True
        reachable = np.zeros(len(self._places), bool)
        reachable[self._place_of[self._to]] = True
        return np.asarray(reachable & ~enterable)

    def _keeps(self, which: int, now: dict[str, Indices], after: dict[str, Indices]) -> NDArray[np.bool_]:
        kept = np.ones(len(self._from), bool)
        for evaluate, ahead in self._safety[which]:
            kept &= evaluate(now, after) if ahead else evaluate(after, None)
        return kept
