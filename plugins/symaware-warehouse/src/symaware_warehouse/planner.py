"""Planners: robust plans of one robot for the specifications that it has accepted, and the cost of one more."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli import Model
from symaware_cli.formulas import Region, Specification
from symaware_cli.planning.optimal_control import (
    Affine,
    LinearDynamics,
    SpecificationPlan,
    SpecificationProgram,
    avoid_moving_box,
    margins,
    predicate_sets,
    sampled,
    state_names,
)
from symaware_warehouse.told_tube import ToldTube
from symaware_warehouse.tube import Tube

Array: TypeAlias = NDArray[np.float64]

#: How often a plan is made again with the alternatives that it chooses itself: it may come by better ones.
_POLISHES = 3

#: The least reduction of the cost for which a plan is made again.
_WORTH = 1e-4

#: The way in which a plan was found: by a search, or with the alternatives of the last plan.
PlanStatus = Literal["searched", "followed"]


class Commitment(NamedTuple):
    """A specification that a robot has accepted, or may accept.

    Attributes:
        name: The name of the specification.
        formulation: Its formula, in steps of the plan.
        sets: Of each predicate the states in which it holds, and those in which its negation does.
        start: The step at which it begins.
        epsilon: The bound of the sum of the risks of its steps; None for no limit.
    """

    name: str
    formulation: Any
    sets: Sequence[Any]
    start: int
    epsilon: float | None

    @classmethod
    def of(
        cls,
        specification: Specification,
        model: Model,
        regions: Mapping[str, Region],
        start: int,
        epsilon: float | None,
        every: int = 1,
    ) -> Commitment:
        """Return the commitment of an agent to a specification, from a step on.

        Args:
            specification: The specification.
            model: The model.
            regions: The regions by name.
            start: The step of the plan at which it begins.
            epsilon: The bound of the sum of the risks of its steps; None for no limit.
            every: The number of steps of the world in a step of the plan. Above 1, predicates that hold at the steps of
                the plan hold on the straight lines between them, too.

        Raises:
            ValueError: A predicate is not linear in the state of the model, or in the position if there are steps in
                between; or there is no formula for the steps of the plan.
        """
        formulation = specification.formulation
        if every == 1:
            sets = predicate_sets(formulation, state_names(model), regions)
            return cls(specification.name, formulation, sets, start, epsilon)
        place = np.eye(2)
        names = {model.state[index].name: Affine(row) for index, row in zip(model.position, place, strict=True)}
        sets = predicate_sets(formulation, {"position": Affine(place), **names}, regions)
        found = sampled(formulation.formula, sets, every)
        return cls(specification.name, found, found.sets, start, epsilon)

    def steps(self, last: int) -> range:
        """Return the steps whose risk counts: those after its start, up to its end or a last step."""
        horizon = self.formulation.horizon
        end = last if horizon is None else min(last, self.start + horizon)
        return range(self.start + 1, end + 1)

    def is_possible(self, last: int, tube: Tube) -> bool:
        """Return whether its epsilon allows the least risk in all of its steps."""
        return self.epsilon is None or len(self.steps(last)) * tube.least_risk <= self.epsilon * (1.0 + 1e-9)


@dataclass(frozen=True, slots=True, eq=False)
class Progress:
    """The progress of a robot.

    Attributes:
        states: The measured states at the steps 0 to k; shape (k + 1, 2).
        risks: The risks that it has taken at these; 0 at step 0. Shape (k + 1,).
    """

    states: Array
    risks: Array

    @classmethod
    def beginning(cls, state: Array) -> Progress:
        """Return the progress at step 0."""
        return cls(np.array(state, float)[None], np.zeros(1))

    @property
    def step(self) -> int:
        """The present step, k."""
        return len(self.states) - 1

    def after(self, state: Array, risk: float) -> Progress:
        """Return the progress one step later, with the state measured then and the risk taken."""
        return Progress(np.concatenate([self.states, state[None]]), np.append(self.risks, risk))

    def along(self, plan: PlannedTube | None, steps: int) -> Progress:
        """Return the progress some steps later if a plan is followed without errors; unchanged without a plan."""
        progress = self
        if plan is None:
            return progress
        for step in range(self.step + 1, self.step + 1 + steps):
            progress = progress.after(plan.positions[step - plan.start], plan.risk_at(step))
        return progress


@dataclass(frozen=True, slots=True, eq=False)
class PlannedTube:
    """A plan with its tube, from a step on.

    Attributes:
        status: The way in which it was found.
        start: The step k at which it begins.
        positions: The positions at the steps from k to N; shape (N - k + 1, 2) [m].
        inputs: The control inputs from k to N - 1; shape (N - k, 2) [m].
        radii: The radii of the tube at the steps from k to N, 0 at k; shape (N - k + 1,) [m].
        risks: The risks of the steps from k to N, 0 at k; shape (N - k + 1,).
        cost: The sum of the risks and of the weighted squares of the control inputs.
        bound: The lower bound of the cost of all plans that the search found.
    """

    status: PlanStatus
    start: int
    positions: Array
    inputs: Array
    radii: Array
    risks: Array
    cost: float
    bound: float

    def rest(self, step: int) -> Array:
        """Return the positions from a later step on."""
        return self.positions[step - self.start :]

    def risk_at(self, step: int) -> float:
        """Return the risk of a step."""
        return float(self.risks[step - self.start])

    def input_at(self, step: int, state: Array, feedback: float) -> Array:
        """Return the control input at a later step, with feedback from the planned position."""
        place = step - self.start
        found: Array = self.inputs[place] - feedback * (state - self.positions[place])
        return found


class Bid(NamedTuple):
    """The cost of accepting a specification.

    Attributes:
        cost: The least future risk of all specifications then accepted; None if there is no plan.
        status: As in `SpecificationPlan`.
    """

    cost: float | None
    status: str


@dataclass(frozen=True, slots=True, eq=False)
class Planner:
    """Plans for one robot, x+ = x + u + w, up to a last step; it keeps nothing between two calls.

    A plan has a tube: at each future step the robot may be anywhere within a radius, which is a variable of the
    program, and each predicate in use holds everywhere in this circle. The risk of a step bounds the probability that
    the robot is not in its tube (`Tube`). The risks of the past and future steps of an accepted specification add up to
    at most its epsilon; then it fails with at most that probability. Past steps count only as far as they leave the
    least risk for each future step, so that they make no program infeasible; the excess is in the recorded risk. There
    is no bid on a specification that needs more than its epsilon even so.

    Attributes:
        dynamics: The dynamics of a step.
        tube: The tube.
        steps: The last step, N.
        energy: The weight of the squares of the control inputs [1/m^2].
        tangents: The number of tangents that approximate these squares during a search.
        gap: The greatest excess of the cost of a plan over the best one.
        tolerance: The greatest excess of the energy over that of the program.
        nodes: The limit of a search: the nodes of its tree.
        margin: The margin by which predicates hold beyond the radius of the tube [m].
        separation: The distance between this robot's tube and those received from others, along x or along y [m].
    """

    dynamics: LinearDynamics
    tube: Tube
    steps: int
    energy: float = 0.001
    tangents: int = 3
    gap: float = 0.05
    nodes: int = 5_000
    tolerance: float = 1e-6
    margin: float = 0.0
    separation: float = 0.0

    def bid(self, offer: Commitment, accepted: Sequence[Commitment], progress: Progress) -> Bid:
        """Return the cost of accepting a specification.

        The cost is the least sum of the risks of the specifications that the robot would then have, each over its own
        steps, from the present on. It is rounded to six decimals, so that equal bids are equal to the bit.
        """
        if not offer.is_possible(self.steps, self.tube):
            return Bid(None, "infeasible")
        program = _TubeProgram(self, [*accepted, offer], progress, energy=False)
        found = program.specifications.solve(nodes=self.nodes, gap=1e-6)
        return Bid(None if found.states is None else round(found.solution.cost, 6), found.status)

    def solve(
        self,
        accepted: Sequence[Commitment],
        progress: Progress,
        last: PlannedTube | None = None,
        event: bool = True,
        others: Sequence[ToldTube] = (),
    ) -> PlannedTube | None:
        """Return a plan from the present step on; None if there is none.

        Args:
            accepted: The specifications to satisfy.
            progress: The progress so far.
            last: The last plan.
            event: Whether to search for the best alternatives; otherwise those of the last plan are kept, and a search
                follows only if that is impossible.
            others: The plans of other robots, from whose tubes that of this robot stays apart; bids ignore them.
        """
        program = _TubeProgram(self, accepted, progress)
        for other in others:
            program.keep_apart(other)
        rest = None if last is None else last.rest(progress.step)
        if not event and rest is not None:
            again = program.specifications.solve_as_chosen(rest, self.tolerance)
            if again.states is not None:
                return program.plan(again, "followed")
        found = program.specifications.solve(nodes=self.nodes, gap=self.gap, guess=rest, refine=False)
        states, best = found.states, None
        if states is None:
            return None
        for _ in range(_POLISHES):
            better = program.specifications.solve_as_chosen(states, self.tolerance)
            if better.states is None or (best is not None and not _is_cheaper(better, best)):
                break
            best, states = better, better.states
        # What the positions seem to choose may cost more than what the search chose.
        searched = program.specifications.refined(found, self.tolerance)
        if best is None or _is_cheaper(searched, best):
            best = searched
        return program.plan(best, "searched", found.solution.bound)

    def risk(self, accepted: Sequence[Commitment], progress: Progress, plan: PlannedTube | None) -> float:
        """Return the sum of the risks of specifications with an epsilon, each over its steps so far and to come."""
        taken = progress.risks
        if plan is not None:
            taken = np.append(taken, plan.risks[progress.step - plan.start + 1 :])
        counted = [each.steps(len(taken) - 1) for each in accepted if each.epsilon is not None]
        return float(sum(taken[steps.start : steps.stop].sum() for steps in counted))


def _is_cheaper(plan: SpecificationPlan, other: SpecificationPlan) -> bool:
    """Whether a plan costs less than another one, by enough to be worth another solution."""
    return plan.solution.cost <= other.solution.cost - _WORTH


class _TubeProgram:
    """The program of a plan with a tube."""

    def __init__(
        self,
        planner: Planner,
        accepted: Sequence[Commitment],
        progress: Progress,
        *,
        energy: bool = True,
    ) -> None:
        self._planner = planner
        self._progress = progress
        tube, present = planner.tube, progress.step
        count = planner.steps - present
        self.specifications = SpecificationProgram(planner.dynamics, progress.states[-1], count)
        program = self.specifications.program
        limited = [each.steps(planner.steps) for each in accepted if each.epsilon is not None]
        ahead = range(present + 1, planner.steps + 1)
        # A plan has the risk of each step as its cost, a bid that of each step of each specification.
        weights = [1.0 if energy else float(sum(step in steps for steps in limited)) for step in ahead]
        self._radii = program.add_variables(count, tube.least, tube.greatest)
        self._risks = program.add_variables(count, tube.least_risk, 1.0, weights)
        for place, (radius, risk) in enumerate(zip(self._radii.tolist(), self._risks.tolist(), strict=True)):
            for a, b in tube.chords:
                program.add_row([risk, radius], [1.0, -b], lower=a)
            self.specifications.add_radius(place + 1, radius, tube.least, tube.greatest)
        for each in accepted:
            self._require(each)
        if energy:
            self.specifications.add_effort(planner.energy, planner.tangents)

    def _require(self, commitment: Commitment) -> None:
        planner, present = self._planner, self._progress.step
        first, sets = commitment.start - present, commitment.sets
        past = margins(sets, self._progress.states[commitment.start : present]) if first < 0 else ()
        self.specifications.require(
            commitment.name,
            commitment.formulation.formula,
            sets,
            first=first,
            past=past,
            reduction=lambda half_space, _: planner.margin * math.hypot(*half_space.normal),
        )
        if commitment.epsilon is not None:
            risks = [int(self._risks[step - present - 1]) for step in commitment.steps(planner.steps) if step > present]
            left = max(commitment.epsilon - self.past_risk(commitment), len(risks) * planner.tube.least_risk)
            self.specifications.program.add_row(risks, [1.0] * len(risks), upper=left)

    def keep_apart(self, other: ToldTube) -> None:
        """Require that both tubes are apart, at the steps and on the straight ways between them."""
        positions, radii = other.rest(self._progress.step)
        if len(positions) > 1:
            state, sizes = self._progress.states[-1], radii + self._planner.separation
            avoid_moving_box(self.specifications, other.id, state, positions, sizes)

    def past_risk(self, commitment: Commitment) -> float:
        """Return the risk of the steps of a specification so far."""
        present = self._progress.step
        past = [step for step in commitment.steps(self._planner.steps) if step <= present]
        return float(self._progress.risks[past].sum())

    def plan(self, found: SpecificationPlan, status: PlanStatus, bound: float | None = None) -> PlannedTube:
        """Return a solution as a plan."""
        assert found.states is not None
        assert found.inputs is not None
        assert found.solution.values is not None
        risks = np.append(0.0, found.solution.values[self._risks])
        cost = float(risks.sum() + self._planner.energy * np.square(found.inputs).sum())
        return PlannedTube(
            status=status,
            start=self._progress.step,
            positions=found.states,
            inputs=found.inputs,
            radii=np.append(0.0, found.solution.values[self._radii]),
            risks=risks,
            cost=cost,
            bound=found.solution.bound if bound is None else bound,
        )
