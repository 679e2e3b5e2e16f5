"""Planning to satisfy specifications in signal temporal logic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.components.control.steering import slowest
from symaware_cli.components.control.stl_instances import Instance, open_instances
from symaware_cli.core import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    Component,
    KnowledgeDatabase,
    Level,
    Parameters,
    Quantity,
    Signal,
    TimeSeries,
)
from symaware_cli.geometry.vectors import Array
from symaware_cli.optimal_control import (
    LinearDynamics,
    SpecificationPlan,
    SpecificationProgram,
    predicate_sets,
    state_names,
)
from symaware_cli.specification.specification import Specification
from symaware_cli.world.time import SECOND, nanoseconds

#: [s] How far ahead to plan if no specification has an end.
_HORIZON = 4.0

#: A plan is followed as it is while the agent is at most this far from it, in each element of the state.
_ON_PLAN = 1e-9


class FollowedPlan(NamedTuple):
    """The plan that an agent follows.

    Attributes:
        states: The states from `made` on, one at each step; shape (N + 1, nx).
        inputs: The control inputs; shape (N, nu).
        made: When it was made, in nanoseconds.
        searched: When its alternatives were chosen, in nanoseconds.
        aims: The specifications that it is to satisfy, with the instants that they are about.
        is_whole: Whether it leads to the last instant that the specifications are about.
        robustness: The least robustness of the specifications.
        gap: How much better the best plan may be, in units of the cost.
    """

    states: Array
    inputs: Array
    made: int
    searched: int
    aims: tuple[tuple[str, int], ...]
    is_whole: bool
    robustness: float
    gap: float


class StlDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control input to request; shape (nu,).
        plan: The plan to follow; None if there is none.
        status: What became of the search for a new plan: a status of a program, ``followed`` without a search, or
            ``done`` if nothing is left to be satisfied.
        gap: The gap of the search.
        conflict: The specifications that cannot be satisfied together, if a search ended just now for that reason.
    """

    control_input: Array
    plan: FollowedPlan | None
    status: str
    gap: float = 0.0
    conflict: tuple[str, ...] = ()


