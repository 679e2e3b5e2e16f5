"""Agents that are pushed all at once, in physics worlds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from symaware_cli.core import AgentGroup, Entity
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.quadrotor import Quadrotor
from symaware_cli.engine.models.racecar import Racecar
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.worlds.physics import PhysicsEnvironment
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

#: A wedge whose centre of mass is not where its coordinates begin.
WEDGE = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def world(
    kind: type[PhysicsEnvironment],
    model: NoisyModel,
    states: Any,
    folder: Path | None = None,
    **description: Any,
) -> tuple[PhysicsEnvironment, AgentGroup]:
    entity = Entity(**(description or {"shape": {"circle": {"radius": 0.3}}}))
    group = AgentGroup("robot", [f"robot.{row}" for row in range(len(states))], model, entity, states)
    environment = kind(kind.Parameters(time_step=0.02))
    if folder:
        environment.folder = folder
    environment.initialise([group], {}, 1)
    return environment, group


def touching(environment: PhysicsEnvironment) -> set[tuple[str, str]]:
    return {(contact.first, contact.second) for contact in environment.contacts() if contact.begins}


@pytest.mark.parametrize("kind", [PymunkEnvironment, PyBulletEnvironment])
@pytest.mark.parametrize(
    ("model", "change"),
    [
        (SingleIntegrator(), [1.0, -2.0]),
        (DoubleIntegrator(), [1.0, -2.0, 0.5, 0.25]),
        (Unicycle(), [0.5, 0.25, 8.0]),
    ],
    ids=["single", "double", "unicycle"],
)
def test_only_the_given_states_change_by_the_given_amount(
    kind: type[PhysicsEnvironment], model: NoisyModel, change: list[float]
) -> None:
    states = np.zeros((3, len(model.state)))
    states[:, 1] = [0.0, 5.0, 10.0]
    environment, group = world(kind, model, states)
    with environment:
        environment.step()
        before = environment.state(group)
        environment.push(group, [0, 2], np.array(change))
        assert environment.state(group) - before == pytest.approx(np.outer([1, 0, 1], change), abs=1e-9)
        assert environment.snapshot().positions[2, :2] == pytest.approx(environment.state(group)[2, :2])
        after = environment.state(group)
        environment.step()
        still = after.copy()
        still[:, :2] += 0.02 * environment.snapshot().velocities[:, :2]
        assert environment.state(group) == pytest.approx(still, abs=1e-9)


@pytest.mark.parametrize("kind", [PymunkEnvironment, PyBulletEnvironment])
def test_a_displaced_agent_touches_another_and_earlier_contacts_stay_reported(kind: type[PhysicsEnvironment]) -> None:
    environment, group = world(kind, Unicycle(), [[0, 0, 0], [0.59, 0, 0], [5, 0, 0]])
    with environment:
        environment.step()
        assert touching(environment) == {("robot.0", "robot.1")}
        environment.push(group, [2], np.array([-3.86, 0, 0]))
        assert touching(environment) == {("robot.0", "robot.1")}
        environment.step()
        assert ("robot.1", "robot.2") in touching(environment)


def test_a_body_turns_about_its_position_not_its_centre_of_mass(tmp_path: Path) -> None:
    (tmp_path / "wedge.obj").write_text(WEDGE)
    shape = {"mesh": {"file": "wedge.obj", "radius": 1.0}}
    environment, group = world(PyBulletEnvironment, Unicycle(), [[1, 2, 0.5]], tmp_path, shape=shape)
    with environment:
        environment.push(group, [0], np.array([0.0, 1.0, 2.0]))
        assert environment.state(group)[0] == pytest.approx([1, 3, 2.5], abs=1e-9)


@pytest.mark.parametrize("model", [Racecar(), Quadrotor()], ids=["racecar", "quadrotor"])
def test_vehicles_are_pushed_too(model: NoisyModel) -> None:
    states = np.zeros((2, len(model.state)))
    states[:, 1] = [0.0, 5.0]
    if isinstance(model, Quadrotor):
        states[:, 2] = 3.0
    environment, group = world(PyBulletEnvironment, model, states)
    with environment:
        environment.step()
        before, change = environment.state(group), 0.2 + 0.01 * np.arange(len(model.state), dtype=float)
        environment.push(group, [1], change)
        assert environment.state(group) - before == pytest.approx(np.outer([0, 1], change), abs=1e-6)
