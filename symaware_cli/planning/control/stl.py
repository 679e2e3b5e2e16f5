"""Planning to satisfy specifications in signal temporal logic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from symaware_cli.core import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    Component,
    KnowledgeDatabase,
    Level,
    Quantity,
    ScenarioView,
    Signal,
    TimeSeries,
)
from symaware_cli.engine import require_known_states, slowest, state_covariance
from symaware_cli.geometry import Array
from symaware_cli.planning.control.stl_chance import ChosenSides, Margins, StlChance
from symaware_cli.planning.control.stl_horizon import planned_steps
from symaware_cli.planning.control.stl_instances import Instance, open_instances
from symaware_cli.planning.control.stl_others import ExpectedPositions, expected_positions
from symaware_cli.planning.control.stl_plan import FollowedPlan, StlDecision, StlParameters
from symaware_cli.planning.control.stl_program import StlPrograms, own_sets, state_bounds
from symaware_cli.planning.control.stl_reservations import reservations
from symaware_cli.planning.optimal_control import (
    LinearDynamics,
    SpecificationPlan,
    SpecificationProgram,
    pair_sets,
)
from symaware_cli.specification import PairScope, Specification, monitor_of
from symaware_cli.world import SECOND, nanoseconds

#: A plan is followed as it is while the agent is at most this far from it, in each element of the state.
_ON_PLAN = 1e-9


class SpecificationControl(Component):
    """Plans a trajectory that satisfies specifications, with as much robustness and as little effort as is weighed.

    The plan is the solution of a mixed-integer linear program over the steps of the world, up to the last instant that
    the specifications are about, or up to a horizon: see
    `symaware_cli.planning.optimal_control.SpecificationProgram`. For a specification without an end, that instant is
    the end of the run. Past states are fixed. Predicates hold at the steps; a minimal robustness covers the motion in
    between.

    A plan is followed unchanged while the agent is in the planned state. If it deviates, the trajectory is planned anew
    with the same alternatives (which regions in which order, on which side of obstacles); these are chosen anew after
    an interval, when specifications begin, or when they cannot be kept.

    If there is no plan, an event names specifications that are in conflict: without any one of them, there would be a
    plan for the others. The agent follows the rest of the last plan, then slows down as far as its model can.

    With a ``maximal_risk`` the specifications are kept in the whole run with a probability of a violation of at most
    that: for linear models with normal noise each constraint is exact, and their sum is an upper bound (Boole's
    inequality). With ``risk_bound: chebyshev`` only the covariance of the noise is assumed. In worlds with forces the
    motion is approximated by that of the linear model, and for pairs others are expected to follow their intents or to
    keep their velocities: with these approximations the bound is not guaranteed, and ``validate`` warns of it.
    """

    specifications = "specifications"
    signals = (
        Signal(
            "plan",
            columns=[Quantity("robustness", ""), Quantity("gap", "")],
            description="the least robustness of the specifications if the run ended with the plan, and the gap of the"
            " last search",
            infinity="the plan is for no specification, or the search found no bound of the cost",
        ),
        Signal(
            "risk_budget",
            columns=[Quantity("planned", "1"), Quantity("spent", "1")],
            description="with `maximal_risk`: a bound of the risk of the rest of the plan, and the risk taken so far",
        ),
    )
    events: ClassVar = {
        "planned": "There is a new plan, after a search; `robustness` is the least of its specifications, if the run "
        "ended with it; `gap` how much better the best plan may be, in units of the cost.",
        "infeasible": "There is no plan; `conflict` names specifications that cannot hold together, `left` the number "
        "of steps left of the last plan. Fired once until there is a plan again.",
        "solver-failed": "The search ended without a plan at the limit of nodes; `left` is the number of steps left of "
        "the last plan.",
        "done": "Nothing is left to be planned for: every specification is decided.",
    }

    class Parameters(StlParameters):
        """The specifications to plan for, and the settings of plans."""

    def __init__(self, parameters: Any = None) -> None:
        super().__init__(parameters)
        if self.parameters.maximal_risk is None:
            vars(self)["signals"] = self.signals[:1]

    def check(self, group: AgentGroup) -> None:
        """Check that the model is linear, and that its control input or state is limited."""
        dynamics = LinearDynamics.of(group.model, group.model.time_step or 0.1)
        low, high = state_bounds(self.parameters, group.model)
        limited = np.isfinite([*dynamics.least, *dynamics.greatest]).all()
        if not limited and not np.isfinite([*low, *high]).all():
            raise ValueError("a plan needs limits of the model's control input, or `bounds` of the whole state")

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that states are known, which a maximal risk requires."""
        require_known_states(view)

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that the predicates are linear in the state, or compare distances of pairs with numbers."""
        if specification.automaton is not None:
            raise ValueError("it is in linear temporal logic")
        if specification.each is None:
            if not isinstance(specification.scope, PairScope):
                raise ValueError("it is about so many pairs that only the closest is known")
            size = len(group.model.position)
            pair_sets(specification.formulation, group.model, "", np.zeros(size), np.zeros((size, size)))
            return
        for row in range(len(group)):
            own_sets(specification, group, row)

    def find_warnings(self, view: ScenarioView) -> None:
        """Warn of missing guarantees with `maximal_risk`, of requirements beyond the horizon, and of long searches."""
        assert view.entry is not None
        own, environment = view.named_specifications, view.environment
        for said in reservations(self.parameters, view.entry.group, own, environment, view.steps):
            view.warn(said)

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the intent as positions."""
        return {"intent": [group.model.state[index] for index in group.model.position]}

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Derive the dynamics over a step of the world."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._step = self.environment.time_step
        self._programs = StlPrograms(self.parameters, agent.group, self.environment)
        #: The greatest number of steps of a plan; None for all that are left.
        self._most = self._greatest_length(agent.group)
        self._plan: FollowedPlan | None = None
        self._chance: StlChance | None = None
        if self.parameters.maximal_risk is not None:
            noise, given = agent.group.model.noise_covariance(self._step / SECOND), self.parameters
            self._chance = StlChance(self._programs.dynamics, noise, given.maximal_risk, given.risk_bound)
        #: What is left of the greatest risk beside that of the plan, the risk that was taken so far, and when.
        self._unassigned, self._spent = self.parameters.maximal_risk or 0.0, 0.0
        self._taken: int | None = None
        #: When a search last failed, in nanoseconds.
        self._failed: int | None = None
        self._is_done = False

    def _compute(self) -> StlDecision:
        agent, present = self._agent, -(-self.now // self._step) * self._step
        if self._taken is not None and self.now != self._taken + self._step:
            raise ValueError("with `maximal_risk` it takes a turn at each step of the world, and it missed one")
        instances = open_instances(agent, self.parameters.specifications, present, self._step)
        if not instances:
            return StlDecision(self._slowest(), None, "done")
        state = self._state_at(present)
        aims = tuple((f"{each.specification.name} {each.other}".strip(), each.start) for each in instances)
        plan = self._plan
        stage = 0 if plan is None else (present - plan.made) // self._step
        rest = None if plan is None or stage >= len(plan.inputs) else plan.states[stage:]
        due = self._is_due(plan, aims, present, any(each.other for each in instances))
        followed = self._followed_on(plan, stage, state, "followed")
        if plan is not None and rest is not None and not due:
            if self._chance is not None or np.abs(rest[0] - state).max() <= _ON_PLAN:
                return followed
            steps, is_whole = self._extent(instances)
            again = self._program(instances, state, steps, is_whole).solve_as_chosen(_fitted(rest, steps))
            if again.inputs is not None:
                anew = self._followed(again, present, plan.searched, aims, is_whole)
                return StlDecision(again.inputs[0], anew._replace(gap=plan.gap), "followed")
        if self._failed is not None and self.now < self._failed + nanoseconds(self.parameters.interval):
            return self._without(followed, "followed")
        steps, is_whole = self._extent(instances)
        guess = None if rest is None else _fitted(rest, steps)
        allowed = self._allowed(followed)
        found, sides, risk = self._searched(instances, state, steps, is_whole, guess, allowed)
        if found.inputs is not None:
            expected = {name: each.mean for name, each in self._others(instances, steps).items()}
            new = self._followed(found, present, present, aims, is_whole)._replace(
                sides=sides, unassigned=allowed - risk, expected=expected
            )
            return self._followed_on(new, 0, state, found.status)._replace(gap=new.gap)
        conflict: tuple[str, ...] = ()
        if found.status == "infeasible" and self._failed is None:
            conflict = self._conflict(instances, state, steps, allowed, is_whole=is_whole)
        return self._without(followed, found.status)._replace(conflict=conflict, allowed=allowed)

    def _update(self, value: StlDecision) -> None:
        self._agent.model.control_input = value.control_input
        before, self._plan = self._plan, value.plan
        if value.plan is not None and value.plan is not before:
            self._unassigned = value.plan.unassigned
        self._count_risk(value)
        if value.status == "done":
            self._finish()
        elif value.status in ("infeasible", "node limit", "failed", "unbounded") and value.plan is before:
            self._report_failure(value)
        elif value.plan is not None and value.plan is not before:
            self._is_done = False
            self._agent.self_awareness.intent = self._intent(value.plan)
            self.record(self.signals[0], np.array([value.plan.robustness, value.plan.gap]))
            if value.status != "followed":
                self._failed = None
                self._report_plan(value, value.plan)

    def _count_risk(self, value: StlDecision) -> None:
        """Add up the risk that is taken until the next step of the world."""
        if self._chance is None:
            return
        planned = 0.0
        if value.risk is not None:
            planned = value.risk.total
            self._spent += value.risk.following
        self._taken = self.computed_at
        self.record(self.signals[1], np.array([planned, self._spent]))

    def _report_plan(self, value: StlDecision, plan: FollowedPlan) -> None:
        said = f"has a plan with a robustness of {plan.robustness:.4g}"
        data: dict[str, Any] = {}
        if not plan.is_whole:
            said += f" over its {len(plan.inputs) * self._step / SECOND:g} s"
        if value.risk is not None:
            said += f" and a risk of {value.risk.total:.2g}"
            data = {"risk": value.risk.total, "spent": self._spent}
        if value.status == "node limit":
            said += f", which may be {value.gap:.3g} from the best: the search ended at its limit of nodes"
        self.emit("planned", said, robustness=plan.robustness, gap=value.gap, **data)

    def _finish(self) -> None:
        if not self._is_done:
            self._is_done = True
            self._agent.self_awareness.intent = TimeSeries()
            self.emit("done", "has nothing left to plan for")

    def _report_failure(self, value: StlDecision) -> None:
        plan = value.plan
        left = 0 if plan is None else max(0, len(plan.inputs) - (self.computed_at - plan.made) // self._step)
        is_first, self._failed = self._failed is None, self.computed_at
        follows = left and self.parameters.fallback == "last-plan"
        instead = f"follows its last plan, of which {left} steps are left" if follows else "slows down"
        if value.status != "infeasible":
            said = f"no new plan ({value.status}); {instead}"
            self.emit("solver-failed", said, level=Level.WARNING, status=value.status, left=left)
        elif is_first:
            names = " and ".join(value.conflict)
            said = f"{names} cannot hold{' together' if len(value.conflict) > 1 else ''}"
            data: dict[str, Any] = {}
            if self._chance is not None:
                said += f" with a risk of at most {value.allowed:.2g}, which is left"
                data = {"allowed": value.allowed, "spent": self._spent}
            said += f"; {instead}"
            self.emit("infeasible", said, level=Level.WARNING, conflict=list(value.conflict), left=left, **data)

    # Programs

    def _program(
        self,
        instances: Sequence[Instance],
        state: Array,
        steps: int,
        is_whole: bool,
        plain: bool = False,
        margins: Margins | None = None,
    ) -> SpecificationProgram:
        others = self._others(instances, steps)
        return self._programs.of(instances, self._agent.row, state, steps, is_whole, others, plain, margins)

    def _others(self, instances: Sequence[Instance], steps: int) -> dict[str, ExpectedPositions]:
        """Return where the other agents of pairs are expected from the present step on, as far as that is known."""
        times = -(-self.now // self._step) * self._step + self._step * np.arange(steps + 1, dtype=np.int64)
        found = {}
        for name in sorted({each.other for each in instances if each.other}):
            expected = expected_positions(self._agent, name, times)
            if expected is not None:
                found[name] = expected
        return found

    def _extent(self, instances: Sequence[Instance]) -> tuple[int, bool]:
        """Return how many steps to plan, and whether these lead to the last instant that counts."""
        last = max(each.last for each in instances)
        if self._most is None or last <= self._most:
            return last, True
        return self._most, False

    def _greatest_length(self, group: AgentGroup) -> int | None:
        """Return how many steps ahead to plan at most; None for as many as are left."""
        if self.parameters.horizon is not None:
            return max(1, round(nanoseconds(self.parameters.horizon) / self._step))
        return planned_steps([monitor_of(group, name).specification for name in self.parameters.specifications])

    def _searched(
        self,
        instances: Sequence[Instance],
        state: Array,
        steps: int,
        is_whole: bool,
        guess: Array | None,
        allowed: float,
    ) -> tuple[SpecificationPlan, ChosenSides | None, float]:
        """Return the result of a search; with `maximal_risk`, the half spaces of the plan and its risk as well."""

        def solve(program: SpecificationProgram) -> SpecificationPlan:
            return program.solve(nodes=self.parameters.nodes, gap=self.parameters.gap, guess=guess)

        if self._chance is None:
            return solve(self._program(instances, state, steps, is_whole)), None, 0.0

        def program(margins: Margins) -> SpecificationProgram:
            return self._program(instances, state, steps, is_whole, margins=margins)

        return self._chance.search(program, solve, steps, allowed, self._believed())

    def _conflict(
        self, instances: Sequence[Instance], state: Array, steps: int, allowed: float, *, is_whole: bool
    ) -> tuple[str, ...]:
        """Return names of specifications that cannot hold together, though they can without any one of them."""
        kept = list(instances)
        margins = None if self._chance is None else self._chance.margins(steps, allowed, allowed, self._believed())
        for each in instances:
            fewer = [other for other in kept if other is not each]
            if not fewer:
                break
            program = self._program(fewer, state, steps, is_whole, plain=True, margins=margins)
            found = program.solve(nodes=self.parameters.nodes)
            if found.status == "infeasible":
                kept = fewer
        return tuple(dict.fromkeys(each.specification.name for each in kept))

    def _believed(self) -> Array:
        """Return the covariance of the belief of the state; shape (nx, nx)."""
        covariance = state_covariance(self._agent.group)
        size = len(self._agent.group.model.state)
        return np.zeros((size, size)) if covariance is None else covariance[self._agent.row]

    # Plans

    def _is_due(
        self, plan: FollowedPlan | None, aims: tuple[tuple[str, int], ...], present: int, about_others: bool
    ) -> bool:
        """Return whether it is time for a search."""
        if plan is None or not set(aims) <= set(plan.aims):
            return True
        return (about_others or not plan.is_whole) and present >= plan.searched + nanoseconds(self.parameters.interval)

    def _followed(
        self, found: SpecificationPlan, made: int, searched: int, aims: tuple[tuple[str, int], ...], is_whole: bool
    ) -> FollowedPlan:
        assert found.states is not None
        assert found.inputs is not None
        robustness = min(found.robustness.values(), default=np.inf)
        return FollowedPlan(found.states, found.inputs, made, searched, aims, is_whole, robustness, found.solution.gap)

    def _followed_on(self, plan: FollowedPlan | None, stage: int, state: Array, status: str) -> StlDecision:
        """Return how a plan is followed at one of its instants; if there is none, the agent slows down."""
        if plan is None or stage >= len(plan.inputs):
            return StlDecision(self._slowest(), plan, status)
        if self._chance is None or plan.sides is None:
            return StlDecision(plan.inputs[stage], plan, status)
        sides = self._present_sides(plan) if plan.expected else plan.sides
        control_input, risk = self._chance.remaining(sides, plan.states, plan.inputs, stage, state, self._believed())
        return StlDecision(control_input, plan, status, risk=risk)

    def _allowed(self, followed: StlDecision) -> float:
        """Return the greatest risk of a new plan: the unassigned risk plus that of the rest of the last plan.

        If other agents do not move as expected, the risk of the last plan has no known bound; so with other agents, a
        new plan may at most have the risk that is not spent yet.
        """
        rest = 0.0 if followed.risk is None else followed.risk.total
        allowed = self._unassigned + rest
        if followed.plan is not None and followed.plan.expected and self.parameters.maximal_risk is not None:
            allowed = min(allowed, max(0.0, self.parameters.maximal_risk - self._spent))
        return allowed

    def _present_sides(self, plan: FollowedPlan) -> ChosenSides:
        """Return the half spaces of a plan, those that move with other agents where these are expected now."""
        sides = plan.sides
        assert sides is not None
        offsets, variances = sides.offsets.copy(), sides.variances.copy()
        places = list(self._agent.group.model.position)
        times = plan.made + self._step * np.arange(len(plan.states), dtype=np.int64)
        for name, before in plan.expected.items():
            expected = expected_positions(self._agent, name, np.maximum(times, self.now))
            chosen = np.flatnonzero(np.array(sides.around) == name)
            if expected is not None and len(chosen):
                instants, along = sides.instants[chosen], sides.normals[chosen][:, places]
                offsets[chosen] += (along * (before[instants] - expected.mean[instants])).sum(axis=1)
                variances[chosen] = np.einsum("ki,kij,kj->k", along, expected.covariance[instants], along)
        return sides._replace(offsets=offsets, variances=variances)

    def _without(self, followed: StlDecision, status: str) -> StlDecision:
        """Return what to do without a new plan."""
        if self.parameters.fallback == "last-plan":
            return followed._replace(status=status)
        return followed._replace(status=status, control_input=self._slowest())

    def _slowest(self) -> Array:
        model = self._agent.group.model
        return slowest(model, self._agent.self_state, model.limit(self._agent.control_input[None]))

    def _state_at(self, present: int) -> Array:
        """Return the state at the next step of the world, which is the present one if a step is taken now."""
        state = self._agent.self_state
        if present == self.now:
            return state
        model = self._agent.group.model
        ahead = LinearDynamics.of(model, (present - self.now) / SECOND)
        return ahead.after(state, model.limit(self._agent.control_input[None])[0])

    def _intent(self, plan: FollowedPlan) -> TimeSeries:
        times = plan.made + np.arange(len(plan.states), dtype=np.int64) * self._step
        return TimeSeries.sampled(times, self._agent.group.model.positions(plan.states))


def _fitted(states: Array, steps: int) -> Array:
    """Return states for a number of steps; the last one is repeated."""
    missing = steps + 1 - len(states)
    return states[: steps + 1] if missing <= 0 else np.concatenate([states, np.repeat(states[-1:], missing, axis=0)])
