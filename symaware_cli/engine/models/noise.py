"""Process noise: the base class and parameter of built-in models with random motion."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field

from symaware_cli.core import Model, Parameters
from symaware_cli.geometry import Array

_NotNegative = Annotated[float, Field(ge=0)]

#: The parameter ``process_noise`` of all built-in models without a covariance of their own.
Deviation = Annotated[
    _NotNegative | list[_NotNegative] | None,
    Field(
        description="Standard deviation of the process noise of each element of the state after one second [its "
        "unit/sqrt(s)]; one number for all, or a list in the order of the state."
    ),
]


class NoisyModel(Model):
    """A model whose state takes a random walk on top of its motion.

    The noise is added once in each step of the world, with independent elements. Its variance is proportional to the
    time step, so that the spread after a second does not depend on the time step. The effect of an increment within its
    own step is neglected.
    """

    class Parameters(Parameters):
        """The process noise; models with parameters of their own repeat it."""

        process_noise: Deviation = None

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        self._declare()
        given, count = self.parameters.process_noise, len(self.state)
        deviations = given if isinstance(given, list) else [given or 0.0] * count
        if len(deviations) != count:
            raise ValueError(f"`process_noise` has {len(deviations)} numbers, and the state has {count}")
        self._deviation = np.array(deviations) if any(deviations) else None

    def _declare(self) -> None:
        """Set the quantities of the model, if they depend on the parameters."""

    def noise_deviation(self, step: float) -> Array | None:
        """Return the standard deviation over a step [s]; it grows with the root of the step."""
        return None if self._deviation is None else self._deviation * np.sqrt(step)
