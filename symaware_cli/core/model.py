"""Dynamics: how a state changes under a control input."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.plugin import Plugin

Array = NDArray[np.float64]


class Quantity(NamedTuple):
    """One element of a state or control input."""

    name: str
    unit: str


class Model(Plugin, ABC):
    """The dynamics x' = f(x, u), written once for arrays and symbols alike.

    One model serves all agents of a group: it holds parameters, never a state.

    Attributes:
        state: Name and unit of each element of x.
        control_input: Name and unit of each element of u.
        position: Where the position [m] stands in x.
        heading: Where the heading [rad] stands in x; None for models without one.
        angles: Which elements of x are angles that may be wrapped for display or comparison.
    """

    state: tuple[Quantity, ...] = ()
    control_input: tuple[Quantity, ...] = ()
    position: tuple[int, ...] = (0, 1)
    heading: int | None = None
    angles: ClassVar[tuple[int, ...]] = ()

    @abstractmethod
    def derivative(self, state: Any, control_input: Any, math: Any) -> Sequence[Any]:
        """The time derivative of the state.

        Args:
            state: The elements of x along the first axis: an array (nx, n), or a column of symbols.
            control_input: The elements of u likewise, (nu, n).
            math: Where ``cos``, ``sin`` and the like come from: ``numpy``, or ``casadi`` for symbols.

        Returns:
            One expression for each element of x, in units per second.
        """

    def input_bounds(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return the lowest and the highest control input, each of length nu; infinite where there is no limit."""
        count = len(self.control_input)
        return [-np.inf] * count, [np.inf] * count

    def limit(self, control_input: Array) -> Array:
        """Saturate requested control inputs; shape (n, nu) in and out."""
        bounds: tuple[Array, Array] | str | None = self.__dict__.get("_bounds", "unknown")
        if isinstance(bounds, str):
            low, high = (np.array(bound, float) for bound in self.input_bounds())
            bounds = None if np.isneginf(low).all() and np.isposinf(high).all() else (low, high)
            self.__dict__["_bounds"] = bounds
        if bounds is None:
            return control_input
        limited: Array = np.minimum(np.maximum(control_input, bounds[0]), bounds[1])
        return limited

    def positions(self, state: Array) -> Array:
        """Pick the positions [m] out of states; (n, nx) to (n, d)."""
        first, last = self.position[0], self.position[-1]
        if self.position == tuple(range(first, last + 1)):
            return state[:, first : last + 1]
        return state[:, list(self.position)]

    def velocity(self, state: Array, control_input: Array) -> Array:
        """Return the velocity of the position [m/s], shape (n, d), for states (n, nx) and control inputs (n, nu)."""
        rates = self.derivative(state.T, control_input.T, np)
        velocity = np.empty((len(state), len(self.position)))
        for column, index in enumerate(self.position):
            velocity[:, column] = rates[index]
        return velocity

    def exact_step(self, state: Array, control_input: Array, step: float) -> Array | None:
        """Advance states in closed form, for models that have one.

        Args:
            state: Shape (n, nx).
            control_input: Constant over the step; shape (n, nu).
            step: Time [s].

        Returns:
            The states after the step, shape (n, nx); None for models that must be integrated.
        """
        return None

    def noise_deviation(self, step: float) -> Array | None:
        """Return the standard deviation of the process noise of each element of x over a step [s].

        Returns:
            Shape (nx,), or None for models without noise.
        """
        return None

    def jacobian(self, state: Array, control_input: Array) -> Array:
        """Return the derivative of f(x, u) by x, shape (n, nx, nx), at states (n, nx) and inputs (n, nu).

        By central differences, unless a model knows better.
        """
        width = 1e-6
        jacobian = np.empty((len(state), len(self.state), len(self.state)))
        for column in range(len(self.state)):
            shift = np.zeros(len(self.state))
            shift[column] = width
            ahead = self.derivative((state + shift).T, control_input.T, np)
            behind = self.derivative((state - shift).T, control_input.T, np)
            for row, (one, other) in enumerate(zip(ahead, behind, strict=True)):
                jacobian[:, row, column] = (one - other) / (2 * width)
        return jacobian

    def follow_velocity(self, state: Array, velocity: Array) -> Array:
        """Return the control inputs that bring the velocity of the position closest to a wanted one.

        Controllers that reason in velocities work with every model that has this.

        Args:
            state: Shape (n, nx).
            velocity: The wanted velocities [m/s]; shape (n, d).

        Returns:
            Control inputs, not yet saturated; shape (n, nu).

        Raises:
            NotImplementedError: The model cannot be steered by a velocity.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot be steered by a velocity")
