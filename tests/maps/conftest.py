"""Fixtures for tests of maps: a small floor in the format of ROS, and a scenario on it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from map_files import YAML, picture

from symaware_cli.language.build import Built, build
from symaware_cli.language.problem import Problem, ScenarioError


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A folder with the map of a room."""
    (tmp_path / "room.pgm").write_bytes(picture())
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(YAML, sort_keys=False))
    return tmp_path


@pytest.fixture
def scenario() -> dict[str, Any]:
    """A robot that goes to the door of the room."""
    return {
        "symaware": 1,
        "name": "room",
        "run": {"duration": 1.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "map": {"file": "room.yaml"},
        "agents": {
            "robot": {
                "entity": {"shape": {"circle": {"radius": 0.15}}},
                "model": {"use": "unicycle"},
                "state": [0.6, 1.0, 0.0],
                "knowledge": {"goal": [2.3, 1.5]},
                "components": {"sense": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
            }
        },
    }


@pytest.fixture
def building(room: Path, scenario: dict[str, Any]) -> Callable[..., Built]:
    """Write the scenario into the folder of the map, and build it."""

    def built(document: dict[str, Any] | None = None) -> Built:
        path = room / "scenario.yaml"
        path.write_text(yaml.safe_dump(document or scenario, sort_keys=False))
        return build(path)

    return built


@pytest.fixture
def problems(building: Callable[..., Built]) -> Callable[..., list[Problem]]:
    """The problems of the scenario."""

    def found(document: dict[str, Any] | None = None) -> list[Problem]:
        with pytest.raises(ScenarioError) as caught:
            building(document)
        return list(caught.value.problems)

    return found
