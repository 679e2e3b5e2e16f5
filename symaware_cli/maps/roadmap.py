"""Probabilistic roadmaps: graphs of random positions joined by straight lines.

L. E. Kavraki, P. Svestka, J.-C. Latombe, M. H. Overmars, Probabilistic roadmaps for path planning in high-dimensional
configuration spaces, IEEE Transactions on Robotics and Automation 12 (1996). The positions that are joined are at most
as far apart as in PRM*: S. Karaman and E. Frazzoli, Sampling-based algorithms for optimal motion planning, The
International Journal of Robotics Research 30 (2011), where costs then converge to the least one.
"""

from __future__ import annotations

import numpy as np

from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.graph_search import least_path
from symaware_cli.maps.planned_path import PlannedPath, no_path, polyline

#: The number of positions whose distances from all others are computed together, to bound memory.
_TOGETHER = 256

#: The search for positions to link a start or goal with widens until it finds some, at most up to this distance in
#: radii of links.
_NEAR = (1.0, 2.0, 4.0)


def connection_radius(area: float, count: int) -> float:
    """Return the greatest distance of joined positions [m]: that of PRM* in the plane, sqrt(6 A log(n) / (pi n)).

    Args:
        area: The area A that the positions are drawn from [m^2].
        count: The number n of positions.
    """
    return float(np.sqrt(6.0 * area * np.log(max(count, 2)) / (np.pi * max(count, 2))))


class Roadmap:
    """A graph of positions.

    Attributes:
        points: Positions that the disc fits in [m]; shape (n, 2).
        radius: The greatest distance of joined positions [m].
        edges: The pairs of positions that the disc can move between in a straight line; the first is less than the
            second; shape (m, 2).
        lengths: The lengths of the edges [m]; shape (m,).
    """

    def __init__(self, space: FreeSpace, points: Array, area: float) -> None:
        """Compute the graph.

        Args:
            space: The free space of the disc.
            points: Positions, some of which the disc may not fit in [m]; shape (n, 2).
            area: The area that the positions are drawn from [m^2].
        """
        self._space = space
        clearance = space.clearances(points)
        fits = clearance >= space.radius
        self.radius = connection_radius(area * float(fits.mean()) if len(fits) else area, int(fits.sum()))
        self.points: Array = points[fits]
        self._usable = np.ones(len(self.points), bool)
        edges = self._near_pairs()
        edges = edges[space.joined(self.points, clearance[fits], edges[:, 0], edges[:, 1])]
        self._set_edges(edges)

    def without(self, outside: Mask, usable: Mask) -> Roadmap:
        """Return the graph with some of its edges, (m,), and with links to some of its positions, (n,)."""
        other = object.__new__(Roadmap)
        other.__dict__.update(self.__dict__)
        other._usable = self._usable & usable
        other._set_edges(self.edges[outside])
        return other

    def links(self, position: Array) -> tuple[Indices, Array]:
        """Return the nodes that a position is linked with, ascending, (k,), and their distances [m], (k,)."""
        distance = np.sqrt(((self.points - position) ** 2).sum(axis=1))
        for reach in _NEAR:
            near = np.flatnonzero((distance <= reach * self.radius) & self._usable)
            ends = self.points[near]
            near = near[self._space.clear(np.broadcast_to(position, ends.shape), ends)]
            if len(near):
                break
        return near, distance[near]

    def path(self, start: Array, goal: Array, most: int) -> PlannedPath:
        """Find a shortest path on the graph, from a position that the disc fits in to another, (2,) each.

        Args:
            start: The start [m].
            goal: The goal [m].
            most: The greatest number of positions to expand.
        """
        first, begin = self.links(start)
        last, finish = self.links(goal)
        ends = dict(zip(last.tolist(), finish.tolist(), strict=True))
        left: list[float] = np.sqrt(((self.points - goal) ** 2).sum(axis=1)).tolist()
        found = least_path(
            dict(zip(first.tolist(), begin.tolist(), strict=True)),
            self._neighbours.__getitem__,
            lambda node: ends.get(node, np.inf),
            left.__getitem__,
            most,
        )
        if not found.nodes:
            return no_path(found.expanded, found.is_limited)
        points = polyline([start[None], self.points[found.nodes], goal[None]])
        return PlannedPath(points, found.cost, found.expanded, False)

    def _near_pairs(self) -> Indices:
        """Return all pairs of positions within the radius; shape (m, 2)."""
        points, parts = self.points, [np.empty((0, 2), np.intp)]
        for begin in range(0, len(points), _TOGETHER):
            some = points[begin : begin + _TOGETHER]
            rest = points[begin:]
            square = (some[:, None, 0] - rest[:, 0]) ** 2 + (some[:, None, 1] - rest[:, 1]) ** 2
            one, other = np.nonzero(square <= self.radius**2)
            later = other > one
            parts.append(np.stack([one[later] + begin, other[later] + begin], axis=1))
        return np.concatenate(parts)

    def _set_edges(self, edges: Indices) -> None:
        self.edges = edges
        ends = self.points[edges]
        self.lengths: Array = np.sqrt(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1))
        #: The neighbours of each position, and their distances.
        self._neighbours: list[list[tuple[int, float]]] = [[] for _ in self.points]
        for (one, other), length in zip(edges.tolist(), self.lengths.tolist(), strict=True):
            self._neighbours[one].append((other, length))
            self._neighbours[other].append((one, length))
