"""Probabilistic roadmaps: costs are those of Dijkstra's algorithm on the same graph, and paths touch no obstacle."""

import os

import numpy as np
import pytest
from random_maps import SIDE, is_free, length_of, random_map
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.roadmap import Roadmap

RADIUS = 0.25
#: How many random maps the slow tests try.
MAPS = int(os.environ.get("SYMAWARE_MAPS", "30"))


def roadmap(seed: int, space: FreeSpace, samples: int = 400) -> Roadmap:
    return Roadmap(space, np.random.default_rng(seed).uniform(0.0, SIDE, (samples, 2)), SIDE * SIDE)


def least_cost(graph: Roadmap, start: Array, goal: Array) -> float:
    """The cost of the best path by Dijkstra's algorithm of SciPy."""
    count = len(graph.points)
    one, other, cost = list(graph.edges[:, 0]), list(graph.edges[:, 1]), list(graph.lengths)
    for end, place in ((count, start), (count + 1, goal)):
        nodes, lengths = graph.links(place)
        one, other, cost = [*one, *[end] * len(nodes)], [*other, *nodes], [*cost, *lengths]
    matrix = coo_array((cost, (one, other)), shape=(count + 2, count + 2)).tocsr()
    return float(dijkstra(matrix, directed=False, indices=np.array([count]))[0, count + 1])


def check(seed: int) -> bool:
    """Check the path on a random map; return whether there is one."""
    found = random_map(seed, RADIUS)
    graph = roadmap(seed, FreeSpace(found.obstacles, RADIUS, 1.0))
    path = graph.path(found.start, found.goal, 10**6)
    assert path.cost == pytest.approx(least_cost(graph, found.start, found.goal), rel=1e-9), seed
    if not np.isfinite(path.cost):
        assert path.points.shape == (0, 2)
        return False
    assert np.array_equal(path.points[[0, -1]], [found.start, found.goal])
    assert path.cost == pytest.approx(length_of(path.points))
    assert is_free(path.points, found.solid, RADIUS), seed
    return True


def test_the_cost_on_random_maps_is_that_of_dijkstra_and_paths_keep_from_obstacles() -> None:
    assert sum(check(seed) for seed in range(12)) >= 6


@pytest.mark.slow
def test_the_same_holds_on_many_maps() -> None:
    assert sum(check(seed) for seed in range(12, 12 + MAPS)) >= 0.5 * MAPS


def test_edges_are_exactly_the_free_lines_within_the_radius() -> None:
    found = random_map(3, RADIUS)
    space = FreeSpace(found.obstacles, RADIUS, 1.0)
    graph = roadmap(3, space, 120)
    one, other = np.triu_indices(len(graph.points), 1)
    near = np.sqrt(((graph.points[one] - graph.points[other]) ** 2).sum(axis=1)) <= graph.radius
    free = [
        is_free(graph.points[[first, second]], found.solid, RADIUS + 1e-3)
        for first, second in zip(one[near], other[near], strict=True)
    ]
    assert set(map(tuple, graph.edges.tolist())) == set(
        zip(one[near][free].tolist(), other[near][free].tolist(), strict=True)
    )


def test_a_search_ends_at_its_limit_and_reports_it() -> None:
    graph = roadmap(0, FreeSpace({}, RADIUS, 1.0))
    path = graph.path(np.array([0.2, 0.2]), np.array([9.8, 9.8]), 3)
    assert (path.expanded, path.is_limited, len(path.points)) == (3, True, 0)


def test_without_positions_there_is_no_path() -> None:
    path = roadmap(0, FreeSpace({}, RADIUS, 1.0), 0).path(np.array([0.2, 0.2]), np.array([9.8, 9.8]), 3)
    assert (path.expanded, path.is_limited, len(path.points)) == (0, False, 0)


@pytest.mark.parametrize("away", [0.0, 0.1, 0.2])
def test_a_body_that_is_near_to_a_wall_gets_away_from_it(away: float) -> None:
    wall = Obstacle.model_validate({"shape": {"box": {"length": 4.0, "width": 0.2}}, "position": (2.0, 0.1)})
    freed = FreeSpace({"wall": wall}, 0.3, 1.0).freed(np.array([2.0, 0.2 + away]))
    assert freed is not None
    assert freed[1] >= 0.5
    assert abs(freed[0] - 2.0) < 0.2


def test_there_is_no_way_out_of_an_obstacle() -> None:
    wall = Obstacle.model_validate({"shape": {"box": {"length": 4.0, "width": 0.2}}, "position": (2.0, 0.1)})
    assert FreeSpace({"wall": wall}, 0.3, 1.0).freed(np.array([2.0, 0.15])) is None
