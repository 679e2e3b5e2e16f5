"""A knowledge model that is the product of others, such as the cells of an agent and the states of its gripper."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from math import prod

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.geometry import Region
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.abstraction.transition_system import TransitionSystem
from symaware_cli.world import ParameterError, Parameters

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: The greatest number of transitions.
_MOST_TRANSITIONS = 1_000_000


class ModelProduct(KnowledgeModel):
    """The synchronous product of models, of which at most one has cells: at each step each makes a transition.

    A strategy chooses the transitions of all models. An agent is steered through the cells of the model that has cells;
    the states of the others, such as a gripper, begin as initial states and change at the end of each step. The name of
    a state joins those of its parts with commas; it has the labels of all parts.
    """

    class Parameters(Parameters):
        """The models."""

        models: tuple[str, ...] = Field(min_length=2, description="Names under `knowledge_models`, each once.")

    def parts(self) -> Mapping[tuple[str | int, ...], str]:
        """Return the names of the models, by their places."""
        return {("models", place): name for place, name in enumerate(self.parameters.models)}

    def prepare(self, regions: Mapping[str, Region]) -> None:
        """Make the product."""
        names = self.parameters.models
        if len(set(names)) < len(names):
            raise ParameterError("a model is a part of a product once", ("models",))
        models = [self.others[name] for name in names]
        placed = [place for place, each in enumerate(models) if len(each.bounds)]
        if len(placed) > 1:
            one, other = (names[place] for place in placed[:2])
            said = f"both `{one}` and `{other}` have cells, and an agent is in one cell"
            raise ParameterError(said, ("models", placed[1]))
        count = prod(sum(map(len, each.system.successors)) for each in models)
        if count > _MOST_TRANSITIONS:
            said = f"there would be {count:,} transitions: at most {_MOST_TRANSITIONS:,} are possible"
            raise ParameterError(said, ("models",))
        try:
            self.system = reduce(TransitionSystem.product, (each.system for each in models))
        except ValueError as error:
            raise ParameterError(str(error), ("models",)) from None
        self._sizes = tuple(len(each.system.states) for each in models)
        self._placed = placed[0] if placed else None
        #: In which state of each part an agent begins, whatever its cell.
        self._initial = tuple(each.system.initial[0] for each in models)
        if self._placed is None:
            self.bounds = np.empty((0, 2, 2))
        else:
            state = np.unravel_index(np.arange(len(self.system.states)), self._sizes)
            self.bounds = models[self._placed].bounds[state[self._placed]]

    def cells(self, points: Array) -> Indices:
        """Return the states in which agents begin at points, -1 outside all cells; see `KnowledgeModel.cells`."""
        if self._placed is None:
            return np.full(len(points), -1, np.intp)
        within = self.others[self.parameters.models[self._placed]].cells(points)
        states = [np.full(len(points), initial, np.intp) for initial in self._initial]
        states[self._placed] = np.maximum(within, 0)
        return np.where(within < 0, -1, np.ravel_multi_index(states, self._sizes)).astype(np.intp)
