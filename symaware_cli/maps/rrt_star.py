"""RRT*: a tree of random positions whose branches become shorter with every iteration.

S. Karaman and E. Frazzoli, Sampling-based algorithms for optimal motion planning, The International Journal of Robotics
Research 30 (2011), algorithm 6. Once there is a path, positions are drawn only from the ellipse that contains all
shorter paths: J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, Informed RRT*, IROS 2014.
"""

from __future__ import annotations

import numpy as np

from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.planned_path import PlannedPath, no_path, polyline
from symaware_cli.maps.roadmap import connection_radius
from symaware_cli.specification import PlacedRegion

#: Positions at most this far apart count as one [m].
_TINY = 1e-9


class RapidTree:
    """The tree of a search from a start to a goal.

    Iterations use the draws one after the other, so a search with more iterations continues the tree of one with fewer.
    Costs in the tree never rise, and so the cost of the path never rises either.
    """

    def __init__(
        self,
        space: FreeSpace,
        within: tuple[float, float, float, float],
        ends: tuple[Array, Array],
        step: float,
        closed: list[PlacedRegion],
    ) -> None:
        """Begin with the start.

        Args:
            space: The free space of the disc.
            within: The area that positions are drawn from: [x, x, y, y] [m].
            ends: The start and the goal, positions that the disc fits in [m]; shape (2,) each.
            step: The greatest length of a new branch [m].
            closed: Regions that the disc may not reach into.
        """
        self._space, self._closed, self._step = space, closed, step
        self._low = np.array([within[0], within[2]])
        self._size = np.array([within[1], within[3]]) - self._low
        self._start, self._goal = ends
        away = self._goal - self._start
        #: The distance from the start to the goal [m], and the unit vector.
        self._least = float(np.sqrt(away[0] ** 2 + away[1] ** 2))
        self._along = away / max(self._least, _TINY)

    def path(self, draws: Array) -> PlannedPath:
        """Grow the tree, and return the shortest path in it.

        Args:
            draws: Numbers from [0, 1) for each iteration; shape (n, 2).
        """
        size = len(draws) + 1
        #: The positions of nodes [m], the costs of the ways to them, their distances from obstacles, the lengths of the
        #: straight ways past them, and their distances from the goal; only the first `_count` are in the tree.
        self._points = np.empty((size, 2))
        self._cost, self._clearance, self._detour, self._to_goal = (np.empty(size) for _ in range(4))
        #: Whether each node is joined with the goal.
        self._reaches_goal = np.zeros(size, bool)
        self._parent: list[int] = []
        self._children: list[list[int]] = []
        self._count = 0
        clearances = self._space.clearances(np.stack([self._start, self._goal]))
        self._goal_clearance = float(clearances[1])
        self._add(self._start, float(clearances[0]), -1, 0.0)
        best = self._best()
        for draw in draws:
            best = self._grow(draw, best)
        if not np.isfinite(best):
            return no_path(len(draws), True)
        linked = np.flatnonzero(self._reaches_goal[: self._count])
        node = int(linked[(self._cost[linked] + self._to_goal[linked]).argmin()])
        nodes = [node]
        while self._parent[nodes[-1]] >= 0:
            nodes.append(self._parent[nodes[-1]])
        points = polyline([self._points[nodes[::-1]], self._goal[None]])
        return PlannedPath(points, best, len(draws), False)

    def _grow(self, draw: Array, best: float) -> float:
        """Make one iteration; return the cost of the best path."""
        count, space = self._count, self._space
        point = self._drawn(draw, best)
        apart = self._points[:count] - point
        square = apart[:, 0] ** 2 + apart[:, 1] ** 2
        nearest = int(square.argmin())
        distance = float(np.sqrt(square[nearest]))
        if distance <= _TINY:
            return best
        if distance > self._step:
            point = self._points[nearest] + (self._step / distance) * (point - self._points[nearest])
            apart = self._points[:count] - point
            square = apart[:, 0] ** 2 + apart[:, 1] ** 2
        detour, to_goal = self._lengths(point)
        if detour >= best:
            return best
        clearance = float(space.clearances(point[None])[0])
        if clearance < space.radius:
            return best
        radius = min(self._step, self._connection_radius(best))
        near = np.flatnonzero(square <= radius * radius)
        if len(near) == 0 or nearest not in near:
            near = np.append(near, nearest)
        length = np.sqrt(square[near])
        free = self._are_free(point, clearance, near, length)
        if not free.any():
            return best
        near, length = near[free], length[free]
        through = self._cost[near] + length
        first = int(through.argmin())
        cost = float(through[first])
        if cost + to_goal >= best:
            return best
        node = self._add(point, clearance, int(near[first]), cost)
        shorter = cost + length < self._cost[near] - _TINY
        for other, step in zip(near[shorter].tolist(), length[shorter].tolist(), strict=True):
            self._move(other, node, cost + step)
        return self._best()

    def _drawn(self, draw: Array, best: float) -> Array:
        """Return the position of a draw: in the area, or in the ellipse of positions that a shorter path may pass."""
        if self._area(best) >= self._size[0] * self._size[1]:
            placed: Array = self._low + draw * self._size
            return placed
        across = self._across(best)
        radius, angle = np.sqrt(draw[0]), 2.0 * np.pi * draw[1]
        x, y = 0.5 * best * radius * np.cos(angle), 0.5 * across * radius * np.sin(angle)
        turned = np.array([x * self._along[0] - y * self._along[1], x * self._along[1] + y * self._along[0]])
        point: Array = 0.5 * (self._start + self._goal) + turned
        return np.clip(point, self._low, self._low + self._size)

    def _connection_radius(self, best: float) -> float:
        """Return the greatest distance of joined positions [m], for the area that shorter paths may pass."""
        area, count = min(float(self._size[0] * self._size[1]), self._area(best)), self._count
        if np.isfinite(best):
            count = int((self._detour[:count] <= best).sum())
        return connection_radius(area, count)

    def _across(self, best: float) -> float:
        """Return the minor axis of the ellipse of positions through which a path may be shorter than another [m]."""
        return float(np.sqrt(max(best * best - self._least * self._least, 0.0)))

    def _area(self, best: float) -> float:
        """Return the area of that ellipse [m^2]."""
        return float(0.25 * np.pi * best * self._across(best)) if np.isfinite(best) else np.inf

    def _are_free(self, point: Array, clearance: float, near: Indices, length: Array) -> Mask:
        """Return whether the lines from a position to nodes are free; shape (m,)."""
        space, others = self._space, self._points[near]
        free = np.ones(len(near), bool)
        # Clearance changes by at most the distance travelled.
        doubtful = np.flatnonzero(0.5 * (clearance + self._clearance[near] - length) < space.radius)
        if len(doubtful):
            starts = np.broadcast_to(point, (len(doubtful), 2))
            free[doubtful] = space.clear(starts, others[doubtful])
        if self._closed:
            free &= space.outside(np.broadcast_to(point, others.shape), others, self._closed)
        return free

    def _lengths(self, point: Array) -> tuple[float, float]:
        """Return the length of the way from start to goal past a position, and from there to the goal [m]."""
        to_goal = float(np.sqrt((point[0] - self._goal[0]) ** 2 + (point[1] - self._goal[1]) ** 2))
        begun = float(np.sqrt((point[0] - self._start[0]) ** 2 + (point[1] - self._start[1]) ** 2))
        return begun + to_goal, to_goal

    def _add(self, point: Array, clearance: float, parent: int, cost: float) -> int:
        """Add a node; return its number."""
        node = self._count
        self._points[node], self._cost[node], self._clearance[node] = point, cost, clearance
        self._detour[node], self._to_goal[node] = self._lengths(point)
        self._parent.append(parent)
        self._children.append([])
        if parent >= 0:
            self._children[parent].append(node)
        if self._to_goal[node] <= self._step:
            row = np.array([node])
            self._reaches_goal[node] = self._are_free(self._goal, self._goal_clearance, row, self._to_goal[row])[0]
        self._count += 1
        return node

    def _move(self, node: int, parent: int, cost: float) -> None:
        """Give a node another parent, and update the costs of all its descendants."""
        self._children[self._parent[node]].remove(node)
        self._children[parent].append(node)
        self._parent[node] = parent
        less = float(self._cost[node]) - cost
        ahead = [node]
        while ahead:
            other = ahead.pop()
            self._cost[other] -= less
            ahead += self._children[other]

    def _best(self) -> float:
        """Return the cost of the best path [m]; infinite if there is none."""
        ends = self._cost[: self._count] + self._to_goal[: self._count]
        return float(ends[self._reaches_goal[: self._count]].min(initial=np.inf))
