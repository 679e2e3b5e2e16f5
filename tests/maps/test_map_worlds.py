"""Every world has the walls of a map as bodies."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import symaware_cli as sa
from symaware_cli.language.build import Built


@pytest.mark.parametrize("world", ["kinematic", "pymunk", "pybullet"])
def test_every_world_has_its_bodies(
    world: str, building: Callable[..., Built], scenario: dict[str, Any], room: Path
) -> None:
    if world != "kinematic":
        pytest.importorskip(world, reason="a physics engine is an extra")
    scenario["environment"] = {"use": world}
    scenario["run"]["duration"] = 3.0
    scenario["agents"]["robot"]["knowledge"]["goal"] = [4.0, 1.5]  # in the wall on the way
    scenario["agents"]["robot"]["components"]["scan"] = {"use": "perception.lidar", "with": {"rays": 4}}
    building().simulation.environment.close()
    log = room / f"{world}.mcap"
    sa.load(room / "scenario.yaml").run(output=log)
    assert any("map_" in str(event.data) for event in sa.open_log(log).events() if event.name == "contact")
