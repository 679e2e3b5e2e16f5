"""A recorded topic as a sensor."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import Log, open_log, verify_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError

Make = Callable[..., Path]


@pytest.fixture
def scenario(tmp_path: Path, recorded: Path) -> Make:
    """Write a scenario in which two robots play a bag back."""

    def write(parameters: dict[str, Any], **use: Any) -> Path:
        shutil.copy(recorded / "bag" / "run.mcap", tmp_path / "drive.mcap")
        shutil.copy(recorded / "bag.db3", tmp_path / "drive.db3")
        document = {
            "symaware": 1,
            "name": "played",
            "run": {"duration": 2.0},
            "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
            "agents": {
                "robot": {
                    "count": 2,
                    "model": {"use": "unicycle"},
                    "state": [[0, -8, 0], [3, 3, 1]],
                    "components": {"sense": {"use": "perception.bag", "with": parameters, **use}},
                }
            },
        }
        path = tmp_path / "played.yaml"
        path.write_text(yaml.safe_dump(document), encoding="utf-8")
        return path

    return write


def run(path: Path) -> Log:
    log = path.with_suffix(".run.mcap")
    execute(build(path, [], None), log)
    return open_log(log)


@pytest.mark.parametrize("file", ["drive.mcap", "drive.db3"])
def test_scans_are_those_of_the_recording_at_their_times(scenario: Make, recorded: Path, file: str) -> None:
    log = run(scenario({"bag": {"file": file, "topic": "/robot_1/scan"}}))
    expected = [each for each in open_log(recorded / "floor.mcap").scans("robot.1") if each.time < 2e9]
    for agent in log.agents["robot"]:
        found = list(log.scans(agent))
        assert [(each.time, each.measured) for each in found] == [(each.time, each.measured) for each in expected]
        for one, other in zip(found, expected, strict=True):
            assert np.array_equal(one.distances, other.distances.astype(np.float32), equal_nan=True)
            assert np.abs(one.angles - other.angles).max() < 1e-5
        assert (found[0].pose[:2] == log.series(agent, "world").values[0, :2]).all()


def test_poses_are_a_signal_at_the_times_of_recording(scenario: Make, recorded: Path) -> None:
    played = {"bag": {"file": "drive.mcap", "topic": "/robot_1/odom", "start": 0.5}, "reading": "pose"}
    found = run(scenario(played)).series("robot.0", "sense")
    truth = open_log(recorded / "floor.mcap").series("robot.1", "world")
    assert found.columns == ("x", "y", "z", "heading")
    assert found.times[0] == 500_000_000
    count = len(found.times)
    assert (found.values[:, :2] == truth.values[:count, :2]).all()


def test_a_run_that_plays_a_bag_is_repeated_from_its_log_alone(scenario: Make, tmp_path: Path) -> None:
    path = scenario({"bag": {"file": "drive.mcap", "topic": "/robot_1/scan"}, "dropout": 0.3})
    log = run(path)
    assert log.attachments["scenario/drive.mcap"] == (tmp_path / "drive.mcap").read_bytes()
    (tmp_path / "drive.mcap").unlink()
    assert verify_log(log.path).difference is None


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"bag": {"file": "drive.mcap", "topic": "/scan"}}, "there is no topic `/scan` in it"),
        ({"bag": {"file": "drive.mcap", "topic": "/robot_1/odom"}}, "that can be used are sensor_msgs/msg/LaserScan"),
        ({"bag": {"file": "other.mcap", "topic": "/scan"}}, "there is no file `other.mcap`"),
        ({"bag": {"file": "played.yaml", "topic": "/scan"}}, "one .mcap or .db3 file"),
        ({"bag": {"file": "played.db3", "topic": "/scan"}}, "there is no file `played.db3`"),
    ],
)
def test_unusable_recordings_are_refused_at_their_place(scenario: Make, parameters: dict[str, Any], said: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        build(scenario(parameters), [], None)
    (problem,) = refused.value.problems
    assert said in problem.message
    assert problem.span is not None
