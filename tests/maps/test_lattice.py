"""State lattices: costs are those of Dijkstra's algorithm on the same graph, and cars can drive the paths."""

import os

import numpy as np
import pytest
from random_maps import SIDE, RandomMap, is_free, length_of, random_map
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.lattice import HEADINGS, TURNS, Lattice, LatticeSearch, primitive

BODY, TIGHTEST = 0.2, 0.8
#: How many random maps the slow tests try.
MAPS = int(os.environ.get("SYMAWARE_MAPS", "30"))


def search(found: RandomMap, heading: float, side: float = 0.4) -> LatticeSearch:
    lattice = Lattice(FreeSpace(found.obstacles, BODY, 1.0), (0.0, SIDE, 0.0, SIDE), TIGHTEST, side)
    return LatticeSearch(lattice, found.start, heading, found.goal, [])


def least_cost(graph: LatticeSearch) -> float:
    """The cost of the best path by Dijkstra's algorithm of SciPy, on all states that can be reached."""
    numbers, ahead = {graph.first: 0}, [graph.first]
    one, other, cost = [], [], []
    while ahead:
        node = ahead.pop()
        for following, length in graph.edges(node):
            if following not in numbers:
                numbers[following] = len(numbers)
                ahead.append(following)
            one.append(numbers[node])
            other.append(numbers[following])
            cost.append(length)
    ends = {number: graph.ending(node) for node, number in numbers.items()}
    for number, length in ends.items():
        if np.isfinite(length):
            one.append(number)
            other.append(len(numbers))
            cost.append(length)
    matrix = coo_array((cost, (one, other)), shape=(len(numbers) + 1,) * 2).tocsr()
    return float(dijkstra(matrix, indices=np.array([0]))[0, -1])


def is_drivable(points: Array, heading: float) -> bool:
    """Whether the turns at all points are within those of arcs of the tightest radius through them."""
    legs = np.diff(points, axis=0)
    length = np.sqrt((legs**2).sum(axis=1))
    angles = np.concatenate([[heading], np.arctan2(legs[:, 1], legs[:, 0])])
    turns = np.abs((np.diff(angles) + np.pi) % (2 * np.pi) - np.pi)
    # A chord of an arc of radius R is 2 R sin(a/2) long, and half the angle a lies at each of its ends.
    half = np.arcsin(np.minimum(length / (2 * TIGHTEST), 1.0))
    allowed = half + np.concatenate([[0.0], half[:-1]])
    return bool((turns <= allowed + 1e-6).all())


def check(seed: int) -> bool:
    """Check the path on a random map; return whether there is one."""
    found = random_map(seed, BODY)
    heading = float(np.random.default_rng(seed).uniform(-3, 3))
    graph = search(found, heading)
    path = graph.path(10**6)
    if not np.isfinite(path.cost):
        assert path.points.shape == (0, 2)
        return False
    assert np.array_equal(path.points[[0, -1]], [found.start, found.goal])
    assert is_free(path.points, found.solid, BODY), seed
    assert is_drivable(path.points, heading), seed
    assert 0.97 * path.cost <= length_of(path.points) <= path.cost * (1 + 1e-9)
    return True


def check_cost(seed: int, side: float) -> None:
    """Compare the cost on a small random map with that of Dijkstra's algorithm."""
    found = random_map(seed, BODY)
    heading = float(np.random.default_rng(seed).uniform(-3, 3))
    assert search(found, heading, side).path(10**6).cost == pytest.approx(
        least_cost(search(found, heading, side)), rel=1e-9
    )


def test_the_cost_on_random_maps_is_that_of_dijkstra() -> None:
    for seed in range(2):
        check_cost(seed, 1.0)


def test_cars_can_drive_paths_on_random_maps_without_a_contact() -> None:
    assert sum(check(seed) for seed in range(3)) >= 2


@pytest.mark.slow
def test_the_cost_on_many_maps_is_that_of_dijkstra() -> None:
    for seed in range(2, 2 + MAPS):
        check_cost(seed, 1.0)


@pytest.mark.slow
def test_cars_can_drive_paths_on_many_maps_without_a_contact() -> None:
    assert sum(check(seed) for seed in range(3, 3 + MAPS)) >= 0.5 * MAPS


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("heading", range(0, len(HEADINGS), 3))
def test_a_primitive_joins_two_states_by_a_way_that_a_car_can_drive(heading: int, turn: int) -> None:
    found = primitive(heading, turn, 0.25, TIGHTEST)
    assert found.heading == (heading + turn) % 16
    assert found.radius >= TIGHTEST * (1 - 1e-9)
    assert np.allclose(found.points[[0, -1]], 0.25 * np.array([(0, 0), found.cells]))
    x, y = HEADINGS[heading]
    assert is_drivable(found.points, float(np.arctan2(y, x)))
    last = found.points[-1] - found.points[-2]
    x, y = HEADINGS[found.heading]
    off = np.arctan2(last[1], last[0]) - np.arctan2(y, x)
    assert abs((off + np.pi) % (2 * np.pi) - np.pi) < 0.15
    assert 0.98 * found.length <= length_of(found.points) <= found.length * (1 + 1e-9)


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ((3.0, 0.0), 3.0),
        # a quarter of a circle to the left, and one to the right
        ((0.8, 0.8), 0.8 * np.pi / 2),
        ((0.8, -0.8), 0.8 * np.pi / 2),
        # half a circle, and straight on
        ((-1.0, 1.6), 0.8 * np.pi + 1.0),
    ],
)
def test_without_obstacles_the_way_to_a_goal_is_that_of_dubins(goal: tuple[float, float], expected: float) -> None:
    lattice = Lattice(FreeSpace({}, BODY, 1.0), (-5.0, 5.0, -5.0, 5.0), TIGHTEST, 0.25)
    path = LatticeSearch(lattice, np.zeros(2), 0.0, np.array(goal), []).path(1000)
    assert path.cost == pytest.approx(expected)
    assert is_drivable(path.points, 0.0)


def test_a_search_ends_at_its_limit_and_reports_it() -> None:
    path = search(random_map(0, BODY), 0.3).path(5)
    assert (path.expanded, path.is_limited, len(path.points)) == (5, True, 0)


def test_a_car_beside_a_wall_drives_away_from_it() -> None:
    wall = Obstacle.model_validate({"shape": {"box": {"length": 8.0, "width": 0.2}}, "position": (4.0, 0.1)})
    lattice = Lattice(FreeSpace({"wall": wall}, 0.3, 1.0), (0.0, 8.0, 0.0, 8.0), TIGHTEST, 0.25)
    path = LatticeSearch(lattice, np.array([1.0, 0.3]), 0.0, np.array([6.0, 4.0]), []).path(20_000)
    assert np.isfinite(path.cost)
    assert path.points[:, 1].min() >= 0.3 - 1e-9
