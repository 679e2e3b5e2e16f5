"""Pure pursuit: how cars follow lines."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import Team, made, simulate

from symaware_cli.core import AgentGroup, Entity
from symaware_cli.engine.components.control.pure_pursuit import PurePursuit
from symaware_cli.engine.components.perception import SelfPerception
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.heading import HeadingModel
from symaware_cli.engine.models.racecar import Racecar
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.log.logged_events import LoggedEvent
from symaware_cli.log.reader import open_log

SQUARE = [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]]


def drive(
    path: Path,
    waypoints: Sequence[Sequence[float]],
    state: Sequence[float],
    steps: int = 400,
    model: HeadingModel | None = None,
    **parameters: float,
) -> tuple[NDArray[np.float64], list[LoggedEvent]]:
    parameters = {"speed": 0.9, "lookahead": 0.5, "lookahead_time": 0.3} | parameters
    team = Team(state=[state], model=model or Bicycle(), knowledge=[{"waypoints": waypoints}])
    team.components = {"sense": SelfPerception, "steer": lambda: made(PurePursuit, **parameters)}
    simulate({"car": team}, steps, path)
    log = open_log(path)
    return log.series("car", "world").values.reshape(steps + 1, -1), list(log.events())


def distance_to_line(points: NDArray[np.float64], one: Sequence[float], other: Sequence[float]) -> NDArray[np.float64]:
    along = np.subtract(other, one) / np.linalg.norm(np.subtract(other, one))
    result: NDArray[np.float64] = np.abs((points - one) @ np.array([-along[1], along[0]]))
    return result


def test_on_a_circle_through_the_point_ahead_it_steers_as_the_formula_says(tmp_path: Path) -> None:
    # The point is 1 m ahead on the line y = 0.6, and the car at the origin: at the distance 1, 0.6 to the left.
    states, _ = drive(tmp_path / "log", [[0.0, 0.6], [9.0, 0.6]], [0, 0, 0], 1, lookahead=1.0, lookahead_time=0.0)
    target = np.array([1.0, 0.6])
    curvature = 2 * 0.6 / (target @ target)
    assert states[1, 2] == pytest.approx(0.9 * 0.05 * curvature, rel=1e-6)


def test_it_comes_to_a_line_and_stays_on_it(tmp_path: Path) -> None:
    states, _ = drive(tmp_path / "log", [[0.0, 0.0], [30.0, 0.0]], [0, 1.0, 0.5])
    assert np.abs(states[200:, 1]).max() < 0.02
    assert states[-1, 0] > 15.0


@pytest.mark.parametrize("model", [Bicycle(), Racecar()], ids=["bicycle", "racecar"])
def test_it_goes_round_a_loop_and_counts_laps(model: HeadingModel, tmp_path: Path) -> None:
    state = [1.0, 0.0, *[0.0] * (len(model.state) - 2)]
    states, events = drive(tmp_path / "log", SQUARE, state, 1200, model, loop=True)
    laps = [event.data["number"] for event in events if event.name == "lap-completed"]
    assert laps == [1, 2]
    sides = [distance_to_line(states[:, :2], SQUARE[number - 1], SQUARE[number]) for number in range(4)]
    assert np.min(sides, axis=0).max() < 0.4  # cuts corners by less than it looks ahead


def test_it_stops_at_the_end_and_says_so_once(tmp_path: Path) -> None:
    states, events = drive(tmp_path / "log", [[0.0, 0.0], [5.0, 0.0]], [0, 0, 0], tolerance=0.1)
    assert states[-1, 0] == pytest.approx(5.0, abs=0.1)
    assert np.abs(states[-1] - states[-20]).max() < 0.01
    assert [event.name for event in events].count("goal-reached") == 1


def test_where_a_line_crosses_itself_it_goes_straight_on(tmp_path: Path) -> None:
    eight = [[0, 0], [6, 6], [9, 3], [6, 0], [0, 6], [-3, 3]]
    states, events = drive(tmp_path / "log", eight, [1.0, 1.0, 0.785], 800, loop=True)
    assert [event.name for event in events].count("lap-completed") == 1
    crossing = np.linalg.norm(states[:, :2] - [3, 3], axis=1) < 0.3
    assert crossing.sum() > 5
    headings = np.degrees(states[crossing, 2]) % 360
    assert all(min(abs(heading - 45), abs(heading - 135)) < 15 for heading in headings)


def test_each_agent_follows_its_own_line(tmp_path: Path) -> None:
    team = Team(count=2, state=[[0, 0, 0], [0, 5, 0]], model=Bicycle())
    team.knowledge = [{"waypoints": [[0, 0], [9, 0]]}, {"waypoints": [[0, 5], [9, 9]]}]
    team.components = {"sense": SelfPerception, "steer": lambda: made(PurePursuit, speed=0.9)}
    simulate({"car": team}, 150, tmp_path / "log")
    last = open_log(tmp_path / "log").series("car", "world").values[-1]
    assert abs(last[0, 1]) < 0.01
    assert distance_to_line(last[1:, :2], [0, 5], [9, 9])[0] < 0.05


@pytest.mark.parametrize(
    ("model", "waypoints", "said"),
    [
        (Unicycle(), [[0, 0], [1, 0]], "it steers cars"),
        (Bicycle(), [[0, 0]], "at least 2 positions"),
        (Bicycle(), [[0, 0, 1], [1, 0, 1]], "at least 2 positions of 2 numbers"),
        (Bicycle(), [[0, 0], [0, 0], [1, 1]], "are equal"),
    ],
)
def test_unusable_options_are_reported(model: HeadingModel, waypoints: list[list[int]], said: str) -> None:
    group = AgentGroup("car", ["car"], model, Entity(), [[0, 0, 0]], [{"waypoints": waypoints}])
    with pytest.raises(ValueError, match=said):
        PurePursuit().check(group)


@pytest.mark.parametrize("heading", [np.pi, -np.pi, 3.0, 2.0])
def test_an_agent_with_the_line_behind_it_turns_round(heading: float, tmp_path: Path) -> None:
    line = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]
    states, events = drive(tmp_path / "log", line, [0, 0, heading], 400, tolerance=0.1)
    assert [event.name for event in events].count("goal-reached") == 1
    assert np.abs(states[:, :2]).max() < 5.0
