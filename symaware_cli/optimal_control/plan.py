"""Plans of a model predictive controller, and the results of solvers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import TimeSeries
from symaware_cli.optimal_control.dynamics import Dynamics
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Control inputs over a horizon and the states they lead to.

    Attributes:
        states: The states at the stages 0 to N; shape (N + 1, nx).
        inputs: The control inputs, held over the steps 0 to N - 1; shape (N, nu).
        dynamics: The dynamics from one state to the next.
        left: The number of inputs that a solver chose; the others repeat the last of them.
    """

    states: Array
    inputs: Array
    dynamics: Dynamics = field(repr=False)
    left: int

    def shifted(self, steps: int = 1) -> Plan:
        """Return the rest of the plan after some steps, with its last input held; the usual warm start."""
        steps = min(steps, len(self.inputs))
        held = np.repeat(self.inputs[-1:], steps, axis=0)
        added = self.dynamics.rollout(self.states[-1], held)[1:]
        return Plan(
            np.concatenate([self.states[steps:], added]),
            np.concatenate([self.inputs[steps:], held]),
            self.dynamics,
            max(self.left - steps, 0),
        )

    def intent(self, now: int) -> TimeSeries:
        """Return the positions as a time series, the form of an intent.

        Args:
            now: Simulated time of stage 0, in nanoseconds.
        """
        offsets = np.round(np.arange(len(self.states)) * (self.dynamics.step * SECOND)).astype(np.int64)
        return TimeSeries.sampled(now + offsets, self.dynamics.model.positions(self.states))


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The result of a solver.

    Attributes:
        plan: The last iterate; a plan to follow only if `solved`.
        solved: Whether it is a solution within the tolerance.
        cost: The cost in the units of the problem, including penalties of soft constraints.
        infeasibility: The greatest violation of a hard constraint, dynamics included, in scaled units.
        violation: The greatest violation of a soft constraint, in its scaled units; 0 without any.
        solver: The solver that succeeded, or was tried last.
        status: ``solved``, ``out of iterations``, or the status that the solver returned.
        iterations: The total number of iterations of all solvers.
        wall_time: The wall time [s]; it varies, so nothing in a run may depend on it.
    """

    plan: Plan
    solved: bool
    cost: float
    infeasibility: float
    violation: float
    solver: str
    status: str
    iterations: int
    wall_time: float


@dataclass(frozen=True, slots=True, eq=False)
class PlanDecision:
    """The plan to follow, whether or not a solver found a new one.

    Attributes:
        plan: The new plan, else the rest of the previous one, else None if that is used up.
        solution: The result of the solver.
    """

    plan: Plan | None
    solution: Solution

    @property
    def fallen_back(self) -> bool:
        """Whether there is no new plan."""
        return not self.solution.solved
