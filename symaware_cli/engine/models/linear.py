"""The linear model in discrete time, with Gaussian noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, model_validator

from symaware_cli.core import Model, Parameters, Quantity, nanoseconds
from symaware_cli.geometry import Array

Matrix = list[list[float]]
Positive = Annotated[float, Field(gt=0)]


class Linear(Model):
    """A map in discrete time, x+ = A x + B u + w with w ~ N(0, W), over a time step of its own.

    The environment must have the same ``time_step``, and is refused otherwise. Nothing is integrated, regardless of the
    environment's ``integrator``. `derivative` is the mean rate over one step without noise, (A x + B u - x) /
    time_step; `velocity` is part of it, and `jacobian` its derivative, (A - I) / time_step.

    The model can follow a velocity if its state is exactly the position and the control input can move it in every
    direction, as in x+ = x + u + w.
    """

    class Parameters(Parameters):
        """The matrices, and names and units of their rows."""

        time_step: float = Field(ge=1e-6, le=1e6, description="Time between x and x+ [s]; that of the environment too.")
        state: dict[str, str] = Field(description="Name and unit of each element of x, in order.")
        control_input: dict[str, str] = Field(description="Name and unit of each element of u, in order.")
        A: Matrix = Field(description="What x becomes by itself; as many rows and columns as x has elements.")
        B: Matrix = Field(description="What u adds; as many rows as x has elements, as many columns as u.")
        W: Matrix | None = Field(
            None, description="Covariance of the noise of one step [squares of the units of x]; no noise if null."
        )
        position: list[Annotated[int, Field(ge=0)]] = Field(
            default=[0, 1], min_length=2, max_length=3, description="Which elements of x, from 0, are the position [m]."
        )
        max_input: Positive | list[Positive] | None = Field(
            None,
            description="Greatest magnitude of each element of u; one number for all, or a list; no limit if null.",
        )

        @model_validator(mode="after")
        def _everything_fits(self) -> Linear.Parameters:
            states, inputs = len(self.state), len(self.control_input)
            if not states or not inputs:
                raise ValueError("`state` and `control_input` name at least one element each")
            for name, matrix, shape in (
                ("A", self.A, (states, states)),
                ("B", self.B, (states, inputs)),
                ("W", self.W, (states, states)),
            ):
                if matrix is not None and (len(matrix), *{len(row) for row in matrix}) != shape:
                    raise ValueError(f"`{name}` must have {shape[0]} rows of {shape[1]} numbers")
            if self.W is not None and not _is_covariance(np.array(self.W)):
                raise ValueError("`W` is not a covariance: symmetric, and without a negative eigenvalue")
            if len(set(self.position)) < len(self.position) or max(self.position) >= states:
                raise ValueError(f"`position` must name different elements of x, from 0 to {states - 1}")
            if isinstance(self.max_input, list) and len(self.max_input) != inputs:
                raise ValueError(f"`max_input` has {len(self.max_input)} numbers, and the control input has {inputs}")
            return self

    def __init__(self, parameters: BaseModel | None = None) -> None:
        super().__init__(parameters)
        given = self.parameters
        self.time_step: float = given.time_step
        self.state = _quantities(given.state)
        self.control_input = _quantities(given.control_input)
        self.position = tuple(given.position)
        self._covariance = np.array(given.W) if given.W is not None and np.any(given.W) else None
        self._steering = self._steered_by_velocity()

    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """Return the mean rate over one step, (A x + B u - x) / time_step."""
        after = self.successor(state, control_input, self.time_step, math)
        return tuple((one - state[row]) / self.time_step for row, one in enumerate(after))

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Sequence[Any]:
        """Return A x + B u.

        Raises:
            ValueError: The step is not the model's own.
        """
        if nanoseconds(step) != nanoseconds(self.time_step):
            raise ValueError(f"this model is a map over {self.time_step:g} s; it has no step of {step:g} s")
        # Sums in textbook order: a matrix product may use another order for other numbers of agents.
        return tuple(
            _sum(own, state) + _sum(added, control_input)
            for own, added in zip(self.parameters.A, self.parameters.B, strict=True)
        )

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return (A - I) / time_step, so that I + time_step J is A."""
        count = len(self.state)
        rate = (np.array(self.parameters.A) - np.eye(count)) / self.time_step
        return np.broadcast_to(rate, (len(state), count, count)).copy()

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the bounds of each element of the control input."""
        given, count = self.parameters.max_input, len(self.control_input)
        high = given if isinstance(given, list) else [np.inf if given is None else given] * count
        return [-bound for bound in high], high

    def noise_deviation(self, step: float) -> Array | None:
        """Return the root of the diagonal of W; correlations are in `noise_covariance` only."""
        return None if self._covariance is None else np.sqrt(np.diag(self._covariance))

    def noise_covariance(self, step: float) -> Array | None:
        """Return W."""
        return None if self._covariance is None else self._covariance.copy()

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Return the smallest control input that moves the state by the velocity in one step.

        Raises:
            NotImplementedError: The state is not exactly a position, or B cannot move it in every direction.
        """
        if self._steering is None:
            raise NotImplementedError(
                "Linear cannot be steered by a velocity unless its state is the position and B of full rank"
            )
        elements = [state[:, index] for index in range(len(self.state))]
        wanted = [
            elements[index] + self.time_step * velocity[:, axis] - _sum(self.parameters.A[index], elements)
            for axis, index in enumerate(self.position)
        ]
        followed = np.empty((len(state), len(self.control_input)))
        for column, row in enumerate(self._steering.tolist()):
            followed[:, column] = _sum(row, wanted)
        return followed

    def _steered_by_velocity(self) -> Array | None:
        """Return the pseudo-inverse of B, its columns in the order of the position; None if not applicable."""
        added = np.array(self.parameters.B)[list(self.position)]
        if len(self.position) < len(self.state) or np.linalg.matrix_rank(added) < len(self.position):
            return None
        return np.linalg.pinv(added)


def _quantities(units: Mapping[str, str]) -> tuple[Quantity, ...]:
    return tuple(Quantity(name, unit) for name, unit in units.items())


def _sum(factors: Sequence[float], elements: Sequence[Any]) -> Any:
    """Return the product of a row and a column; factors of 0 are left out."""
    total: Any = 0.0
    for index, factor in enumerate(factors):
        if factor:
            total = total + (elements[index] if factor == 1.0 else factor * elements[index])
    return total


def _is_covariance(matrix: Array) -> bool:
    scale = np.abs(matrix).max()
    if not np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12 * scale):
        return False
    return bool(np.linalg.eigvalsh(matrix).min() >= -1e-12 * scale)
