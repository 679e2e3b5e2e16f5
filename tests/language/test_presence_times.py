"""Agents enter at times that are drawn, and wait until there is room."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import open_log
from symaware_cli.language.build import Built, build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError


def scenario(folder: Path, present: Any, seed: int = 1, count: int = 3, states: Any = None) -> Built:
    document = {
        "symaware": 1,
        "name": "queue",
        "seed": seed,
        "run": {"duration": 8.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "car": {
                "count": count,
                "model": {"use": "single-integrator", "with": {"max_speed": 2.0}},
                "state": states or [0.0, 0.0],
                "knowledge": {"goal": [50.0, 0.0]},
                "present": present,
                "components": {"sense": {"use": "perception.self"}, "go": {"use": "control.go-to-goal"}},
            }
        },
    }
    path = folder / "queue.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return build(path, [], None)


def entered(built: Built, folder: Path) -> dict[str, float]:
    """When each agent entered [s]."""
    execute(built, folder / "queue.mcap")
    events = open_log(folder / "queue.mcap").events()
    return {event.source.removeprefix("agents."): event.seconds for event in events if event.name == "added"}


def test_times_are_drawn_for_each_agent_from_the_seed(tmp_path: Path) -> None:
    present = {"from": {"uniform": [1.0, 5.0]}}
    intervals = [
        scenario(tmp_path, present, seed, count).options.presence["car"] for seed, count in ((1, 3), (1, 4), (2, 3))
    ]
    first, more, other = ([each.begin for each in interval] for interval in intervals)
    assert first == more[:3], "one agent more does not change the others"
    assert len({*first, *other}) == 6
    assert all(1e9 <= each <= 5e9 for each in (*first, *other) if isinstance(each, int))
    times = entered(scenario(tmp_path, present), tmp_path)
    begins = {f"car.{row}": each / 1e9 for row, each in enumerate(first) if isinstance(each, int)}
    assert times == pytest.approx(begins, abs=0.1), "at the next step"


def test_agents_that_wait_for_room_enter_one_after_the_other(tmp_path: Path) -> None:
    # The goal is far, so that they move at 1 m/s, and make room for the next after 2 s.
    times = entered(scenario(tmp_path, {"from": 1.0, "apart": 1.95}), tmp_path)
    assert times == pytest.approx({"car.0": 1.0, "car.1": 3.0, "car.2": 5.0})


def test_an_event_is_not_forgotten_while_an_agent_waits(tmp_path: Path) -> None:
    after = {"from": {"event": "added", "of": "agents.car.0"}, "apart": 1.95}
    times = entered(scenario(tmp_path, [{"from": 1.0}, after, after]), tmp_path)
    assert times == pytest.approx({"car.0": 1.0, "car.1": 3.0, "car.2": 5.0})


def test_an_agent_that_leaves_at_that_instant_is_not_in_the_way(tmp_path: Path) -> None:
    present = [{"until": 2.0}, {"from": 2.0, "apart": 50.0}, {"from": 2.0, "apart": 1.0}]
    assert entered(scenario(tmp_path, present, states=[[0, 0], [1, 0], [2, 0]]), tmp_path)["car.1"] == 2.0


@pytest.mark.parametrize(
    ("present", "said"),
    [
        ({"from": {"uniform": [-1.0, 5.0]}}, "never negative"),
        ({"from": {"uniform": [1.0, 5.0]}, "until": 1.0}, "has not entered by then"),
        ({"from": 1.0, "apart": 0.0}, "apart"),
    ],
)
def test_impossible_times_are_refused(present: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=said):
        scenario(tmp_path, present)
