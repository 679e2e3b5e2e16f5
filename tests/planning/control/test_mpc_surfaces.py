"""Model predictive control by what a lidar sees."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("casadi", reason="CasADi is an extra")

from symaware_cli import ScenarioError, scenario
from symaware_cli.planning.control.mpc_surfaces import parted, straightened


def document(**options: Any) -> dict[str, Any]:
    """A robot whose way leads past a pillar, along a wall."""
    return {
        "symaware": 1,
        "name": "seen",
        "run": {"duration": 10.0, "until": "all(goals_reached)"},
        "environment": {
            "use": "kinematic",
            "with": {"time_step": 0.1},
            "entities": {
                "pillar": {"shape": {"circle": {"radius": 0.4}}, "position": [2.0, 0.15]},
                "wall": {"shape": {"box": {"length": 5.0, "width": 0.2}}, "position": [2.0, -1.2]},
            },
        },
        "agents": {
            "robot": {
                "entity": {"shape": {"circle": {"radius": 0.25}}},
                "model": {"use": "unicycle"},
                "state": [0.0, 0.0, 0.0],
                "knowledge": {"goal": [4.0, 0.0]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "lidar": {"use": "perception.lidar", "with": {"rays": 72, "range": 4.0, "noise": 0.01}},
                    "steer": {"use": "control.mpc", "with": {"horizon": 3.0, "steps": 8, "margin": 0.1, **options}},
                },
            }
        },
    }


def test_a_robot_passes_what_it_sees() -> None:
    summary = scenario(document(scan="lidar", deviation=0.01)).run(record=False).summary
    assert (len(summary.goals_reached), summary.contacts) == (1, 0)


def test_surfaces_beyond_the_range_of_the_lidar_are_not_known() -> None:
    content = document(scan="lidar")
    content["agents"]["robot"]["components"]["lidar"]["with"]["range"] = 0.01
    assert scenario(content).run(record=False).summary.contacts > 0


def test_a_captured_controller_goes_on_as_it_was() -> None:
    content = scenario(document(scan="lidar", deviation=0.01))
    with content.start() as first:
        first.step(15)
        captured = first.capture()
        first.step(10)
        state = first.state("robot")
    with content.start() as second:
        second.restore(captured)
        second.step(10)
        assert np.array_equal(second.state("robot"), state)


def test_a_scan_that_nobody_makes_is_refused() -> None:
    with pytest.raises(ScenarioError, match="there is no component `eye`"):
        scenario(document(scan="eye"))


def circle(angle: float) -> tuple[float, float]:
    return float(np.cos(angle)), float(np.sin(angle))


def corner(share: float) -> tuple[float, float]:
    return (share, 0.0) if share < 1.0 else (1.0, share - 1.0)


@pytest.mark.parametrize("curve", [circle, corner, lambda share: (share, 0.0)])
def test_straight_pieces_cover_their_points(curve: Callable[[float], tuple[float, float]]) -> None:
    chain = np.array([curve(share) for share in np.linspace(0.0, 2.0, 41)])
    pieces = straightened(chain, 0.05)
    distances = []
    for ends, radius in pieces:
        assert radius <= 0.05
        along = ends[-1] - ends[0]
        share = np.clip((chain - ends[0]) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        distances.append(np.linalg.norm(chain - ends[0] - share[:, None] * along, axis=1) - radius)
    assert np.min(distances, axis=0).max() <= 1e-9


def test_a_corner_has_two_pieces_and_a_wall_one() -> None:
    assert len(straightened(np.array([corner(share) for share in np.linspace(0.0, 2.0, 41)]), 0.05)) == 2
    assert len(straightened(np.array([(share, 0.0) for share in np.linspace(0.0, 2.0, 41)]), 0.05)) == 1


def test_chains_end_where_returns_are_not_joined_and_go_on_around() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [np.nan, np.nan], [2.0, 0.0], [3.0, 0.0]])
    chains = parted(points, np.array([True, False, False, True, True]))
    assert [each.tolist() for each in chains] == [[[2.0, 0.0], [3.0, 0.0], [0.0, 0.0], [1.0, 0.0]]]
    assert len(parted(points[:2], np.array([True, True]))[0]) == 3
