"""Random maps for tests of planners, and computations on them by shapely."""

from typing import NamedTuple

import numpy as np
import shapely

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array

#: The side of the maps [m].
SIDE = 10.0


class RandomMap(NamedTuple):
    """A square of side 10 m with boxes and discs.

    Attributes:
        obstacles: The obstacles.
        solid: The area that they cover, made without our geometry.
        start: A position [m], and `goal` another one.
    """

    obstacles: dict[str, Obstacle]
    solid: shapely.Geometry
    start: Array
    goal: Array


def outlines(obstacles: list[Obstacle]) -> shapely.Geometry:
    """The obstacles as shapely has them, made without our geometry."""
    found = []
    for each in obstacles:
        assert each.position is not None
        if each.shape.circle:
            found.append(shapely.Point(each.position).buffer(each.shape.circle.radius, quad_segs=64))
        elif each.shape.box:
            half = 0.5 * np.array([each.shape.box.length, each.shape.box.width])
            turn = np.array(
                [[np.cos(each.heading), np.sin(each.heading)], [-np.sin(each.heading), np.cos(each.heading)]]
            )
            corners = (np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half) @ turn + each.position
            found.append(shapely.Polygon(corners))
    return shapely.unary_union(found)


def random_map(seed: int, radius: float) -> RandomMap:
    """Draw a map, and a start and a goal, at least 5 m apart, where a disc of a radius touches nothing."""
    random = np.random.default_rng(seed)
    obstacles = []
    for _ in range(int(random.integers(8, 25))):
        size, ratio = random.uniform(0.5, 2.5), random.uniform(0.2, 1.0)
        box = {"box": {"length": float(size), "width": float(size * ratio)}}
        shape = box if random.random() < 0.7 else {"circle": {"radius": float(0.3 * size)}}
        place = tuple(random.uniform(0.0, SIDE, 2).tolist())
        heading = float(random.uniform(-3, 3))
        obstacles.append(Obstacle.model_validate({"shape": shape, "position": place, "heading": heading}))
    solid = outlines(obstacles)
    while True:
        start, goal = random.uniform(0.5, SIDE - 0.5, (2, 2))
        far = np.hypot(*(goal - start)) > 5.0
        if far and all(shapely.Point(each).distance(solid) > radius + 0.01 for each in (start, goal)):
            return RandomMap({f"body_{number}": each for number, each in enumerate(obstacles)}, solid, start, goal)


def is_free(points: Array, solid: shapely.Geometry, radius: float) -> bool:
    """Whether a disc touches nothing on the lines through points, by shapely."""
    return bool(shapely.LineString(points).distance(solid) >= radius - 1e-3)


def length_of(points: Array) -> float:
    """The length of the lines through points."""
    return float(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)).sum())


def shortest(found: RandomMap, radius: float) -> float:
    """The length of a shortest path of a disc by the visibility graph of widened obstacles; infinite without one.

    The widened obstacles are polygons within the real ones, so the length is too small by up to half a percent.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    square = shapely.box(0.0, 0.0, SIDE, SIDE)
    wide = found.solid.buffer(radius, quad_segs=4).simplify(0.005)
    corners = np.unique(shapely.get_coordinates(wide), axis=0)
    inside = shapely.contains_xy(square, corners[:, 0], corners[:, 1])
    points = np.concatenate([[found.start, found.goal], corners[inside]])
    one, other = np.triu_indices(len(points), 1)
    lines = shapely.linestrings(np.stack([points[one], points[other]], axis=1))
    blocking = wide.buffer(-1e-6)
    shapely.prepare(blocking)
    seen = ~shapely.intersects(blocking, lines)
    graph = coo_array((shapely.length(lines[seen]), (one[seen], other[seen])), shape=(len(points),) * 2).tocsr()
    return float(dijkstra(graph, directed=False, indices=np.array([0]))[0, 1])
