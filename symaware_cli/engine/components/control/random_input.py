"""A controller that draws its control input."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.core import AgentGroup, GroupComponent, Parameters
from symaware_cli.geometry import Array
from symaware_cli.world import ParameterError

Probability = Annotated[float, Field(ge=0, le=1)]


class RandomInput(GroupComponent):
    """Draws the control input of each agent from a list, in each turn independently of the past.

    It makes random walks and Markov chains, whose probabilities are known, and is a baseline for other controllers.
    """

    batchable = True

    class Parameters(Parameters):
        """The control inputs to draw from."""

        inputs: list[list[float]] = Field(
            min_length=1, description="The control inputs, each a number for every element, in the units of the model."
        )
        probabilities: list[Probability] | None = Field(
            None, description="How probable each of them is; their sum is 1. All are equally probable if null."
        )

        @model_validator(mode="after")
        def _they_are_a_distribution(self) -> RandomInput.Parameters:
            given = self.probabilities
            if given is None:
                return self
            if len(given) != len(self.inputs):
                raise ValueError(f"there are {len(given)} `probabilities` and {len(self.inputs)} `inputs`")
            if abs(sum(given) - 1.0) > 1e-9:
                raise ValueError(f"the sum of `probabilities` is {sum(given):.10g}, not 1")
            return self

    def check(self, group: AgentGroup) -> None:
        """Check that every control input has as many elements as that of the model."""
        width = len(group.model.control_input)
        for number, each in enumerate(self.parameters.inputs):
            if len(each) != width:
                names = ", ".join(quantity.name for quantity in group.model.control_input)
                raise ParameterError(
                    f"a control input of this model has {width} elements ({names})", ("inputs", number)
                )

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the bounds between the control inputs, as numbers from 0 to 1."""
        super().initialise_component(group)
        count = len(self.parameters.inputs)
        probabilities = self.parameters.probabilities or [1.0 / count] * count
        self._inputs = np.array(self.parameters.inputs)
        #: A number below the first bound is the first control input, and so on; the last one needs none.
        self._bounds = np.cumsum(probabilities)[:-1]

    def _compute(self) -> Array:
        drawn = self.random.uniform(1)[:, 0]
        return self._inputs[np.searchsorted(self._bounds, drawn, side="right")]

    def _update(self, value: Array) -> None:
        self._group.control_input = value
