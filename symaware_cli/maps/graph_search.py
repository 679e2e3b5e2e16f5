"""A* on graphs whose edges are found when a node is expanded."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np


class GraphPath(NamedTuple):
    """The result of a search.

    Attributes:
        nodes: The nodes of the path; empty without a path.
        cost: The cost of the path, with those of its start and end; infinite without a path.
        expanded: The number of expanded nodes.
        is_limited: Whether the search ended because of its limit.
    """

    nodes: list[int]
    cost: float
    expanded: int
    is_limited: bool


def least_path(
    starts: Mapping[int, float],
    edges: Callable[[int], Iterable[tuple[int, float]]],
    ending: Callable[[int], float],
    estimate: Callable[[int], float],
    most: int,
) -> GraphPath:
    """Find a path of least cost.

    Among entries of equal estimates the lowest node is taken first, so that the result depends on the graph alone.

    Args:
        starts: The nodes that a path may begin with, and the cost of each.
        edges: Returns the successors of a node, and the cost of each edge, at least 0.
        ending: Returns the cost of ending a path at a node; infinite where a path cannot end.
        estimate: Returns a lower bound of the remaining cost from a node. Along an edge it must decrease by at most the
            cost of the edge.
        most: The greatest number of nodes to expand.
    """
    best = dict(starts)
    parent: dict[int, int] = {}
    ahead = [(cost + estimate(node), node) for node, cost in best.items()]
    heapq.heapify(ahead)
    done: set[int] = set()
    found, found_cost = -1, np.inf
    while ahead:
        total, node = heapq.heappop(ahead)
        if total >= found_cost:
            break
        if node in done:
            continue
        if len(done) >= most:
            return GraphPath([], np.inf, len(done), True)
        done.add(node)
        cost = best[node]
        end = cost + ending(node)
        if end < found_cost:
            found, found_cost = node, end
        for other, length in edges(node):
            reached = cost + length
            if other not in done and reached < best.get(other, np.inf):
                best[other] = reached
                parent[other] = node
                heapq.heappush(ahead, (reached + estimate(other), other))
    if found < 0:
        return GraphPath([], np.inf, len(done), False)
    nodes = [found]
    while nodes[-1] in parent:
        nodes.append(parent[nodes[-1]])
    return GraphPath(nodes[::-1], float(found_cost), len(done), False)
