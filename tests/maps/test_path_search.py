"""Paths on grids: their cost is that of Dijkstra's algorithm on the same graph, and they touch no obstacle."""

import numpy as np
import pytest
import shapely
from random_maps import outlines
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array
from symaware_cli.maps.path_search import PathSearch
from symaware_cli.maps.planning_grid import MOVES, GridFrame, PlanningGrid

RADIUS, SIDE = 0.3, 0.25


def drawn(seed: int) -> tuple[PlanningGrid, list[Obstacle], Array, Array]:
    """A random map with boxes and discs, the grid over it, and a start and a goal in free space."""
    random = np.random.default_rng(seed)
    columns, rows = (int(each) for each in random.integers(8, 32, 2))
    frame = GridFrame(
        (float(random.normal()), float(random.normal())),
        float(random.choice([0.0, random.uniform(-3, 3)])),
        SIDE,
        (rows, columns),
    )
    obstacles = []
    for _ in range(int(random.integers(0, columns * rows // 25))):
        place = tuple(frame.placed(random.uniform(0.0, [columns, rows])[None])[0].tolist())
        size, ratio = random.uniform(0.05, 1.5), random.uniform(0.05, 1.0)
        box = {"box": {"length": float(size), "width": float(size * ratio)}}
        shape = box if random.random() < 0.7 else {"circle": {"radius": float(0.3 * size)}}
        heading = float(random.choice([0.0, np.pi / 2, random.uniform(-3, 3)]))
        obstacles.append(Obstacle.model_validate({"shape": shape, "position": place, "heading": heading}))
    named = {f"box_{number}": each for number, each in enumerate(obstacles)}
    grid = PlanningGrid(frame, named, RADIUS, float(random.choice([0.0, 0.5])), float(random.uniform(0.0, 4.0)))
    ends = frame.placed(random.uniform(0.0, [columns, rows], (2, 2)))
    return grid, obstacles, ends[0], ends[1]


def least_cost(grid: PlanningGrid, search: PathSearch, start: Array, goal: Array) -> float:
    """The cost of the best path by Dijkstra's algorithm of SciPy."""
    columns, count = grid.frame.shape[1], len(grid.centres)
    one, other, cost = [], [], []
    for bit, (column, row) in enumerate(MOVES):
        from_cells = np.flatnonzero(grid.moves >> bit & 1)
        to_cells = from_cells + row * columns + column
        lengths = np.sqrt(((grid.centres[to_cells] - grid.centres[from_cells]) ** 2).sum(axis=1))
        one.append(from_cells)
        other.append(to_cells)
        cost.append(lengths * (1.0 + 0.5 * (grid.penalty[from_cells] + grid.penalty[to_cells])))
    for is_goal, place in ((False, start), (True, goal)):
        cells, costs = search.links(place)
        ends = np.full(len(cells), count + is_goal)
        one.append(cells if is_goal else ends)
        other.append(ends if is_goal else cells)
        cost.append(costs)
    edges = (np.concatenate(cost), (np.concatenate(one), np.concatenate(other)))
    graph = coo_array(edges, shape=(count + 2, count + 2)).tocsr()
    return float(dijkstra(graph, indices=np.array([count]))[0, count + 1])


def check(seed: int) -> bool:
    """Check the path on a random map; return whether there is one."""
    grid, obstacles, start, goal = drawn(seed)
    search = PathSearch(grid)
    path = search.path(start, goal, 10**6)
    expected = least_cost(grid, search, start, goal)
    if np.linalg.norm(goal - start) > SIDE:  # otherwise a straight line may be cheaper
        assert path.cost == pytest.approx(expected, rel=1e-9), seed
    assert path.cost <= expected * (1.0 + 1e-9)
    assert path.expanded <= len(grid.centres)
    if not np.isfinite(path.cost):
        assert path.points.shape == (0, 2)
        return False
    assert np.array_equal(path.points[[0, -1]], [start, goal])
    solid = outlines(obstacles)
    if len(path.points) > 2:
        # Only between the first and the last cell, as the links of a start or goal beside an obstacle lead away from
        # it.
        inner = shapely.LineString(path.points[1:-1]) if len(path.points) > 3 else shapely.Point(path.points[1])
        assert solid.is_empty or inner.distance(solid) >= RADIUS - 1e-3, seed
    whole = shapely.LineString(path.points)
    assert (
        solid.is_empty
        or shapely.Point(start).intersects(solid)
        or shapely.Point(goal).intersects(solid)
        or (whole.distance(solid) >= min(RADIUS, *(shapely.Point(end).distance(solid) for end in (start, goal))) - 1e-3)
    ), seed
    return True


def test_the_cost_on_random_maps_is_that_of_dijkstra_and_paths_keep_from_obstacles() -> None:
    assert 5 <= sum(check(seed) for seed in range(12)) <= 11


@pytest.mark.slow
def test_the_same_holds_on_a_hundred_maps() -> None:
    assert sum(check(seed) for seed in range(12, 112)) >= 30


def test_a_move_between_two_obstacles_that_meet_at_their_corners_is_not_possible() -> None:
    box = {"shape": {"box": {"length": 1.0, "width": 1.0}}}
    corners = {
        name: Obstacle.model_validate({**box, "position": place})
        for name, place in {"a": (0.5, 1.5), "b": (1.5, 0.5)}.items()
    }
    grid = PlanningGrid(GridFrame((0.0, 0.0), 0.0, 0.5, (4, 4)), corners, 0.0, 0.0, 0.0)
    path = PathSearch(grid).path(np.array([0.25, 0.25]), np.array([1.75, 1.75]), 1000)
    assert np.isinf(path.cost)


@pytest.mark.parametrize(("gap", "passes"), [(0.66, True), (0.58, False)])
def test_the_body_passes_a_gap_that_is_wider_than_it(gap: float, passes: bool) -> None:
    walls = {
        name: Obstacle.model_validate({"shape": {"box": {"length": 0.2, "width": 2.0}}, "position": (2.1, y)})
        for name, y in {"above": 2.1 + 1.0 + 0.5 * gap, "below": 2.1 - 1.0 - 0.5 * gap}.items()
    }
    grid = PlanningGrid(GridFrame((0.0, 1.1), 0.0, 0.04, (50, 100)), walls, 0.3, 0.2, 1.0)
    path = PathSearch(grid).path(np.array([0.5, 2.1]), np.array([3.5, 2.0]), 10**5)
    assert np.isfinite(path.cost) == passes


def test_without_obstacles_the_path_is_straight_and_its_cost_its_length() -> None:
    grid = PlanningGrid(GridFrame((0.0, 0.0), 0.0, 0.5, (20, 20)), {}, 0.3, 0.5, 3.0)
    path = PathSearch(grid).path(np.array([0.25, 0.25]), np.array([6.25, 0.25]), 1000)
    assert path.points.tolist() == [[0.25, 0.25], [6.25, 0.25]]
    assert path.cost == pytest.approx(6.0)
    assert path.expanded <= 30


def test_a_search_ends_at_its_limit_and_reports_it() -> None:
    grid = PlanningGrid(GridFrame((0.0, 0.0), 0.0, 0.5, (20, 20)), {}, 0.3, 0.5, 3.0)
    path = PathSearch(grid).path(np.array([0.25, 0.25]), np.array([6.25, 9.1]), 5)
    assert (path.expanded, path.is_limited, len(path.points)) == (5, True, 0)
    assert not PathSearch(grid).path(np.array([0.25, 0.25]), np.array([50.0, 0.0]), 1000).is_limited


def test_a_body_that_touches_a_wall_gets_away_from_it() -> None:
    wall = Obstacle.model_validate({"shape": {"box": {"length": 4.0, "width": 0.2}}, "position": (2.0, 0.1)})
    grid = PlanningGrid(GridFrame((0.0, 0.0), 0.0, 0.25, (16, 16)), {"wall": wall}, 0.3, 0.0, 0.0)
    path = PathSearch(grid).path(np.array([1.0, 0.3]), np.array([3.0, 3.0]), 1000)
    assert np.isfinite(path.cost)


def uniform(seed: int) -> tuple[PlanningGrid, Array, Array]:
    """A random grid on which every move costs its length."""
    grid, obstacles, start, goal = drawn(seed)
    named = {f"box_{number}": each for number, each in enumerate(obstacles)}
    return PlanningGrid(grid.frame, named, 0.5 * RADIUS, 0.0, 0.0), start, goal


@pytest.mark.parametrize("first", range(0, 500, 100))
def test_jump_points_find_the_cost_of_a_star_and_expand_fewer_cells(first: int) -> None:
    jumped, expanded = 0, 0
    for seed in range(first, first + 100):
        grid, start, goal = uniform(seed)
        path, other = (PathSearch(grid, jumps).path(start, goal, 10**6) for jumps in (True, False))
        assert path.cost == pytest.approx(other.cost, rel=1e-9), seed
        if len(path.points) > 1:
            legs = np.diff(path.points, axis=0)
            assert np.sqrt((legs**2).sum(axis=1)).sum() == pytest.approx(path.cost), seed
            jumped, expanded = jumped + path.expanded, expanded + other.expanded
    assert jumped < 0.5 * expanded
