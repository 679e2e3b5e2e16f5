"""Linear dynamics in discrete time, x+ = A x + B u + c, and the states that they can reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symaware_cli.core import Model
from symaware_cli.geometry import Array
from symaware_cli.world import Integrator, integrate

#: The number of sides of the polygon within the disc of control inputs of limited length.
_SIDES = 16


@dataclass(frozen=True, slots=True, eq=False)
class LinearDynamics:
    """The state after one step, x+ = A x + B u + c, with limited control inputs.

    Attributes:
        A: Shape (nx, nx).
        B: Shape (nx, nu).
        c: Shape (nx,).
        least: The least control input; shape (nu,).
        greatest: The greatest; shape (nu,).
        normals: Further limits of the control input, ``normals @ u <= limits``; shape (m, nu).
        limits: Shape (m,).
    """

    A: Array
    B: Array
    c: Array
    least: Array
    greatest: Array
    normals: Array
    limits: Array

    @classmethod
    def of(cls, model: Model, step: float, integrator: Integrator = "exact", substeps: int = 1) -> LinearDynamics:
        """Return the dynamics of a model over a step, as the kinematic world integrates it.

        Control inputs whose length is limited are limited to a polygon of 16 sides within that disc.

        Args:
            model: The model.
            step: Duration of a step [s].
            integrator: ``exact``, ``rk4`` or ``euler``.
            substeps: The number of parts of a step, if the model is integrated.

        Raises:
            ValueError: The model is not linear.
        """
        states, inputs = len(model.state), len(model.control_input)

        def after(state: Array, control_input: Array) -> Array:
            return integrate(model, state, control_input, step, integrator, substeps)

        units = np.eye(states + inputs)
        origin = after(np.zeros((1, states)), np.zeros((1, inputs)))[0]
        columns = after(units[:, :states], units[:, states:]) - origin
        generator = np.random.Generator(np.random.PCG64(1))
        drawn = generator.normal(size=(4, states + inputs))
        with np.errstate(all="ignore"):
            found = after(drawn[:, :states], drawn[:, states:])
        if not np.allclose(found, drawn @ columns + origin, rtol=1e-9, atol=1e-9):
            raise ValueError(f"the model {type(model).__name__} is not linear")
        least, greatest = (np.array(bound, float) for bound in model.input_bounds())
        normals, limits = np.zeros((0, inputs)), np.zeros(0)
        corner = model.limit(greatest[None])[0]
        if np.isfinite(greatest).all() and not np.array_equal(corner, greatest):
            # The length is limited, by as much as each element.
            if inputs == 2:
                angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
                normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
                limits = np.full(_SIDES, greatest[0] * np.cos(np.pi / _SIDES))
            else:
                least, greatest = least / np.sqrt(inputs), greatest / np.sqrt(inputs)
        A, B = columns[:states].T, columns[states:].T
        return cls(np.ascontiguousarray(A), np.ascontiguousarray(B), origin, least, greatest, normals, limits)

    def after(self, state: Array, control_input: Array) -> Array:
        """Return the state (nx,) after a step."""
        return self.A @ state + self.B @ control_input + self.c

    def rollout(self, state: Array, inputs: Array) -> Array:
        """Return the states from a state (nx,) under control inputs (N, nu); shape (N + 1, nx)."""
        states = [np.asarray(state, float)]
        for control_input in inputs:
            states.append(self.after(states[-1], control_input))
        return np.array(states)

    def reach(self, normal: Array, state: Array, steps: int, disturbance: Array | None = None) -> tuple[Array, Array]:
        """Return bounds of ``normal @ x`` after 0 to N steps from a state; each of shape (N + 1,).

        The bounds are exact for control inputs in a box that change at every step.

        Args:
            normal: Shape (nx,).
            state: Shape (nx,).
            steps: N.
            disturbance: The disturbance added to the state in each step, shape (N, nx); None for none.
        """
        low, high = np.empty(steps + 1), np.empty(steps + 1)
        rows = [np.asarray(normal, float)]
        for _ in range(steps):
            rows.append(rows[-1] @ self.A)
        powers = np.array(rows)
        gains = powers[:steps] @ self.B
        with np.errstate(invalid="ignore"):
            one = np.where(gains == 0.0, 0.0, gains * self.least)
            other = np.where(gains == 0.0, 0.0, gains * self.greatest)
        drift = np.concatenate([[0.0], np.cumsum(powers[:steps] @ self.c)])
        low[0] = high[0] = 0.0
        low[1:] = np.cumsum(np.minimum(one, other).sum(axis=1))
        high[1:] = np.cumsum(np.maximum(one, other).sum(axis=1))
        added = powers @ np.asarray(state, float) + drift
        if disturbance is not None:
            for k in range(1, steps + 1):
                added[k] += float((powers[:k][::-1] * disturbance[:k]).sum())
        return low + added, high + added
