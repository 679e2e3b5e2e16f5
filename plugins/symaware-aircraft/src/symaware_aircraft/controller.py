"""Robust model predictive control over a scenario tree."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import casadi
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_aircraft.manoeuvres import manoeuvres, safest
from symaware_aircraft.prediction import check_aircraft, check_poses, course, rollout
from symaware_aircraft.tree import ScenarioTree, ThirdBranch
from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    Component,
    KnowledgeDatabase,
    Level,
    Model,
    Parameters,
    Quantity,
    TimeSeries,
    seconds,
)
from symaware_cli.planning.optimal_control import OptimalControlProblem, Plan, Solution, Solver

Array = NDArray[np.float64]
Weight = Annotated[float, Field(ge=0)]

#: Coordinates of unknown others, far from all aircraft [m].
_NOWHERE = 1e6
#: The fraction of the separation that may be missing before it counts as violated: more than solver tolerances.
_TOLERANCE = 1e-5
#: The barrier of IPOPT in the published runs: small from the beginning, and constant.
_RECORDED_BARRIER = 1e-4


class _Turn(NamedTuple):
    """The result of a turn of the controller."""

    plan: Plan
    solution: Solution
    fan: Array
    risk: float
    nearest: float
    clearance: float


@dataclass
class _Safe:
    """The motion to follow if no plan is found, which is simulated only then."""

    controller: ScenarioTreeMPC
    state: Array
    rest: Plan
    fan: Array

    @cached_property
    def motion(self) -> tuple[Plan, float]:
        """The motion, and the distance that it keeps from all scenarios [m]."""
        return self.controller.safest(self.state, self.rest, self.fan)


class ScenarioTreeMPC(Component):
    """Flies to its target and keeps clear of others in every scenario of their possible motions.

    A robust model predictive controller. It knows the intent of each other aircraft, as estimated by `aircraft.intent`,
    but not how it turns during the next few steps. In each of these steps, the scenario tree branches into the greatest
    turn rate to either side and a third branch; after them the other continues as intended. All scenarios start at the
    perceived pose of the other, and the single plan of this agent keeps the separation from all of them. The solver
    starts with the previous plan, shifted by a step. If it fails, it tries other guesses: turning right, turning left,
    slowing down, both together, and straight flight.

    It sets the control input, the plan as intent, all scenarios as uncertainty at the times of the plan, and as risk
    the fraction of scenarios that come closer to the plan than the risk margin.

    If all these guesses fail within the budgets, a set of manoeuvres is simulated: turning away and flying on, or on a
    parallel course, at several speeds. One that keeps the separation in every scenario is the last guess. If the solver
    fails from that as well, the agent follows the rest of the previous plan if that keeps the separation, else the
    manoeuvre, and fires `fell-back`; if nothing keeps the separation, it follows what keeps the greatest distance.
    """

    knowledge: ClassVar = {"target": "where to fly, as x [m], y [m] and heading [rad]"}
    events: ClassVar = {
        "fell-back": "No solver found a plan within its budget; the shifted previous one or a manoeuvre is followed.",
        "too-close": "Another aircraft is perceived nearer than the separation in this step; the run exits with 3.",
    }

    class Parameters(Parameters):
        """The program, the scenarios and the solver."""

        horizon: int = Field(30, ge=1, le=1000, description="N: planning horizon, in steps of the world.")
        robust_horizon: int = Field(
            3,
            ge=0,
            le=5,
            description="N_r: number of steps in which others may turn arbitrarily; 3^N_r scenarios for each. With 0 "
            "their intent is the only one.",
        )
        third_branch: ThirdBranch = Field(
            "paper",
            description="Besides turning to the left and right: `paper` turns as intended; `recorded` goes straight, "
            "keeps the intent as one scenario more, and leaves the others out at the end of the horizon, as the "
            "published runs did.",
        )
        others: int = Field(1, ge=1, le=50, description="Number of others to consider: the nearest known ones.")
        avoid: bool = Field(True, description="Whether to keep clear of them; if not, they are only observed.")
        others_turn_rate: float = Field(0.07, gt=0, description="Greatest turn rate of the others [rad/s].")
        separation: float = Field(
            math.sqrt(2000.0), gt=0, description="rho: the least distance to keep from the centres of others [m]."
        )
        risk_margin: float = Field(60.0, gt=0, description="A scenario that comes closer than this is a threat [m].")
        state_weights: tuple[Weight, Weight, Weight] = Field(
            (0.1, 0.1, 0.1),
            description="Q: weights of the squared distances from the target at each stage [1/m^2, 1/m^2, 1/rad^2].",
        )
        terminal_weights: tuple[Weight, Weight, Weight] = Field(
            (1.0, 1.0, 1.0), description="Q_f: likewise at the end of the horizon."
        )
        smoothing: Weight = Field(
            5.5e6, description="Weight of the squared change of the turn rate from stage to stage [s^2/rad^2]."
        )
        min_speed: float | None = Field(None, description="Least speed to plan with [m/s]; that of the model if null.")
        max_speed: float | None = Field(
            None, gt=0, description="Greatest speed to plan with [m/s]; that of the model if null."
        )
        max_turn_rate: float | None = Field(
            None, gt=0, description="Greatest turn rate to plan with [rad/s]; that of the model if null."
        )
        integrator: Literal["exact", "rk4", "euler"] = Field(
            "euler", description="Integration method of the own motion; best that of the world."
        )
        solver: Literal["fatrop", "ipopt", "recorded"] = Field(
            "fatrop",
            description="`fatrop`, with IPOPT where it fails; `ipopt`; or `recorded`: IPOPT on the program without "
            "scaling and with the settings of the published runs.",
        )
        iterations: int = Field(
            300, ge=1, le=100_000, description="Iteration limit of a solver from one guess; there are up to nine."
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the agents are aircraft with a target pose, and that the limits are consistent."""
        check_aircraft(group)
        check_poses(group, "target")
        low, high = program(group.model, self.parameters, 1.0).input_bounds
        if (low > high).any():
            raise ValueError(f"no speed or no turn rate is left between {low.tolist()} and {high.tolist()}")

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        """Declare the plan as states, a position for each scenario, and one risk."""
        parameters = self.parameters
        count = parameters.others * _tree(parameters).count
        fan = [Quantity(f"{axis}.{number}", "m") for number in range(count) for axis in "xy"]
        return {"intent": group.model.state, "uncertainty": fan, "risk": [Quantity("risk", "1")]}

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Build the program."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._step = seconds(self.environment.time_step)
        self._tree = _tree(self.parameters)
        problem = program(agent.group.model, self.parameters, self._step)
        self._solver = solver(problem, self.parameters)
        (slowest, _), (fastest, turn) = problem.input_bounds
        middle = (slowest + fastest) / 2
        #: The constant input of the first guess: straight flight at the greatest speed.
        self._straight = np.array([fastest, 0.0])
        #: The constant inputs of further guesses. Turns come first: a solver that starts straight ahead of another
        #: aircraft, or at rest, has no gradient to either side.
        self._manoeuvres = [
            np.array(each)
            for each in (
                *((fastest, -turn), (fastest, turn), (slowest, 0.0)),
                *((middle, -turn), (middle, turn), (fastest, 0.0)),
            )
        ]
        #: The control inputs of the manoeuvres that are simulated if no guess leads to a plan.
        self._simulated = manoeuvres(problem.input_bounds, self.parameters.horizon)
        #: The plan of the previous turn, and the last iterate of its solver.
        self._plan: Plan | None = None
        self._iterate: Plan | None = None

    def _compute(self) -> _Turn:
        agent = self.agent
        state, fan = agent.self_state, self._fan()
        values: dict[str, Any] = {"target": agent.self_knowledge["target"]}
        if self.parameters.avoid:
            values["scenarios"] = np.nan_to_num(fan, nan=_NOWHERE).transpose(1, 2, 0)
        if self._plan is None or self._iterate is None:
            rest = guess = self._solver.rollout(state, self._straight)
        else:
            rest, guess = self._plan.shifted(), self._iterate.shifted()
        safe = _Safe(self, state, rest, fan)
        solution = self._solver.solve(
            state,
            values,
            previous_input=agent.control_input,
            guess=guess,
            alternatives=self._alternatives(state, rest, safe),
        )
        plan, kept = (solution.plan, np.inf) if solution.solved else safe.motion
        nearest = np.nanmin(np.hypot(*(fan[:, 0] - state[:2]).T), initial=np.inf)
        return _Turn(plan, solution, fan, self._risk(plan, fan), float(nearest), kept)

    def _update(self, value: _Turn) -> None:
        self._plan = value.plan
        # A solver that ran out of iterations continues from its last iterate, which is faster than starting again.
        iterate = value.solution.plan
        finite = np.isfinite(iterate.states).all() and np.isfinite(iterate.inputs).all()
        self._iterate = iterate if finite else value.plan
        awareness = self.agent.self_awareness
        self.agent.model.control_input = value.plan.inputs[0]
        times = self.computed_at + np.arange(len(value.plan.states)) * self.environment.time_step
        awareness.intent = TimeSeries.sampled(times, value.plan.states)
        awareness.uncertainty = TimeSeries.sampled(times, value.fan.swapaxes(0, 1).reshape(len(times), -1))
        awareness.risk = TimeSeries.sampled([self.computed_at], [value.risk])
        if not value.solution.solved:
            separation = self.parameters.separation
            lacking = "" if value.clearance >= separation else f"; at best {value.clearance:.4g} m can be kept"
            self.emit(
                "fell-back",
                f"{value.solution.solver} gave up: {value.solution.status}{lacking}",
                level=Level.WARNING,
                clearance=value.clearance if np.isfinite(value.clearance) else None,
                solver=value.solution.solver,
                status=value.solution.status,
                iterations=value.solution.iterations,
                infeasibility=value.solution.infeasibility,
            )

        if self.parameters.avoid and value.nearest < self.parameters.separation * (1.0 - _TOLERANCE):
            text = f"{value.nearest:.4g} m from somebody, {self.parameters.separation:.4g} m are to be kept"
            self.emit("too-close", text, level=Level.ERROR, distance=value.nearest)

    def _alternatives(self, state: Array, rest: Plan, safe: _Safe) -> Iterator[Plan]:
        """Yield further guesses: the previous plan if the solver ended elsewhere, constant inputs, a safe manoeuvre."""
        if self._plan is not None and self._iterate is not self._plan:
            yield rest
        for held in self._manoeuvres:
            yield self._solver.rollout(state, held)
        if self.parameters.avoid:
            motion, kept = safe.motion
            if kept >= self.parameters.separation:
                yield motion

    def safest(self, state: Array, rest: Plan, fan: Array) -> tuple[Plan, float]:
        """Return the motion to follow if no plan is found, and the distance that it keeps from all scenarios [m]."""
        parameters = self.parameters
        if not parameters.avoid:
            return rest, np.inf
        before, at_end = (np.tile(each, parameters.others) for each in self._tree.counting)
        target = np.asarray(self.agent.self_knowledge["target"], float)
        return safest(state, self._simulated, rest, fan, (before, at_end), parameters.separation, target)

    def _fan(self) -> Array:
        """Return the nearest others' positions in each scenario, NaN for missing ones; shape (others * M, N + 1, 2)."""
        parameters, tree, database = self.parameters, self._tree, self.agent.awareness_database
        fan = np.full((parameters.others, tree.count, parameters.horizon + 1, 2), np.nan)
        own = self.agent.self_state[:2]
        known = [database[id] for id in database if id != self.agent.id]
        known.sort(key=lambda other: float(np.hypot(*(other.state[:2] - own))))
        for slot, other in zip(fan, known, strict=False):
            pose, speeds, intended = course(other, self.now, parameters.horizon, self._step)
            slot[:] = rollout(pose, speeds, tree.turn_rates(intended), self._step)[:, :, :2]
        return fan.reshape(-1, parameters.horizon + 1, 2)

    def _risk(self, plan: Plan, fan: Array) -> float:
        """Return the fraction of scenarios in which a plan comes closer to others than the margin."""
        known = fan[~np.isnan(fan[:, 0, 0])]
        if not len(known):
            return 0.0
        squares = np.square(known - plan.states[:, :2]).sum(axis=2)
        return float(np.mean(squares.min(axis=1) < self.parameters.risk_margin**2))


