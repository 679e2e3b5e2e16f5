"""Assignments of least total cost, with a rule for ties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

#: Totals that differ by less than this part of the greatest cost are equal.
_TOLERANCE = 1e-9


def assignment(costs: Mapping[str, Mapping[str, float]], agents: Sequence[str]) -> dict[str, str]:
    """Assign each task to one agent and each agent to at most one task.

    As many tasks as possible are assigned, and among these assignments one with the least total cost is chosen
    (H. W. Kuhn, *The Hungarian method for the assignment problem*, Naval Research Logistics Quarterly 2, 1955). Of
    several with the same total, the first task goes to the agent that comes first, then the second task, and so on.

    Args:
        costs: The cost of each agent that can do a task, by task and agent.
        agents: The agents in the order that breaks ties.

    Returns:
        The agent of each task that is assigned, in the order of the tasks.
    """
    from scipy.optimize import linear_sum_assignment

    tasks = list(costs)
    finite = [abs(cost) for each in costs.values() for cost in each.values()]
    if not finite:
        return {}
    largest = max(finite)
    # One assigned task more is worth more than any saving on the others.
    forbidden = 2.0 * (largest + 1.0) * (len(tasks) + 1)
    # Columns after those of the agents are for tasks that nobody gets, so that each row has one.
    table = np.full((len(tasks), len(agents) + len(tasks)), forbidden)
    for row, task in enumerate(tasks):
        for column, agent in enumerate(agents):
            if agent in costs[task]:
                table[row, column] = costs[task][agent]

    def least(table: NDArray[np.float64]) -> float:
        return float(table[linear_sum_assignment(table)].sum())

    total, tolerance = least(table), _TOLERANCE * (largest + 1.0)
    found: dict[str, str] = {}
    for row, task in enumerate(tasks):
        for column, agent in enumerate(agents):
            if agent not in costs[task] or agent in found.values():
                continue
            tried = table.copy()
            tried[row] = np.where(np.arange(table.shape[1]) == column, table[row], 2.0 * forbidden)
            if least(tried) <= total + tolerance:
                table, found[task] = tried, agent
                break
    return found
