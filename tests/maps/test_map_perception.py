"""Beliefs of agents about the map, compared with the map."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from symaware_cli import ScenarioError, open_log, scenario

LIDAR = {"use": "perception.lidar", "with": {"rays": 180, "range": 3.0}, "period": 0.2}


def document(**belief: Any) -> dict[str, Any]:
    """Two robots in a yard; one drives past a crate, the other stands."""
    return {
        "symaware": 1,
        "name": "yard",
        "environment": {
            "use": "kinematic",
            "with": {"time_step": 0.1},
            "entities": {
                "crate": {"shape": {"box": {"length": 1.0, "width": 1.0}}, "position": [3.0, 1.5]},
                "wall": {"shape": {"box": {"length": 8.0, "width": 0.4}}, "position": [4.0, -1.2]},
            },
        },
        "run": {"duration": 6.0},
        "agents": {
            "robot": {
                "count": 2,
                "entity": {"shape": {"circle": {"radius": 0.2}}},
                "model": {"use": "unicycle"},
                "state": [[0.5, 0.0, 0.0], [7.5, 2.0, 0.0]],
                "knowledge": {"goal": [[5.5, 0.0], [7.5, 2.0]]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "lidar": LIDAR,
                    "belief": {
                        "use": "perception.map",
                        "with": {"scan": "lidar", "resolution": 0.1, "within": [0.0, 8.0, -2.0, 3.0], **belief},
                    },
                    "steer": {"use": "control.go-to-goal"},
                },
            }
        },
    }


def beliefs(log: Path, agent: str) -> list[tuple[int, Any]]:
    """Return the tables of an agent, by instant."""
    return [(each.time, each.values) for each in open_log(log).tables(agent, "belief.map")]


def test_believed_cells_agree_with_the_map(tmp_path: Path) -> None:
    scenario(document()).run(output=tmp_path / "run.mcap")
    last = beliefs(tmp_path / "run.mcap", "robot.0")[-1][1]
    occupied, free = last[last[:, 4] == 1.0], last[last[:, 4] == 0.0]
    assert len(occupied)
    for west, east, south, north, _ in occupied:
        x, y = 0.5 * (west + east), 0.5 * (south + north)
        in_crate = abs(x - 3.0) < 0.6 and abs(y - 1.5) < 0.6
        in_wall = abs(y + 1.2) < 0.3
        at_other = np.hypot(x - 7.5, y - 2.0) < 0.35  # of which the first robot is not aware
        assert in_crate or in_wall or at_other, (x, y)
    for west, east, south, north, _ in free:
        assert not (west < 3.4 and east > 2.6 and south < 1.9 and north > 1.1)
        assert not south < -1.1


def test_unseen_cells_stay_unknown(tmp_path: Path) -> None:
    scenario(document()).run(output=tmp_path / "run.mcap")
    for agent, x, y in (("robot.0", 3.0, 1.5), ("robot.0", 2.9, 2.6), ("robot.1", 1.0, 0.0)):
        last = beliefs(tmp_path / "run.mcap", agent)[-1][1]
        assert not ((last[:, 0] < x) & (last[:, 1] > x) & (last[:, 2] < y) & (last[:, 3] > y)).any()


def test_beliefs_are_recorded_at_their_rate(tmp_path: Path) -> None:
    scenario(document(record=2.0)).run(output=tmp_path / "run.mcap")
    assert [time / 1e9 for time, _ in beliefs(tmp_path / "run.mcap", "robot.0")] == [0.0, 2.0, 4.0]


def test_known_agents_are_not_in_the_map(tmp_path: Path) -> None:
    content = document()
    content["agents"]["robot"]["components"]["sense"] = {"use": "perception.omniscient"}
    scenario(content).run(output=tmp_path / "run.mcap")
    last = beliefs(tmp_path / "run.mcap", "robot.0")[-1][1]
    occupied = last[last[:, 4] == 1.0]
    middle = np.stack([occupied[:, :2].mean(axis=1), occupied[:, 2:4].mean(axis=1)], axis=1)
    assert (np.hypot(*(middle - [7.5, 2.0]).T) > 0.5).all()


def test_a_run_continues_equally_from_a_captured_belief(tmp_path: Path) -> None:
    content = scenario(document())
    with content.start(output=tmp_path / "first.mcap") as first:
        first.step(20)
        captured = first.capture()
        first.step(30)
    with content.start(output=tmp_path / "second.mcap") as second:
        second.restore(captured)
        second.step(30)
    for agent in ("robot.0", "robot.1"):
        one, other = (beliefs(tmp_path / f"{name}.mcap", agent) for name in ("first", "second"))
        assert np.array_equal(one[-1][1], other[-1][1])


@pytest.mark.parametrize(
    ("belief", "said"),
    [
        ({"resolution": None}, "the side of the cells is needed"),
        ({"within": None}, "the area of the map is needed"),
        ({"within": [1.0, 0.0, 0.0, 1.0]}, "the least of a coordinate is not below its greatest"),
        ({"resolution": 0.001}, "cells each, and may have"),
        ({"certain": 0.6}, "`certain` has to be greater"),
        ({"scan": "eye"}, "there is no component `eye`"),
    ],
)
def test_invalid_settings_are_refused(belief: dict[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        scenario(document(**belief))
