"""Conflict-based search: paths of a team with the least sum of costs.

G. Sharon, R. Stern, A. Felner and N. R. Sturtevant, Conflict-based search for optimal multi-agent pathfinding,
Artificial Intelligence 219 (2015). Conflicts that raise the cost of both agents, however they are resolved, are
resolved first, as by E. Boyarski et al. (ICBS: improved conflict-based search algorithm for multi-agent pathfinding,
IJCAI 2015).
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from symaware_cli.maps.space_time import (
    NEVER,
    Limits,
    Neighbours,
    PlanningTeam,
    TeamPaths,
    at,
    distances,
    space_time_path,
)


class CellConflict(NamedTuple):
    """A conflict: two agents are in one cell, or exchange their cells.

    Attributes:
        step: The step of the conflict; for an exchange, the step in which it begins.
        one: The first agent.
        other: The second agent.
        cell: The cell of the first agent.
        other_cell: The cell of the second agent; equal to `cell` for two agents in one cell.
    """

    step: int
    one: int
    other: int
    cell: int
    other_cell: int


class StepConstraint(NamedTuple):
    """A constraint: an agent may not be in a cell at a step, or may not begin a move.

    Attributes:
        row: The agent.
        step: The step.
        cell: The cell.
        to: The cell that the move leads to; None if the constraint is on a cell.
    """

    row: int
    step: int
    cell: int
    to: int | None


class ConstraintNode(NamedTuple):
    """A node of the tree of constraints."""

    constraints: tuple[StepConstraint, ...]
    paths: tuple[tuple[int, ...], ...]


class ConflictSearch:
    """The search of one team."""

    def __init__(self, team: PlanningTeam, most: int, most_cells: int) -> None:
        """Prepare.

        Args:
            team: The team.
            most: The greatest number of nodes of the tree of constraints.
            most_cells: The greatest number of nodes of one search in space and time.
        """
        self._team, self._most, self._most_cells = team, most, most_cells
        self._to_goal = [distances(team.neighbours[row], team.goals[row]) for row in range(len(team.starts))]
        self._widths: dict[tuple[int, tuple[StepConstraint, ...], int], list[set[int]]] = {}

    def paths(self) -> TeamPaths:
        """Find paths without conflicts whose sum of costs is least."""
        team = self._team
        found: list[tuple[int, ...]] = []
        for row, name in enumerate(team.names):
            if self._to_goal[row][team.starts[row]] >= NEVER:
                return TeamPaths([], 0, f"no path leads {name} to its goal, wherever the others are", row)
            path = self._path(row, (), found)
            if path is None:
                return TeamPaths([], 0, self._too_far(row), row)
            found.append(path)
        root = ConstraintNode((), tuple(found))
        # Nodes of equal costs: fewest conflicts first, then the oldest.
        ahead = [(self._cost(root), len(conflicts_of(root.paths)), 0, root)]
        nodes, made = 0, 1
        while ahead:
            _, _, _, node = heapq.heappop(ahead)
            conflicts = conflicts_of(node.paths)
            if not conflicts:
                return TeamPaths([list(path) for path in node.paths], nodes)
            if nodes >= self._most:
                most = Counter(row for each in conflicts for row in (each.one, each.other)).most_common(2)
                names = " and ".join(team.names[row] for row, _ in sorted(most))
                said = (
                    f"no plan was found within {self._most} nodes of the tree of constraints; {names} are in conflict"
                )
                return TeamPaths([], nodes, said)
            nodes += 1
            for constraint in self._split(self._choice(node, conflicts)):
                constraints = (*node.constraints, constraint)
                others = [path for row, path in enumerate(node.paths) if row != constraint.row]
                path = self._path(constraint.row, constraints, others)
                if path is None:
                    continue
                paths = (*node.paths[: constraint.row], path, *node.paths[constraint.row + 1 :])
                child = ConstraintNode(constraints, paths)
                heapq.heappush(ahead, (self._cost(child), len(conflicts_of(paths)), made, child))
                made += 1
        return TeamPaths([], nodes, f"no plan was found whose paths take less than {self._most_cells} nodes each")

    def _too_far(self, row: int) -> str:
        return f"no path of {self._team.names[row]} was found within {self._most_cells} nodes"

    def _cost(self, node: ConstraintNode) -> int:
        return sum(len(path) - 1 for path in node.paths)

    def _path(
        self, row: int, constraints: Sequence[StepConstraint], others: Sequence[Sequence[int]]
    ) -> tuple[int, ...] | None:
        team = self._team
        longest = max((len(path) for path in others), default=0)
        avoided = {(at(path, step), step) for path in others for step in range(longest + 1)}
        path, _ = space_time_path(
            team.neighbours[row],
            team.starts[row],
            team.goals[row],
            self._to_goal[row],
            limits_of(row, constraints),
            self._most_cells,
            avoided,
        )
        return None if path is None else tuple(path)

    def _split(self, conflict: CellConflict) -> tuple[StepConstraint, StepConstraint]:
        """Return a constraint for each agent, at least one of which every plan without conflicts meets."""
        step, one, other, cell, other_cell = conflict
        if cell == other_cell:
            return StepConstraint(one, step, cell, None), StepConstraint(other, step, cell, None)
        return StepConstraint(one, step, cell, other_cell), StepConstraint(other, step, other_cell, cell)

    def _choice(self, node: ConstraintNode, conflicts: Sequence[CellConflict]) -> CellConflict:
        """Return the earliest conflict that raises the cost of both agents, else that of one agent, else any."""
        best, most = conflicts[0], -1
        for conflict in conflicts:
            raised = int(self._is_forced(node, conflict.one, conflict, conflict.cell, conflict.other_cell))
            raised += self._is_forced(node, conflict.other, conflict, conflict.other_cell, conflict.cell)
            if raised > most:
                best, most = conflict, raised
            if raised == 2:
                break
        return best

    def _is_forced(self, node: ConstraintNode, row: int, conflict: CellConflict, cell: int, to: int) -> bool:
        """Return whether all paths of an agent that are as short as its present one contain its part of a conflict."""
        path = node.paths[row]
        if conflict.step >= len(path) - (cell != to):
            return cell == to
        own = tuple(each for each in node.constraints if each.row == row)
        key = (row, own, len(path))
        if key not in self._widths:
            self._widths[key] = shortest_cells(
                self._team.neighbours[row], path[0], self._to_goal[row], limits_of(row, own), len(path) - 1
            )
        widths = self._widths[key]
        if cell == to:
            return widths[conflict.step] == {cell}
        return widths[conflict.step] == {cell} and widths[conflict.step + 1] == {to}


def limits_of(row: int, constraints: Sequence[StepConstraint]) -> Limits:
    """Return the constraints of an agent as limits."""
    limits = Limits()
    for each in constraints:
        if each.row == row and each.to is None:
            limits.forbid_cell(each.cell, each.step)
        elif each.row == row and each.to is not None:
            limits.forbid_move(each.cell, each.to, each.step)
    return limits


def shortest_cells(
    neighbours: Neighbours, start: int, to_goal: Sequence[int], limits: Limits, length: int
) -> list[set[int]]:
    """Return the cells that paths of a length pass at each step."""
    forward = [{start}]
    for step in range(length):
        forward.append(
            {
                other
                for cell in forward[-1]
                for other in (*neighbours[cell], cell)
                if step + 1 + to_goal[other] <= length and limits.allows_move(cell, other, step)
            }
        )
    for step in range(length - 1, -1, -1):
        after = forward[step + 1]
        forward[step] = {
            cell
            for cell in forward[step]
            if any(other in after and limits.allows_move(cell, other, step) for other in (*neighbours[cell], cell))
        }
    return forward


def conflicts_of(paths: Sequence[Sequence[int]]) -> list[CellConflict]:
    """Return the first conflict of each pair of agents, earliest first."""
    found: dict[tuple[int, int], CellConflict] = {}
    longest = max((len(path) for path in paths), default=0)
    before: list[int] = []
    for step in range(longest):
        now = [at(path, step) for path in paths]
        where: dict[int, list[int]] = {}
        for row, cell in enumerate(now):
            for other in where.get(cell, ()):
                found.setdefault((other, row), CellConflict(step, other, row, cell, cell))
            where.setdefault(cell, []).append(row)
        for row, cell in enumerate(before):
            for other in where.get(cell, ()):
                if other > row and before[other] == now[row] and cell != now[row]:
                    found.setdefault((row, other), CellConflict(step - 1, row, other, cell, now[row]))
        before = now
    return sorted(found.values())


def is_free_of_conflicts(paths: Sequence[Sequence[int]]) -> bool:
    """Return whether no two agents are in one cell, or exchange their cells."""
    longest = max((len(path) for path in paths), default=0)
    steps = [[at(path, step) for path in paths] for step in range(longest)]
    if any(len(set(now)) < len(now) for now in steps):
        return False
    return not any(
        before[one] == now[other] and before[other] == now[one]
        for before, now in pairwise(steps)
        for one in range(len(paths))
        for other in range(one)
    )
