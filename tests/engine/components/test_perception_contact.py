"""What contact sensors feel, against the contacts of the world."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulating import STEP, Team, execute, simulation

from symaware_cli import Component, Entity, GroupComponent, Obstacle, open_log
from symaware_cli.core import Controller, TimeSeries
from symaware_cli.engine.components.perception_contact import ContactSensor
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.worlds.planar import PymunkEnvironment

WALL = {"wall": Obstacle.model_validate({"shape": {"wall": {"points": [[1, -5], [1, 5]]}}, "elasticity": 1.0})}


class Rightwards(Controller):
    """Drives rightwards until 0.5 s, then back."""

    def _compute(self) -> tuple[list[float], TimeSeries]:
        return [2.0 if self.time < 0.5 else -2.0, 0.0], TimeSeries()


def simulated(
    environment: type[ColumnEnvironment] = KinematicEnvironment,
    steps: int = 20,
    path: Path | None = None,
    seed: int = 7,
    **parameters: float,
) -> None:
    disc = Entity(shape={"circle": {"radius": 0.3}}, mass=2.0)
    components: dict[str, Callable[[], Component | GroupComponent]] = {
        "feel": lambda: ContactSensor(ContactSensor.Parameters(**parameters)),
        "drive": Rightwards,
    }
    team = Team(components, 2, [[0.0, 0.0], [-9.0, 4.0]], model=SingleIntegrator(), entity=disc)
    world = environment(environment.Parameters(time_step=STEP / 1e9))
    ready = simulation({"robot": team}, environment=world, obstacles=WALL, seed=seed)
    execute(ready, steps, path)


def series(path: Path) -> Iterator[Any]:
    return open_log(path).messages("/agents/robot/measurement/feel")


def test_an_agent_at_a_wall_senses_one_contact_until_it_leaves(tmp_path: Path) -> None:
    path = tmp_path / "touch.mcap"
    simulated(path=path)
    log = open_log(path)
    begin, end = [contact.time for contact in log.contacts() if "robot.0" in (contact.a, contact.b)]
    touching = {message.time: message.decode().values[:, 0].tolist() for message in series(path)}
    assert len(touching) == 20
    assert [time for time, values in touching.items() if values[0]] == list(range(begin, end, STEP))
    assert all(values[1] == 0 for values in touching.values())
    metadata = log.channels["/agents/robot/measurement/feel"].metadata
    assert (metadata["columns"], metadata["units"]) == ("touching,impulse", "1,N s")


def test_a_hit_is_felt_once_as_hard_as_the_log_says(tmp_path: Path) -> None:
    path = tmp_path / "hit.mcap"
    simulated(PymunkEnvironment, path=path)
    first = next(contact for contact in open_log(path).contacts() if contact.stage == "BEGIN")
    impulses = np.array([message.decode().values[0, 1] for message in series(path)])
    assert first.impulse > 0.0
    assert impulses.max() == pytest.approx(first.impulse)
    assert (impulses > 0).sum() <= sum(contact.stage == "BEGIN" for contact in open_log(path).contacts())


def test_a_sensor_that_drops_out_reports_nothing(tmp_path: Path) -> None:
    path = tmp_path / "dropout.mcap"
    simulated(path=path, steps=100, dropout=0.3)
    values = np.array([message.decode().values for message in series(path)])
    assert np.isnan(values).mean() == pytest.approx(0.3, abs=0.1)
    assert (np.isnan(values[..., 0]) == np.isnan(values[..., 1])).all()


def test_a_late_touch_is_felt_that_much_later(tmp_path: Path) -> None:
    prompt, late = tmp_path / "prompt.mcap", tmp_path / "late.mcap"
    simulated(path=prompt)
    simulated(path=late, delay=2 * STEP / 1e9)
    first = [next(message.time for message in series(path) if message.decode().values[0, 0]) for path in (prompt, late)]
    assert first[1] - first[0] == 2 * STEP
