"""Assignments are as large as possible, then cheapest, and ties go to the first agent."""

from itertools import permutations

import numpy as np

from symaware_cli.engine.components.allocation.auction import assignment

AGENTS = ("a", "b", "c")


def test_the_total_is_least_and_not_each_cost() -> None:
    assert assignment({"x": {"a": 1.0, "b": 2.0}, "y": {"a": 1.0, "b": 5.0}}, AGENTS) == {"x": "b", "y": "a"}


def test_one_task_more_is_worth_any_cost() -> None:
    assert assignment({"x": {"a": -1e6, "b": 1e6}, "y": {"a": 0.0}}, AGENTS) == {"x": "b", "y": "a"}


def test_ties_go_to_the_first_task_and_the_first_agent() -> None:
    equal = dict.fromkeys(reversed(AGENTS), 0.2)
    assert assignment({"x": equal, "y": equal}, AGENTS) == {"x": "a", "y": "b"}


def test_with_fewer_agents_than_tasks_the_cheapest_are_assigned() -> None:
    assert assignment({"x": {"a": 3.0}, "y": {"a": 1.0}, "z": {}}, AGENTS) == {"y": "a"}
    assert assignment({"x": {}}, AGENTS) == {}


def test_assignments_equal_those_found_by_trying_all() -> None:
    random = np.random.default_rng(4)
    for _ in range(60):
        tasks = [f"t{row}" for row in range(random.integers(1, 5))]
        # Few different costs, so that there are ties.
        costs = {
            task: {agent: float(random.integers(0, 3)) for agent in AGENTS if random.random() < 0.7} for task in tasks
        }
        places = [*AGENTS, *["~"] * len(tasks)]  # "~" is no agent and comes after all
        best = min(
            (-len(feasible), sum(costs[task][agent] for task, agent in feasible), choice)
            for choice in set(permutations(places, len(tasks)))
            if all(agent == "~" or agent in costs[task] for task, agent in zip(tasks, choice, strict=True))
            for feasible in [[(t, a) for t, a in zip(tasks, choice, strict=True) if a != "~"]]
        )
        expected = {task: agent for task, agent in zip(tasks, best[2], strict=True) if agent != "~"}
        assert assignment(costs, AGENTS) == expected
