"""Model predictive control: plans a trajectory over a receding horizon, around agents and obstacles."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from pydantic import Field

from symaware_cli.core import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    Component,
    Environment,
    KnowledgeDatabase,
    Level,
    Quantity,
    ScenarioView,
    Signal,
    TimeSeries,
)
from symaware_cli.engine import (
    ScanOptions,
    ScanReturns,
    ScanSurfaces,
    bounding_radii,
    check_scan,
    require_known_states,
    slowest,
)
from symaware_cli.geometry import Array
from symaware_cli.planning.control.mpc_chance import ChanceConstrained, ChanceConstraints, ChancePlan
from symaware_cli.planning.control.mpc_prediction import AgentPrediction, ObstaclePrediction, clearance, sizes
from symaware_cli.planning.control.mpc_problem import Sizes, tracking_problem, weights_of
from symaware_cli.planning.control.mpc_reference import (
    ReferencePath,
    Routes,
    goal_of,
    standing,
    turned_right,
    waypoints_of,
)
from symaware_cli.planning.control.mpc_surfaces import SeenObstacles
from symaware_cli.planning.optimal_control import Dynamics, Plan, PlanDecision, Solver
from symaware_cli.planning.risk.failure_bound import is_linear
from symaware_cli.planning.risk.invariants import invariants
from symaware_cli.planning.risk.risk_budget import RiskBudget
from symaware_cli.specification import Specification
from symaware_cli.world import SECOND

#: Initial barrier parameter of interior-point methods: small, because the rest of the last plan is a good guess.
_BARRIER = 1e-2

#: [m] Obstacles that are farther from the reference than its length plus this are ignored.
_OBSTACLE_MARGIN = 1.0

#: In distances to keep: a reference that comes this near to others turns off.
_TURN_OFF_DISTANCE = 4.0

#: In distances to keep: a plan is too close to others if it comes this much nearer to them than the agent is now.
_NOTICEABLE = 0.05

#: The solvers that have been built, by group; its agents share them.
_SOLVERS: WeakKeyDictionary[AgentGroup, dict[tuple[object, ...], Solver]] = WeakKeyDictionary()

#: The routes around obstacles that have been found, by environment and distance to keep.
_ROUTES: WeakKeyDictionary[Environment, dict[float, Routes]] = WeakKeyDictionary()


class PredictiveDecision(NamedTuple):
    """The result of a turn.

    Attributes:
        control_input: The control input to request; shape (nu,).
        decision: The result of planning; None if a new plan was not due.
        slows: Whether the agent slows down instead of following its plan.
        passed: The number of waypoints passed.
        distance: The remaining distance to the goal [m].
        way: The path to the goal.
        is_other_way: Whether the path differs from that of the previous turn.
        chance: The plan under chance constraints, if there are any.
        risk: The risk that is taken until the next turn.
        returns: The scan that was used, if there is a lidar.
        relied: The others whose promises the plan relies on, as indices in the roster.
    """

    control_input: Array
    decision: PlanDecision | None
    slows: bool
    passed: int
    distance: float
    way: ReferencePath
    is_other_way: bool
    chance: ChancePlan | None = None
    risk: float = 0.0
    returns: ScanReturns | None = None
    relied: tuple[int, ...] = ()


class ModelPredictiveControl(Component):
    """Plans a trajectory to the ``goal`` over a horizon, around other agents and obstacles, and applies its beginning.

    The plan minimises weighted squares of deviations from a reference, of control inputs and of their changes, subject
    to the model's dynamics and the limits of its control input. The reference goes to the goal at cruise speed, via the
    ``waypoints`` if the agent has some, and around static obstacles. A new plan is made when a step of the last one has
    passed; its initial guess is the rest of that plan. In between the control input is held, so an undisturbed plan is
    followed exactly.

    Others are expected to keep their believed velocity, or to follow the intent they sent. Discs among the obstacles
    are avoided as such, all other obstacles by one half-plane for each stage, where they are nearest to the rest of the
    last plan. With a `scan`, obstacles are what a lidar sees, as pieces of surfaces; otherwise agents know them.
    Both constraints hold at the stages; ``margin`` covers the motion in between. Unless ``penalty`` is null,
    they have a slack with a high price, so a plan always exists; but a plan that soon comes too close to others is not
    followed.

    Each agent solves a nonlinear program of its own, which array operations cannot do for all agents at once. They
    share the solver.

    If no solver finds a plan within its budget of iterations, the rest of the last plan is followed, and after that the
    agent slows down as far as its model can. The intent is the plan.

    With a ``maximal_risk`` the ``specifications`` are chance constraints: the probability that one of them is violated
    in the run is at most that. The model must be linear, and a step of the plan one of the world. The risk of a plan is
    that of the whole rest of the run: after its horizon the agent stops, and stays there. Each plan may take a share of
    the unspent risk, in proportion to its part of the remaining run; if every new plan is too risky, the rest of the
    last one is followed, whose risk is small enough. If the first plan is too risky, the event ``infeasible`` names the
    specification and the spent risk, and the ``fallback`` acts; only then is more risk than `maximal_risk` taken.

    Specifications may be about pairs, such as ``always distance > 1``. Others are expected to keep their velocities
    over the horizon and to stop then; each of the two may take half of the risk.
    """

    sees_world = True
    specifications = "specifications"
    signals = (
        Signal(
            "risk_budget",
            columns=[Quantity("planned", "1"), Quantity("spent", "1")],
            description="the risk of violating `specifications` in the rest of the run by the plan, and that taken so"
            " far",
        ),
    )
    knowledge: ClassVar = {"goal": "where to go, as a position [m] or a whole state"}
    events: ClassVar = {
        "goal-reached": "The agent came within the tolerance of its goal, for the first time.",
        "goal-changed": "An agent that had reached its goal has a new one, which counts as not reached.",
        "waypoint-reached": "It came within `passing` of its next waypoint; `number` counts them from 0.",
        "slowed": "It slows down, because its plan comes too close to others; once until it follows a plan again.",
        "solver-failed": "There is no new plan; `left` is the number of steps left of the last one.",
        "infeasible": "No plan keeps `specification` from the instant `time` [s] on with little enough risk: it is "
        "`risk`, where `allowed` is left and `spent` was taken; once until there is one.",
        "feasible": "There is such a plan again.",
    }

    class Parameters(ChanceConstrained, ScanOptions):
        """Parameters of planning."""

        scan: str | None = Field(
            None,
            description="The name of the lidar that sees the obstacles, which are expected to stand still; null for "
            "agents that know them. Nothing that is seen is planned around from afar: `waypoints` lead past walls.",
        )

        speed: float = Field(1.0, gt=0, description="Cruise speed of the reference [m/s].")
        tolerance: float = Field(0.1, gt=0, description="Distance at which the goal counts as reached [m].")
        passing: float = Field(0.5, gt=0, description="Distance at which a waypoint counts as reached [m].")
        margin: float = Field(0.1, ge=0, description="Distance to keep from other bodies [m].")
        caution: float = Field(
            1.2,
            ge=0,
            description="A plan that comes too close to others within this time is not followed: the agent slows down"
            " [s]. 0 to follow every plan.",
        )
        neighbours: int = Field(5, ge=0, le=100, description="How many others to avoid at most; the nearest count.")
        reach: float = Field(10.0, gt=0, description="Others farther away are not avoided [m].")
        obstacles: int = Field(
            6, ge=0, le=100, description="How many discs, and how many other pieces of obstacles, to avoid at most."
        )
        detours: bool = Field(
            True,
            description="Whether the reference takes the shortest way around obstacles that stand still (in the plane,"
            " and up to fifty pieces of them), or goes straight.",
        )
        perturbation: float = Field(
            0.2,
            ge=0,
            lt=1.5,
            description="A reference that comes near others turns to the right by an angle of the agent's own, drawn"
            " from half of this to all of it [rad]: without, symmetric encounters go wrong. 0 for not at all.",
        )
        integrator: Literal["exact", "rk4", "euler"] | None = Field(
            None, description="How the motion is predicted; as the world moves where that is known if null, else exact."
        )
        solvers: list[Literal["fatrop", "ipopt"]] = Field(
            default=["fatrop", "ipopt"],
            min_length=1,
            max_length=2,
            description="Solvers; each is tried where the one before failed.",
        )
        iterations: int = Field(100, ge=1, le=10_000, description="Budget of each solver for each plan.")

    def __init__(self, parameters: Any = None) -> None:
        super().__init__(parameters)
        if self.parameters.maximal_risk is None:
            vars(self)["signals"] = ()  # nothing to record

    def check(self, group: AgentGroup) -> None:
        """Check that goal, waypoints and weights fit the model, and that the model works with CasADi's symbols."""
        model = group.model
        weights_of(model, self.parameters)
        for knowledge in group.knowledge:
            goal_of(knowledge, model, self.parameters)
            waypoints_of(knowledge, len(model.position))
        dynamics = Dynamics(model, model.time_step or 0.1, self.parameters.integrator or "exact")
        try:
            problem = tracking_problem(dynamics, 1, self.parameters, Sizes(0, 0, 0))
            dynamics.symbolic(problem.state, problem.control_input)
        except Exception as error:
            raise ValueError(f"the model does not work with CasADi's symbols: {error}") from error
        if self.parameters.maximal_risk is not None:
            if not is_linear(model):
                raise ValueError("`maximal_risk` works only with a model that is linear")
            try:
                model.follow_velocity(group.initial_state, np.zeros((len(group), len(model.position))))
            except NotImplementedError as error:
                raise ValueError(f"`maximal_risk` works only with a model that can stop: {error}") from error

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that states are known, which a maximal risk requires, and that the scan exists."""
        require_known_states(view)
        check_scan(view, self.parameters.scan)

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that a specification can be a chance constraint."""
        self.parameters.check_steps(specification.formulation.time_step)
        invariants(specification, group)

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the intent as positions."""
        return {"intent": [group.model.state[index] for index in group.model.position]}

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Build the solver, or share that of another agent of the group."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        parameters, model, environment = self.parameters, agent.group.model, self.environment
        room = sizes(environment, parameters.neighbours, parameters.obstacles)
        if parameters.scan is not None:
            room = room._replace(discs=0, sides=parameters.obstacles)
        dynamics, turns = self._dynamics(agent)
        self._chance: ChanceConstraints | None = None
        if parameters.maximal_risk is not None:
            self._chance = ChanceConstraints(agent, parameters, dynamics, environment.time_step)
            room = room._replace(faces=self._chance.count())
        #: The risk that may be taken, and whether the last plan kept the specifications.
        paid = 0.0 if self._chance is None else self._chance.paid
        whole = RiskBudget.whole((parameters.maximal_risk or 0.0) - paid, 1)
        self._budget, self._keeps = whole._replace(spent=whole.spent + paid), True
        #: The others whose promises the last plan relied on, as indices in the roster.
        self._relied: tuple[int, ...] = ()
        self._solver = self._shared_solver(dynamics, room)
        #: Time between two plans, in nanoseconds.
        self._step = turns * environment.time_step
        self._offsets = np.arange(parameters.steps + 1, dtype=np.int64) * self._step
        self._others = AgentPrediction(
            agent, bounding_radii(environment), parameters.margin, parameters.reach, room.others
        )
        keep = agent.entity.radius + parameters.margin
        self._surfaces = None if parameters.scan is None else ScanSurfaces(parameters.scan, parameters, keep)
        self._obstacles, self._room = ObstaclePrediction(environment, keep, room), room
        self._way = self._present_way()
        #: The angle by which the reference turns off to the right near others [rad].
        self._turn = parameters.perturbation * (0.5 + 0.5 * float(self.random.uniform()))
        #: The distance along the reference at each stage [m]; shape (N + 1,).
        self._travelled = parameters.speed * self._offsets / SECOND
        self._plan: Plan | None = None
        self._planned: int | None = None
        self._held = np.zeros(len(model.control_input))
        self._slows = False
        self._passed = 0
        self._reached = False

    def _present_way(self, before: ReferencePath | None = None) -> ReferencePath:
        """Return the path to the present goal via the waypoints; the previous one if these are unchanged.

        Raises:
            ValueError: Goal or waypoints do not fit the model.
        """
        known, model = self._agent.self_knowledge, self._agent.group.model
        goal, waypoints = goal_of(known, model, self.parameters), waypoints_of(known, len(model.position))
        if before is not None and before.leads_to(goal, waypoints):
            return before
        return ReferencePath(model, goal, waypoints, self._shared_routes())

    def _dynamics(self, agent: Agent) -> tuple[Dynamics, int]:
        """Return the dynamics over a step of the plan as the world integrates them, and the step in time steps."""
        parameters, world, model = self.parameters, self.environment.parameters, agent.group.model
        time_step = self.environment.time_step / SECOND
        turns = max(1, round(parameters.horizon / parameters.steps / time_step))
        integrator = parameters.integrator or getattr(world, "integrator", "exact")
        still = np.zeros((1, len(model.control_input)))
        if model.time_step is not None:
            parts = turns
        elif integrator == "exact" and model.exact_step(agent.self_state[None], still, time_step) is not None:
            parts = 1
        else:
            parts = turns * int(getattr(world, "substeps", 1))
        return Dynamics(model, turns * time_step, integrator, parts), turns

    def _shared_solver(self, dynamics: Dynamics, room: Sizes) -> Solver:
        """Return the solver of the group for these parameters, built on first use."""
        parameters = self.parameters
        same = _SOLVERS.setdefault(self._agent.group, {})
        key = (parameters.model_dump_json(), dynamics.step, dynamics.integrator, dynamics.substeps, room)
        if key not in same:
            problem = tracking_problem(dynamics, parameters.steps, parameters, room)
            same[key] = Solver(problem, parameters.solvers, iterations=parameters.iterations, barrier=_BARRIER)
        return same[key]

    def _shared_routes(self) -> Routes | None:
        """Return the routes around known obstacles for bodies of this size, found on first use; None without any."""
        if not self.parameters.detours or self.parameters.scan is not None:
            return None
        keep = self._agent.entity.radius + self.parameters.margin
        if len(self._agent.group.model.position) > 2 or not keep:
            return None
        same = _ROUTES.setdefault(self.environment, {})
        if keep not in same:
            same[keep] = Routes(standing(self.environment), keep)
        return same[keep]

    def _compute(self) -> PredictiveDecision:
        agent, model = self._agent, self._agent.group.model
        state = agent.self_state
        position = model.positions(state[None])[0]
        way = self._present_way(self._way)
        other = way is not self._way
        passed = way.passed(position, 0 if other else self._passed, self.parameters.passing)
        distance = way.remaining(position)
        returns = None if self._surfaces is None else self._surfaces.returns(agent.group, self.now)
        if self._planned is not None and self.now < self._planned + self._step:
            return PredictiveDecision(self._held, None, self._slows, passed, distance, way, other, returns=returns)
        requested = model.limit(agent.control_input[None])
        rest = kept = None
        if self._plan is not None and self._planned is not None:
            if self._chance is None:
                rest = self._plan.shifted(max(1, round((self.now - self._planned) / self._step)))
            else:
                kept, rest = self._chance.rest(self._plan)
        times = self.now + self._offsets
        expected = model.positions((self._solver.rollout(state) if rest is None else rest).states)
        others = self._others.ahead(times)
        avoided = self._obstacles
        if returns is not None and self._surfaces is not None:
            radii = bounding_radii(self.environment)
            avoided = SeenObstacles.of(agent, self._surfaces, returns, radii, self._room)
        obstacles = avoided.ahead(expected[:, :2], times, self._travelled[-1] + _OBSTACLE_MARGIN)
        places = way.ahead(position, passed, self._travelled)
        if self._turn and others and clearance(places, others).min() < _TURN_OFF_DISTANCE:
            # Near the goal it turns less, so that it reaches the goal.
            turned = turned_right(places, self._turn * min(1.0, distance / self._travelled[-1]))
            places = turned if avoided.clear(turned) else places
        given = {"reference": way.reference(state, places), **others, **obstacles}

        def solve(further: Mapping[str, Array]) -> PlanDecision:
            return self._solver.replan(state, {**given, **further}, previous_input=requested[0], rest=rest)

        chance, relied = None, self._relied
        if self._chance is None:
            decision = solve({})
        else:
            relied = self._chance.relied(self._relied)
            around = self._solver.rollout(state) if rest is None else rest
            chance = self._chance.plan(solve, around, kept, self.now, self._planned, self._account(relied))
            decision = chance.decision
            if chance.unkept is not None and self.parameters.fallback != "best-effort":
                follows = self.parameters.fallback == "last-plan" and rest is not None and rest.left
                decision = PlanDecision(rest if follows else None, decision.solution)
        slows = decision.plan is None or bool(others and self._comes_too_close(decision.plan, others))
        chosen = slowest(model, state, requested) if slows or decision.plan is None else decision.plan.inputs[0]
        risk = 0.0 if self._chance is None else self._chance.next_risk(chosen, self.now)
        return PredictiveDecision(chosen, decision, slows, passed, distance, way, other, chance, risk, returns, relied)

    def _account(self, relied: Collection[int]) -> RiskBudget:
        """Return the account of the risk. When a promise is not relied on any more, the rest of the plan is paid anew.

        Args:
            relied: The others whose promises are relied on now.
        """
        lost = {*self._relied} - {*relied}
        return self._budget._replace(kept=np.zeros(1, bool)) if lost else self._budget

    def _comes_too_close(self, plan: Plan, others: Mapping[str, Array]) -> bool:
        """Return whether a plan soon comes too close to others, and closer than the agent is now."""
        near = clearance(self._agent.group.model.positions(plan.states), others)
        soon = near[1 : 1 + round(self.parameters.caution * SECOND / self._step)]
        return bool(soon.min(initial=np.inf) < min(near[0], 1.0) - _NOTICEABLE)

    def _update(self, value: PredictiveDecision) -> None:
        self._agent.model.control_input = self._held = value.control_input
        if value.returns is not None and self._surfaces is not None:
            self._surfaces.remember(self._agent.group, self.computed_at, value.returns)
        decision = value.decision
        if decision is not None:
            self._plan, self._planned = decision.plan, self.computed_at
            self._agent.self_awareness.intent = TimeSeries() if self._plan is None else self._plan.intent(self._planned)
            if decision.fallen_back:
                self._emit_failure(decision)
            elif value.slows and not self._slows:
                self.emit("slowed", "slows down, because its plan comes too close to others")
        self._slows = value.slows
        if value.chance is not None:
            rest, planned, taken = (np.array([each]) for each in (value.chance.rest, value.chance.risk, value.risk))
            kept = value.chance.unkept is None and not value.slows
            self._budget = self._account(value.relied).after(rest, planned, taken, np.array([kept]))
            self._relied = value.relied
            self.record(self.signals[0], np.array([value.chance.risk, self._budget.spent[0]]))
            self._emit_feasibility(value.chance)
            if kept:
                self._plan = value.chance.plan
        if value.is_other_way:
            self._way, self._passed = value.way, 0
            if self._reached:
                self._reached = False
                self.emit("goal-changed", "has another way to go than the one it reached the end of")
        for number in range(self._passed, value.passed):
            self.emit("waypoint-reached", f"reached its waypoint {number}", number=number)
        self._passed = value.passed
        arrived = self._way.is_behind(self._passed) and value.distance <= self.parameters.tolerance
        if arrived and not self._reached:
            self._reached = True
            self.emit("goal-reached", "reached its goal", distance=value.distance)

    def _emit_feasibility(self, chance: ChancePlan) -> None:
        if chance.unkept is None and not self._keeps:
            self.emit("feasible", "has a plan with little enough risk again", risk=chance.risk)
        elif chance.unkept is not None and self._keeps:
            text, data = chance.problem(self.parameters.fallback)
            self.emit("infeasible", text, level=Level.WARNING, **data)
        self._keeps = chance.unkept is None

    def _emit_failure(self, decision: PlanDecision) -> None:
        solution, left = decision.solution, 0 if decision.plan is None else decision.plan.left
        instead = f"follows its last plan, of which {left} steps are left" if left else "slows down"
        self.emit(
            "solver-failed",
            f"no new plan ({solution.solver}: {solution.status}); {instead}",
            level=Level.WARNING,
            status=solution.status,
            solver=solution.solver,
            iterations=solution.iterations,
            left=left,
        )
