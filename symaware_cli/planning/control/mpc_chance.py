"""Chance constraints of `control.mpc`: specifications that are kept with a given probability over the run.

The risk of a plan is at most the sum of the probabilities of leaving a half space, over half spaces and stages (Boole's
inequality). Each gets a part of the risk that is left, and the plan keeps its mean inside by the quantile of that
part times the standard deviation (L. Blackmore, M. Ono, B. C. Williams, "Chance-constrained optimal path planning with
obstacles", IEEE Transactions on Robotics 27(6), 2011). The parts are equal or, iteratively, taken from where they are
not used and given to where they limit the plan (M. Ono, B. C. Williams, "Iterative risk allocation: a new approach to
robust model predictive control with a joint chance constraint", IEEE Conference on Decision and Control, 2008).

Reasons: docs/decisions/0035-chance-constraints.md, for promises docs/decisions/0109-maximal-risk-pays-for-promises.md
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from symaware_cli.core import Agent
from symaware_cli.engine import state_covariance
from symaware_cli.geometry import Array, Indices, Mask, separation_from_points
from symaware_cli.planning.control.feedback_policy import FeedbackPolicy
from symaware_cli.planning.control.mpc_problem import Tracking
from symaware_cli.planning.optimal_control import Dynamics, Plan, PlanDecision
from symaware_cli.planning.risk.invariants import ExpectedMotion, InvariantWindows
from symaware_cli.planning.risk.pair_conditions import OtherPositions, OthersAhead
from symaware_cli.planning.risk.risk_budget import RiskBudget
from symaware_cli.planning.risk.state_conditions import HalfSpaces, Moments, exceeding, propagated, quantile
from symaware_cli.specification import PredictedAgentScope
from symaware_cli.world import SECOND

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
        description="The specifications of the agent that it keeps; each says `always` of linear predicates, or of"
        " `distance` of pairs.",
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
        description="How strongly deviations from a plan are corrected while it is followed, as a velocity [1/s]: the"
        " more, the closer to dangers it may come.",
    )
    promises: Literal["paid", "if-kept", "ignored"] = Field(
        "paid",
        description="What promises of others to stay in a region count, with a `maximal_risk`: pairs rely on them, and "
        "the declared probability that they are broken is taken from it (`paid`); it holds if all are kept "
        "(`if-kept`); or they do not count.",
    )
    fallback: Literal["best-effort", "last-plan", "slow-down"] = Field(
        "best-effort",
        description="What it does if no plan has little enough risk, nor the rest of the last one: follow the plan that"
        " comes nearest to it, follow the rest of the last plan, or slow down.",
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
        decision: The result of planning; its plan begins at the present state.
        plan: The plan that is kept: that one, or the one from which deviations are corrected on the way.
        risk: A bound of its risk: over the horizon, and of then stopping and staying until the end.
        allowed: The maximum of this risk.
        rest: The risk of the rest of the plan that was kept before; `allowed` if there was none.
        unkept: The specification that is not kept with the plan; None if all are.
        time: The instant from which on that specification is not kept [ns].
        spent: The risk that was taken before.
    """

    decision: PlanDecision
    plan: Plan | None
    risk: float
    allowed: float
    rest: float
    unkept: str | None
    time: int
    spent: float

    def problem(self, fallback: str) -> tuple[str, dict[str, Any]]:
        """Return the text and the data of an event about the specification that is not kept."""
        left = f"of which {self.allowed:.2g} is left and {self.spent:.2g} spent"
        time = self.time / SECOND
        data = {"specification": self.unkept, "time": time, "risk": self.risk, "allowed": self.allowed}
        said = f"no plan keeps `{self.unkept}` from {time:g} s on: a risk of {self.risk:.2g}, {left}"
        return f"{said}; {_FALLBACKS[fallback]}", {**data, "spent": self.spent}