class SpecificationControl(Component):
    """Plans a trajectory that satisfies specifications, with as much robustness and as little effort as is weighed.

    The plan is the solution of a mixed-integer linear program over the steps of the world, up to the last instant that
    the specifications are about, or up to a horizon: see `symaware_cli.optimal_control.SpecificationProgram`. What
    happened so far is fixed. Predicates hold at the steps; a minimal robustness covers the motion in between.

    A plan is followed as it is while the agent is where it is expected to be. If it is not, the trajectory is planned
    anew with the same alternatives (which regions in which order, on which side of obstacles), and these are chosen
    anew after an interval, when specifications begin, or when they cannot be kept.

    If there is no plan, an event names specifications that are in conflict: without any one of them, there would be a
    plan for the others. The agent follows the rest of the last plan, then slows down as far as its model can.
    """

    specifications = "specifications"
    signals = (
        Signal(
            "plan",
            columns=[Quantity("robustness", ""), Quantity("gap", "")],
            description="the least robustness of the specifications in the plan, and the gap of the last search",
        ),
    )
    events: ClassVar = {
        "planned": "There is a new plan, after a search; `robustness` is the least of its specifications, `gap` how "
        "much better the best plan may be, in units of the cost.",
        "infeasible": "There is no plan; `conflict` names specifications that cannot hold together, `left` the number "
        "of steps left of the last plan. Once until there is a plan again.",
        "solver-failed": "The search ended without a plan at the limit of nodes; `left` is the number of steps left of "
        "the last plan.",
        "done": "Nothing is left to be planned for: every specification is decided.",
    }

    class Parameters(Parameters):
        """What to plan for, and how."""

        specifications: list[str] = Field(
            min_length=1, description="The specifications to satisfy: of the group's agents, and linear in the state."
        )
        horizon: float | None = Field(
            None,
            gt=0,
            description="How far ahead to plan [s]; what lies beyond counts as satisfied. If null, to the last instant"
            " that the specifications are about (4 s where none has an end).",
        )
        interval: float = Field(
            1.0, ge=0, description="Time between two searches [s], if the agent leaves its plan, or that is not whole."
        )
        hold: int = Field(1, ge=1, le=1000, description="For how many steps of the world a control input is held.")
        robustness: float = Field(
            0.001, ge=0, description="Least robustness of each specification, in the unit of its predicates."
        )
        robustness_weight: float = Field(
            1.0, ge=0, description="Reward for robustness beyond that, of the specification that has least of it."
        )
        effort_weight: float = Field(
            0.001, ge=0, description="Cost of the square of each element of the control input, in each step."
        )
        deviations: float = Field(
            0.0,
            ge=0,
            description="Standard deviations of the model's noise by which margins are reduced: the weight of risk.",
        )
        noise_horizon: float = Field(
            1.0, gt=0, description="The noise of this time adds up in `deviations`; what follows is corrected [s]."
        )
        bounds: dict[str, tuple[float, float]] = Field(
            default={}, description="Least and greatest value of elements of the state, by name."
        )
        nodes: int = Field(2_000, ge=1, description="Limit of a search: the nodes of its tree.")
        gap: float = Field(
            1e-3, ge=0, description="A plan is good enough if the best is better by at most this, in units of the cost."
        )
        fallback: Literal["last-plan", "slow-down"] = Field(
            "last-plan", description="What to do without a plan: follow the rest of the last one, or slow down at once."
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the model is linear, and that its control input or state is limited."""
        dynamics = LinearDynamics.of(group.model, group.model.time_step or 0.1)
        low, high = self._state_bounds(group)
        limited = np.isfinite([*dynamics.least, *dynamics.greatest]).all()
        if not limited and not np.isfinite([*low, *high]).all():
            raise ValueError("a plan needs limits of the model's control input, or `bounds` of the whole state")

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that the predicates are linear in the state."""
        if specification.each is None:
            raise ValueError("it is about pairs, and others are not planned for")
        if specification.automaton is not None:
            raise ValueError("it is in linear temporal logic")
        for knowledge in group.knowledge:
            self._sets(specification, group, knowledge)

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
        world, model = self.environment.parameters, agent.group.model
        self._step = self.environment.time_step
        self._dynamics = LinearDynamics.of(
            model,
            self._step / SECOND,
            getattr(world, "integrator", "exact"),
            int(getattr(world, "substeps", 1)),
        )
        self._reductions = self._noise_roots()
        self._plan: FollowedPlan | None = None
        #: When a search last failed, in nanoseconds.
        self._failed: int | None = None
        self._is_done = False

    def _compute(self) -> StlDecision:
        agent, present = self._agent, -(-self.now // self._step) * self._step
        instances = open_instances(agent, self.parameters.specifications, present, self._step)
        if not instances:
            return StlDecision(self._slowest(), None, "done")
        state = self._state_at(present)
        plan, aims = self._plan, tuple((each.specification.name, each.start) for each in instances)
        stage = 0 if plan is None else (present - plan.made) // self._step
        rest = None if plan is None or stage >= len(plan.inputs) else plan.states[stage:]
        due = self._is_due(plan, aims, present)
        if plan is not None and rest is not None and not due:
            if np.abs(rest[0] - state).max() <= _ON_PLAN:
                return StlDecision(plan.inputs[stage], plan, "followed")
            steps, is_whole = self._extent(instances)
            again = self._program(instances, state, steps, is_whole).solve_as_chosen(_fitted(rest, steps))
            if again.inputs is not None:
                followed = self._followed(again, present, plan.searched, aims, is_whole)
                return StlDecision(again.inputs[0], followed._replace(gap=plan.gap), "followed")
        if self._failed is not None and self.now < self._failed + nanoseconds(self.parameters.interval):
            return self._without(plan, stage, "followed")
        steps, is_whole = self._extent(instances)
        program = self._program(instances, state, steps, is_whole)
        guess = None if rest is None else _fitted(rest, steps)
        found = program.solve(nodes=self.parameters.nodes, gap=self.parameters.gap, guess=guess)
        if found.inputs is not None:
            followed = self._followed(found, present, present, aims, is_whole)
            return StlDecision(found.inputs[0], followed, found.status, followed.gap)
        conflict: tuple[str, ...] = ()
        if found.status == "infeasible" and self._failed is None:
            conflict = self._conflict(instances, state, steps, is_whole=is_whole)
        return self._without(plan, stage, found.status)._replace(conflict=conflict)

    def _update(self, value: StlDecision) -> None:
        self._agent.model.control_input = value.control_input
        before, self._plan = self._plan, value.plan
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
                said = f"has a plan with a robustness of {value.plan.robustness:.4g}"
                if value.status == "node limit":
                    said += f", which may be {value.gap:.3g} from the best: the search ended at its limit of nodes"
                self.emit("planned", said, robustness=value.plan.robustness, gap=value.gap)

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
            said = f"{names} cannot hold{' together' if len(value.conflict) > 1 else ''}; {instead}"
            self.emit("infeasible", said, level=Level.WARNING, conflict=list(value.conflict), left=left)

    # Programs

    def _extent(self, instances: Sequence[Instance]) -> tuple[int, bool]:
        """Return how many steps to plan, and whether these lead to the last instant that counts."""
        ends = [each.last for each in instances if each.last is not None]
        horizon = self.parameters.horizon if ends or self.parameters.horizon is not None else _HORIZON
        last = max(ends, default=None)
        if horizon is None:
            return max(1, last or 1), True
        most = max(1, round(nanoseconds(horizon) / self._step))
        return (most, False) if last is None or last > most else (max(1, last), True)

    def _program(
        self, instances: Sequence[Instance], state: Array, steps: int, is_whole: bool, plain: bool = False
    ) -> SpecificationProgram:
        """Return the program of a plan; a plain one asks only whether there is a plan."""
        group, parameters = self._agent.group, self.parameters
        low, high = self._state_bounds(group)
        program = SpecificationProgram(
            self._dynamics,
            state,
            steps,
            hold=parameters.hold,
            lower=low,
            upper=high,
            robustness_weight=0.0 if plain else parameters.robustness_weight,
        )
        for each in instances:
            program.require(
                each.specification.name,
                each.specification.formulation.formula,
                self._sets(each.specification, group, self._agent.self_knowledge),
                least=parameters.robustness,
                first=each.first,
                last=each.last,
                past=each.past,
                reduction=self._reduction if self._reductions is not None else None,
                open_future=not is_whole,
            )
        if not plain:
            program.add_effort(parameters.effort_weight)
        return program

    def _conflict(self, instances: Sequence[Instance], state: Array, steps: int, *, is_whole: bool) -> tuple[str, ...]:
        """Return names of specifications that cannot hold together, though they can without any one of them."""
        kept = list(instances)
        for each in instances:
            fewer = [other for other in kept if other is not each]
            if not fewer:
                break
            found = self._program(fewer, state, steps, is_whole, plain=True).solve(nodes=self.parameters.nodes)
            if found.status == "infeasible":
                kept = fewer
        return tuple(dict.fromkeys(each.specification.name for each in kept))

    def _sets(self, specification: Specification, group: AgentGroup, knowledge: Mapping[str, Any]) -> list[Any]:
        names = state_names(group.model, knowledge)
        return predicate_sets(specification.formulation, names, group.regions)

    def _state_bounds(self, group: AgentGroup) -> tuple[Array, Array]:
        names = [quantity.name for quantity in group.model.state]
        low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
        for name, (least, greatest) in self.parameters.bounds.items():
            if name not in names:
                raise ValueError(f"`bounds` names `{name}`, and the elements of the state are {', '.join(names)}")
            if least >= greatest:
                raise ValueError(f"the bounds of `{name}` are not in order")
            low[names.index(name)], high[names.index(name)] = least, greatest
        return low, high

    def _noise_roots(self) -> list[Array] | None:
        """Return the covariances of the noise that has added up after some steps; None if there is no noise to heed."""
        noise = self._agent.group.model.noise_covariance(self._step / SECOND)
        if noise is None or not self.parameters.deviations:
            return None
        found, A = [np.zeros_like(noise)], self._dynamics.A
        for _ in range(max(1, round(nanoseconds(self.parameters.noise_horizon) / self._step))):
            found.append(A @ found[-1] @ A.T + noise)
        return found

    def _reduction(self, normal: Array, instant: int) -> float:
        assert self._reductions is not None
        covariance = self._reductions[min(instant, len(self._reductions) - 1)]
        return float(self.parameters.deviations * np.sqrt(max(0.0, float(normal @ covariance @ normal))))

    # Plans

    def _is_due(self, plan: FollowedPlan | None, aims: tuple[tuple[str, int], ...], present: int) -> bool:
        """Return whether it is time for a search."""
        if plan is None or not set(aims) <= set(plan.aims):
            return True
        return not plan.is_whole and present >= plan.searched + nanoseconds(self.parameters.interval)

    def _followed(
        self, found: SpecificationPlan, made: int, searched: int, aims: tuple[tuple[str, int], ...], is_whole: bool
    ) -> FollowedPlan:
        assert found.states is not None
        assert found.inputs is not None
        robustness = min(found.robustness.values(), default=np.inf)
        return FollowedPlan(found.states, found.inputs, made, searched, aims, is_whole, robustness, found.solution.gap)

    def _without(self, plan: FollowedPlan | None, stage: int, status: str) -> StlDecision:
        """Return what to do without a new plan."""
        if plan is not None and stage < len(plan.inputs) and self.parameters.fallback == "last-plan":
            return StlDecision(plan.inputs[stage], plan, status)
        return StlDecision(self._slowest(), plan, status)

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
