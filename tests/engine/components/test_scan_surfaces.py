"""Surfaces that agents see by a lidar, against those that are there."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import Team, made, simulation

from symaware_cli import Box, Circle, Entity, Obstacle, Shape, Wall
from symaware_cli.core import Scan
from symaware_cli.engine.components.perception_lidar import angles
from symaware_cli.engine.components.relative_motion import bounding_radii
from symaware_cli.engine.components.scan_surfaces import ScanOptions, ScanSurfaces
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.geometry import Nearby

OBSTACLES = {
    "wall": Obstacle(
        shape=Shape(wall=Wall(points=((-4.0, 2.0), (3.0, 2.0), (3.0, -4.0)), thickness=0.2)), position=(0, 0)
    ),
    "crate": Obstacle(shape=Shape(box=Box(length=1.0, width=1.0)), position=(-2.0, -1.0), heading=0.4),
    "pillar": Obstacle(shape=Shape(circle=Circle(radius=0.3)), position=(0.5, -2.0)),
}


class Looking:
    """Robots that look around."""

    def __init__(self, states: list[list[float]], **options: Any) -> None:
        """Place them among the obstacles."""
        disc = Entity(shape=Shape(circle=Circle(radius=0.2)))
        team = Team(count=len(states), state=states, model=made(Unicycle), entity=disc)
        ready = simulation({"robot": team}, obstacles=OBSTACLES)
        self.environment, (self.group,) = ready.environment, ready.groups
        self.surfaces = ScanSurfaces("lidar", ScanOptions(**options), 0.3)

    def look(self, rays: int = 360, reach: float = 8.0, field_of_view: float = 2 * np.pi, time: int = 0) -> None:
        """Make a scan."""
        spread = angles(rays, field_of_view)
        state = self.group.initial_state
        facing = state[:, 2, None] + spread
        directions = np.stack([np.cos(facing), np.sin(facing)], axis=2)
        rows = np.arange(len(state))
        distances = self.environment.ray_cast(rows, state[:, :2].copy(), directions, reach)
        self.group.awareness.readings["lidar"] = Scan(time, spread, distances, reach, np.zeros((len(state), 4)))

    def nearest(self, position: NDArray[np.float64] | None = None, reach: float = 8.0) -> Nearby:
        """Return what is near."""
        found = self.surfaces.returns(self.group, 0)
        where = self.group.initial_state[:, :2] if position is None else position
        return self.surfaces.nearest(self.group, found, where, reach, bounding_radii(self.environment))


def test_the_nearest_seen_points_are_those_of_the_bodies() -> None:
    robots = Looking([[0.0, 0.0, 0.7]])
    robots.look(rays=720)
    seen, there = robots.nearest(), robots.environment.scenery.nearest(robots.group.initial_state, 8.0)
    for point, distance in zip(there.point, there.distance, strict=True):
        apart = np.sqrt(((seen.point - point) ** 2).sum(axis=1))
        assert apart.min() < 0.05
        assert seen.distance[apart.argmin()] == pytest.approx(distance, abs=0.01)
    assert seen.distance.min() == pytest.approx(there.distance.min(), abs=0.01)


def test_of_a_flat_wall_only_the_nearest_point_counts() -> None:
    robots = Looking([[0.0, 1.0, 0.0]])
    robots.look(rays=180, reach=1.5)
    seen = robots.nearest(reach=1.2)
    assert len(seen.row) == 1
    assert np.allclose(seen.point, [[0.0, 1.9]], atol=0.01)


def test_surfaces_stay_where_they_were_seen_while_the_agent_moves() -> None:
    robots = Looking([[0.0, 0.0, 0.7]])
    robots.look(rays=720)
    seen = robots.nearest(np.array([[0.0, 1.0]]), reach=1.0)
    assert np.allclose(seen.point[seen.distance.argmin()], [0.0, 1.9], atol=0.01)


def test_each_agent_has_its_own_detections() -> None:
    robots = Looking([[0.0, 1.0, 0.0], [2.0, 0.0, 3.0]])
    robots.look()
    seen = robots.nearest(reach=1.2)
    assert sorted(set(seen.row.tolist())) == [0, 1]
    assert (np.diff(seen.row) >= 0).all()


def test_surfaces_measured_with_errors_count_as_nearer() -> None:
    exact, careful = Looking([[0.0, 1.0, 0.0]]), Looking([[0.0, 1.0, 0.0]], deviation=0.05)
    exact.look()
    careful.look()
    assert careful.nearest(reach=1.2).distance.min() == pytest.approx(exact.nearest(reach=1.2).distance.min() - 0.15)


def test_an_agent_that_is_known_is_no_obstacle_and_one_that_is_not_is() -> None:
    robots = Looking([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
    robots.look()
    assert robots.nearest(reach=1.4).distance.min() == pytest.approx(1.3, abs=0.01)
    robots.group.awareness.world = robots.environment.snapshot()
    assert not len(robots.nearest(reach=1.3).row)


@pytest.mark.parametrize(("unseen", "blocked"), [("free", 0), ("occupied", 1)])
def test_unevaluated_specifications_count_as_the_scenario_says(unseen: str, blocked: int) -> None:
    robots = Looking([[0.0, 0.0, 0.0]], unseen=unseen)
    robots.look(rays=91, reach=1.0, field_of_view=np.pi)
    near = robots.surfaces.near(robots.surfaces.returns(robots.group, 0), robots.group.initial_state[:, :2])
    behind = np.abs(near.angles[0]) > np.pi / 2 + 0.05
    assert np.isfinite(near.distances[0]).any() == bool(blocked)
    assert behind.any() == bool(blocked)
    assert (near.distances[0][behind] == 0.3).all()
    assert bool(len(robots.nearest(reach=1.0).row)) == bool(blocked)


@pytest.mark.parametrize(("unseen", "blocked"), [("free", False), ("occupied", True)])
def test_before_the_first_scan_nothing_was_seen(unseen: str, blocked: bool) -> None:
    robots = Looking([[0.0, 0.0, 0.0]], unseen=unseen)
    near = robots.surfaces.near(robots.surfaces.returns(robots.group, 0), robots.group.initial_state[:, :2])
    assert np.isfinite(near.distances).all() == blocked


def test_a_scan_that_arrives_late_is_placed_where_the_agent_was() -> None:
    robots = Looking([[0.0, 1.0, 0.0]])
    group = robots.group
    robots.surfaces.remember(group, 0, robots.surfaces.returns(group, 0))
    group.awareness.state = np.array([[1.0, 1.0, 0.0]])
    robots.surfaces.remember(group, 100, robots.surfaces.returns(group, 100))
    robots.look(time=0)
    points = robots.surfaces.returns(group, 200).points[0]
    upwards = np.nanargmin(np.abs(np.arctan2(points[:, 1] - 1.0, points[:, 0]) - np.pi / 2))
    assert np.allclose(points[upwards], [0.0, 1.9], atol=1e-6)
