"""Waypoints are passed in their order."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulating import Team, execute, simulation

from symaware_cli.engine.components.control.goal import GoToGoal
from symaware_cli.engine.components.control.waypoints import Waypoints
from symaware_cli.engine.components.perception import SelfPerception
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle

SQUARE = [[4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]


def patrol(waypoints: Any, state: Any = (0.0, 0.0), model: Any = None, **parameters: Any) -> Any:
    """One agent for each list of waypoints."""
    return Team(
        {"sense": SelfPerception, "steer": lambda: Waypoints(Waypoints.Parameters(**parameters))},
        len(waypoints),
        [list(state)] * len(waypoints),
        [{"waypoints": each} for each in waypoints],
        model or SingleIntegrator(),
    )


def travel(team: Any, steps: Any) -> Any:
    """Run; the events of the controller, and where everybody was, (steps, n, 2)."""
    ready = simulation({"robot": team})
    events, places = [], []
    for name in ("waypoint-reached", "goal-reached"):
        ready.events.subscribe(name, lambda event: events.append((event.source, event.name, event.data.get("number"))))
    ready.events.subscribe("stepped", lambda _: places.append(ready.environment.snapshot().positions[:, :2].copy()))
    execute(ready, steps)
    return events, np.array(places), ready


def intent_of(team: Any, steps: int = 1) -> Any:
    _, places, ready = travel(team, steps)
    series = ready.groups[0].awareness.intent.row(0)
    return places, series


@pytest.mark.parametrize(
    ("model", "state"), [(SingleIntegrator(), (0, 0)), (Unicycle(), (0, 0, 0))], ids=["point", "unicycle"]
)
def test_waypoints_are_reached_one_after_the_other_and_the_last_is_the_goal(model: Any, state: Any) -> None:
    events, places, _ = travel(patrol([SQUARE], state, model), 400)
    source = "agents.robot.0.steer"
    numbers = [(source, "waypoint-reached", number) for number in range(3)]
    assert events == [*numbers, (source, "goal-reached", None)]
    assert places[-1, 0] == pytest.approx([0, 4], abs=0.05)


def test_each_agent_has_waypoints_of_its_own() -> None:
    _, places, _ = travel(patrol([SQUARE, [[-1.0, 0.0], [-1.0, -1.0], [-2.0, -1.0]]]), 400)
    assert places[-1] == pytest.approx(np.array([[0, 4], [-2, -1]]), abs=0.01)


def test_a_loop_never_ends() -> None:
    events, _, _ = travel(patrol([SQUARE], loop=True, speed=2.0), 600)
    numbers = [number for _, name, number in events if name == "waypoint-reached"]
    assert len(numbers) == len(events) > 6
    assert numbers == [number % 3 for number in range(len(numbers))]


def test_the_speed_is_kept_between_waypoints_and_falls_before_the_last() -> None:
    _, places, _ = travel(patrol([SQUARE], speed=1.0), 300)
    speed = np.hypot(*np.diff(places[:, 0], axis=0).T) / 0.05
    along = np.hypot(*(places[1:, 0] - SQUARE[-1]).T)
    assert speed[along > 1.1] == pytest.approx(1.0)
    assert speed[along < 0.5].max() < 0.56


def test_a_single_waypoint_is_a_goal() -> None:
    _, places, ready = travel(patrol([[[3.0, 1.0]]]), 60)
    goal = Team(
        {"sense": SelfPerception, "steer": GoToGoal}, 1, [[0.0, 0.0]], [{"goal": [3.0, 1.0]}], SingleIntegrator()
    )
    _, expected, other = travel(goal, 60)
    assert places.tobytes() == expected.tobytes()
    one, two = (each.groups[0].awareness.intent.row(0).values for each in (ready, other))
    assert one == pytest.approx(two, abs=1e-9)


def test_the_intent_is_the_way_ahead_around_corners() -> None:
    _, intent = intent_of(patrol([SQUARE], speed=2.0, horizon=4.0, samples=5))
    assert list(intent) == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert intent.values == pytest.approx(np.array([[0, 0], [2, 0], [4, 0], [4, 2], [4, 4]], float))


def test_the_intent_ends_at_the_last_waypoint_and_goes_around_a_loop() -> None:
    _, ends = intent_of(patrol([SQUARE], speed=2.0, horizon=8.0, samples=3))
    assert ends.values[1:] == pytest.approx(np.array([[4, 4], [0, 4]], float))
    triangle = [[3.0, 0.0], [3.0, 4.0], [0.0, 0.0]]
    _, around = intent_of(patrol([triangle], loop=True, speed=12.0, horizon=3.25, samples=14))
    assert around.values[4] == pytest.approx([0, 0], abs=1e-9)
    assert around.values[-1] == pytest.approx([3, 0], abs=1e-9)


PLACES = st.lists(st.tuples(*[st.integers(-5, 5).map(float)] * 2), min_size=1, max_size=5)


@given(PLACES, st.booleans(), st.floats(0.1, 3.0))
def test_the_intent_never_goes_faster_than_the_agent_and_stays_on_the_way(places: Any, loop: Any, speed: Any) -> None:
    _, intent = intent_of(patrol([places], loop=loop, speed=speed, samples=9))
    legs = np.hypot(*np.diff(intent.values, axis=0).T)
    assert np.isfinite(intent.values).all()
    assert (legs <= speed * 2.0 / 8 + 1e-9).all()
    corners = np.array([[0.0, 0.0], *places, places[0]])
    assert (intent.values >= corners.min(axis=0) - 1e-9).all()
    assert (intent.values <= corners.max(axis=0) + 1e-9).all()


@pytest.mark.parametrize("waypoints", [[1.0, 2.0], [[1.0, 2.0, 3.0]], 5.0])
def test_anything_but_a_list_of_positions_is_refused(waypoints: Any) -> None:
    group = Team({}, 1, [[0.0, 0.0]], [{"waypoints": waypoints}]).group("robot")
    with pytest.raises(ValueError, match="`waypoints`"):
        Waypoints().check(group)


@pytest.mark.parametrize("lists", [[[], SQUARE], [[], []]], ids=["some", "all"])
def test_an_agent_without_waypoints_waits_and_has_reached_nothing(lists: Any) -> None:
    events, places, _ = travel(patrol(lists), 400)
    assert (places[:, 0] == 0.0).all()
    assert [source for source, name, _ in events if name == "goal-reached"] == [
        f"agents.robot.{row}.steer" for row, each in enumerate(lists) if each
    ]
