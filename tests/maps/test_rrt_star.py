"""RRT*: paths touch no obstacle, never become longer with more iterations, and are nearly the shortest."""

import numpy as np
import pytest
from random_maps import SIDE, RandomMap, is_free, length_of, random_map, shortest

from symaware_cli.core import Obstacle
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.planned_path import PlannedPath
from symaware_cli.maps.rrt_star import RapidTree

RADIUS = 0.25


def planned(found: RandomMap, seed: int, iterations: int, most: int = 5000, step: float = 2.0) -> PlannedPath:
    draws = np.random.default_rng(seed).random((most, 2))[:iterations]
    space = FreeSpace(found.obstacles, RADIUS, 1.0)
    return RapidTree(space, (0.0, SIDE, 0.0, SIDE), (found.start, found.goal), step, []).path(draws)


def check(seed: int, numbers: list[int]) -> float:
    """Check the paths of some numbers of iterations; return the cost of the last one, relative to the least."""
    found = random_map(seed, RADIUS)
    paths = [planned(found, seed, number) for number in numbers]
    costs = [path.cost for path in paths]
    assert costs == sorted(costs, reverse=True), seed
    for path, number in zip(paths, numbers, strict=True):
        assert path.expanded == number
        if np.isfinite(path.cost):
            assert np.array_equal(path.points[[0, -1]], [found.start, found.goal])
            assert path.cost == pytest.approx(length_of(path.points), rel=1e-9)
            assert is_free(path.points, found.solid, RADIUS), seed
        else:
            assert path.is_limited
    least = shortest(found, RADIUS)
    assert np.isfinite(costs[-1]) <= np.isfinite(least), seed
    return costs[-1] / least if np.isfinite(least) else np.nan


def test_paths_are_free_never_longer_with_iterations_and_nearly_the_shortest() -> None:
    ratios = [check(seed, [50, 150, 400, 800]) for seed in range(4)]
    assert float(np.median(ratios)) < 1.1
    assert min(ratios) > 0.999


@pytest.mark.slow
def test_after_five_thousand_iterations_the_median_is_within_two_percent_of_the_shortest() -> None:
    # That fewer iterations give no shorter path is shown above.
    ratios = [check(seed, [5000]) for seed in range(9)]
    ratios = [ratio for ratio in ratios if not np.isnan(ratio)]
    assert len(ratios) >= 7
    assert float(np.median(ratios)) < 1.02


@pytest.mark.parametrize("step", [0.4, 20.0])
def test_paths_are_free_for_any_length_of_branches(step: float) -> None:
    found = random_map(1, RADIUS)
    path = planned(found, 1, 800, step=step)
    assert np.isfinite(path.cost)
    assert is_free(path.points, found.solid, RADIUS)


def test_a_walled_in_goal_is_not_reached() -> None:
    found = random_map(0, RADIUS)
    angles = np.arange(16) * np.pi / 8
    fence = {
        f"post_{number}": Obstacle.model_validate({"shape": {"circle": {"radius": 0.2}}, "position": place.tolist()})
        for number, place in enumerate(found.goal + np.stack([np.cos(angles), np.sin(angles)], axis=1))
    }
    path = planned(found._replace(obstacles=fence), 0, 300)
    assert (path.cost, path.expanded, path.is_limited, len(path.points)) == (np.inf, 300, True, 0)
