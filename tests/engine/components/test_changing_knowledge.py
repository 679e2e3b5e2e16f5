"""Every built-in component lives on what its agents know at each turn, whoever changes that in the middle of a run."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, execute, simulation, untyped
from talking import Setting, made

from symaware_cli import Agent, AgentGroup, Component, GroupComponent, Model
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import STEADY, Timing
from symaware_cli.language.catalogue import Catalogue


@dataclass
class Case:
    """What a component needs, and what becomes of its agent.

    Attributes:
        name: What the agent knows.
        first: What it knows at first; an agent that reaches it does so within `CHANGE` steps.
        second: And from then on.
        end: What `read` is near at the end because of that.
        within: How near.
        steps: By when.
    """

    name: str
    first: Any
    second: Any
    end: Sequence[float]
    within: float = 0.15
    steps: int = 400
    model: Model = field(default_factory=SingleIntegrator)
    state: Sequence[float] = (0.0, 0.0)
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def read(self, group: AgentGroup) -> NDArray[np.float64]:
        """Where the agents are; how fast, where it is a velocity that they know."""
        model, state = group.model, group.surroundings.environment.state(group)
        return model.velocity(state, group.control_input) if self.name == "velocity" else model.positions(state)


#: Steps at first.
CHANGE = 60

CASES = {
    "control.go-to-goal": Case("goal", [1, 0], [0, 3], [0, 3]),
    "control.velocity-obstacle": Case("goal", [1, 0], [0, 3], [0, 3]),
    "control.dynamic-window": Case(
        "goal", [1, 0], [0, 3], [0, 3], model=Unicycle(), state=(0, 0, 0), parameters={"scan": "lidar"}
    ),
    "control.vector-field-histogram": Case("goal", [1, 0], [0, 3], [0, 3], parameters={"scan": "lidar"}),
    "control.waypoints": Case("waypoints", [[1, 0]], [[1, 2], [-1, 2]], [-1, 2]),
    "control.timed-waypoints": Case("timed_waypoints", [[0, 1, 0]], [[0, 1, 2], [1, -1, 2]], [-1, 2]),
    "control.pure-pursuit": Case(
        "waypoints", [[0, 0], [1, 0]], [[1, 0], [3, 0], [6, 2], [9, 2]], [9, 2], 0.3, 600, Bicycle(), (0, 0, 0)
    ),
    "control.follow": Case("offset", [-1, 0], [0, -2], [5, 3], parameters={"leader": "leader", "frame": "world"}),
    "control.mpc": Case("goal", [1, 0], [0, 3], [0, 3], parameters={"horizon": 2.0, "steps": 8, "neighbours": 0}),
    "control.quadrotor-velocity": Case(
        "velocity", [1, 0, 0], [0, 1, 0], [0, 1, 0], 0.1, 400, Quadrotor(), [0.0] * 12, {"gain": 2.0}
    ),
}


def built_in() -> Iterator[tuple[str, type[Component | GroupComponent]]]:
    catalogue = Catalogue()
    for listing in catalogue.listings("component"):
        if listing.built_in:
            yield listing.name, catalogue.load("component", listing.name)


def ready(use: str, change: Callable[..., Any], case: Case, count: int = 1, timing: Timing = STEADY) -> Simulation:
    """A run in which something that is no controller calls `change` with each agent at each turn."""
    if use == "control.mpc":
        pytest.importorskip("casadi", reason="CasADi is an extra")
    kind = Catalogue().load("component", use)
    team = Team(
        {
            "sense": OmniscientPerception,
            "plan": lambda: Setting(change),
            "steer": made(kind, **case.parameters),
        },
        count=count,
        state=[list(case.state)] * count,
        knowledge=[{case.name: case.first}] * count,
        model=case.model,
        timings={"steer": timing},
    )
    leader = Team({}, state=[[5.0, 5.0]])
    time_step = 0.01 if case.name == "velocity" else STEP / 1e9
    world = KinematicEnvironment(KinematicEnvironment.Parameters(time_step=time_step))
    made_ready = simulation({"robot": team, "leader": leader}, environment=world)
    untyped(made_ready).fired = []
    made_ready.events.subscribe("*", untyped(made_ready).fired.append)
    return made_ready


def changing(case: Case, at: int = CHANGE) -> Callable[..., None]:
    def change(agent: Agent) -> None:
        environment = agent.surroundings.environment
        if agent.row == 0 and agent.surroundings.clock.now == at * environment.time_step:
            agent.self_knowledge[case.name] = case.second

    return change


def robots(simulation: Simulation) -> AgentGroup:
    return next(group for group in simulation.groups if group.name == "robot")


def names(simulation: Simulation, *wanted: str) -> list[str]:
    return [event.name for event in untyped(simulation).fired if event.name in wanted]


each_case = pytest.mark.parametrize("use", CASES)


def test_there_is_a_case_for_every_built_in_component_that_needs_knowledge() -> None:
    # Planners steer nobody; whether they plan anew is tested in tests/maps.
    planners = {
        "planning.cbs",
        "planning.grid",
        "planning.lattice",
        "planning.prioritised",
        "planning.roadmap",
        "planning.rrt-star",
    }
    assert {name for name, kind in built_in() if kind.knowledge} == {*CASES, *planners}


@each_case
def test_knowledge_gained_in_a_run_counts(use: str) -> None:
    case = CASES[use]
    one = ready(use, changing(case), case)
    summary = execute(one, case.steps)
    assert summary.status == "finished", summary.failure
    assert np.abs(case.read(robots(one))[0] - case.end).max() <= case.within


@pytest.mark.parametrize("use", sorted(set(CASES) - {"control.velocity-obstacle"}))  # its agents avoid each other
def test_knowledge_of_one_agent_is_not_that_of_its_group(use: str) -> None:
    case = CASES[use]
    both, alone = ready(use, changing(case), case, count=2), ready(use, lambda agent: None, case, count=2)
    for each in (both, alone):
        assert execute(each, 2 * CHANGE).status == "finished"
    states = [each.environment.state(robots(each)) for each in (both, alone)]
    assert np.array_equal(states[0][1], states[1][1])
    assert not np.allclose(states[0][0], states[1][0])


with_goal = pytest.mark.parametrize("use", [use for use in CASES if CASES[use].name in ("goal", "waypoints")])


@with_goal
def test_a_goal_that_was_replaced_and_not_reached_is_not_reported_as_reached(use: str) -> None:
    case = CASES[use]
    early, late = ready(use, changing(case), case), ready(use, changing(case), case)
    assert execute(early, CHANGE).goals_reached == ("robot.0",)
    assert execute(late, CHANGE + 10).goals_reached == ()
    assert names(late, "goal-reached", "goal-changed") == ["goal-reached", "goal-changed"]


@with_goal
def test_a_new_goal_is_reached_anew(use: str) -> None:
    case = CASES[use]
    one = ready(use, changing(case), case)
    assert execute(one, case.steps).goals_reached == ("robot.0",)
    assert names(one, "goal-reached", "goal-changed") == ["goal-reached", "goal-changed", "goal-reached"]


@with_goal
def test_to_assign_the_same_goal_again_is_no_news(use: str) -> None:
    case = CASES[use]

    def again(agent: Agent) -> None:
        agent.self_knowledge[case.name] = [*np.array(case.first, float).tolist()]

    one = ready(use, again, case)
    assert execute(one, CHANGE + 20).goals_reached == ("robot.0",)
    assert names(one, "goal-reached", "goal-changed") == ["goal-reached"]


@pytest.mark.parametrize("use", [name for name, kind in built_in() if kind.knowledge and not kind.sees_world])
def test_in_a_process_of_its_own_it_learns_of_changes_likewise(use: str) -> None:
    case = CASES[use]
    states = []
    for timing in (STEADY, Timing(in_process=True)):
        one = ready(use, changing(case), case, 2, timing)
        summary = execute(one, CHANGE + 20)
        assert summary.status == "finished", summary.failure
        states.append((one.environment.state(robots(one)).tolist(), summary.goals_reached, names(one, "goal-changed")))
    assert states[0] == states[1]


@each_case
@pytest.mark.parametrize("value", [[1.0], "nowhere", None, [[0.0, 1.0], "x"]], ids=["short", "text", "None", "mixed"])
def test_invalid_knowledge_ends_the_run_with_a_description_of_valid_values(use: str, value: list[float] | str) -> None:
    case = CASES[use]

    def spoil(agent: Agent) -> None:
        if agent.surroundings.clock.now:
            agent.self_knowledge[case.name] = value

    summary = execute(ready(use, spoil, case), 3)
    assert summary.status == "failed"
    assert summary.failure is not None
    assert f"the knowledge `{case.name}`" in summary.failure
    assert "steer" in summary.failure
