"""Nearby obstacles and lines of sight, compared with dense sampling and Shapely."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from outlines import distance, placed, random_shape
from simulating import Team

from symaware_cli import Box, Circle, Obstacle, Polygon, Scenery, ScriptedPath, Shape, Wall
from symaware_cli.engine.environments.kinematic import KinematicEnvironment

seeds = st.integers(0, 2**32 - 1)


def random_obstacles(random: np.random.Generator, count: int, moving: bool = False) -> dict[str, Obstacle]:
    obstacles = {}
    for number in range(count):
        if random.random() < 0.4:
            points = [tuple(point) for point in random.uniform(-6, 6, (random.integers(2, 5), 2))]
            shape = Shape(wall=Wall(points=points, thickness=random.uniform(0.02, 0.5)))
        else:
            shape = random_shape(random)
        if moving and random.random() < 0.5:
            place: dict[str, Any] = {
                "path": ScriptedPath(
                    times=(0.0, 1.0, 3.0),
                    positions=[tuple(position) for position in random.uniform(-5, 5, (3, 2))],
                    headings=(0.0, 1.0, -2.0) if random.random() < 0.5 else None,
                    repeat=True,
                )
            }
        else:
            place = {"position": tuple(random.uniform(-5, 5, 2)), "heading": random.uniform(-4, 4)}
        obstacles[f"o{number}"] = Obstacle(shape=shape, **place)
    return obstacles


def pieces_at(
    obstacles: Mapping[str, Obstacle], time: float
) -> Iterator[tuple[int, tuple[NDArray[np.float64], float]]]:
    """Every piece with the index of its obstacle, in order."""
    for index, obstacle in enumerate(obstacles.values()):
        pose = obstacle.pose(time)
        for piece in placed(obstacle.shape, pose.position, pose.heading):
            yield index, piece


@settings(max_examples=30)
@given(seeds, st.integers(0, 12), st.integers(0, 30), st.floats(0, 8))
def test_nearest_finds_exactly_the_pieces_within_reach_of_each_point(
    seed: int, count: int, many: int, reach: float
) -> None:
    random = np.random.default_rng(seed)
    obstacles = random_obstacles(random, count, moving=True)
    points = random.uniform(-7, 7, (many, random.integers(2, 4)))
    found = Scenery(obstacles, 2_500_000_000).nearest(points, reach)
    expected = [
        (row, index, apart, piece)
        for row, point in enumerate(points[:, :2])
        for index, piece in pieces_at(obstacles, 2.5)
        if (apart := distance((point[None], 0.0), piece)) <= reach
    ]
    assert found.row.tolist() == [row for row, *_ in expected]
    assert found.obstacle.tolist() == [index for _, index, *_ in expected]
    np.testing.assert_allclose(found.distance, [apart for *_, apart, _ in expected], atol=1e-9)
    for point, (*_, piece) in zip(found.point, expected, strict=True):
        assert abs(distance((point[None], 0.0), piece)) < 1e-9, "the point lies on the surface"
    np.testing.assert_allclose(
        np.linalg.norm(points[found.row, :2] - found.point, axis=1), np.abs(found.distance), atol=1e-9
    )


def test_nearest_can_have_a_reach_for_each_point() -> None:
    scenery = Scenery({"post": Obstacle(shape=Shape(circle=Circle(radius=1.0)), position=(0, 0))})
    points = np.array([[4.0, 0.0], [4.0, 0.0], [0.5, 0.0], [0.0, 0.0]])
    found = scenery.nearest(points, np.array([2.9, 3.0, 0.0, 0.0]))
    assert found.row.tolist() == [1, 2, 3]
    np.testing.assert_allclose(found.distance, [3.0, -0.5, -1.0])
    np.testing.assert_allclose(np.linalg.norm(found.point, axis=1), 1.0)


@settings(max_examples=30)
@given(seeds)
def test_the_velocity_of_an_obstacle_is_that_of_the_point_of_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    obstacles = random_obstacles(random, 6, moving=True)
    scenery, later = Scenery(obstacles, 2_000_000_000), Scenery(obstacles, 2_000_010_000)
    found = scenery.nearest(random.uniform(-6, 6, (20, 2)), 4.0)
    for obstacle, point, velocity in zip(found.obstacle, found.point, found.velocity, strict=True):
        now, soon = (list(obstacles.values())[obstacle].pose(time) for time in (2.0, 2.00001))
        arm, turn = point - now.position, soon.heading - now.heading
        turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ arm
        np.testing.assert_allclose((soon.position + turned - point) / 1e-5, velocity, atol=1e-3)
    np.testing.assert_allclose(scenery.at(2_000_010_000).pieces.vertices, later.pieces.vertices, atol=1e-15)


@settings(max_examples=30)
@given(seeds, st.integers(0, 8))
def test_a_line_is_blocked_where_it_goes_through_an_obstacle(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    obstacles = random_obstacles(random, count, moving=True)
    origins, targets = np.round(random.uniform(-7, 7, (2, 60, 2)), 1)
    targets[::10] = origins[::10]
    blocked = Scenery(obstacles, 2_500_000_000).blocks(origins, targets)
    pieces = [piece for _, piece in pieces_at(obstacles, 2.5)]
    for origin, target, is_blocked in zip(origins, targets, blocked, strict=True):
        line = np.array([origin, target]) if (origin != target).any() else origin[None]
        clearance = min((distance((line, 0.0), piece) for piece in pieces), default=np.inf)
        assert is_blocked == (clearance < 0.0) or abs(clearance) < 1e-9


@pytest.mark.parametrize(
    ("shape", "grazing"),
    [
        (Shape(circle=Circle(radius=1.0)), 1.0),
        (Shape(box=Box(length=2.0, width=2.0)), 1.0),
        (Shape(polygon=Polygon(vertices=[(-1, -1), (1, -1), (0, 1)])), 1.0),
        (Shape(wall=Wall(points=[(-2, 0), (2, 0)], thickness=2.0)), 1.0),
    ],
    ids=lambda shape: getattr(shape, "kind", ""),
)
def test_a_line_that_only_grazes_an_obstacle_is_free(shape: Shape, grazing: float) -> None:
    scenery = Scenery({"it": Obstacle(shape=shape, position=(0, 0))})
    height = np.array([grazing, grazing - 1e-6, grazing + 1e-6, 0.0])
    origins, targets = np.c_[np.full(4, -5.0), height], np.c_[np.full(4, 5.0), height]
    assert scenery.blocks(origins, targets).tolist() == [False, True, False, True]


def test_a_line_that_ends_before_an_obstacle_or_begins_behind_it_is_free_and_one_inside_is_not() -> None:
    scenery = Scenery({"box": Obstacle(shape=Shape(box=Box(length=2.0, width=2.0)), position=(0, 0))})
    lines = np.array(
        [[[-3, 0], [-1.5, 0]], [[3, 0], [1.5, 0]], [[-0.5, 0], [0.5, 0]], [[0, 0], [0, 0]], [[0, 0], [9, 0]]]
    )
    assert scenery.blocks(lines[:, 0], lines[:, 1]).tolist() == [False, False, True, True, True]


def test_walls_leave_no_gap_at_their_corners() -> None:
    scenery = Scenery({"wall": Obstacle(shape=Shape(wall=Wall(points=[(0, 0), (2, 0), (2, 2)], thickness=0.4)))})
    outside = 0.19 * np.array([np.cos(-np.pi / 4), np.sin(-np.pi / 4)]) + [2, 0]
    assert (scenery.nearest(outside[None], 0.0).distance < 0).all()
    assert len(scenery.nearest(outside[None], 0.0).row) == 2, "an entry for each segment"


def test_many_lines_are_tested_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(3)
    scenery = Scenery(random_obstacles(random, 10))
    origins, targets = random.uniform(-7, 7, (2, 500, 2))
    at_once, near = scenery.blocks(origins, targets), scenery.nearest(origins, 2.0)
    monkeypatch.setattr("symaware_cli.geometry.scenery._TOGETHER", 50)
    assert scenery.blocks(origins, targets).tolist() == at_once.tolist()
    for one, other in zip(scenery.nearest(origins, 2.0), near, strict=True):
        np.testing.assert_array_equal(one, other)


def test_without_obstacles_no_point_is_near_and_no_line_blocked() -> None:
    scenery = Scenery({})
    assert len(scenery) == 0
    assert [len(each) for each in scenery.nearest(np.zeros((3, 2)), 9.0)] == [0] * 5
    assert scenery.blocks(np.zeros((3, 2)), np.ones((3, 2))).tolist() == [False] * 3


def world(obstacles: Mapping[str, Obstacle]) -> KinematicEnvironment:
    environment = KinematicEnvironment(KinematicEnvironment.Parameters(time_step=0.5))
    environment.initialise([Team().group("robot")], obstacles, 7)
    return environment


def test_scenery_that_stands_still_is_built_once() -> None:
    environment = world({"post": Obstacle(shape=Shape(circle=Circle(radius=1.0)), position=(3, 0))})
    before = environment.scenery
    environment.step()
    assert environment.scenery is before


def test_scenery_that_moves_is_shared_within_a_step_and_never_changed() -> None:
    path = ScriptedPath(times=(0, 1), positions=((0, 0), (4, 0)))
    environment = world({"cart": Obstacle(shape=Shape(circle=Circle(radius=1.0)), path=path)})
    before = environment.scenery
    assert environment.scenery is before
    environment.step()
    after = environment.scenery
    assert environment.scenery is after
    np.testing.assert_allclose(before.pieces.vertices, [[[0, 0]]])
    np.testing.assert_allclose(after.pieces.vertices, [[[2, 0]]])
