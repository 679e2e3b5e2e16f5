"""Vehicles keep to their lanes, follow others, and change lanes."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from road_groups import LANES, group

from symaware_cli import Log
from symaware_cli.language.build import Built
from symaware_cli.language.problem import ScenarioError
from symaware_cli.roads.driver_model import Driver, equilibrium_gap, idm_acceleration

Drive = Callable[..., Log]

TWO = {
    "slow": {"points": [[0, 0], [3000, 0]], "width": 4, "speed_limit": 30},
    "fast": {"points": [[0, 4], [3000, 4]], "width": 4, "speed_limit": 30},
}


def states(log: Log, name: str) -> NDArray[np.float64]:
    """The true states of one agent or of a group, by time."""
    values = log.series(name, "world").values
    return values.reshape(len(values), -1, 3)


def leader(speed: float, place: float, lane: float = 0.0) -> dict[str, Any]:
    return group(
        [place, lane, 0.0],
        {"use": "control.lane-keeping", "with": {"speed": speed}},
        knowledge={"initial_speed": speed},
    )


@pytest.mark.parametrize(("speed", "step"), [(5.0, 0.1), (15.0, 0.1), (25.0, 0.1), (15.0, 0.05)])
def test_behind_a_leader_of_constant_speed_the_gap_becomes_that_of_the_model(
    speed: float, step: float, drive: Drive
) -> None:
    # The follower begins with a greater gap, and as fast as the leader.
    given = {"use": "control.car-following", "with": {"headway": 1.2, "standstill": 3.0}}
    follower = group([0, 0, 0], given, knowledge={"initial_speed": speed})
    start = 4.0 + 1.3 * (3.0 + speed * 1.2) / np.sqrt(1.0 - (speed / 30.0) ** 4)
    log = drive({"lanes": LANES}, 70.0 if speed > 20.0 else 30.0, step, lead=leader(speed, float(start)), car=follower)
    gap = states(log, "lead")[-1, 0, 0] - states(log, "car")[-1, 0, 0] - 4.0
    wanted = (3.0 + speed * 1.2) / np.sqrt(1.0 - (speed / 30.0) ** 4)
    assert gap == pytest.approx(wanted, rel=0.01)
    assert wanted == pytest.approx(equilibrium_gap(speed, 30.0, Driver(3.0, 1.2, 1.5, 2.0, 9.0)))


def test_at_the_equilibrium_gap_cars_do_not_accelerate() -> None:
    driver, speed = Driver(2.0, 1.5, 1.0, 2.0, 9.0), np.array([5.0, 20.0])
    gaps = np.array([equilibrium_gap(each, 30.0, driver) for each in speed.tolist()])
    np.testing.assert_allclose(idm_acceleration(speed, np.full(2, 30.0), gaps, speed, driver), 0.0, atol=1e-12)


def test_a_car_stops_behind_one_that_stands(drive: Drive) -> None:
    follower = group([0, 0, 0], {"use": "control.car-following"}, knowledge={"initial_speed": 25.0})
    standing = group([200, 0, 0], {"use": "control.lane-keeping"}, knowledge={"desired_speed": 0.0})
    log = drive({"lanes": LANES}, 30.0, standing=standing, car=follower)
    gap = states(log, "standing")[:, 0, 0] - states(log, "car")[:, 0, 0] - 4.0
    assert gap.min() > 1.9
    assert gap[-1] == pytest.approx(2.0, abs=0.2)


def test_agents_that_are_not_perceived_are_not_followed(drive: Drive) -> None:
    blind = group([0, 0, 0], {"use": "control.car-following"}, knowledge={"initial_speed": 20.0})
    blind["components"]["see"] = {"use": "perception.self"}
    log = drive({"lanes": LANES}, 20.0, lead=leader(1.0, 50.0), car=blind)
    assert states(log, "car")[-1, 0, 0] > states(log, "lead")[-1, 0, 0]


def test_a_slow_car_is_overtaken_and_no_car_changes_without_need(drive: Drive) -> None:
    fast = group([0, 0, 0], {"use": "control.lane-change"}, knowledge={"initial_speed": 20.0})
    alone = group([0, 4, 0], {"use": "control.lane-change"}, knowledge={"initial_speed": 20.0})
    log = drive({"lanes": TWO}, 30.0, lead=leader(10.0, 100.0), car=fast, alone=alone)
    changes = Counter(event.source for event in log.events() if event.name == "lane-changed")
    assert changes == {"agents.car.drive": 1}
    assert states(log, "car")[-1, 0, 0] > states(log, "lead")[-1, 0, 0]
    assert states(log, "car")[-1, 0, 1] == pytest.approx(4.0, abs=0.1)


def test_no_car_changes_lanes_beside_or_closely_ahead_of_another(drive: Drive) -> None:
    fast = group([0, 0, 0], {"use": "control.lane-change"}, knowledge={"initial_speed": 10.0})
    beside = group(
        [[k * 12.0 - 60.0, 4.0, 0.0] for k in range(12)], {"use": "control.lane-keeping", "with": {"speed": 10.0}}
    )
    beside |= {"count": 12, "knowledge": {"initial_speed": 10.0}}
    log = drive({"lanes": TWO}, 10.0, lead=leader(9.0, 40.0), car=fast, beside=beside)
    assert "lane-changed" not in {event.name for event in log.events()}
    assert abs(states(log, "car")[:, 0, 1]).max() < 0.01


# A double integrator follows velocities with a delay, so it is carried out of the curve.
@pytest.mark.parametrize(
    ("model", "off"),
    [("bicycle", 0.1), ("unicycle", 0.1), ("racecar", 0.2), ("double-integrator", 0.6), ("single-integrator", 0.2)],
)
def test_models_of_vehicles_keep_to_the_centre_of_a_curve(model: str, off: float, drive: Drive) -> None:
    angles = np.linspace(0, np.pi, 61)
    circle = np.stack([50 * np.sin(angles), 50 - 50 * np.cos(angles)], axis=1)
    parameters = {"racecar": {"max_speed": 10}, "bicycle": {"max_speed": 10, "wheelbase": 2.5}}.get(model, {})
    state = {"racecar": [0, 0, 0, 5, 0], "double-integrator": [0, 0, 5, 0], "single-integrator": [0, 0]}
    car = group(state.get(model, [0, 0, 0]), {"use": "control.lane-keeping", "with": {"speed": 5.0}})
    car |= {"model": {"use": model, "with": parameters}, "knowledge": {"initial_speed": 5.0}}
    log = drive({"lanes": {"bend": {"points": circle.tolist()}}}, 20.0, 0.1, car=car)
    places = log.series("car", "world").values.reshape(201, -1)[:, :2]
    radius = np.sqrt(places[:, 0] ** 2 + (places[:, 1] - 50) ** 2)
    assert np.abs(radius - 50.0).max() < off


def test_at_a_fork_the_route_decides_and_at_an_end_there_is_an_event(drive: Drive) -> None:
    lanes = {
        "begin": {"points": [[0, 0], [50, 0]]},
        "left": {"points": [[50, 0], [100, 5], [150, 5]]},
        "right": {"points": [[50, 0], [100, -5], [150, -5]]},
    }
    given = {"use": "control.lane-keeping", "with": {"speed": 10.0}}
    knowledge = {"initial_speed": 10.0, "route": {"each": [["begin", "right"], []]}}
    cars = group([[0, 0, 0], [20, 0, 0]], given, count=2, knowledge=knowledge)
    log = drive({"lanes": lanes}, 16.0, car=cars)
    assert states(log, "car")[-1, :, 1] == pytest.approx([-5.0, 5.0], abs=0.3)
    ended = [(event.source, event.text) for event in log.events() if event.name == "road-ended"]
    said = "came to the end of the lane"
    assert ended == [("agents.car.1.drive", f"{said} left"), ("agents.car.0.drive", f"{said} right")]


def test_on_a_ring_of_one_lane_cars_follow_each_other_over_its_seam(drive: Drive) -> None:
    angles = np.linspace(0, 2 * np.pi, 121)
    circle = np.stack([40 * np.sin(angles), -40 * np.cos(angles)], axis=1)
    circle[-1] = circle[0]
    starts = [[float(40 * np.sin(a)), float(-40 * np.cos(a)), float(a)] for a in np.arange(8) * 2 * np.pi / 8]
    cars = group(starts, {"use": "control.car-following", "with": {"speed": 20.0}}, count=8)
    log = drive({"lanes": {"ring": {"points": circle.tolist(), "width": 4.0}}}, 60.0, car=cars)
    places = states(log, "car")[-1, :, :2]
    angle = np.unwrap(np.sort(np.arctan2(places[:, 1], places[:, 0])))
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi)) * 40.0
    assert gaps.min() > 25.0
    assert "contact" not in {event.name for event in log.events()}


@pytest.mark.parametrize(
    ("roads", "change", "said"),
    [
        (None, {}, "the scenario has no `roads`"),
        ({"lanes": {"one": {"points": [[0, 0], [9, 0]]}}}, {}, "the lane `one` has no speed limit"),
        ({"lanes": LANES}, {"knowledge": {"route": {"all": ["two"]}}}, "names the lane `two`, which does not exist"),
        ({"lanes": LANES}, {"knowledge": {"desired_speed": -1}}, "must be a speed"),
    ],
)
def test_agents_that_cannot_drive_are_refused(
    roads: dict[str, Any] | None, change: dict[str, Any], said: str, road: Callable[..., Built]
) -> None:
    car = group([0, 0, 0], {"use": "control.lane-keeping"}, **change)
    with pytest.raises(ScenarioError, match=said):
        road(roads, car=car)
