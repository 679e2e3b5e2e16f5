"""A controller that requests control inputs of a timetable."""

from __future__ import annotations

from bisect import bisect_right
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from symaware_cli.core import AgentGroup, GroupComponent, Parameters
from symaware_cli.geometry import Array
from symaware_cli.world import ParameterError

Time = Annotated[float, Field(ge=0, le=1e9)]


class InputAt(Parameters):
    """A control input from an instant on."""

    time: Time = Field(description="From when on [s].")
    input: list[float] = Field(
        min_length=1, description="A number for every element of the control input, in the units of the model."
    )


class InputSchedule(GroupComponent):
    """Requests the control inputs of a timetable, each until the time of the next.

    All agents of the group have the same; before the first time, the control input is 0. It makes open loops, such as
    the postures that an arm goes through.
    """

    batchable = True

    class Parameters(Parameters):
        """The timetable."""

        inputs: list[InputAt] = Field(min_length=1, description="The control inputs, by ascending times.")

        @field_validator("inputs")
        @classmethod
        def _times_ascend(cls, inputs: list[InputAt]) -> list[InputAt]:
            for number in range(1, len(inputs)):
                if inputs[number].time <= inputs[number - 1].time:
                    raise ValueError(f"the time of input {number} is not after that of the one before")
            return inputs

    def check(self, group: AgentGroup) -> None:
        """Check that every control input has as many elements as that of the model."""
        width = len(group.model.control_input)
        for number, each in enumerate(self.parameters.inputs):
            if len(each.input) != width:
                names = ", ".join(quantity.name for quantity in group.model.control_input)
                raise ParameterError(
                    f"a control input of this model has {width} elements ({names})", ("inputs", number, "input")
                )

    def initialise_component(self, group: AgentGroup) -> None:
        """Store the timetable as arrays."""
        super().initialise_component(group)
        width = len(group.model.control_input)
        self._times = [each.time for each in self.parameters.inputs]
        self._inputs = np.array([[0.0] * width, *(each.input for each in self.parameters.inputs)])

    def _compute(self) -> Array:
        row = bisect_right(self._times, self.time)
        return np.tile(self._inputs[row], (len(self._group), 1))

    def _update(self, value: Array) -> None:
        self._group.control_input = value
