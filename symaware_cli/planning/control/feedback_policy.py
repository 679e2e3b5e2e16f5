"""How a plan is followed in noise: deviations from it are corrected, and after its end the agent stops and stays."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar

import numpy as np

from symaware_cli.geometry import Array
from symaware_cli.planning.optimal_control import Dynamics, Plan
from symaware_cli.planning.risk.state_conditions import propagated

#: Within so many steps a linear model has come to rest, as far as numbers tell.
_RESTED = 1_000


class FeedbackPolicy:
    """Follows plans of a linear model by a feedback: a velocity against the deviation of the position.

    Attributes:
        free: The matrix of deviations over a step in which they are not corrected; shape (nx, nx).
        corrected: The same, for deviations that are corrected.
        rest: Where an agent comes to rest if it stops, as a matrix of its state; shape (nx, nx).
    """

    uncaptured: ClassVar[Collection[str]] = "*"  # no state between calls

    def __init__(self, dynamics: Dynamics, correction: float) -> None:
        """Prepare.

        Args:
            dynamics: The linear dynamics over a step.
            correction: The velocity for each metre of deviation [1/s].
        """
        model = dynamics.model
        size = len(model.state)
        states = np.concatenate([np.zeros((1, size)), np.eye(size)])
        inputs = np.zeros((size + 1, len(model.control_input)))
        free = dynamics(states, inputs)
        self.free: Array = (free[1:] - free[0]).T
        gains = inputs
        if correction:
            gains = model.follow_velocity(states, -correction * model.positions(states))
        #: The control input for each unit of deviation; shape (nu, nx).
        self._gain: Array = (gains[1:] - gains[0]).T
        after = dynamics(states, gains)
        self.corrected: Array = (after[1:] - after[0]).T
        stopped = dynamics(states, model.follow_velocity(states, np.zeros((size + 1, len(model.position)))))
        self.rest: Array = np.linalg.matrix_power((stopped[1:] - stopped[0]).T, _RESTED)
        self._dynamics = dynamics
        #: The last covariances, and that of the estimate which they are for: exact knowledge always has the same.
        self._known: tuple[Array, Array] | None = None

    def followed(self, plan: Plan, state: Array, steps: int | None = None) -> Plan:
        """Return a plan as it is followed from a state, which need not be its first one; at its end it stops.

        Args:
            plan: The plan.
            state: The state; shape (nx,).
            steps: For how many steps, which may be more than the plan has; those by default.
        """
        model, states, inputs = self._dynamics.model, [state], list[Array]()
        reference = plan.states[0]
        for stage in range(len(plan.inputs) if steps is None else steps):
            if stage < plan.left:
                wanted = plan.inputs[stage]
            else:
                wanted = model.follow_velocity(reference[None], np.zeros((1, len(model.position))))[0]
            inputs.append(model.limit((wanted + self._gain @ (states[-1] - reference))[None])[0])
            reference = self._dynamics(reference[None], wanted[None])[0]
            states.append(self._dynamics(states[-1][None], inputs[-1][None])[0])
        return Plan(np.array(states), np.array(inputs), plan.dynamics, plan.left)

    def shifted(self, plan: Plan) -> Plan:
        """Return the rest of a plan after a step, with a step more in which the agent stops."""
        longer = self.followed(plan, plan.states[0], len(plan.inputs) + 1)
        return Plan(longer.states[1:], longer.inputs[1:], plan.dynamics, max(plan.left - 1, 0))

    def covariances(self, believed: Array, noise: Array, steps: int) -> Array:
        """Return the covariance of the state at the stages of a plan that is followed; shape (steps + 1, nx, nx).

        The feedback corrects the deviation of the estimate from the plan. The covariance of the estimation error is
        assumed to be constant: each measurement reduces it by as much as it grew, and moves the estimate accordingly.

        Args:
            believed: The covariance of the estimate; shape (nx, nx). 0 for exact knowledge.
            noise: The covariance of the noise of a step; shape (nx, nx).
            steps: The number of steps.
        """
        if self._known is not None and len(self._known[1]) > steps and np.array_equal(self._known[0], believed):
            return self._known[1][: steps + 1]
        learned = propagated(believed[None], self.free[None])[0] + noise - believed
        if believed.any():
            values, vectors = np.linalg.eigh(0.5 * (learned + learned.T))
            learned = (vectors * np.maximum(values, 0.0)) @ vectors.T
        found = np.empty((steps + 1, *believed.shape))
        deviation = np.zeros((1, *believed.shape))
        for stage in range(steps + 1):
            found[stage] = believed + deviation[0]
            deviation = propagated(deviation, self.corrected[None]) + learned
        self._known = (believed, found)
        return found
