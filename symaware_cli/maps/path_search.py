"""A* on a planning grid between two positions; by jump points where costs are lengths.

P. E. Hart, N. J. Nilsson and B. Raphael, A formal basis for the heuristic determination of minimum cost paths, IEEE
Transactions on Systems Science and Cybernetics 4 (1968).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np

from symaware_cli.geometry import Array
from symaware_cli.geometry.vectors import Indices
from symaware_cli.maps.jump_points import JumpPoints
from symaware_cli.maps.planned_path import PlannedPath, no_path
from symaware_cli.maps.planning_grid import MOVES, PlanningGrid

_DIAGONAL = 2.0**0.5

#: The greatest ratio of costs that differ by rounding errors only.
_ALIKE = 1.0 + 1e-9

#: Within how many cells of a position the search for cells that it is linked with goes on until there are some.
_NEAR = (1.5, 3.0, 6.0)


class PathSearch:
    """Searches paths on a grid.

    A start or a goal is linked with the passable cells around it that a straight line leads to without touching an
    obstacle. A body that is nearer to an obstacle than its radius counts as narrower on the link, so that it can leave
    the obstacle.
    """

    def __init__(self, grid: PlanningGrid, jumps: bool = True) -> None:
        """Prepare.

        Args:
            grid: The grid.
            jumps: Whether to search by jump points if costs are lengths.
        """
        self._grid = grid
        self._penalty: list[float] = grid.penalty.tolist()
        columns = grid.frame.shape[1]
        step = grid.frame.resolution
        steps = [(row * columns + column, step * (_DIAGONAL if column and row else 1.0)) for column, row in MOVES]
        #: The moves from a cell by its bits: changes of the index, and lengths.
        self._steps = [[steps[bit] for bit in range(8) if bits >> bit & 1] for bits in range(256)]
        self._moves: list[int] = grid.moves.tolist()
        is_uniform = not grid.penalty[grid.passable].any()
        self._jump_points = JumpPoints(grid) if jumps and is_uniform else None
        self._lengths = [length for _, length in steps]

    def path(self, start: Array, goal: Array, most: int) -> PlannedPath:
        """Find a path of least cost.

        Args:
            start: The start [m]; shape (2,).
            goal: The goal [m]; shape (2,).
            most: The greatest number of cells to expand.
        """
        grid, penalty, all_steps, moves = self._grid, self._penalty, self._steps, self._moves
        first, begin = self.links(start)
        last, finish = self.links(goal)
        ends = dict(zip(last.tolist(), finish.tolist(), strict=True))
        columns, step = grid.frame.shape[1], grid.frame.resolution
        goal_x, goal_y = (grid.frame.cells(goal[None])[0] - 0.5).tolist()
        # A path passes one of the last cells, so this is how much nearer than the goal it may be without being better.
        slack = max((self._distance(cell, goal_x, goal_y) for cell in ends), default=0.0)

        def estimate(cell: int) -> float:
            row, column = divmod(cell, columns)
            x, y = abs(column - goal_x), abs(row - goal_y)
            least = step * (max(x, y) + (_DIAGONAL - 1.0) * min(x, y)) - slack
            return least if least > 0.0 else 0.0

        if self._jump_points is not None:
            return self._jumped(start, goal, most, self._jump_points, estimate)
        best: dict[int, float] = dict(zip(first.tolist(), begin.tolist(), strict=True))
        parent: dict[int, int] = {}
        # Among entries of equal estimates the lowest cell is taken first, so that the result depends on the grid alone.
        ahead = [(cost + estimate(cell), cell) for cell, cost in best.items()]
        heapq.heapify(ahead)
        done: set[int] = set()
        found, found_cost, expanded = -1, self._direct(start, goal), 0
        while ahead:
            total, cell = heapq.heappop(ahead)
            if total >= found_cost:
                break
            if cell in done:
                continue
            if expanded >= most:
                return no_path(expanded, True)
            done.add(cell)
            expanded += 1
            cost = best[cell]
            if cell in ends and cost + ends[cell] < found_cost:
                found, found_cost = cell, cost + ends[cell]
            here = penalty[cell]
            for change, length in all_steps[moves[cell]]:
                other = cell + change
                if other in done:
                    continue
                reached = cost + length * (1.0 + 0.5 * (here + penalty[other]))
                if reached < best.get(other, np.inf):
                    best[other] = reached
                    parent[other] = cell
                    heapq.heappush(ahead, (reached + estimate(other), other))
        if found < 0:
            points = np.stack([start, goal]) if np.isfinite(found_cost) else np.empty((0, 2))
            return PlannedPath(points, found_cost, expanded, False)
        cells = [found]
        while cells[-1] in parent:
            cells.append(parent[cells[-1]])
        return PlannedPath(self._points(start, cells[::-1], goal), found_cost, expanded, False)

    def _jumped(
        self, start: Array, goal: Array, most: int, jump_points: JumpPoints, estimate: Callable[[int], float]
    ) -> PlannedPath:
        """Find a path of least cost by jump points; see `path`.

        A node is a cell with the move that led to it, since that move decides which moves to consider next. Among
        several nodes of a cell, those of least cost are kept, within rounding errors.
        """
        first, begin = self.links(start)
        last, finish = self.links(goal)
        ends = dict(zip(last.tolist(), finish.tolist(), strict=True))
        nearest: dict[int, float] = dict(zip(first.tolist(), begin.tolist(), strict=True))
        best = {(cell, -1): cost for cell, cost in nearest.items()}
        parent: dict[tuple[int, int], tuple[int, int]] = {}
        ahead = [(cost + estimate(cell), cell, -1) for cell, cost in nearest.items()]
        heapq.heapify(ahead)
        done: set[tuple[int, int]] = set()
        found, found_cost, expanded = (-1, -1), self._direct(start, goal), 0
        while ahead:
            total, cell, arrived = heapq.heappop(ahead)
            if total >= found_cost:
                break
            node = (cell, arrived)
            cost = best[node]
            if node in done or cost > nearest[cell] * _ALIKE:
                continue
            if expanded >= most:
                return no_path(expanded, True)
            done.add(node)
            expanded += 1
            if cell in ends and cost + ends[cell] < found_cost:
                found, found_cost = node, cost + ends[cell]
            for bit in jump_points.directions(cell, arrived):
                other, steps = jump_points.jump(cell, bit, ends)
                if other < 0:
                    continue
                reached = cost + steps * self._lengths[bit]
                following = (other, bit)
                if reached < best.get(following, np.inf) and reached <= nearest.get(other, np.inf) * _ALIKE:
                    best[following] = reached
                    nearest[other] = min(reached, nearest.get(other, np.inf))
                    parent[following] = node
                    heapq.heappush(ahead, (reached + estimate(other), other, bit))
        if found[0] < 0:
            points = np.stack([start, goal]) if np.isfinite(found_cost) else np.empty((0, 2))
            return PlannedPath(points, found_cost, expanded, False)
        nodes = [found]
        while nodes[-1] in parent:
            nodes.append(parent[nodes[-1]])
        return PlannedPath(self._points(start, [cell for cell, _ in nodes[::-1]], goal), found_cost, expanded, False)

    def links(self, position: Array) -> tuple[Indices, Array]:
        """Return the cells that a position is linked with, ascending, (m,), and the costs of these links, (m,)."""
        grid = self._grid
        rows, columns = grid.frame.shape
        x, y = (grid.frame.cells(position[None])[0] - 0.5).tolist()
        radius = min(grid.radius, max(grid.clearance(position), 0.0))
        for reach in _NEAR:
            across = np.arange(max(0, int(np.ceil(x - reach))), min(columns, int(np.floor(x + reach)) + 1))
            up = np.arange(max(0, int(np.ceil(y - reach))), min(rows, int(np.floor(y + reach)) + 1))
            cells: Indices = (up[:, None] * columns + across).ravel()
            cells = cells[grid.passable[cells]]
            centres = grid.centres[cells]
            starts = np.broadcast_to(position, centres.shape)
            length = np.sqrt(((centres - starts) ** 2).sum(axis=1))
            linked = (length <= reach * grid.frame.resolution) & grid.clear(starts, centres, radius)
            if linked.any():
                cost = length[linked] * (1.0 + grid.penalty[cells[linked]])
                return cells[linked], cost
        return np.empty(0, np.intp), np.empty(0)

    def _direct(self, start: Array, goal: Array) -> float:
        """Return the cost of the straight line between positions in one cell or two; infinite if it is blocked."""
        grid = self._grid
        away = goal - start
        length = float(np.sqrt((away**2).sum()))
        if length > grid.frame.resolution:
            return np.inf
        radius = min(grid.radius, max(grid.clearance(start), 0.0), max(grid.clearance(goal), 0.0))
        is_clear = grid.clear(start[None], goal[None], radius)[0]
        return length * (1.0 + float(grid.penalty.max(initial=0.0))) if is_clear else np.inf

    def _distance(self, cell: int, x: float, y: float) -> float:
        row, column = divmod(cell, self._grid.frame.shape[1])
        across, up = abs(column - x), abs(row - y)
        return self._grid.frame.resolution * (max(across, up) + (_DIAGONAL - 1.0) * min(across, up))

    def _points(self, start: Array, cells: list[int], goal: Array) -> Array:
        """Return the start, the positions where the path turns, and the goal."""
        kept = [start]
        for point in (*self._grid.centres[cells], goal):
            if len(kept) > 1:
                one, other = kept[-1] - kept[-2], point - kept[-1]
                is_straight = abs(one[0] * other[1] - one[1] * other[0]) <= 1e-9 * self._grid.frame.resolution**2
                if is_straight and one[0] * other[0] + one[1] * other[1] >= 0.0:
                    kept.pop()
            if (point != kept[-1]).any():
                kept.append(point)
        return np.array(kept)