class _Stages(NamedTuple):
    """The half spaces of all stages but the present one. The last stage is for all later instants, too.

    Attributes:
        times: The instants [ns]; shape (N,).
        sides: The half spaces of the own state; k for each stage.
        deviations: Their standard deviations, the greatest of a stage; shape (k, N).
        weights: The number of instants at which they count, times the weight of the invariant; shape (k, N).
        names: The specification of each of the k.
    """

    times: Times
    sides: HalfSpaces
    deviations: Array
    weights: Array
    names: list[str]

    @property
    def counts(self) -> Mask:
        """Which of them count; shape (k, N)."""
        return self.weights > 0.0


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
        group = agent.group
        environment = agent.surroundings.environment
        self._agent = agent
        self._given = given
        self._maximal = given.maximal_risk or 0.0
        self._dynamics = dynamics
        self._step = step
        self._windows = InvariantWindows(group, given.specifications, step)
        self._scope = PredictedAgentScope(group, environment, environment.groups, group.regions)
        noise = group.model.noise_covariance(step / SECOND)
        size = len(group.model.state)
        self._noise = np.zeros((size, size)) if noise is None else noise
        self._policy = FeedbackPolicy(dynamics, given.correction)
        self._others = OthersAhead(group)
        own = range(environment.roster.start(group.name), environment.roster.start(group.name) + len(group))
        #: Whether each invariant is about another agent of the group, which corrects its deviations likewise.
        self._alike = [None if each is None else each[agent.row] in own for each in self._windows.others]

        breach = group.breach(agent.row, self._partners) if given.promises == "paid" else 0.0
        self._relies = given.promises != "ignored" and breach < self._maximal
        #: The part of the maximal risk that promises of partners cost, whether or not they are known yet.
        self.paid = breach if self._relies else 0.0

    @property
    def _partners(self) -> frozenset[int]:
        """The others of pairs, as indices in the roster."""
        found = (int(each[self._agent.row]) for each in self._windows.others if each is not None)
        return frozenset(each for each in found if each >= 0)

    def relied(self, before: Collection[int]) -> tuple[int, ...]:
        """Return the partners whose promises the plans rely on, as indices in the roster.

        Args:
            before: Those of the last plan; a partner that is not seen stays one of them.
        """
        group, row = self._agent.group, self._agent.row
        if not self._relies or not self._partners:
            return ()
        tracks = group.others(np.inf)
        seen = {int(each) for each in tracks.others[tracks.pointers[row] : tracks.pointers[row + 1]]}
        now = {
            int(tracks.others[place])
            for confined in group.confined(tracks)
            for place in confined.rows.tolist()
            if tracks.observers[place] == row
        }
        return tuple(sorted(self._partners & (now | ({*before} - seen))))

    def _kept(self, other: int, positions: Array) -> list[OtherPositions]:
        """Return the nearest points of the sets in which a partner stays if it keeps its promises; one for each set.

        A half space at the nearest point of a convex set, across the way to it, has none of the set within. Own
        positions in the set have no such point.

        Args:
            other: The partner, as an index in the roster.
            positions: Expected own positions [m]; shape (m, d).
        """
        group, row = self._agent.group, self._agent.row
        count, size = positions.shape
        tracks, found = group.others(np.inf), list[OtherPositions]()
        for confined in group.confined(tracks) if self._relies else ():
            for number, place in enumerate(confined.rows.tolist()):
                if tracks.observers[place] == row and tracks.others[place] == other:
                    sets = confined.sets.take(np.full(count, number))
                    apart = separation_from_points(positions[:, :2], np.zeros(count), sets)
                    nearest = positions.copy()
                    nearest[:, :2] = apart.second
                    still, outside = np.zeros((count, size, size)), apart.distance > 0.0
                    found.append(OtherPositions(nearest, still, np.zeros(count, bool), outside))
        return found

    def count(self) -> int:
        """Return the number of half spaces of each stage."""
        states = self._agent.self_state[None]
        return len(self._sides(states, np.zeros(1, np.int64), np.zeros((1, states.shape[1], states.shape[1])))[1])

    def rest(self, plan: Plan) -> tuple[Plan, Plan]:
        """Return the rest of the last plan, and how it is followed from the present state.

        Args:
            plan: The plan that was made, or kept, one step ago.
        """
        rest = self._policy.shifted(plan)
        return rest, self._policy.followed(rest, self._agent.self_state)

    def plan(
        self,
        solve: Callable[[Mapping[str, Array]], PlanDecision],
        expected: Plan,
        rest_of_plan: Plan | None,
        now: int,
        before: int | None,
        budget: RiskBudget,
    ) -> ChancePlan:
        """Make a plan with little enough risk, or keep the rest of the last one.

        Args:
            solve: Makes a plan with the parameters ``faces`` and ``faces_offset``.
            expected: How the rest of the last plan is followed, or else a plan around which half spaces are chosen.
            rest_of_plan: The rest of the last plan; None if there is none.
            now: The present time [ns].
            before: When the last plan was made [ns]; None for the first.
            budget: The risk that may be taken, of one agent.

        Raises:
            ValueError: There was no plan at the last step of the world, so it is not known which risk was taken; or the
                end of the run is unknown.
        """
        if before is not None and now != before + self._step:
            raise ValueError("with `maximal_risk` it takes a turn at each step of the world, and it missed one")
        steps = len(expected.inputs)
        stages, remaining = self._stages(expected.states, now)
        rest = np.array([self._risk(expected if rest_of_plan is None else rest_of_plan, now, remaining)])
        keeps = bool(budget.kept[0]) and rest_of_plan is not None
        limit = float(budget.allowed(rest)[0])
        # Without a plan that is kept, there is no telling what stopping costs: it is what the first plan ends with.
        allowed = float(budget.paced(rest if keeps else np.zeros(1), steps, np.array([remaining]))[0])
        spent = float(budget.spent[0])
        allocated = max(_ALLOCATED * allowed, _LEAST * self._maximal)
        total = max(float(stages.weights.sum()), 1.0)
        parts = np.where(stages.counts, stages.weights * (allocated / total), 1.0)
        best: ChancePlan | None = None
        for _ in range(1 + _REALLOCATIONS):
            decision = solve(self._tightened(stages, parts))
            risks = self._risks(stages, decision.solution.plan)
            risk = self._risk(decision.solution.plan, now, remaining)
            unkept = None if risk <= allowed and decision.solution.solved else self._first(stages, risks, parts)
            name, time = unkept or (None, 0)
            found = ChancePlan(decision, decision.plan, risk, limit, float(rest[0]), name, time, spent)
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
        if best.unkept is not None and keeps:
            # The rest of the last plan is always affordable.
            kept = PlanDecision(expected, best.decision.solution)
            return best._replace(decision=kept, plan=rest_of_plan, risk=float(rest[0]), unkept=None)
        if best.unkept is not None and best.decision.solution.solved and best.risk <= limit:
            return best._replace(unkept=None)
        return best

    def _risk(self, plan: Plan, now: int, remaining: int) -> float:
        """Return a bound of the risk of following a plan, and of staying after its end, at each of the steps to come.

        Args:
            plan: Its first state is the present one, or else the deviation from that is corrected.
            now: The present time [ns].
            remaining: How many steps to come count.
        """
        if not remaining:
            return 0.0
        path = self._policy.followed(plan, self._agent.self_state, remaining)
        times = now + self._step * np.arange(1, remaining + 1)
        covariances = self._policy.covariances(self._believed(), self._noise, remaining)[1:]
        return self._violation(path.states[1:], times, covariances, now)

    def _violation(self, states: Array, times: Times, covariances: Array, now: int) -> float:
        """Return a bound of the risk at some instants, given the expected states and their covariances."""
        sides, places, weights, deviations = self._sides(states, times, covariances)
        counts = np.isfinite(sides.offsets) & self._counting(times, now)[places]
        margins = np.where(counts, sides.margins(states), 1.0)
        fails = np.where(counts, exceeding(margins, deviations, self._given.risk_bound)[0], 0.0)
        return min(float((fails * weights[:, None]).sum()), 1.0)

    def next_risk(self, control_input: Array, now: int) -> float:
        """Return a bound of the risk that is taken by applying a control input until the next step.

        Args:
            control_input: Shape (nu,).
            now: The present time [ns].
        """
        states = self._dynamics(self._agent.self_state[None], control_input[None])
        times = np.array([now + self._step])
        covariance = propagated(self._believed()[None], self._policy.free[None]) + self._noise
        return self._violation(states, times, covariance, now)

    def _counting(self, times: Times, now: int) -> Mask:
        """Return which invariants must hold at some instants; shape (invariants, instants)."""
        return self._windows.counting(times, now, self._agent.surroundings.clock.end)[:, self._agent.row]

    def _believed(self) -> Array:
        """Return the covariance of the present state; shape (nx, nx)."""
        believed = state_covariance(self._agent.group)
        return np.zeros_like(self._noise) if believed is None else believed[self._agent.row]

    def _sides(
        self, states: Array, times: Times, covariances: Array
    ) -> tuple[HalfSpaces, NDArray[np.intp], Array, Array]:
        """Return half spaces of own states in which the invariants hold.

        Args:
            states: Expected states; shape (m, nx).
            times: The instants [ns]; shape (m,).
            covariances: Of the states; shape (m, nx, nx).

        Returns:
            The half spaces, k for each state; the invariant of each of the k, and its weight; and the deviations of the
            margins, in which those of partners count; shape (k, m). Half spaces without a partner have no offset.
        """
        count, size, row = *states.shape, self._agent.row
        inputs = np.zeros((count, len(self._agent.group.model.control_input)))
        motion = ExpectedMotion(times / SECOND, states, inputs, np.full(count, row))
        slopes, offsets, deviations = [], [], []
        places: list[int] = []
        for place, (each, others) in enumerate(zip(self._windows.invariants, self._windows.others, strict=True)):
            if others is None:
                moments = motion.moments(covariances, self._scope)
                sides = each.condition.half_spaces(moments)
                missing = np.zeros(count, bool)
            else:
                seen = self._partner(others, times, covariances, self._alike[place] is True)
                moments = seen.moments(states, covariances, self._agent.group.model.position)
                sides, missing = each.condition.half_spaces(moments), ~seen.known
                own = states[:, list(self._agent.group.model.position)]
                for kept in self._kept(int(others[row]), own):
                    # Either half space suffices, so the one that is violated less probably is taken.
                    instead = kept.moments(states, covariances, self._agent.group.model.position)
                    faces = each.condition.half_spaces(instead)
                    before, after = (self._failing(*pair) for pair in ((sides, moments), (faces, instead)))
                    better = kept.known & seen.known & (after < before)
                    chosen = kept.where(better, seen)
                    sides = HalfSpaces(
                        np.where(better[None, :, None], faces.slopes, sides.slopes),
                        np.where(better, faces.offsets, sides.offsets),
                    )
                    seen, moments = chosen, chosen.moments(states, covariances, self._agent.group.model.position)
            deviations.append(sides.deviations(moments.covariance))
            of_other = (sides.slopes[:, :, size:] * moments.mean[:, size:]).sum(axis=2)
            slopes.append(np.where(missing[None, :, None], 0.0, sides.slopes[:, :, :size]))
            offsets.append(np.where(missing, np.inf, sides.offsets + of_other))
            places += [place] * len(sides.offsets)
        weights = np.array([self._windows.invariants[place].weight for place in places])
        found = HalfSpaces(np.concatenate(slopes), np.concatenate(offsets))
        return found, np.array(places, np.intp), weights, np.concatenate(deviations)

    def _failing(self, sides: HalfSpaces, moments: Moments) -> Array:
        """Return a bound of the probability of leaving half spaces at each instant; shape (m,)."""
        margins, deviations = sides.margins(moments.mean), sides.deviations(moments.covariance)
        there = np.isfinite(margins)
        fails = exceeding(np.where(there, margins, 1.0), deviations, self._given.risk_bound)[0]
        total: Array = np.where(there, fails, 0.0).sum(axis=0)
        return total

    def _partner(self, others: Indices, times: Times, covariances: Array, alike: bool) -> OtherPositions:
        """Return where a partner is expected at some instants, its velocity held over the horizon.

        A partner of the own group corrects its deviations as the agent does, so they grow no more than the own ones.
        """
        group, row = self._agent.group, self._agent.row
        now = group.surroundings.clock.now
        at = self._others.now(others)
        horizon = self._given.steps * self._step
        seen = [at(np.full(len(group), time), horizon).take(np.array([row])) for time in times.tolist()]
        places = list(group.model.position)
        found = OtherPositions(*(np.concatenate(each) for each in zip(*seen, strict=True)))
        if alike:
            believed = at(np.full(len(group), now), horizon).take(np.array([row])).covariance
            own = covariances[:, places][:, :, places] - self._believed()[places][:, places]
            found = found._replace(covariance=believed + own)
        return found

    def _stages(self, expected: Array, now: int) -> tuple[_Stages, int]:
        """Return the half spaces around expected states (N + 1, nx), and how many steps to come count."""
        steps, end, row = len(expected) - 1, self._agent.surroundings.clock.end, self._agent.row
        if end is None:
            raise ValueError("`maximal_risk` is about the whole run, whose end is not known")
        last = int(self._windows.spans(now, end)[1][:, row].max(initial=now))
        remaining = (last - now) // self._step
        times = now + self._step * np.arange(1, max(steps, remaining) + 1)
        covariances = self._policy.covariances(self._believed(), self._noise, len(times))[1:]
        counting = self._counting(times, now)
        sides, places, weights, deviations = self._sides(expected[1:], times[:steps], covariances[:steps])
        found = np.where(np.isfinite(sides.offsets) & counting[places, :steps], weights[:, None], 0.0)
        if len(times) > steps:
            # After the horizon the agent stays where the plan ends; what grows is its deviation, for a while.
            ends = np.repeat(expected[-1:], len(times) - steps, axis=0)
            _, _, _, later = self._sides(ends, times[steps:], covariances[steps:])
            counted = counting[places, steps:] & np.isfinite(sides.offsets[:, -1:])
            found[:, -1] += weights * counted.sum(axis=1)
            deviations[:, -1] = np.maximum(deviations[:, -1], np.where(counted, later, 0.0).max(axis=1))
        names = [self._windows.invariants[place].specification for place in places]
        return _Stages(times[:steps], sides, deviations, found, names), remaining

    def _tightened(self, stages: _Stages, parts: Array) -> dict[str, Array]:
        """Return ``faces`` (N + 1, nx, k) and ``faces_offset`` (N + 1, k): faces @ x >= faces_offset, in lengths."""
        count, steps = stages.counts.shape
        slopes = stages.sides.slopes.copy()
        size = slopes.shape[2]
        # At the end of the plan, that is where the agent comes to rest.
        slopes[:, -1] = slopes[:, -1] @ self._policy.rest
        faces, offsets = np.zeros((steps + 1, size, count)), np.full((steps + 1, count), -1.0)
        length = np.sqrt(np.square(slopes).sum(axis=2))
        counts = stages.counts & (length > 0.0)
        length = np.where(counts, length, 1.0)
        quantiles = quantile(
            np.where(counts, np.minimum(parts / np.maximum(stages.weights, 1e-12), 0.5), 0.5), self._given.risk_bound
        )
        away = quantiles * stages.deviations
        faces[1:] = np.where(counts[..., None], slopes / length[..., None], 0.0).transpose(1, 2, 0)
        offsets[1:] = np.where(
            counts, (away - np.where(counts, stages.sides.offsets, 0.0)) / length + _CLEARANCE, -1.0
        ).T
        return {"faces": faces, "faces_offset": offsets}

    def _risks(self, stages: _Stages, plan: Plan) -> Array:
        """Return the probabilities of leaving the half spaces; shape (k, N)."""
        margins = stages.sides.margins(plan.states[1:])
        # On the way from the last state to where the agent comes to rest, the margin lies between those at both ends.
        resting = stages.sides.margins(np.concatenate([plan.states[1:-1], (self._policy.rest @ plan.states[-1])[None]]))
        margins = np.minimum(margins, resting)
        fails = exceeding(np.where(stages.counts, margins, 1.0), stages.deviations, self._given.risk_bound)[0]
        return np.where(stages.counts, np.minimum(stages.weights * fails, 1.0), 0.0)

    def _first(self, stages: _Stages, risks: Array, parts: Array) -> tuple[str, int]:
        """Return the specification that is not kept, and the first instant at which it is not."""
        excess = np.where(stages.counts, risks - parts, -np.inf)
        stage = int(np.flatnonzero((excess >= min(0.0, float(excess.max()))).any(axis=0))[0])
        return stages.names[int(excess[:, stage].argmax())], int(stages.times[stage])


def _rank(found: ChancePlan) -> tuple[bool, bool, float, float]:
    solved, kept = found.decision.solution.solved, found.unkept is None
    return not solved, not kept, 0.0 if kept else found.risk, found.decision.solution.cost
