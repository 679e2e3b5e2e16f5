"""Model predictive control: plans that arrive, keep clear, and fail politely."""

import gc
import subprocess
import sys
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from casadi.casadi import SX
from checkout import CHECKOUT
from numpy.typing import ArrayLike, NDArray
from simulating import untyped

from symaware_cli import Component, Event, GroupComponent, Model
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.runtime.run_summary import RunSummary

pytest.importorskip("casadi", reason="CasADi is an extra")

from simulating import Team, execute, simulation

from symaware_cli import AwarenessVector, Entity, Obstacle, TimeSeries, open_log
from symaware_cli.engine.components.perception import OmniscientPerception, SelfPerception
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.components.uncertainty_gaussian import GaussianUncertainty
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute as run
from symaware_cli.planning.control.mpc import ModelPredictiveControl
from symaware_cli.planning.control.risk_aware import RiskAware

DISC = Entity.model_validate({"shape": {"circle": {"radius": 0.3}}})
SCENARIO = CHECKOUT / "scenarios" / "mpc.yaml"
#: Half as many steps as usual, for tests that do not look at the finest motion.
COARSE = {"horizon": 3.0, "steps": 10, "neighbours": 2}

MODELS = {
    "single integrator": SingleIntegrator(SingleIntegrator.Parameters(max_speed=1.2)),
    "double integrator": DoubleIntegrator(DoubleIntegrator.Parameters(max_acceleration=1.5)),
    "unicycle": Unicycle(Unicycle.Parameters(max_speed=1.2)),
    "bicycle": Bicycle(Bicycle.Parameters(max_speed=1.2)),
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def control(**parameters: Any) -> ModelPredictiveControl:
    return ModelPredictiveControl(ModelPredictiveControl.Parameters(**{**COARSE, **parameters}))


def team(
    model: Model,
    starts: Sequence[Sequence[float]],
    goals: Sequence[Sequence[float]],
    sense: type[GroupComponent] = OmniscientPerception,
    knowledge: Mapping[str, Any] | None = None,
    **parameters: Any,
) -> Team:
    """Agents that begin somewhere, at rest or heading along x, and want to be elsewhere."""
    states = [[*start, *[0.0] * (len(model.state) - len(start))] for start in starts]
    known = [{"goal": goal, **(knowledge or {})} for goal in goals]
    components: dict[str, Callable[[], Component | GroupComponent]] = {
        "sense": sense,
        "steer": lambda: control(**parameters),
    }
    return Team(components, len(states), states, known, model, DISC)


def travel(
    teams: Mapping[str, Team], steps: int, **options: Any
) -> tuple[RunSummary, list[Event], NDArray[np.float64]]:
    """Run: the summary, the events of the controllers, and where everybody was; positions (steps, N, d)."""
    ready = simulation(teams, **options)
    places = []
    events: list[Event] = []
    ready.events.subscribe("*", events.append, "agents.*")
    ready.events.subscribe("stepped", lambda _: places.append(ready.environment.snapshot().positions.copy()))
    summary = execute(ready, steps)
    return summary, events, np.array(places)


@every_model
def test_every_model_goes_to_its_goal_and_stays_there(model: NoisyModel) -> None:
    summary, events, places = travel({"robot": team(model, [[0.0, 0.0]], [[4.0, 1.0]])}, 200)
    assert summary.goals_reached
    assert [event.name for event in events] == ["goal-reached"]
    assert places[-20:, 0] == pytest.approx(np.tile([4.0, 1.0], (20, 1)), abs=0.1)
    assert np.hypot(*np.diff(places[:, 0], axis=0).T).max() <= 1.3 * 0.05


@every_model
def test_two_who_head_for_each_other_pass_and_arrive(model: NoisyModel) -> None:
    pair = team(model, [[-3.0, 0.0], [3.0, 0.0]], [[3.0, 0.0], [-3.0, 0.0]])
    if model.heading is not None:
        untyped(pair.state)[1][model.heading] = np.pi
    summary, _, places = travel({"robot": pair}, 180)
    assert summary.contacts == 0
    assert summary.minimum_separation is not None
    assert summary.minimum_separation.value > 0.0
    assert len(summary.goals_reached) == 2
    closest = min(places, key=lambda each: np.hypot(*(each[0] - each[1])))
    assert closest[0, 1] < 0.0 < closest[1, 1]  # on the right


SHAPES = {
    "circle": {"circle": {"radius": 0.7}},
    "box": {"box": {"length": 1.0, "width": 1.4}},
    "polygon": {"polygon": {"vertices": [[-0.8, -0.5], [0.8, 0.0], [-0.3, 0.8]]}},
    "wall": {"wall": {"points": [[-0.5, -0.5], [0.0, 0.6], [0.7, 0.8]], "thickness": 0.2}},
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_obstacles_of_every_shape_are_passed(shape: dict[str, Any]) -> None:
    obstacle = Obstacle.model_validate({"shape": shape, "position": [0.0, -0.2]})
    robot = team(MODELS["unicycle"], [[-3.0, 0.0]], [[3.0, 0.0]], steps=15)
    summary, _, places = travel({"robot": robot}, 220, obstacles={"thing": obstacle})
    assert summary.contacts == 0
    assert summary.goals_reached
    assert np.abs(places[:, 0, 1]).max() > 0.5


def test_an_obstacle_on_its_way_is_dodged_before_it_is_there() -> None:
    path = {"times": [0.0, 20.0], "positions": [[0.0, 5.0], [0.0, -5.0]]}
    cart = Obstacle.model_validate({"shape": {"box": {"length": 0.8, "width": 0.8}}, "path": path})
    # Alone at 1 m/s it would be at the origin after 10 s, together with the cart.
    robot = team(MODELS["unicycle"], [[-10.0, 0.0]], [[3.0, 0.0]], perturbation=0.0)
    summary, _, _ = travel({"robot": robot}, 320, obstacles={"cart": cart})
    assert summary.contacts == 0
    assert summary.goals_reached


def test_an_unperceived_agent_is_not_avoided() -> None:
    pair = team(MODELS["single integrator"], [[-3.0, 0.0], [3.0, 0.0]], [[3.0, 0.0], [-3.0, 0.0]], sense=SelfPerception)
    assert travel({"robot": pair}, 120)[0].contacts > 0


def test_an_agent_that_is_seen_late_is_expected_at_its_extrapolated_position() -> None:
    def sense() -> RangePerception:
        return RangePerception(RangePerception.Parameters(range=20.0, delay=1.0))

    pair = team(MODELS["single integrator"], [[-6.0, 0.0], [0.0, -6.0]], [[6.0, 0.0], [0.0, 6.0]], margin=0.3)
    pair.components = {"sense": sense, "belief": GaussianUncertainty, "steer": pair.components["steer"]}
    summary, _, _ = travel({"robot": pair}, 260)
    assert summary.contacts == 0
    assert len(summary.goals_reached) == 2


class Told(Component):
    """Believes that robot.1 said it would turn off upwards."""

    def _compute(self) -> AwarenessVector:
        state = self._agent.awareness_database["robot.1"].state
        times = self.time + np.linspace(0.0, 4.0, 5)
        return AwarenessVector("robot.1", state, TimeSeries({t: [state[0], 9.0] for t in times}))

    def _update(self, value: AwarenessVector) -> None:
        self._agent.awareness_database["robot.1"] = value


def test_an_intent_that_was_told_counts_more_than_a_velocity() -> None:
    def aside(**told: type[Told]) -> float:
        """How far robot.0 plans to leave the line on which both come at each other."""
        pair = team(MODELS["single integrator"], [[-1.0, 0.0], [1.0, 0.1]], [[1.0, 0.0], [-1.0, 0.1]], perturbation=0.0)
        pair.components = {"sense": OmniscientPerception, **told, "steer": pair.components["steer"]}
        ready = simulation({"robot": pair})
        execute(ready, 7)
        return float(np.abs(ready.groups[0].agents[0].self_awareness.intent.values[:, 1]).max())

    assert aside() > 0.2
    assert aside(told=Told) < 1e-3


def test_the_plan_is_the_intent_and_what_happens_while_nothing_disturbs_it() -> None:
    robot = team(MODELS["unicycle"], [[0.0, 0.0]], [[5.0, 2.0]], neighbours=0)
    ready = simulation({"robot": robot})
    plans, places = [], []
    group = ready.groups[0]
    ready.events.subscribe("iterated", lambda _: plans.append(group.awareness.intent.row(0)))
    ready.events.subscribe("stepped", lambda _: places.append(ready.environment.state(group)[0, :2].copy()))
    execute(ready, 60)
    # A step of the plan, 0.3 s, is six of the world. At its end the next plan begins where this one said.
    for k in range(0, 54, 6):
        assert plans[k].times.tolist() == [k * 50_000_000 + n * 300_000_000 for n in range(11)]
        assert all(plan == plans[k] for plan in plans[k : k + 6])
        assert plans[k].values[1] == pytest.approx(places[k + 5], abs=1e-9)


@pytest.mark.parametrize("integrator", ["exact", "rk4", "euler"])
def test_a_plan_reckons_as_the_world_does(integrator: str) -> None:
    parameters = KinematicEnvironment.Parameters(time_step=0.1, integrator=integrator, substeps=2)
    ready = simulation(
        {"robot": team(MODELS["bicycle"], [[0.0, 0.0]], [[2.0, 3.0]])}, environment=KinematicEnvironment(parameters)
    )
    execute(ready, 3)
    plan = ready.groups[0].agents[0].self_awareness.intent
    assert plan.values[1] == pytest.approx(ready.environment.state(ready.groups[0])[0, :2], abs=1e-8)


def test_waypoints_come_before_the_goal() -> None:
    known = {"waypoints": [[2.0, 0.0], [2.0, 2.0]]}
    robot = team(MODELS["unicycle"], [[0.0, 0.0]], [[0.0, 2.0]], knowledge=known)
    summary, events, places = travel({"robot": robot}, 220)
    assert summary.goals_reached
    assert [(event.name, event.data.get("number")) for event in events] == [
        ("waypoint-reached", 0),
        ("waypoint-reached", 1),
        ("goal-reached", None),
    ]
    for waypoint in known["waypoints"]:
        assert np.hypot(*(places[:, 0] - waypoint).T).min() < 0.5


def test_a_goal_near_the_start_is_not_reached_before_the_waypoints() -> None:
    around = [[2.0, 0.0], [2.0, 2.0]]
    robot = team(MODELS["single integrator"], [[0.0, 0.0]], [[0.0, 0.05]], knowledge={"waypoints": around})
    summary, events, _ = travel({"robot": robot}, 200)
    assert [event.name for event in events] == ["waypoint-reached", "waypoint-reached", "goal-reached"]
    assert summary.goals_reached


def test_a_goal_that_is_a_state_is_reached_as_a_whole_the_shorter_way_round() -> None:
    weights = {"x": 1.0, "y": 1.0, "heading": 0.5}
    robot = team(MODELS["unicycle"], [[0.0, 0.0, 3.0]], [[-3.0, 0.5, -3.0]], state_weight=weights)
    ready = simulation({"robot": robot})
    execute(ready, 150)
    state = ready.environment.state(ready.groups[0])[0]
    assert state == pytest.approx([-3.0, 0.5, 2 * np.pi - 3.0], abs=0.1)


def test_models_in_discrete_time_and_in_space_are_steered_too() -> None:
    given = {"state": {"x": "m", "y": "m"}, "control_input": {"a": "m", "b": "m"}}
    eye = [[1.0, 0.0], [0.0, 1.0]]
    walk = Linear(Linear.Parameters(time_step=0.05, A=eye, B=eye, max_input=0.05, **given))
    summary, _, _ = travel({"robot": team(walk, [[0.0, 0.0], [4.0, 0.0]], [[4.0, 0.0], [0.0, 0.0]])}, 160)
    assert (summary.contacts, len(summary.goals_reached)) == (0, 2)
    drone = SingleIntegrator(SingleIntegrator.Parameters(dimensions=3, max_speed=1.2))
    pair = team(drone, [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0]], [[4.0, 0.0, 2.0], [0.0, 0.0, 2.0]])
    summary, _, _ = travel({"drone": pair, "robot": team(walk, [[9.0, 9.0]], [[9.0, 8.0]])}, 160)
    assert (summary.contacts, len(summary.goals_reached)) == (0, 3)


def test_an_aircraft_that_cannot_stop_circles() -> None:
    model = DubinsAircraft(DubinsAircraft.Parameters(min_speed=0.5, max_speed=1.0, max_turn_rate=1.0))
    _, events, places = travel({"plane": team(model, [[0.0, 0.0]], [[3.0, 1.0]])}, 300)
    assert "solver-failed" not in {event.name for event in events}
    assert np.hypot(*(places[100:, 0] - [3.0, 1.0]).T).max() < 1.5


def test_a_solver_that_fails_is_an_event_and_the_last_plan_goes_on_until_the_agent_stops() -> None:
    # One iteration is never enough, so there is not even a first plan.
    robot = team(MODELS["unicycle"], [[0.0, 0.0]], [[4.0, 1.0]], iterations=1)
    _, events, places = travel({"robot": robot}, 12)
    assert [event.name for event in events] == ["solver-failed"] * 2
    assert events[0].data == {"status": "out of iterations", "solver": "ipopt", "iterations": 3, "left": 0}
    assert "slows down" in events[0].text
    assert places[-1, 0].tolist() == [0.0, 0.0]


class Mirage(Component):
    """After a while believes to be in the middle of the obstacle."""

    def _compute(self) -> NDArray[np.float64] | list[float]:
        return [0.0, 0.1, 0.0] if 1.0 < self.time < 5.0 else self.environment.state(self._agent.group)[0]

    def _update(self, value: ArrayLike) -> None:
        self._agent.self_awareness.state = value


def test_the_rest_of_the_last_plan_is_followed_while_there_is_no_new_one() -> None:
    pillar = Obstacle.model_validate({"shape": {"circle": {"radius": 0.7}}, "position": [0.0, 0.0]})
    robot = team(MODELS["unicycle"], [[-4.0, 3.0]], [[4.0, 3.0]], penalty=None)
    robot.components = {"sense": Mirage, "steer": robot.components["steer"]}
    _, events, places = travel({"robot": robot}, 120, obstacles={"pillar": pillar})
    failures = [event for event in events if event.name == "solver-failed"]
    assert [event.data["left"] for event in failures] == [9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 0, 0, 0]
    assert {event.data["status"] for event in failures} == {"infeasible problem detected"}
    assert "of which 9 steps are left" in failures[0].text
    speed = np.hypot(*np.diff(places[:, 0], axis=0).T) / 0.05
    assert speed[20:70].min() > 0.5  # on by the plan
    assert speed[85:95].max() < 1e-9  # then at rest
    assert speed[110:].min() > 0.5  # and on when it sees again where it is


def test_failures_are_in_the_log(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    execute(simulation({"robot": team(MODELS["unicycle"], [[0.0, 0.0]], [[4.0, 1.0]], iterations=1)}), 4, log)
    events = [event for event in open_log(log).events() if event.name == "solver-failed"]
    assert events[0].source == "agents.robot.0.steer"
    assert events[0].data["status"] == "out of iterations"


def test_a_control_input_changes_once_for_each_turn() -> None:
    # Between two plans the input is held as it was planned, so that a brake behind it does not add up.
    model = MODELS["single integrator"]
    robot = team(model, [[0.0, 0.0]], [[9.0, 0.0]], perturbation=0.0)

    class Risk(Component):
        def _compute(self) -> TimeSeries:
            return TimeSeries({self.time: [0.5]})

        def _update(self, value: TimeSeries) -> None:
            self._agent.self_awareness.risk = value

    brake = RiskAware.Parameters(caution=0.0, bound=1.0)
    robot.components = {**robot.components, "risk": Risk, "brake": lambda: RiskAware(brake)}
    ready = simulation({"robot": robot})
    speeds = []
    ready.events.subscribe("stepped", lambda _: speeds.append(ready.groups[0].control_input[0, 0]))
    execute(ready, 6)
    assert max(speeds) - min(speeds) < 1e-12
    assert speeds[0] > 0.3


def choices(teams: Mapping[str, Any], steps: int = 7, **options: Any) -> dict[str, bytes]:
    """Every bit of where everybody is after some steps, by id."""
    ready = simulation(teams, **options)
    execute(ready, steps)
    states = [(group.ids, ready.environment.state(group)) for group in ready.groups]
    return {id: row.tobytes() for ids, rows in states for id, row in zip(ids, rows, strict=True)}


def crowd(count: int, centre: float = 0.0) -> Team:
    chance = np.random.default_rng(5)
    places, goals = chance.uniform(-3, 3, (2, count, 2)) + centre
    return team(MODELS["single integrator"], places.tolist(), goals.tolist())


def test_no_bit_of_a_choice_depends_on_who_is_far_away_or_on_the_order_of_groups() -> None:
    alone = choices({"robot": crowd(3), "drone": crowd(1, 1.5)})
    together = choices({"cloud": crowd(2, 1000.0), "drone": crowd(1, 1.5), "robot": crowd(3)})
    assert {id: together[id] for id in alone} == alone


def test_agents_of_a_group_share_a_solver_and_others_do_not() -> None:
    first, second = crowd(2), crowd(2)
    second.components = {"sense": OmniscientPerception, "steer": lambda: control(margin=0.4)}
    ready = simulation({"one": first, "two": second})
    ready.initialise()
    one, two = (
        [untyped(component)._solver for component in entry.components]
        for entry in ready.entries
        if entry.name == "steer"
    )
    assert one[0] is one[1]
    assert two[0] is two[1]
    assert one[0] is not two[0]


def test_solvers_and_routes_go_when_their_simulation_goes() -> None:
    pillar = Obstacle.model_validate({"shape": {"circle": {"radius": 0.7}}, "position": [9.0, 0.0]})
    ready = simulation({"robot": crowd(1)}, obstacles={"pillar": pillar})
    execute(ready, 1)
    steer: Any = next(entry.components[0] for entry in ready.entries if entry.name == "steer")
    held = [weakref.ref(steer._solver), weakref.ref(ready.environment), weakref.ref(ready.groups[0])]
    del ready, steer
    gc.collect()
    assert [each() for each in held] == [None, None, None]


REFUSED = {
    "a goal of another length": (
        {},
        {"goal": [1.0, 2.0, 3.0, 4.0]},
        "must be a position of 2 numbers, or a state of 3",
    ),
    "waypoints of another length": (
        {},
        {"goal": [1.0, 2.0], "waypoints": [[1.0]]},
        "`waypoints` of each agent must be",
    ),
    "waypoints that are none": ({}, {"goal": [1.0, 2.0], "waypoints": "home"}, "`waypoints` of each agent must be"),
    "a name": ({"state_weight": {"speed": 1.0}}, {}, "`state_weight` is for `speed`, and the model has x, y, heading"),
    "a list": ({"change_weight": [1.0]}, {}, "`change_weight` has 1 numbers, and the model has speed, turn_rate"),
    "a heading": ({"terminal_weight": 1.0}, {}, "a weight of `heading` needs a `goal` that is a whole state"),
}


@pytest.mark.parametrize(("parameters", "knowledge", "said"), REFUSED.values(), ids=REFUSED)
def test_parameters_that_do_not_fit_the_model_are_refused(
    parameters: dict[str, Any], knowledge: dict[str, Any], said: str
) -> None:
    group = Team({}, 1, [[0.0, 0.0, 0.0]], [{"goal": [1.0, 0.0], **knowledge}], Unicycle()).group("robot")
    with pytest.raises(ValueError, match=said):
        control(**parameters).check(group)


class Lookup(SingleIntegrator):
    """Moves by a table of numbers, which symbols cannot look up."""

    def derivative(self, state: SX, control_input: SX, math: ModuleType) -> Any:
        return tuple((0.0, 0.5, 1.0)[int(control_input[axis])] for axis in self.position)

    def successor(self, state: SX, control_input: SX, step: float, math: ModuleType) -> Any:
        return None


def test_a_model_that_is_not_for_symbols_is_refused() -> None:
    group = Team({}, 1, [[0.0, 0.0]], [{"goal": [1.0, 0.0]}], Lookup()).group("robot")
    with pytest.raises(ValueError, match="does not work with CasADi's symbols"):
        control().check(group)


def test_without_casadi_a_scenario_says_which_extra_is_missing(tmp_path: Path) -> None:
    script = "import sys; sys.modules['casadi'] = None; from symaware_cli.cli import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", script, "run", str(SCENARIO), "--output", str(tmp_path / "run.mcap")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "needs the module `casadi`, which is not installed" in " ".join(done.stderr.split())
    assert "symaware-cli[casadi]" in done.stderr


def swaps(seeds: Sequence[int], *overrides: str) -> None:
    for seed in seeds:
        built = build(SCENARIO, overrides, seed)
        count = built.document.agents["robot"].count
        summary = run(built, None)
        assert (seed, summary.contacts, len(summary.goals_reached)) == (seed, 0, count)


OPEN = ("environment.entities={}", "agents.robot.components.steer.with.steps=10")


def test_six_robots_swap_places_among_obstacles_without_a_contact() -> None:
    swaps([12])


def test_six_robots_swap_places_without_a_contact_with_half_the_steps() -> None:
    swaps(range(2), *OPEN)


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        "{use: unicycle, with: {max_speed: 1.2}}",
        "{use: bicycle, with: {max_speed: 1.2}}",
        "{use: single-integrator, with: {max_speed: 1.2}}",
        "{use: double-integrator, with: {max_acceleration: 2.0}}",
    ],
)
def test_six_robots_swap_places_without_a_contact_whatever_the_seed_and_model(model: Any) -> None:
    swaps(range(2), OPEN[0], f"agents.robot.model={model}")
