"""Every sensor has a rate, noise, a delay, dropouts and its own source of chance, in every world that it works in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, execute, simulation, untyped

from symaware_cli import Entity, Obstacle
from symaware_cli.core import Frame, GroupComponent, Observation, Scan
from symaware_cli.engine.components.perception_camera import Camera
from symaware_cli.engine.components.perception_contact import ContactSensor
from symaware_cli.engine.components.perception_imu import InertialUnit
from symaware_cli.engine.components.perception_lidar import Lidar
from symaware_cli.engine.components.perception_range import RangePerception
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.timing import STEADY, Timing
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

AGENTS = 24
STEPS = 12
WORLDS = {"kinematic": KinematicEnvironment, "pymunk": PymunkEnvironment, "pybullet": PyBulletEnvironment}


@dataclass(frozen=True)
class Kind:
    """A sensor: its class, what it is told in all tests, and which of its parameters is a standard deviation."""

    component: type[GroupComponent]
    parameters: dict[str, object]
    noise: str
    deviation: float
    worlds: tuple[str, ...] = tuple(WORLDS)


KINDS = {
    "range": Kind(RangePerception, {"range": 3.5}, "position_noise", 0.1),
    "lidar": Kind(Lidar, {"range": 6.0, "rays": 15}, "noise", 0.02),
    "camera": Kind(Camera, {"width": 8, "height": 6}, "depth_noise", 0.02, ("pybullet",)),
    "contact": Kind(ContactSensor, {}, "noise", 0.2),
    "imu": Kind(InertialUnit, {}, "acceleration_noise", 0.1),
}
EVERY = [(kind, world) for kind, each in KINDS.items() for world in each.worlds]
everywhere = pytest.mark.parametrize(("kind", "world"), EVERY)


class Forth(GroupComponent):
    """Drives forwards for half a second, and then back."""

    def _compute(self) -> NDArray[np.float64]:
        speed = 1.0 if self.time < 0.5 else -1.0
        return np.column_stack([np.full(len(self._group), speed), np.zeros(len(self._group))])

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.control_input = value


Told = tuple[int, Any, NDArray[np.float64]]


@dataclass
class Witness:
    """What was known at each step, when it was measured, and in numbers; None where nothing new was known."""

    known: list[Told | None] = field(default_factory=list)

    def component(self) -> GroupComponent:
        told = self.known

        class Watch(GroupComponent):
            """Looks at what the sensor before it has told."""

            def _compute(self) -> None:
                awareness = self._group.awareness
                reading = awareness.readings.get("look", awareness.observation)
                if "look" in awareness.signals:
                    reading = awareness["look"] if untyped(awareness.columns["look"]).writes else None
                new = reading is not None and reading is not getattr(self, "_last", None)
                # Numbers do not say when they were measured.
                measured = getattr(reading, "time", None)
                told.append((self.now, measured, numbers(reading, len(self._group))) if new else None)
                self._last = reading

            def _update(self, value: Any) -> None:
                pass

        return Watch()


def numbers(reading: Any, count: int) -> Any:
    """What was measured of each agent; NaN where it was missed."""
    match reading:
        case Observation():
            tracks = reading.tracks
            seen = np.full((count, count, tracks.positions.shape[1]), np.nan)
            seen[tracks.observers, tracks.others] = tracks.positions
            return seen
        case Scan():
            return reading.distances
        case np.ndarray():
            # Of an inertial unit the accelerations, of a contact sensor whom it touches and how hard.
            return reading[:, :3]
        case Frame():
            nothing = np.full((6, 8), np.nan)
            return np.array([nothing if image is None else image.depth for image in reading.images])
        case _:
            raise AssertionError(reading)


def known(
    kind: str,
    world: str,
    *,
    seed: int = 7,
    timing: Timing = STEADY,
    beside: Sequence[Callable[[], GroupComponent]] = (),
    **parameters: Any,
) -> list[Told | None]:
    """Robots in lanes run against a wall, and bounce or pass: what a sensor tells at each step."""
    sensor, witness = KINDS[kind], Witness()
    make = sensor.component
    components = {
        "look": lambda: make(make.Parameters(**sensor.parameters | parameters)),
        "witness": witness.component,
        "drive": Forth,
        **{f"other{number}": each for number, each in enumerate(beside)},
    }
    states = [[0.42, 1.5 * row, 0.0] for row in range(AGENTS)]
    body = Entity(shape={"cylinder": {"radius": 0.3, "height": 1.0}}, mass=2.0, elasticity=0.5)
    team = Team(components, AGENTS, states, model=Unicycle(), entity=body, timings={"look": timing})
    wall = {"shape": {"box": {"length": 0.4, "width": 99.0, "height": 1.0}}, "position": [1.2, 0.0], "elasticity": 0.5}
    environment = untyped(WORLDS[world])(WORLDS[world].Parameters(time_step=STEP / 1e9))
    obstacles = {"wall": Obstacle.model_validate(wall)}
    with environment:
        execute(simulation({"robot": team}, environment=environment, obstacles=obstacles, seed=seed), STEPS)
    return witness.known


def values(told: Sequence[Told | None]) -> NDArray[np.float64]:
    """The numbers of what was told, step by step."""
    return np.array([each[2] for each in told if each is not None])


@everywhere
def test_it_measures_as_often_as_its_period_says(kind: str, world: str) -> None:
    told = known(kind, world, timing=Timing(period=3 * STEP))
    assert [number for number, each in enumerate(told) if each is not None] == list(range(0, STEPS, 3))
    assert all(time in (now, None) for now, time, _ in filter(None, told))


@everywhere
def test_its_errors_have_the_given_deviation(kind: str, world: str) -> None:
    sensor = KINDS[kind]
    exact, noisy = values(known(kind, world)), values(known(kind, world, **untyped({sensor.noise: sensor.deviation})))
    assert (np.isfinite(exact) == np.isfinite(noisy)).mean() > 0.99  # but for who is just within range
    both = np.isfinite(exact) & np.isfinite(noisy)
    if kind == "contact":
        # Who touches is never in doubt; how hard is, where anybody was hit.
        np.testing.assert_array_equal(noisy[..., 0], exact[..., 0])
        both &= (np.arange(2) == 1) & (exact > 0.0)
    errors = noisy[both] - exact[both]
    if (kind, world) == ("contact", "kinematic"):
        assert not len(errors)  # nothing hits in a world without forces
        return
    assert len(errors) >= AGENTS
    assert errors.std() == pytest.approx(sensor.deviation, rel=0.3)
    assert abs(errors.mean()) < 4 * sensor.deviation / np.sqrt(len(errors))


@everywhere
def test_measurements_are_known_a_delay_later(kind: str, world: str) -> None:
    prompt, late = known(kind, world), known(kind, world, delay=2 * STEP / 1e9)
    told = [each for each in late if each is not None and (each[1] is None or each[1] >= 0)]
    assert [now for now, _, _ in told] == [k * STEP for k in range(2, STEPS)]
    assert all(time in (now - 2 * STEP, None) for now, time, _ in told)
    np.testing.assert_array_equal(values(told), values(prompt)[:-2])


@everywhere
def test_its_share_of_misses_is_the_given_one(kind: str, world: str) -> None:
    exact = values(known(kind, world))
    could = ~np.isnan(exact)
    missed = np.isnan(values(known(kind, world, dropout=0.3)))[could]
    assert missed.mean() == pytest.approx(0.3, abs=0.08)
    assert np.isnan(values(known(kind, world, dropout=1.0))).all()


@everywhere
def test_its_chance_is_its_own_and_comes_from_the_seed(kind: str, world: str) -> None:
    sensor = KINDS[kind]
    errors: dict[str, Any] = {sensor.noise: sensor.deviation, "dropout": 0.2}
    first = values(known(kind, world, **errors))
    np.testing.assert_array_equal(values(known(kind, world, **errors)), first)
    others: list[Callable[[], GroupComponent]] = [
        lambda: InertialUnit(InertialUnit.Parameters(acceleration_noise=1.0, dropout=0.5)),
        lambda: Lidar(Lidar.Parameters(rays=3, noise=1.0, dropout=0.5)),
    ]
    np.testing.assert_array_equal(values(known(kind, world, beside=others, **errors)), first)
    assert not np.array_equal(values(known(kind, world, seed=8, **errors)), first, equal_nan=True)
