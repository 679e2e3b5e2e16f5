"""Plans: what is going to be done, and what a solver has to say of it."""

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
        states: At the stages 0 to N; shape (N + 1, nx).
        inputs: Held over the steps 0 to N - 1; shape (N, nu).
        dynamics: What leads from one state to the next.
        left: How many of the inputs a solver chose; the others only hold on to the last of them.
    """

    states: Array
    inputs: Array
    dynamics: Dynamics = field(repr=False)
    left: int

    def shifted(self, steps: int = 1) -> Plan:
        """What is left of the plan some steps later, then its last input held on; the usual warm start."""
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
        """The positions as a time series, which is what an intent consists of.

        Args:
            now: Simulated time of stage 0, in nanoseconds.
        """
        offsets = np.round(np.arange(len(self.states)) * (self.dynamics.step * SECOND)).astype(np.int64)
        return TimeSeries.sampled(now + offsets, self.dynamics.model.positions(self.states))


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """What came of a solver's work.

    Attributes:
        plan: The last iterate; a plan to follow only if `solved`.
        solved: Whether it is a solution to the tolerance.
        cost: Value of the cost in the units of the problem, with the price of violated soft constraints.
        infeasibility: The most by which it violates what must hold, the motion included, in scaled units.
        violation: The most by which it violates a soft constraint, in its scaled units; 0 without such.
        solver: Who solved it, or tried last.
        status: ``solved``, ``out of iterations``, or that solver's own word.
        iterations: How many iterations all solvers together made.
        wall_time: How long they took [s]; never the same twice, so nothing in a run may depend on it.
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
    """What to do next, whether or not a solver found a new plan.

    Attributes:
        plan: The new plan, else the rest of the previous one, else None where that is used up too.
        solution: What came of the attempt.
    """

    plan: Plan | None
    solution: Solution

    @property
    def fallen_back(self) -> bool:
        """Whether there is no new plan."""
        return not self.solution.solved
