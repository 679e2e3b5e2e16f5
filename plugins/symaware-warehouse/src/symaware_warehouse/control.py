"""The controller: plans, follows its plan, and bids the cost of further specifications."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    Component,
    KnowledgeDatabase,
    Level,
    Quantity,
    Signal,
    TimeSeries,
    nanoseconds,
    seconds,
)
from symaware_cli.formulas import Specification
from symaware_warehouse.plan_parameters import PlanParameters
from symaware_warehouse.planner import Bid, Commitment, PlannedTube, Planner, Progress
from symaware_warehouse.told_tube import ToldTube

Array = NDArray[np.float64]

#: The probability of the ellipse that is drawn of a covariance in the plane, as the square of its radius in deviations.
_ELLIPSE = 5.991464547107979


@dataclass(frozen=True, slots=True, eq=False)
class TubeDecision:
    """The result of a turn.

    Attributes:
        control_input: The control input to request; shape (2,).
        progress: The progress up to the present step.
        plan: The plan to follow; None if there is none.
        is_new: Whether it was made in this turn.
        starts: The first steps of the specifications that the robot has to satisfy, by name.
        required: Those of them that are not decided.
        answered: Marks of the offers that bids were made for.
        bids: New bids, and the time from which the offer is open [s]; by name of the specification.
        risk: The risk of all accepted specifications.
    """

    control_input: Array
    progress: Progress
    plan: PlannedTube | None
    is_new: bool
    starts: Mapping[str, int]
    required: tuple[str, ...]
    answered: tuple[str, ...]
    bids: Mapping[str, tuple[Bid, float]]
    risk: float


class TubeControl(Component):
    """Satisfies the specifications that a robot has accepted, each with a probability of at least 1 - epsilon.

    The robot is x+ = x + u + w with normal w. A plan up to the end of the horizon has a tube: at each future step the
    robot is with some probability within a radius of the plan, and the predicates that a specification needs hold
    everywhere in the tube (`symaware_warehouse.Planner`). The plan is a mixed-integer program. Its alternatives (which
    region when, on which side of a wall) are searched when the robot has accepted a specification or one is decided,
    and otherwise kept: each step has a new plan, from the position of the robot. Without a plan, the last one is
    followed with the feedback that the tube is designed for.

    With a `step` the plan consists of positions for a robot with another model, such as a differential drive, which
    `warehouse.track` moves along the straight lines between them. Then the predicates hold on these lines, too, and by
    `margin` beyond the tube.

    The specifications are those of the scenario that are in force by themselves, and offered ones that a component such
    as `allocation.nearest` or an auction accepts. The risk of an offered one is at most its epsilon.

    The risk of the robot is the sum of the risks of its accepted specifications, each over its past and future steps.
    The plan is the intent, and the tube is its uncertainty: the `radius`, and the covariance that a replay draws as
    this circle.

    For each offered specification that it knows, the knowledge `bids` has, by name, the cost of accepting it: `cost`,
    the least future risk of all specifications that the robot would then have, or null if there is no plan with it;
    `since`, from the offer, and `at`, the time of the bid [s]. Bids are renewed when the robot has accepted a
    specification. `allocation.auction` reads them, with `bids: bids`.
    """

    specifications = "specifications"
    signals = (
        Signal(
            "tube",
            columns=[Quantity("cost", "1"), Quantity("energy", "1"), Quantity("radius", "m")],
            description="the cost of the plan from the present on, its energy, and the radius of the next step",
        ),
    )
    events: ClassVar[Mapping[str, str]] = {
        "planned": "A search has found a plan: its `cost`, and the greatest possible improvement, `gap`.",
        "bid": "The robot bids: `costs` of specifications by name, null without a plan, with `reasons`.",
        "infeasible": "There is no plan; the last one is followed, with feedback. Fired once until there is one.",
    }

    class Parameters(PlanParameters):
        """The specifications to plan for, and the settings of plans."""

    def check(self, group: AgentGroup) -> None:
        """Check that the model is x+ = x + u + w with limited u and known noise, or that a plan can be made without."""
        if self.parameters.step is not None and len(group.model.position) != 2:
            raise ValueError("plans are for robots that move in a plane")
        for row in range(len(group)):
            self.parameters.planner(group, row, self._plan_step(group), 0)

    def _plan_step(self, group: AgentGroup) -> float:
        """Return the duration of a step of the plan, before the world is known [s]."""
        return self.parameters.step or group.model.time_step or 1.0

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that a specification is linear in the state, and that its epsilon is possible."""
        if specification.each is None:
            raise ValueError("it is about pairs or the world, which one robot does not plan for")
        if specification.automaton is not None:
            raise ValueError("it is in linear temporal logic")
        epsilon = None if specification.offer is None else specification.offer.epsilon
        every = self.parameters.every(specification.formulation.time_step)
        commitment = Commitment.of(specification, group.model, group.regions, 0, epsilon, every)
        step = self._plan_step(group)
        planners = [self.parameters.planner(group, row, step, 0) for row in range(len(group))]
        planner = min(planners, key=lambda each: each.tube.least_risk)
        if epsilon is not None and not commitment.is_possible(planner.steps, planner.tube):
            count = len(commitment.steps(planner.steps))
            raise ValueError(
                f"its {count} steps have a risk of at least {count * planner.tube.least_risk:g}, above its epsilon of "
                f"{epsilon:g}: a `least_risk` of {epsilon / count:.3g} makes it possible"
            )

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the intent as positions, and the uncertainty as covariances and radii."""
        x, y = (group.model.state[index] for index in group.model.position)
        covariance = [Quantity(f"cov_{one.name}_{other.name}", "m*m") for one in (x, y) for other in (x, y)]
        return {
            "intent": [x, y],
            "uncertainty": [*covariance, Quantity("radius", "m")],
            "risk": [Quantity("risk", "1")],
        }

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start without a plan."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        time_step = self.environment.time_step
        self._step: int = time_step * self.parameters.every(time_step)
        #: The step of the plan at which the robot begins; its own steps count from there.
        self._origin = -(-self.now // self._step)
        self._planner: Planner = self.parameters.planner(agent.group, agent.row, seconds(self._step), self._origin)
        self._progress: Progress | None = None
        self._plan: PlannedTube | None = None
        self._starts: Mapping[str, int] = {}
        self._required: tuple[str, ...] = ()
        self._answered: tuple[str, ...] = ()
        self._is_lost = False

    # A turn

    def _compute(self) -> TubeDecision:
        planner = self._planner
        state = self._agent.self_state[list(self._agent.group.model.position)]
        before, plan = self._progress, self._plan
        if before is None:
            progress = Progress.beginning(state)
        else:
            progress = before.after(state, 1.0 if plan is None else plan.risk_at(before.step + 1))
        starts = self._all_starts(progress.step)
        accepted, required = self._commitments(starts, progress.step)
        answered, needed = self._unanswered(required)
        bids = {name: (self._bid(name, required, progress), since) for name, since in needed.items()}
        found, control_input = None, np.zeros(2)
        if progress.step < planner.steps:
            event = plan is None or not {each.name for each in required} <= {*self._required}
            found = planner.solve(required, progress, plan, event, self._others())
            if found is not None:
                plan, control_input = found, found.inputs[0]
            elif plan is not None:
                control_input = plan.input_at(progress.step, state, self.parameters.feedback)
        risk = planner.risk(accepted, progress, plan)
        names_required = tuple(each.name for each in required)
        return TubeDecision(
            control_input, progress, plan, found is not None, starts, names_required, answered, bids, risk
        )

    def _update(self, value: TubeDecision) -> None:
        agent, awareness, now = self._agent, self._agent.self_awareness, self.computed_at
        if self.parameters.step is None:
            agent.model.control_input = value.control_input
        self._progress, self._plan = value.progress, value.plan
        self._starts, self._required, self._answered = value.starts, value.required, value.answered
        awareness.risk = TimeSeries.sampled([now], [value.risk])
        if value.bids:
            self._tell(value.bids)
        plan = value.plan
        if value.progress.step >= self._planner.steps:
            return
        if not value.is_new or plan is None:
            if not self._is_lost:
                self._is_lost = True
                names = ", ".join(value.required)
                instead = "stands still" if plan is None else "follows its last plan"
                self.emit(
                    "infeasible", f"no plan for {names}; {instead}", level=Level.WARNING, left=list(value.required)
                )
            return
        self._is_lost = False
        times = now + np.arange(len(plan.positions), dtype=np.int64) * self._step
        awareness.intent = TimeSeries.sampled(times, plan.positions)
        variances = np.square(plan.radii) / _ELLIPSE
        none = np.zeros(len(variances))
        awareness.uncertainty = TimeSeries.sampled(
            times, np.column_stack([variances, none, none, variances, plan.radii])
        )
        energy = self.parameters.energy * float(np.square(plan.inputs).sum())
        self.record(self.signals[0], np.array([plan.cost, energy, plan.radii[1]]))
        if plan.status == "searched":
            gap = max(0.0, plan.cost - plan.bound)
            text = f"a plan for {', '.join(value.required)} costs {plan.cost:.4g}"
            self.emit("planned", text, cost=plan.cost, gap=gap, specifications=list(value.required))

    def _tell(self, bids: Mapping[str, tuple[Bid, float]]) -> None:
        """Write bids as knowledge."""
        knowledge, at = self._agent.self_knowledge, seconds(self.computed_at)
        said = {name: {"since": since, "at": at, "cost": bid.cost} for name, (bid, since) in bids.items()}
        knowledge["bids"] = {**knowledge.get("bids", {}), **said}
        costs = {name: bid.cost for name, (bid, _) in bids.items()}
        reasons = {name: bid.status for name, (bid, _) in bids.items() if bid.cost is None}
        text = ", ".join(f"{name} {reasons[name] if cost is None else f'{cost:g}'}" for name, cost in costs.items())
        self.emit("bid", text, costs=costs, reasons=reasons)

    # Specifications

    def _all_starts(self, step: int) -> dict[str, int]:
        """Return the first steps of the specifications in force for the robot, counted from its own beginning."""
        agent = self._agent
        statuses = agent.specifications
        names = [name for name in self.parameters.specifications if name in statuses]
        return {name: self._starts.get(name, self._start(name, step)) for name in names}

    def _start(self, name: str, step: int) -> int:
        """Return the step at which a specification began, or begins."""
        statuses = self._agent.group.specifications[name]
        began = statuses.began
        if began is None:
            began = max(self.now, statuses.specification.start)
        place: int = -(-began // self._step) - self._origin
        return max(0, place)

    def _commitments(self, starts: Mapping[str, int], step: int) -> tuple[list[Commitment], list[Commitment]]:
        """Return the specifications that the robot has to satisfy, and the undecided ones among them.

        One that is violated already, and was not offered, is required again from the present on: a robot that was in a
        wall still avoids walls.
        """
        statuses = self._agent.specifications
        accepted, required = [], []
        for name, start in starts.items():
            commitment = self._commitment(name, start)
            accepted.append(commitment)
            verdict = statuses[name].verdict
            if verdict is None:
                required.append(commitment)
            elif verdict is False and commitment.epsilon is None:
                required.append(commitment._replace(start=step))
        return accepted, required

    def _commitment(self, name: str, start: int) -> Commitment:
        group = self._agent.group
        specification = group.specifications[name].specification
        if specification is None:
            raise ValueError("a plan needs the specifications themselves, which a process of its own does not have")
        epsilon = None
        if specification.offer is not None:
            epsilon = math.inf if specification.offer.epsilon is None else specification.offer.epsilon
        every = self.parameters.every(specification.formulation.time_step)
        return Commitment.of(specification, group.model, group.regions, start, epsilon, every)

    def _others(self) -> Sequence[ToldTube]:
        """Return the received plans of robots with a lower index, if this robot is to stay apart from them."""
        if self.parameters.separation is None:
            return ()
        agent = self._agent
        # As it was sent: what the robot believes itself of the other's position now is less.
        sent = agent.awareness_database.received
        known = [(id, sent[id]) for id in agent.group.ids[: agent.row] if id in sent]
        told = (ToldTube.of(id, each.intent, each.uncertainty, self._step, self._origin) for id, each in known)
        return [each for each in told if each is not None]

    # Bids

    def _unanswered(self, required: Sequence[Commitment]) -> tuple[tuple[str, ...], Mapping[str, float]]:
        """Return marks of the present offers, and the times from which those that need a new bid are open [s]."""
        if not self.parameters.bids:
            return (), {}
        offers = self._agent.offers
        held = " ".join(each.name for each in required if each.epsilon is not None)
        marks = {name: f"{name} since {offers[name]['since']} beside {held}" for name in sorted(offers)}
        # An auction removes bids that are used: new ones are needed then.
        made = self._agent.self_knowledge.get("bids", {})
        needed = {
            name: offers[name]["since"]
            for name, mark in marks.items()
            if mark not in self._answered or name not in made
        }
        return tuple(marks.values()), needed

    def _bid(self, name: str, required: Sequence[Commitment], progress: Progress) -> Bid:
        if name not in self.parameters.specifications or name not in self._agent.group.specifications:
            return Bid(None, "unknown")
        held = [each for each in required if each.name != name]
        if progress.step >= self._planner.steps:
            return Bid(None, "infeasible")
        notice = min(nanoseconds(self.parameters.notice) // self._step, self._planner.steps - 1 - progress.step)
        start = self._start(name, progress.step)
        return self._planner.bid(self._commitment(name, start), held, progress.along(self._plan, notice))
