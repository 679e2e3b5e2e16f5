"""Chance constraints of `control.mpc`: specifications that are kept with a given probability over the run.

The risk of a plan is at most the sum of the probabilities of leaving a half space, over half spaces and stages (Boole's
inequality). Each gets a part of the risk that is left, and the plan keeps its mean inside by the quantile of that
part times the standard deviation (L. Blackmore, M. Ono, B. C. Williams, "Chance-constrained optimal path planning with
obstacles", IEEE Transactions on Robotics 27(6), 2011). The parts are equal or, iteratively, taken from where they are
not used and given to where they limit the plan (M. Ono, B. C. Williams, "Iterative risk allocation: a new approach to
robust model predictive control with a joint chance constraint", IEEE Conference on Decision and Control, 2008).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from symaware_cli.components.control.mpc_problem import Tracking
from symaware_cli.components.risk.body_pairs import state_covariance
from symaware_cli.components.risk.invariants import ExpectedMotion, InvariantWindows
from symaware_cli.components.risk.state_conditions import HalfSpaces, exceeding, propagated, quantile
from symaware_cli.core import Agent
from symaware_cli.geometry.vectors import Array, Mask
from symaware_cli.optimal_control import Dynamics, Plan, PlanDecision
from symaware_cli.specification.predicted_scope import PredictedAgentScope
from symaware_cli.world.time import SECOND

Times = NDArray[np.int64]

#: How often a plan is made with another allocation, at most.
_REALLOCATIONS = 3

#: The part of the unused risk that remains where it is not used, in a reallocation.
_REMAINING = 0.3

#: From this part of its risk on, a half space counts as one that limits the plan.
_LIMITING = 0.95

#: The part of the risk that is allocated; the rest is for the tolerance of solvers.
_ALLOCATED = 0.98

#: The least risk that is allocated to all half spaces together, as a part of the greatest one.
_LEAST = 1e-3

#: [units of the state] The least distance from a half space's edge, so that what is known for sure is inside.
_CLEARANCE = 1e-4


#: What an agent does if no plan has little enough risk.
_FALLBACKS = {
    "best-effort": "follows the plan that comes nearest",
    "last-plan": "follows its last plan",
    "slow-down": "slows down",
}


class ChanceConstrained(Tracking):
    """The horizon of `control.mpc`, and what it keeps by chance constraints."""

    horizon: float = Field(4.0, gt=0, description="How far ahead to plan [s].")
    steps: int = Field(
        20,
        ge=1,
        le=500,
        description="In how many steps; each is rounded to a whole number of the world's time steps.",
    )
    specifications: list[str] = Field(
        default=[],
        description="The specifications of the agent that it keeps; each says `always` of linear predicates.",
    )
    maximal_risk: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="The greatest probability that one of the `specifications` is violated in the run.",
    )
    risk_allocation: Literal["uniform", "iterative"] = Field(
        "iterative", description="How the risk is allocated to the stages: equally, or where it is of use."
    )
    risk_bound: Literal["normal", "chebyshev"] = Field(
        "normal", description="What is assumed about deviations: that they are normal, or nothing but their covariance."
    )
    correction: float = Field(
        2.0,
        ge=0,
        description="How strongly later plans are expected to correct deviations, as a velocity [1/s]. It affects how"
        " far ahead of time a plan keeps away, and not how much risk is counted.",
    )
    fallback: Literal["best-effort", "last-plan", "slow-down"] = Field(
        "best-effort",
        description="What it does if no plan has little enough risk: follow the plan that comes nearest to it, follow"
        " the rest of the last plan, or slow down.",
    )

    def check_steps(self, time_step: int) -> None:
        """Check that a step of the plan is one of the world [ns].

        Raises:
            ValueError: It is not.
        """
        if round(self.horizon / self.steps / (time_step / SECOND)) > 1:
            told = f"{time_step / SECOND:g} s"
            raise ValueError(
                f"a plan that keeps it has steps (`horizon` / `steps`) as long as those of the world, {told}"
            )

    @model_validator(mode="after")
    def _risk_of_something(self) -> ChanceConstrained:
        if (self.maximal_risk is None) != (not self.specifications):
            missing = "`specifications` to keep" if self.maximal_risk is not None else "a `maximal_risk`"
            raise ValueError(f"a chance constraint needs {missing} as well")
        return self


class ChancePlan(NamedTuple):
    """A plan with little enough risk, or the reason why there is none.

    Attributes:
        decision: The result of planning.
        risk: A bound of the risk over the horizon.
        allowed: What it may be.
        unkept: The specification that is not kept with the plan; None if all are.
        time: The instant from which on it is not [ns].
    """

    decision: PlanDecision
    risk: float
    allowed: float
    unkept: str | None
    time: int

    def problem(self, fallback: str) -> tuple[str, dict[str, Any]]:
        """Return what there is to say about a specification that is not kept: in words, and as data of an event."""
        risk, time = f"a risk of {self.risk:.2g}, of which {self.allowed:.2g} is left", self.time / SECOND
        data = {"specification": self.unkept, "time": time, "risk": self.risk, "allowed": self.allowed}
        return f"no plan keeps `{self.unkept}` from {time:g} s on: {risk}; {_FALLBACKS[fallback]}", data


class _Stages(NamedTuple):
    """The half spaces of all stages but the present one.

    Attributes:
        times: The instants [ns]; shape (N,).
        sides: The half spaces; k for each stage.
        deviations: Their standard deviations; shape (k, N).
        counts: Which of them count; shape (k, N).
        names: The specification of each of the k.
    """

    times: Times
    sides: HalfSpaces
    deviations: Array
    counts: Mask
    names: list[str]


class ChanceConstraints:
    """The chance constraints of one agent."""

    uncaptured: ClassVar[Collection[str]] = "*"  # no state between calls

    def __init__(self, agent: Agent, given: ChanceConstrained, dynamics: Dynamics, step: int) -> None:
        """Prepare.

        Args:
            agent: The agent.
            given: The parameters.
            dynamics: The linear dynamics over a step of the world.
            step: The step [ns].
        """
        assert given.maximal_risk is not None
        group = agent.group
        environment = agent.surroundings.environment
        self._agent = agent
        self._given = given
        self._maximal = given.maximal_risk
        self._dynamics = dynamics
        self._step = step
        self._windows = InvariantWindows(group, given.specifications, step)
        self._scope = PredictedAgentScope(group, environment, environment.groups, group.regions)
        self._noise = group.model.noise_covariance(step / SECOND)
        self._transition, self._corrected = _transitions(dynamics, given.correction)

    def count(self) -> int:
        """Return the number of half spaces of each stage."""
        states, now = self._agent.self_state[None], np.zeros(1, np.int64)
        moments = self._motion(states, now).moments(np.zeros((1, states.shape[1], states.shape[1])), self._scope)
        return sum(len(each.condition.half_spaces(moments).offsets) for each in self._windows.invariants)

    def plan(
        self,
        solve: Callable[[Mapping[str, Array]], PlanDecision],
        expected: Array,
        now: int,
        before: int | None,
        spent: float,
    ) -> ChancePlan:
        """Make a plan with little enough risk, if there is one.

        Args:
            solve: Makes a plan with the parameters ``faces`` and ``faces_offset``.
            expected: The states around which half spaces are chosen; shape (N + 1, nx).
            now: The present time [ns].
            before: When the last plan was made [ns]; None for the first.
            spent: The risk that was taken until now.

        Raises:
            ValueError: There was no plan at the last step of the world, so it is not known which risk was taken.
        """
        if before is not None and now != before + self._step:
            raise ValueError("with `maximal_risk` it takes a turn at each step of the world, and it missed one")
        steps = len(expected) - 1
        stages = self._stages(expected, now)
        remaining = self._windows.remaining(now, self._agent.surroundings.clock.end)[self._agent.row]
        allowed = max(self._maximal - spent, 0.0) * min(1.0, steps / max(int(remaining), 1))
        allocated = max(_ALLOCATED * allowed, _LEAST * self._maximal)
        total = max(int(stages.counts.sum()), 1)
        parts = np.where(stages.counts, allocated / total, 1.0)
        best: ChancePlan | None = None
        for _ in range(1 + _REALLOCATIONS):
            decision = solve(self._tightened(stages, parts))
            risks = self._risks(stages, decision.solution.plan)
            risk = min(float(risks.sum()), 1.0)
            unkept = None if risk <= allowed and decision.solution.solved else self._first(stages, risks, parts)
            found = ChancePlan(decision, risk, allowed, *(unkept or (None, 0)))
            if best is None or _rank(found) < _rank(best):
                best = found
            limiting = stages.counts & (risks >= _LIMITING * parts)
            if self._given.risk_allocation == "uniform" or not decision.solution.solved:
                break
            if not limiting.any() or limiting[stages.counts].all():
                break
            unused = stages.counts & ~limiting
            parts = np.where(unused, _REMAINING * parts + (1.0 - _REMAINING) * risks, parts)
            spare = allocated - parts[stages.counts].sum()
            parts = np.where(limiting, parts + spare / limiting.sum(), parts)
        assert best is not None
        return best

    def next_risk(self, control_input: Array, now: int) -> float:
        """Return a bound of the risk that is taken by applying a control input until the next step.

        Args:
            control_input: Shape (nu,).
            now: The present time [ns].
        """
        states = self._dynamics(self._agent.self_state[None], control_input[None])
        times = np.array([now + self._step])
        moments = self._motion(states, times).moments(self._covariances(1)[1:], self._scope)
        risk = 0.0
        for each, counts in zip(self._windows.invariants, self._counting(times, now), strict=True):
            if counts[0]:
                risk += float(each.condition.failure(moments, self._given.risk_bound)[0])
        return min(risk, 1.0)

    def _counting(self, times: Times, now: int) -> Mask:
        """Return which invariants must hold at some instants; shape (invariants, instants)."""
        return self._windows.counting(times, now, self._agent.surroundings.clock.end)[:, self._agent.row]

    def _motion(self, states: Array, times: Times) -> ExpectedMotion:
        count = len(states)
        inputs = np.zeros((count, len(self._agent.group.model.control_input)))
        return ExpectedMotion(times / SECOND, states, inputs, np.full(count, self._agent.row))

    def _covariances(self, steps: int) -> Array:
        """Return the covariance of the state at the stages; shape (steps + 1, nx, nx)."""
        size = len(self._agent.group.model.state)
        believed = state_covariance(self._agent.group)
        found = np.zeros((steps + 1, size, size))
        if believed is not None:
            found[0] = believed[self._agent.row]
        for stage in range(steps):
            transition = self._corrected if stage else self._transition
            found[stage + 1] = propagated(found[stage : stage + 1], transition[None])[0]
            if self._noise is not None:
                found[stage + 1] += self._noise
        return found

    def _stages(self, expected: Array, now: int) -> _Stages:
        steps = len(expected) - 1
        times = now + self._step * np.arange(1, steps + 1)
        covariances = self._covariances(steps)[1:]
        moments = self._motion(expected[1:], times).moments(covariances, self._scope)
        slopes, offsets, counts, names = [], [], [], []
        for each, of_each in zip(self._windows.invariants, self._counting(times, now), strict=True):
            sides = each.condition.half_spaces(moments)
            slopes.append(sides.slopes)
            offsets.append(sides.offsets)
            counts.append(np.isfinite(sides.offsets) & of_each)
            names += [each.specification] * len(sides.offsets)
        found = HalfSpaces(np.concatenate(slopes), np.concatenate(offsets))
        return _Stages(times, found, found.deviations(covariances), np.concatenate(counts), names)

    def _tightened(self, stages: _Stages, parts: Array) -> dict[str, Array]:
        """Return ``faces`` (N + 1, nx, k) and ``faces_offset`` (N + 1, k): faces @ x >= faces_offset, in lengths."""
        count, steps = stages.counts.shape
        size = stages.sides.slopes.shape[2]
        faces, offsets = np.zeros((steps + 1, size, count)), np.full((steps + 1, count), -1.0)
        length = np.sqrt(np.square(stages.sides.slopes).sum(axis=2))
        counts = stages.counts & (length > 0.0)
        length = np.where(counts, length, 1.0)
        away = quantile(np.where(counts, parts, 0.5), self._given.risk_bound) * stages.deviations
        faces[1:] = np.where(counts[..., None], stages.sides.slopes / length[..., None], 0.0).transpose(1, 2, 0)
        offsets[1:] = np.where(
            counts, (away - np.where(counts, stages.sides.offsets, 0.0)) / length + _CLEARANCE, -1.0
        ).T
        return {"faces": faces, "faces_offset": offsets}

    def _risks(self, stages: _Stages, plan: Plan) -> Array:
        """Return the probabilities of leaving the half spaces; shape (k, N)."""
        margins = stages.sides.margins(plan.states[1:])
        fails = exceeding(np.where(stages.counts, margins, 1.0), stages.deviations, self._given.risk_bound)[0]
        return np.where(stages.counts, fails, 0.0)

    def _first(self, stages: _Stages, risks: Array, parts: Array) -> tuple[str, int]:
        """Return the specification that is not kept, and the first instant at which it is not."""
        excess = np.where(stages.counts, risks - parts, -np.inf)
        stage = int(np.flatnonzero((excess >= min(0.0, float(excess.max()))).any(axis=0))[0])
        return stages.names[int(excess[:, stage].argmax())], int(stages.times[stage])


def _rank(found: ChancePlan) -> tuple[bool, bool, float, float]:
    solved, kept = found.decision.solution.solved, found.unkept is None
    return not solved, not kept, 0.0 if kept else found.risk, found.decision.solution.cost


def _transitions(dynamics: Dynamics, correction: float) -> tuple[Array, Array]:
    """Return the matrices of a step of deviations, without and with later corrections; each of shape (nx, nx)."""
    model = dynamics.model
    size = len(model.state)
    states = np.concatenate([np.zeros((1, size)), np.eye(size)])
    inputs = np.zeros((size + 1, len(model.control_input)))
    free = dynamics(states, inputs)
    corrected = free
    if correction:
        corrected = dynamics(states, model.follow_velocity(states, -correction * model.positions(states)))
    return (free[1:] - free[0]).T, (corrected[1:] - corrected[0]).T
