"""Paths of teams: without conflicts, and of least cost by conflict-based search."""

import heapq
from itertools import count, pairwise, product

import numpy as np
import pytest

from symaware_cli.maps.conflict_search import ConflictSearch, conflicts_of, is_free_of_conflicts
from symaware_cli.maps.prioritised_search import prioritised_paths
from symaware_cli.maps.space_time import Limits, PlanningTeam, TeamPaths, distances, space_time_path


def grid(rows: list[str]) -> list[list[int]]:
    """The graph of a grid whose cells `#` are occupied, with moves to four neighbours."""
    height, width = len(rows), len(rows[0])
    found: list[list[int]] = []
    for row, column in product(range(height), range(width)):
        near = [(row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column)]
        is_free = rows[row][column] != "#"
        found.append(
            [y * width + x for y, x in near if is_free and 0 <= y < height and 0 <= x < width and rows[y][x] != "#"]
        )
    return found


def team(rows: list[str], starts: list[int], goals: list[int]) -> PlanningTeam:
    return PlanningTeam([grid(rows)] * len(starts), starts, goals, [f"robot.{row}" for row in range(len(starts))])


def drawn(seed: int) -> PlanningTeam:
    """A random team of two or three on a small grid."""
    random = np.random.default_rng(seed)
    height, width = (int(each) for each in random.integers(2, 5, 2))
    rows = ["".join("#" if random.random() < 0.2 else "." for _ in range(width)) for _ in range(height)]
    free = [cell for cell in range(height * width) if rows[cell // width][cell % width] == "."]
    agents = min(int(random.integers(2, 4)), len(free))
    starts = random.choice(free, agents, replace=False).tolist() if agents else []
    goals = random.choice(free, agents, replace=False).tolist() if agents else []
    return team(rows, starts, goals)


def least_cost(problem: PlanningTeam) -> int | None:
    """The least sum of costs by an exhaustive search of the cells of all agents together; None without a plan.

    An agent pays for each step until it declares that it stays at its goal.
    """
    neighbours, goals = problem.neighbours, problem.goals
    number = count()
    begin = (tuple(problem.starts), (False,) * len(goals))
    best = {begin: 0}
    ahead = [(0, next(number), begin)]
    while ahead:
        cost, _, state = heapq.heappop(ahead)
        if cost > best[state]:
            continue
        cells, stays = state
        if all(stays):
            return cost
        for row, cell in enumerate(cells):
            if not stays[row] and cell == goals[row]:
                after = (cells, (*stays[:row], True, *stays[row + 1 :]))
                if cost < best.get(after, 1 << 30):
                    best[after] = cost
                    heapq.heappush(ahead, (cost, next(number), after))
        options = [[cell] if stays[row] else [cell, *neighbours[row][cell]] for row, cell in enumerate(cells)]
        for then in product(*options):
            if len(set(then)) < len(then) or any(
                then[one] == cells[other] and then[other] == cells[one]
                for one in range(len(then))
                for other in range(one)
            ):
                continue
            following = (then, stays)
            reached = cost + stays.count(False)
            if reached < best.get(following, 1 << 30):
                best[following] = reached
                heapq.heappush(ahead, (reached, next(number), following))
    return None


def check(problem: PlanningTeam, found: TeamPaths) -> None:
    """Check that paths are a plan."""
    assert is_free_of_conflicts(found.paths)
    assert not conflicts_of(found.paths)
    for row, path in enumerate(found.paths):
        assert (path[0], path[-1]) == (problem.starts[row], problem.goals[row])
        assert all(after == before or after in problem.neighbours[row][before] for before, after in pairwise(path))


#: The greatest difference of the cost of a plan from the sum of the shortest paths that the node limit here allows: the
#: tree of constraints grows exponentially with that difference.
HARD = 10


@pytest.mark.parametrize("first", range(0, 272, 68))
def test_conflict_based_search_finds_the_least_sum_of_costs_of_an_exhaustive_search(first: int) -> None:
    solved = 0
    for seed in range(first, first + 68):
        problem = drawn(seed)
        expected = least_cost(problem)
        found = ConflictSearch(problem, 20 if expected is None else 1000, 1000).paths()
        if expected is None:
            assert found.failure, seed
            continue
        if found.failure:
            alone = sum(
                distances(problem.neighbours[row], goal)[problem.starts[row]] for row, goal in enumerate(problem.goals)
            )
            assert expected - alone > HARD, seed
            continue
        check(problem, found)
        assert found.cost == expected, seed
        solved += 1
    assert solved >= 50, "at least 200 in all"


def test_prioritised_plans_have_no_conflicts_and_cost_no_less() -> None:
    solved = 0
    for seed in range(200):
        problem = drawn(seed)
        found = prioritised_paths(problem, 10_000)
        if found.failure:
            assert found.row is None or problem.names[found.row] in found.failure
            continue
        check(problem, found)
        assert found.cost >= ConflictSearch(problem, 300, 1000).paths().cost
        solved += 1
    assert solved > 120


def test_two_robots_pass_each_other_in_a_corridor_with_a_bay() -> None:
    problem = team(["#.###", ".....", "#####"], [5, 9], [9, 5])
    found = ConflictSearch(problem, 1000, 1000).paths()
    check(problem, found)
    assert found.cost == least_cost(problem)


def test_a_corridor_without_a_bay_has_no_plan_and_both_searches_report_it() -> None:
    problem = team([".....", "#####"], [0, 4], [4, 0])
    found = ConflictSearch(problem, 50, 1000).paths()
    assert found.failure == (
        "no plan was found within 50 nodes of the tree of constraints; robot.0 and robot.1 are in conflict"
    )
    assert "finds no path past those of robot." in prioritised_paths(problem, 1000).failure


def test_an_agent_that_cannot_reach_its_goal_alone_is_named() -> None:
    problem = team(["..#.", "..#."], [0, 4], [1, 3])
    for found in (ConflictSearch(problem, 50, 1000).paths(), prioritised_paths(problem, 1000)):
        assert found.failure == "no path leads robot.1 to its goal, wherever the others are"
        assert found.row == 1


def test_the_limits_are_numbers_of_nodes() -> None:
    problem = team(["......", "......"], [0, 5], [5, 0])
    assert "within 3 nodes" in prioritised_paths(problem, 3).failure
    assert "no path of robot.0 was found within 3 nodes" in ConflictSearch(problem, 10, 3).paths().failure


def test_a_path_past_an_agent_that_parks_later_passes_before_it() -> None:
    neighbours = grid(["....."])
    limits = Limits()
    limits.forbid_from(2, 4)
    path, _ = space_time_path(neighbours, 0, 4, distances(neighbours, 4), limits, 100)
    assert path == [0, 1, 2, 3, 4]
    limits.forbid_from(2, 2)
    assert space_time_path(neighbours, 0, 4, distances(neighbours, 4), limits, 100)[0] is None
