"""Every shipped scenario of a physics world runs in MuJoCo, and in every other capable world."""

import re
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import symaware_cli as sa

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

ROOT = Path(__file__).parents[3]
WORLDS = sorted(point.name for point in metadata.entry_points(group="symaware.environments"))
PATTERNS = ("scenarios/[!_]*.yaml", "plugins/*/scenarios/[!_]*.yaml")
SHIPPED = sorted(path for pattern in PATTERNS for path in ROOT.glob(pattern))

#: [m] The greatest distance of agents from their positions in the world of their scenario, after a second: a racecar
#: accelerates by 3.0 m/s^2 in MuJoCo, as the torque of its motors says, and by 2.4 m/s^2 in PyBullet.
APART = 0.35


def own_world(path: Path) -> str:
    """The world that a scenario or one of its bases names."""
    text = path.read_text(encoding="utf-8")
    named = re.search(r"^environment:.*?\buse: *(\S+)", text, re.MULTILINE | re.DOTALL)
    base = re.search(r"^extends: *(\S+\.yaml)", text, re.MULTILINE)
    if named:
        return named[1].strip(",{}")
    return own_world(path.parent / base[1]) if base else "kinematic"


def is_planar(world: str) -> bool:
    return world in ("kinematic", "pymunk")


def is_physical(path: Path) -> bool:
    return own_world(path) != "kinematic" or "environment.use=" in path.read_text(encoding="utf-8")


PHYSICAL = [path for path in SHIPPED if is_physical(path)]


@cache
def ran(path: Path, world: str) -> Any:
    """Positions after a second, and whether an agent touched anything; None if the world refuses the scenario."""
    try:
        scenario = sa.load(path, [f"environment.use={world}", "run.duration=1.0"])
    except sa.ScenarioError:
        return None
    positions: dict[str, Any] = {}
    touching: list[set[str]] = []
    with scenario.start() as simulation:
        simulation.subscribe("contact", lambda event: touching.append(set(event.text.split())))
        while not simulation.done:
            simulation.step()
        for group, ids in simulation.groups.items():
            columns = [name for name in simulation.state_columns(group) if name in ("x", "y", "z")]
            for id in ids:
                positions[id] = np.array(simulation.state(id, *columns))[:2]
    # If entities stand on each other at the start, worlds differ in whether a contact begins.
    return positions, any(names & positions.keys() for names in touching)


def test_scenarios_of_physics_worlds_are_found() -> None:
    names = {path.stem for path in PHYSICAL}
    assert {"billiards", "drives", "drones", "pushing", "quadrotors", "racecars", "three-worlds"} <= names
    assert {"kinematic", "mujoco", "pymunk"} <= set(WORLDS)


@pytest.mark.parametrize("path", PHYSICAL, ids=lambda path: path.stem)
def test_a_scenario_runs_alike_in_each_world_that_can(path: Path) -> None:
    own = own_world(path) if own_world(path) in WORLDS else "mujoco"
    expected = ran(path, own)
    found = {world: ran(path, world) for world in WORLDS}
    assert found["mujoco"] is not None
    for world, result in found.items():
        # Bodies that push each other do so in physics worlds only.
        if result is None or world == "kinematic":
            continue
        positions, touched = result
        assert touched == expected[1], world
        for id, position in positions.items():
            assert np.isfinite(position).all()
            # A planar world has no friction with the floor.
            if is_planar(world) == is_planar(own) or not touched:
                assert np.linalg.norm(position - expected[0][id]) < APART, (world, id)
