"""Prioritised planning: agents plan one after the other, each around the paths of those before it.

M. Erdmann and T. Lozano-Perez, On multiple moving objects, Algorithmica 2 (1987). The search is fast, but neither
complete nor optimal. An agent that finds no path is moved to the front and all plan again, as by A. Andreychuk and K.
Yakovlev (Two techniques that enhance the performance of multi-robot prioritized path planning, AAMAS 2018).
"""

from __future__ import annotations

from symaware_cli.maps.space_time import NEVER, Limits, PlanningTeam, TeamPaths, distances, space_time_path


def prioritised_paths(team: PlanningTeam, most: int) -> TeamPaths:
    """Find paths of a team without conflicts.

    Agents with farther goals plan first.

    Args:
        team: The team.
        most: The greatest number of nodes of all searches together.
    """
    count = len(team.starts)
    to_goal = [distances(team.neighbours[row], team.goals[row]) for row in range(count)]
    for row in range(count):
        if to_goal[row][team.starts[row]] >= NEVER:
            return TeamPaths([], 0, f"no path leads {team.names[row]} to its goal, wherever the others are", row)
    order = sorted(range(count), key=lambda row: (-to_goal[row][team.starts[row]], row))
    nodes = 0
    tried: set[tuple[int, ...]] = set()
    while True:
        tried.add(tuple(order))
        paths: dict[int, list[int]] = {}
        for row in order:
            limits = _past(list(paths.values()))
            path, expanded = space_time_path(
                team.neighbours[row], team.starts[row], team.goals[row], to_goal[row], limits, most - nodes
            )
            nodes += expanded
            if path is None:
                break
            paths[row] = path
        else:
            return TeamPaths([paths[row] for row in range(count)], nodes)
        if nodes >= most:
            return TeamPaths(
                [], nodes, f"no plan was found within {most} nodes; the last to plan was {team.names[row]}"
            )
        order = [row, *(each for each in order if each != row)]
        if tuple(order) in tried:
            others = ", ".join(team.names[each] for each in paths) or "nobody"
            said = f"{team.names[row]} finds no path past those of {others}; `planning.cbs` may find a plan"
            return TeamPaths([], nodes, said, row)


def _past(paths: list[list[int]]) -> Limits:
    """Return the limits that other paths set."""
    limits = Limits()
    for path in paths:
        for step, cell in enumerate(path):
            limits.forbid_cell(cell, step)
            if step and path[step - 1] != cell:
                limits.forbid_move(cell, path[step - 1], step - 1)
        limits.forbid_from(path[-1], len(path) - 1)
    return limits
