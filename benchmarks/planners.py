"""Measures planners of single paths on random maps: the lengths of paths, and the time that they take.

`python benchmarks/planners.py [MAPS]` prints a table: for each planner the number of maps with a path, the median and
the greatest of length over shortest length, and CPU times. The maps are squares of 10 m with 8 to 24 boxes and discs
(`tests/random_maps.py`); a disc of radius 0.25 m goes at least 5 m. The shortest lengths are those of visibility graphs
of widened obstacles, made by shapely and SciPy, and too small by up to half a percent. It ends with status 1 if a path
is not free according to shapely, or if the cost rises with the iterations.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from random_maps import SIDE, RandomMap, is_free, random_map, shortest

from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.path_search import PathSearch
from symaware_cli.maps.planned_path import PlannedPath
from symaware_cli.maps.planning_grid import GridFrame, PlanningGrid
from symaware_cli.maps.roadmap import Roadmap
from symaware_cli.maps.rrt_star import RapidTree

RADIUS = 0.25
ITERATIONS = (500, 2000, 5000)
Planner = Callable[[RandomMap, int], PlannedPath]


def by_grid(found: RandomMap, seed: int) -> PlannedPath:
    """Plan on cells of 0.1 m, by jump points."""
    frame = GridFrame((0.0, 0.0), 0.0, 0.1, (100, 100))
    return PathSearch(PlanningGrid(frame, found.obstacles, RADIUS, 0.0, 0.0)).path(found.start, found.goal, 10**6)


def by_roadmap(found: RandomMap, seed: int) -> PlannedPath:
    """Plan on a roadmap of 1,000 samples."""
    points = np.random.default_rng(seed).uniform(0.0, SIDE, (1000, 2))
    graph = Roadmap(FreeSpace(found.obstacles, RADIUS, 1.0), points, SIDE * SIDE)
    return graph.path(found.start, found.goal, 10**6)


def by_tree(iterations: int) -> Planner:
    """Plan by RRT* with a number of iterations."""

    def planned(found: RandomMap, seed: int) -> PlannedPath:
        draws = np.random.default_rng(seed).random((max(ITERATIONS), 2))[:iterations]
        space = FreeSpace(found.obstacles, RADIUS, 1.0)
        return RapidTree(space, (0.0, SIDE, 0.0, SIDE), (found.start, found.goal), 2.0, []).path(draws)

    return planned


PLANNERS: dict[str, Planner] = {
    "grid, 0.1 m": by_grid,
    "roadmap, 1,000 samples": by_roadmap,
    **{f"RRT*, {number:,} iterations": by_tree(number) for number in ITERATIONS},
}


def main() -> int:
    """Plan on all maps, and print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    ratios: dict[str, list[float]] = {name: [] for name in PLANNERS}
    times: dict[str, list[float]] = {name: [] for name in PLANNERS}
    reachable, faults = 0, 0
    for seed in range(count):
        found = random_map(seed, RADIUS)
        least = shortest(found, RADIUS)
        reachable += bool(np.isfinite(least))
        before = np.inf
        for name, planner in PLANNERS.items():
            began = time.process_time()
            path = planner(found, seed)
            times[name].append(time.process_time() - began)
            if np.isfinite(path.cost):
                ratios[name].append(path.cost / least)
                faults += not is_free(path.points, found.solid, RADIUS)
            if name.startswith("RRT*"):
                faults += bool(path.cost > before)
                before = path.cost
    print(f"{reachable} of {count} maps have a path by the visibility graph; {faults} faults")
    print("planner | maps with a path | median of length / shortest | greatest | CPU time, median [ms] | greatest")
    for name in PLANNERS:
        found_ratios, spent = np.array(ratios[name]), 1e3 * np.array(times[name])
        figures = f"{np.median(found_ratios):.4f} | {found_ratios.max():.4f}"
        print(f"{name} | {len(found_ratios)} | {figures} | {np.median(spent):.1f} | {spent.max():.1f}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
