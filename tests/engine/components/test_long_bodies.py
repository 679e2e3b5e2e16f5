"""Long bodies that drive by a lidar through gaps that the circle around them does not fit into."""

from typing import Any

import pytest

from symaware_cli import ScenarioError, scenario

#: Half the length, and half the width, of the body; the circle around it has a radius of 0.36 m.
HALF, SIDE = 0.3, 0.2


def document(steer: str, gap: float, goal: list[float] | None = None, **options: Any) -> dict[str, Any]:
    """A robot in front of a wall with a gap."""
    side = {"shape": {"box": {"length": 0.3, "width": 3.0}}}
    return {
        "symaware": 1,
        "name": "gap",
        "environment": {
            "use": "kinematic",
            "with": {"time_step": 0.1, "on_contact": "stop"},
            "entities": {
                "left": side | {"position": [2.0, 1.5 + 0.5 * gap]},
                "right": side | {"position": [2.0, -1.5 - 0.5 * gap]},
            },
        },
        "run": {"duration": 10.0, "until": "all(goals_reached)"},
        "agents": {
            "robot": {
                "entity": {"shape": {"box": {"length": 2 * HALF, "width": 2 * SIDE}}},
                "model": {"use": "unicycle", "with": {"max_speed": 1.0}},
                "state": [0.0, 0.3, 0.0],
                "knowledge": {"goal": goal or [4.0, 0.0]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "lidar": {"use": "perception.lidar", "with": {"range": 3.0, "rays": 90}},
                    "steer": {"use": steer, "with": {"scan": "lidar", "margin": 0.04, "tolerance": 0.3, **options}},
                },
            }
        },
    }


def test_the_rectangle_passes_a_gap_that_the_disc_does_not() -> None:
    options: dict[str, Any] = {"footprint": "rectangle", "radius": SIDE}
    summary = scenario(document("control.dynamic-window", 0.6, **options)).run(record=False).summary
    assert (len(summary.goals_reached), summary.contacts) == (1, 0)
    summary = scenario(document("control.dynamic-window", 0.6)).run(record=False, duration=5.0).summary
    assert (len(summary.goals_reached), summary.contacts) == (0, 0)


def test_a_rectangle_does_not_turn_into_a_body_beside_it() -> None:
    # The goal is behind a robot between two walls, in which it cannot turn around.
    content = document("control.dynamic-window", 0.5, [-3.0, 0.0], footprint="rectangle", radius=SIDE)
    content["agents"]["robot"]["state"] = [2.0, 0.0, 0.0]
    content["environment"]["entities"]["left"]["shape"] = {"box": {"length": 1.5, "width": 3.0}}
    content["environment"]["entities"]["right"]["shape"] = {"box": {"length": 1.5, "width": 3.0}}
    assert scenario(content).run(record=False, duration=5.0).summary.contacts == 0


def test_the_disc_of_a_body_may_be_smaller_than_the_circle_around_it() -> None:
    steer = "control.vector-field-histogram"
    assert len(scenario(document(steer, 0.6, radius=SIDE)).run(record=False).summary.goals_reached) == 1
    assert not scenario(document(steer, 0.6)).run(record=False, duration=6.0).summary.goals_reached


def test_planners_take_the_same_disc() -> None:
    content = document("control.dynamic-window", 0.6, footprint="rectangle", radius=SIDE)
    content["agents"]["robot"]["knowledge"]["waypoints"] = [[0, 0]]
    components = content["agents"]["robot"]["components"]
    plan: dict[str, Any] = {
        "use": "planning.grid",
        "with": {"resolution": 0.1, "within": [-1, 5, -2, 2], "margin": 0.02},
    }
    content["agents"]["robot"]["components"] = {"plan": plan, **components}
    # It finds no path, and the robot waits.
    summary = scenario(content).run(record=False, duration=1.0).summary
    assert not summary.goals_reached
    plan["with"]["radius"] = SIDE
    assert len(scenario(content).run(record=False).summary.goals_reached) == 1


@pytest.mark.parametrize("options", [{"radius": 0.0}, {"footprint": "star"}])
def test_an_impossible_footprint_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError, match=next(iter(options))):
        scenario(document("control.dynamic-window", 0.6, **options))