def _tree(parameters: ScenarioTreeMPC.Parameters) -> ScenarioTree:
    return ScenarioTree(
        parameters.horizon, parameters.robust_horizon, parameters.others_turn_rate, parameters.third_branch
    )


def program(model: Model, parameters: ScenarioTreeMPC.Parameters, step: float) -> OptimalControlProblem:
    """Return the optimal control problem of a turn, with parameters ``target`` (3,) and ``scenarios`` (2, others * M).

    Args:
        model: The model of the agent.
        parameters: The parameters of the controller.
        step: Duration of a step of the horizon [s].
    """
    problem = OptimalControlProblem(model, steps=parameters.horizon, time_step=step, integrator=parameters.integrator)
    state, turn_rate, before = problem.state, problem.control_input[1], problem.previous_input[1]
    offset = state - problem.parameter("target", 3)
    problem.add_cost(casadi.dot(casadi.DM(parameters.state_weights), offset**2))
    problem.add_terminal_cost(casadi.dot(casadi.DM(parameters.terminal_weights), offset**2))
    if parameters.horizon > 1:
        problem.add_cost(parameters.smoothing * (turn_rate - before) ** 2, stages=range(1, parameters.horizon))
    slowest, fastest, turn = parameters.min_speed, parameters.max_speed, parameters.max_turn_rate
    problem.bound_input(
        [-math.inf if slowest is None else slowest, -math.inf if turn is None else -turn],
        [math.inf if fastest is None else fastest, math.inf if turn is None else turn],
    )
    if parameters.avoid:
        tree, square = _tree(parameters), parameters.separation**2
        scenarios = problem.parameter("scenarios", (2, parameters.others * tree.count), per_stage=True)
        apart = casadi.sum1((scenarios - state[:2]) ** 2).T
        scale = 1.0 if parameters.solver == "recorded" else square
        last = parameters.horizon
        for stages, counting in zip((range(1, last), [last]), tree.counting, strict=True):
            chosen = np.flatnonzero(np.tile(counting, parameters.others)).tolist()
            if stages:
                problem.add_constraint(apart[chosen], lower=square, stages=stages, scale=scale)
    return problem


def solver(problem: OptimalControlProblem, parameters: ScenarioTreeMPC.Parameters) -> Solver:
    """Return the solver of the problem for the parameters of the controller."""
    if parameters.solver == "recorded":
        target = {"ipopt": {"ipopt.mu_target": _RECORDED_BARRIER}}
        return Solver(
            problem,
            ["ipopt"],
            tolerance=1e-8,
            barrier=_RECORDED_BARRIER,
            options=target,
            iterations=parameters.iterations,
        )
    names = ["fatrop", "ipopt"] if parameters.solver == "fatrop" else ["ipopt"]
    # Measured on the case study: these values of barrier and cost scale need the fewest iterations.
    return Solver(problem, names, tolerance=1e-6, barrier=1e-2, cost_scale=1e-3, iterations=parameters.iterations)
