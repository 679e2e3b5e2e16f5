"""A short log with measurements of all kinds of sensors."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from simulating import STEP, Team, simulate

from symaware_cli import Component, Entity, GroupComponent, Obstacle
from symaware_cli.engine.components.perception_camera import Camera
from symaware_cli.engine.components.perception_contact import ContactSensor
from symaware_cli.engine.components.perception_imu import InertialUnit
from symaware_cli.engine.components.perception_lidar import Lidar
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.worlds.spatial import PyBulletEnvironment

STEPS = 3


def teams() -> dict[str, Team]:
    """Two robots that stand: the second beside the first."""
    components: dict[str, Callable[[], Component | GroupComponent]] = {
        "scan": lambda: Lidar(Lidar.Parameters(rays=180, range=5.0, noise=0.01, dropout=0.1)),
        "eye": lambda: Camera(Camera.Parameters(width=32, height=24)),
        "bumper": lambda: ContactSensor(ContactSensor.Parameters()),
        "inertia": lambda: InertialUnit(InertialUnit.Parameters(acceleration_noise=0.1, dropout=0.3)),
    }
    disc = Entity(shape={"cylinder": {"radius": 0.2, "height": 1.0}})
    states = [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
    return {"robot": Team(components, 2, states, model=Unicycle(), entity=disc)}


def world() -> dict[str, Any]:
    """A crate 3 m ahead of the first."""
    crate = {"shape": {"box": {"length": 1.0, "width": 1.0, "height": 1.0}}, "position": [3, 0]}
    environment = PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9))
    return {"environment": environment, "obstacles": {"crate": Obstacle.model_validate(crate)}}


def write_sensing(path: Path) -> Path:
    """Write the log."""
    simulate(teams(), STEPS, path, **world())
    return path
