"""Paths in space and time: cells of a graph at whole numbers of steps, under constraints.

D. Silver, Cooperative pathfinding, AIIDE 2005.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

#: The neighbours of each cell, without the cell itself.
Neighbours = Sequence[Sequence[int]]

#: The number of steps to the goal from cells that have no path to it.
NEVER = 1 << 40


class PlanningTeam(NamedTuple):
    """Agents that move between cells or wait in common steps, and stay at their goals.

    Two agents are in conflict if they are in one cell, or exchange their cells.

    Attributes:
        neighbours: The graph of each agent.
        starts: The initial cell of each agent.
        goals: The final cell of each agent.
        names: The name of each agent in messages.
    """

    neighbours: Sequence[Neighbours]
    starts: Sequence[int]
    goals: Sequence[int]
    names: Sequence[str]


class TeamPaths(NamedTuple):
    """The result of a search for a team.

    Attributes:
        paths: The cells of each agent, one for each step until it stays at its goal; empty without a plan.
        nodes: The number of nodes that the search took.
        failure: The reason why there is no plan; empty if there is one.
        row: The agent that the failure concerns; None if it concerns all.
    """

    paths: list[list[int]]
    nodes: int
    failure: str = ""
    row: int | None = None

    @property
    def cost(self) -> int:
        """The sum of the steps after which each agent stays at its goal."""
        return sum(len(path) - 1 for path in self.paths)


@dataclass
class Limits:
    """Constraints on one agent.

    Attributes:
        cells: Cells that the agent may not be in: (cell, step).
        moves: Moves that may not begin: (from, to, step).
        parked: Cells that are closed from a step on: that step, by cell.
        last: The last step with a constraint.
    """

    cells: set[tuple[int, int]] = field(default_factory=set)
    moves: set[tuple[int, int, int]] = field(default_factory=set)
    parked: dict[int, int] = field(default_factory=dict)
    last: int = 0

    def forbid_cell(self, cell: int, step: int) -> None:
        """Forbid a cell at a step."""
        self.cells.add((cell, step))
        self.last = max(self.last, step)

    def forbid_move(self, start: int, end: int, step: int) -> None:
        """Forbid a move that begins at a step."""
        self.moves.add((start, end, step))
        self.last = max(self.last, step + 1)

    def forbid_from(self, cell: int, step: int) -> None:
        """Forbid a cell from a step on."""
        self.parked[cell] = min(step, self.parked.get(cell, step))
        self.last = max(self.last, step)

    def allows_cell(self, cell: int, step: int) -> bool:
        """Return whether the agent may be in a cell at a step."""
        return (cell, step) not in self.cells and step < self.parked.get(cell, NEVER)

    def allows_move(self, start: int, end: int, step: int) -> bool:
        """Return whether a move may begin at a step."""
        return self.allows_cell(end, step + 1) and (start, end, step) not in self.moves

    def free_from(self, cell: int) -> int:
        """Return the step from which on an agent may stay in a cell for ever."""
        if cell in self.parked:
            return NEVER
        return max((step + 1 for other, step in self.cells if other == cell), default=0)


def distances(neighbours: Neighbours, goal: int) -> list[int]:
    """Return the steps from each cell to a goal, in a graph whose moves can be reversed."""
    found = [NEVER] * len(neighbours)
    found[goal] = 0
    ahead = deque([goal])
    while ahead:
        cell = ahead.popleft()
        for other in neighbours[cell]:
            if found[other] == NEVER:
                found[other] = found[cell] + 1
                ahead.append(other)
    return found


def space_time_path(
    neighbours: Neighbours,
    start: int,
    goal: int,
    to_goal: Sequence[int],
    limits: Limits,
    most: int,
    avoided: Container[tuple[int, int]] = frozenset(),
) -> tuple[list[int] | None, int]:
    """Find the path that stays at a goal earliest, by A*.

    After the last step with a constraint, time does not matter, so the search ends even if there is no path.

    Args:
        neighbours: The graph.
        start: The cell at step 0.
        goal: The cell to stay in.
        to_goal: The steps from each cell to the goal without limits.
        limits: The constraints on the agent.
        most: The greatest number of nodes.
        avoided: Pairs of cell and step that the path avoids where its length allows it.

    Returns:
        The cells of the path, one for each step, and the number of nodes. None without a path; then `most` nodes
        mean that the search ended because of its limit.
    """
    latest, stays = limits.last + 1, limits.free_from(goal)
    if to_goal[start] >= NEVER or stays >= NEVER or not limits.allows_cell(start, 0):
        return None, 0
    first = (start, 0)
    parent: dict[tuple[int, int], tuple[int, int] | None] = {first: None}
    # Equal lengths: fewest avoided cells first, then the cell nearest to the goal, then the lowest cell.
    ahead = [(max(to_goal[start], stays), 0, to_goal[start], start, 0)]
    seen = {(start, min(0, latest)): 0}
    done: set[tuple[int, int]] = set()
    nodes = 0
    while ahead:
        _, crossed, _, cell, step = heapq.heappop(ahead)
        key = (cell, min(step, latest))
        if key in done:
            continue
        if nodes >= most:
            return None, nodes
        done.add(key)
        nodes += 1
        if cell == goal and step >= stays:
            path, node = [], (cell, step)
            following: tuple[int, int] | None = node
            while following is not None:
                path.append(following[0])
                following = parent[following]
            return path[::-1], nodes
        for other in (*neighbours[cell], cell):
            then = (other, min(step + 1, latest))
            if then in done or to_goal[other] >= NEVER or not limits.allows_move(cell, other, step):
                continue
            crossing = crossed + ((other, step + 1) in avoided)
            if crossing >= seen.get(then, NEVER) and (other, step + 1) in parent:
                continue
            seen[then] = min(crossing, seen.get(then, NEVER))
            parent[other, step + 1] = (cell, step)
            total = max(step + 1 + to_goal[other], stays)
            heapq.heappush(ahead, (total, crossing, to_goal[other], other, step + 1))
    return None, nodes


def at(path: Sequence[int], step: int) -> int:
    """Return the cell of an agent at a step."""
    return path[step] if step < len(path) else path[-1]
