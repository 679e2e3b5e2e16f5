"""Lidar scans against geometry by brute force, in every world; and what its errors, delay and gaps do."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import STEP, Team, present, simulation

from symaware_cli import Entity, Environment, Obstacle
from symaware_cli.engine.components.perception_lidar import Lidar
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.geometry.pieces import Pieces, separation_from_points
from symaware_cli.geometry.rays import nearest_hits
from symaware_cli.world.reading import Scan
from symaware_cli.worlds.planar import PymunkEnvironment

WORLDS = {"kinematic": KinematicEnvironment, "pymunk": PymunkEnvironment}
DISC = Entity(shape={"circle": {"radius": 0.3}})


def world(name: str) -> ColumnEnvironment:
    if name == "pybullet":
        from symaware_cli.worlds.spatial import PyBulletEnvironment

        return PyBulletEnvironment(PyBulletEnvironment.Parameters(time_step=STEP / 1e9))
    return WORLDS[name](WORLDS[name].Parameters(time_step=STEP / 1e9))


def begun(
    parameters: Mapping[str, Any],
    *,
    states: Sequence[tuple[float, float, float]] = ((0.0, 0.0, 0.0),),
    obstacles: Mapping[str, Any] | None = None,
    use: str = "kinematic",
    entity: Entity = DISC,
    seed: int = 7,
) -> Simulation:
    team = Team(
        {"look": lambda: Lidar(Lidar.Parameters(**parameters))},
        len(states),
        [list(state) for state in states],
        model=Unicycle(),
        entity=entity,
    )
    made = {name: Obstacle.model_validate(each) for name, each in (obstacles or {}).items()}
    ready = simulation({"robot": team}, environment=world(use), obstacles=made, seed=seed)
    ready.initialise()
    return ready


def scan(ready: Simulation) -> Scan | None:
    for entry in ready.entries:
        for component in entry.components:
            component.compute_and_update()
    found = ready.groups[0].awareness.readings.get("look")
    assert found is None or isinstance(found, Scan)
    return found


def step(ready: Simulation) -> None:
    ready.environment.step()
    ready.clock.now += ready.environment.time_step


pieces = st.one_of(
    st.just([(0.0, 0.0)]),
    st.just([(-0.5, -0.2), (0.7, 0.3)]),
    st.just([(-1.0, -0.5), (1.0, -0.5), (1.0, 0.5), (-1.0, 0.5)]),
    st.just([(0.0, 0.0), (2.0, 0.0), (0.0, 1.0)]),
)


@given(
    pieces,
    st.sampled_from([0.0, 0.1, 0.8]),
    st.floats(-4, 4),
    st.floats(-4, 4),
    st.floats(-7, 7),
    st.floats(0, 6.28),
)
@settings(deadline=None)
def test_a_ray_ends_where_marching_along_it_first_meets_the_piece(
    core: list[tuple[float, float]], radius: float, x: float, y: float, heading: float, bearing: float
) -> None:
    """Marching by the distance to the piece never goes through its surface (J. Hart, Sphere tracing, 1996)."""
    if len(core) == 1 and not radius:
        return
    placed = Pieces.of([(core, radius)]).placed(np.array([[x, y]]), np.array([heading]))
    direction = np.array([math.cos(bearing), math.sin(bearing)])
    one = np.zeros(1, np.intp)
    (((hit,),),) = (nearest_hits(np.zeros((1, 2)), direction[None, None], placed, one, one),)
    marched, least = 0.0, math.inf
    for _ in range(3000):
        apart = float(separation_from_points((marched * direction)[None], np.zeros(1), placed).distance[0])
        least = min(least, apart)
        if apart < 1e-9 or marched > 20:
            break
        marched += apart
    if abs(least) < 1e-9 and marched < 1e-9:
        # It begins on the surface, where either answer is right.
        return
    if least < 1e-9:
        assert hit == pytest.approx(marched, abs=2e-4)
    elif least > 1e-6:
        assert hit == math.inf


YARD = {
    "wall": {"shape": {"wall": {"points": [[3, -5], [3, 5]], "thickness": 0.2}}},
    "pillar": {"shape": {"cylinder": {"radius": 0.5, "height": 1.0}}, "position": [-2, 0]},
    "crate": {"shape": {"box": {"length": 1.0, "width": 2.0}}, "position": [0, 4], "heading": math.pi / 2},
}


@pytest.mark.parametrize("use", ["kinematic", "pymunk", "pybullet"])
def test_rays_end_at_walls_and_bodies_but_not_at_the_own(use: str) -> None:
    ready = begun({"rays": 4, "range": 6.0}, states=[(0, 0, 0), (0, -2, 0)], obstacles=YARD, use=use)
    with ready.environment:
        found = scan(ready)
    assert found is not None
    np.testing.assert_allclose(found.angles, [-math.pi, -math.pi / 2, 0, math.pi / 2])
    np.testing.assert_allclose(found.distances[0], [1.5, 1.7, 2.9, 3.5], atol=2e-3)
    # The other looks at the first, and to the left past the pillar.
    np.testing.assert_allclose(found.distances[1], [math.inf, math.inf, 2.9, 1.7], atol=2e-3)


@pytest.mark.parametrize("use", ["pymunk", "pybullet"])
def test_all_worlds_scan_alike(use: str) -> None:
    states = [(0.0, 0.0, 0.3), (1.5, -2.0, 2.0), (-1.0, 2.5, -1.0)]
    scans = []
    for name in ("kinematic", use):
        with begun({"rays": 90, "range": 8.0}, states=states, obstacles=YARD, use=name).environment as environment:
            scans.append(environment.ray_cast(*fan(environment), 8.0))
    both = np.isfinite(scans[0]) & np.isfinite(scans[1])
    assert both.sum() > 130
    assert (np.isfinite(scans[0]) != np.isfinite(scans[1])).sum() <= 2  # who grazes
    assert np.quantile(np.abs(scans[0][both] - scans[1][both]), 0.98) < 5e-3


def clutter(seed: int) -> dict[str, dict[str, Any]]:
    """Some discs and boxes around the origin."""
    chance = np.random.default_rng(seed)
    places = [place for place in chance.uniform(-6, 6, (12, 2)) if math.hypot(*place) > 2.2]
    made = {}
    for number, (place, heading) in enumerate(zip(places, chance.uniform(-3, 3, len(places)), strict=True)):
        length, width = chance.uniform(0.3, 2.0, 2)
        disc = {"cylinder": {"radius": width / 2, "height": 2.0}}
        shape = disc if number % 2 else {"box": {"length": length, "width": width, "height": 2.0}}
        made[f"thing{number}"] = {"shape": shape, "position": place.tolist(), "heading": heading}
    return made


@pytest.mark.parametrize("seed", range(6))
def test_discs_and_boxes_are_equally_far_in_every_world(seed: int) -> None:
    """The worlds of the plane agree to rounding; PyBullet searches for the surface of a cylinder, to 2 mm.

    One ray in fifty grazes, and may end up to 3 cm off.
    """
    body = Entity(shape={"cylinder": {"radius": 0.3, "height": 1.0}})
    found = {}
    for use in ("kinematic", "pymunk", "pybullet"):
        ready = begun({"rays": 360, "range": 10.0}, obstacles=clutter(seed), use=use, entity=body)
        with ready.environment:
            found[use] = present(scan(ready)).distances[0]
    met = np.isfinite(found["kinematic"])
    assert met.sum() > 90
    np.testing.assert_allclose(found["pymunk"], found["kinematic"], atol=1e-9)
    np.testing.assert_array_equal(np.isfinite(found["pybullet"]), met)
    apart = np.abs(found["pybullet"][met] - found["kinematic"][met])
    assert np.quantile(apart, 0.98) < 2e-3
    assert apart.max() < 0.03


def fan(environment: Environment, rays: int = 90) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    positions = environment.snapshot().positions
    bearings = np.linspace(0.01, 6.29, rays)
    directions = np.broadcast_to(np.stack([np.cos(bearings), np.sin(bearings)], axis=1), (len(positions), rays, 2))
    return np.arange(len(positions)), positions, directions


def test_in_space_a_ray_meets_a_ball_at_the_height_of_the_sensor() -> None:
    ball = {"ball": {"shape": {"circle": {"radius": 0.5}}, "position": [2, 0]}}
    ready = begun({"rays": 1}, obstacles=ball, use="pybullet")
    with ready.environment:
        # It rests on the ground as the agent does, a ball of 0.3 m.
        assert present(scan(ready)).distances[0, 0] == pytest.approx(2 - math.sqrt(0.5**2 - 0.2**2), abs=1e-4)


@pytest.mark.parametrize("use", ["kinematic", "pymunk", "pybullet"])
def test_it_sees_moving_bodies_at_their_present_positions(use: str) -> None:
    bus = {"shape": {"box": {"length": 1, "width": 1}}, "path": {"times": [0, 1], "positions": [[3, 0], [5, 0]]}}
    ready = begun({"rays": 1}, obstacles={"bus": bus}, use=use)
    with ready.environment:
        assert present(scan(ready)).distances[0, 0] == pytest.approx(2.5, abs=1e-3)
        for _ in range(10):
            step(ready)
        assert present(scan(ready)).distances[0, 0] == pytest.approx(3.5, abs=1e-3)


def test_rays_are_spread_over_the_field_of_view_around_the_heading() -> None:
    ready = begun({"rays": 3, "field_of_view": math.pi}, states=[(0, 0, math.pi / 2)], obstacles=YARD)
    found = scan(ready)
    assert found is not None
    np.testing.assert_allclose(found.angles, [-math.pi / 2, 0, math.pi / 2])
    np.testing.assert_allclose(found.distances, [[2.9, 3.5, 1.5]])


def test_a_sensor_sits_where_it_is_mounted() -> None:
    found = scan(begun({"rays": 1, "position": (0.25, 0, 0)}, obstacles=YARD))
    assert found is not None
    assert found.distances[0, 0] == pytest.approx(2.65)
    assert found.poses[0].tolist() == [0.25, 0, 0, 0]


def test_noise_has_its_deviation_and_is_repeated_with_the_seed() -> None:
    one, same, other = (
        present(scan(begun({"rays": 2000, "noise": 0.05, "field_of_view": 0.1}, obstacles=YARD, seed=seed))).distances
        for seed in (1, 1, 2)
    )
    exact = present(scan(begun({"rays": 2000, "field_of_view": 0.1}, obstacles=YARD))).distances
    assert np.std(one - exact) == pytest.approx(0.05, rel=0.1)
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_whoever_else_scans_changes_nothing_for_an_agent() -> None:
    alone = present(scan(begun({"noise": 0.1, "dropout": 0.2}, obstacles=YARD))).distances
    together = present(
        scan(begun({"noise": 0.1, "dropout": 0.2}, states=[(0, 0, 0), (90, 90, 0)], obstacles=YARD))
    ).distances
    np.testing.assert_array_equal(alone[0], together[0])


def test_dropouts_are_not_numbers_and_nothing_in_range_is_infinite() -> None:
    found = scan(begun({"rays": 2000, "dropout": 0.3}))
    assert found is not None
    missed = np.isnan(found.distances)
    assert missed.mean() == pytest.approx(0.3, abs=0.04)
    assert np.isinf(found.distances[~missed]).all()


def test_a_late_scan_is_that_of_then() -> None:
    ready = begun({"rays": 1, "delay": 0.1}, obstacles=YARD)
    assert scan(ready) is None
    ready.groups[0].control_input = [[1.0, 0.0]]
    step(ready)
    assert scan(ready) is None
    step(ready)
    late = scan(ready)
    assert late is not None
    assert (late.time, late.distances[0, 0]) == (0, pytest.approx(2.9))
    step(ready)
    assert present(scan(ready)).distances[0, 0] == pytest.approx(2.85)
