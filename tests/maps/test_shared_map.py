"""Shared maps: each agent uses the scans of others, and counts no evidence twice."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from symaware_cli import ScenarioError, open_log, scenario

WITHIN = [0.0, 8.0, 0.0, 4.0]


def document(channel: dict[str, Any] | None = None, **belief: Any) -> dict[str, Any]:
    """Two robots at the two ends of a room, each beside a crate that the other cannot see."""
    crate = {"shape": {"box": {"length": 0.4, "width": 0.4}}}
    return {
        "symaware": 1,
        "name": "room",
        "environment": {
            "use": "kinematic",
            "with": {"time_step": 0.1},
            "entities": {"west": crate | {"position": [1.0, 3.0]}, "east": crate | {"position": [7.0, 3.0]}},
        },
        "run": {"duration": 3.0},
        "topology": {"use": "complete", "channel": channel or {}},
        "agents": {
            "robot": {
                "count": 2,
                "entity": {"shape": {"circle": {"radius": 0.2}}},
                "model": {"use": "unicycle"},
                "state": [[1.0, 1.0, 0.0], [7.0, 1.0, 0.0]],
                "components": {
                    "sense": {"use": "perception.self"},
                    "lidar": {"use": "perception.lidar", "with": {"rays": 90, "range": 2.5}, "period": 0.2},
                    "belief": {
                        "use": "communication.map",
                        "with": {
                            "scan": "lidar",
                            "resolution": 0.2,
                            "within": WITHIN,
                            "record": 0.5,
                            "interval": 0.5,
                            **belief,
                        },
                    },
                },
            }
        },
    }


def knows(log: Path, agent: str, position: tuple[float, float]) -> bool:
    """Return whether the last belief of an agent has an occupied area near a position."""
    areas = list(open_log(log).tables(agent, "belief.map"))[-1].values
    west, east, south, north, occupied = areas.T
    x, y = position
    near = (west < x + 0.3) & (east > x - 0.3) & (south < y + 0.1) & (north > y - 0.3)
    return bool((near & (occupied == 1.0)).any())


def test_each_robot_knows_the_crate_that_the_other_has_seen(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    scenario(document()).run(output=log)
    for agent in ("robot.0", "robot.1"):
        assert knows(log, agent, (1.0, 2.8))
        assert knows(log, agent, (7.0, 2.8))


def test_without_messages_each_robot_knows_its_own_part(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    scenario(document({"loss": 1.0})).run(output=log)
    assert knows(log, "robot.0", (1.0, 2.8))
    assert not knows(log, "robot.0", (7.0, 2.8))
    assert knows(log, "robot.1", (7.0, 2.8))
    assert not knows(log, "robot.1", (1.0, 2.8))


def test_a_delayed_message_is_used_on_its_arrival(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    scenario(document({"delay": 1.25})).run(output=log)
    received = [each for each in open_log(log).events() if each.name == "map-received"]
    assert [each.time for each in received] == [1_300_000_000, 1_300_000_000]


def test_evidence_that_is_sent_again_counts_once(tmp_path: Path) -> None:
    # A cell that was hit by one scan has the probability 0.6, and is occupied from 0.65 on.
    for interval in (10.0, 0.1):
        content = document(interval=interval, hit=0.6)
        content["agents"]["robot"]["components"]["lidar"]["period"] = 10.0
        scenario(content).run(output=tmp_path / f"{interval}.mcap")
        assert not knows(tmp_path / f"{interval}.mcap", "robot.1", (1.0, 2.8))


def test_evidence_of_two_robots_adds_up(tmp_path: Path) -> None:
    # Each robot has hit the crate between them once, which alone is not enough.
    content = document(hit=0.6)
    content["environment"]["entities"] = {
        "crate": {"shape": {"circle": {"radius": 0.05}}, "position": [4.1, 1.9]},
    }
    content["agents"]["robot"] |= {"state": [[4.1, 0.5, 1.57], [4.1, 3.4, -1.57]]}
    content["agents"]["robot"]["components"]["lidar"]["period"] = 10.0
    scenario(content).run(output=tmp_path / "together.mcap")
    assert knows(tmp_path / "together.mcap", "robot.0", (4.1, 1.9))
    content["topology"]["channel"] = {"loss": 1.0}
    scenario(content).run(output=tmp_path / "alone.mcap")
    assert not knows(tmp_path / "alone.mcap", "robot.0", (4.1, 1.9))


def test_a_later_message_makes_up_for_a_lost_one(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    scenario(document({"loss": 0.6})).run(output=log, duration=8.0)
    assert knows(log, "robot.0", (7.0, 2.8))
    assert knows(log, "robot.1", (1.0, 2.8))


def test_robots_with_other_cells_do_not_share_and_fire_an_event(tmp_path: Path) -> None:
    content, log = document(), tmp_path / "run.mcap"
    robot = content["agents"].pop("robot")
    belief = robot["components"]["belief"]
    other = belief | {"with": belief["with"] | {"resolution": 0.1}}
    for name, place, map_of in (("one", 1.0, belief), ("two", 7.0, other)):
        components = robot["components"] | {"belief": map_of}
        content["agents"][name] = robot | {"count": 1, "state": [place, 1.0, 0.0], "components": components}
    scenario(content).run(output=log)
    refused = [each for each in open_log(log).events() if each.name == "map-refused"]
    assert sorted(each.data["other"] for each in refused) == ["one.0", "two.0"]
    assert not knows(log, "one.0", (7.0, 2.8))


def test_a_run_continues_equally_from_a_captured_belief(tmp_path: Path) -> None:
    content = scenario(document({"delay": 0.3, "loss": 0.3}))
    with content.start(output=tmp_path / "first.mcap") as first:
        first.step(15)
        captured = first.capture()
        first.step(15)
    with content.start(output=tmp_path / "second.mcap") as second:
        second.restore(captured)
        second.step(15)
    one, other = (
        list(open_log(tmp_path / f"{name}.mcap").tables("robot.0", "belief.map"))[-1] for name in ("first", "second")
    )
    assert np.array_equal(one.values, other.values)


def test_an_interval_is_a_time() -> None:
    with pytest.raises(ScenarioError, match="interval"):
        scenario(document(interval=0.0))
