"""Obstacles of `control.mpc` that are seen by a lidar: surfaces as straight pieces with a thickness.

Reasons: docs/decisions/0098-barn-and-shared-maps.md
"""

from __future__ import annotations

import numpy as np

from symaware_cli.core import Agent, Environment
from symaware_cli.engine import ScanReturns, ScanSurfaces
from symaware_cli.geometry import Array, Mask, Pieces, separation_from_points
from symaware_cli.planning.control.mpc_prediction import ObstaclePrediction, Times
from symaware_cli.planning.control.mpc_problem import Sizes

#: The greatest distance of the points of a piece from its middle line, as a share of the distance to keep.
_STRAIGHT = 0.15


class SeenObstacles(ObstaclePrediction):
    """Constrains a plan to the free side of what a lidar sees, which is expected to stand still.

    Returns between which the body does not fit are joined to chains, and each chain is divided into pieces that are
    nearly straight: lines, rounded so that they cover their points and three standard deviations of the distances.
    """

    def __init__(self, environment: Environment, seen: Pieces, keep: float, room: Sizes) -> None:
        """Avoid what is seen.

        Args:
            environment: The world.
            seen: The pieces of surfaces.
            keep: Distance to keep from them [m].
            room: The number of pieces to avoid.
        """
        super().__init__(environment, keep, room)
        self._seen = seen

    @classmethod
    def of(cls, agent: Agent, surfaces: ScanSurfaces, returns: ScanReturns, radii: Array, room: Sizes) -> SeenObstacles:
        """Take the obstacles from the returns of a scan.

        Args:
            agent: The agent that avoids them.
            surfaces: What its group knows of the surfaces.
            returns: The scan of the group.
            radii: Bounding radius of each agent by index in the roster [m]; shape (N,).
            room: The number of pieces to avoid.
        """
        group, row = agent.group, agent.row
        position = group.model.positions(group.awareness.state)[:, :2]
        chains = surfaces.chains(group, returns, position, radii)
        seen = Pieces.of(
            (ends, rounding + surfaces.uncertainty)
            for chain in parted(chains.points[row], chains.joined[row])
            for ends, rounding in straightened(chain, _STRAIGHT * surfaces.clearance)
        )
        return cls(agent.surroundings.environment, seen, surfaces.clearance, room)

    def clear(self, path: Array) -> bool:
        """Return whether a path (N + 1, 2) keeps its distance from what is seen."""
        count, places = len(self._seen), path[:, :2]
        if not count:
            return True
        pieces = self._seen.take(np.tile(np.arange(count), len(places)))
        found = separation_from_points(np.repeat(places, count, axis=0), np.zeros(len(pieces)), pieces)
        return bool((found.distance >= self._keep).all())

    def _pieces(self, path: Array, times: Times, reach: float) -> tuple[Pieces, Mask]:
        count = len(self._seen)
        return self._seen.take(np.tile(np.arange(count), len(path))), np.zeros(count, bool)


def parted(points: Array, joined: Mask) -> list[Array]:
    """Return the chains of points (k, 2) that are joined, each of shape (m, 2), in the order of directions.

    Args:
        points: The points [m], NaN where there is none.
        joined: Whether each is joined to the one after it, the last to the first; shape (k,).
    """
    count = len(points)
    ends = np.flatnonzero(~joined)
    if not len(ends):
        return [np.concatenate([points, points[:1]])]
    chains = []
    # Each chain goes from after one end to the next; the first one may begin among the last points.
    for end, after in zip(ends.tolist(), np.roll(ends, -1).tolist(), strict=True):
        length = (after - end - 1) % count + 1
        chain = points[(end + 1 + np.arange(length)) % count]
        if not np.isnan(chain).any():
            chains.append(chain)
    return chains


def straightened(chain: Array, tolerance: float) -> list[tuple[Array, float]]:
    """Divide a chain of points (m, 2) into straight pieces: the ends, (2, 2) or (1, 2), and a radius around them [m].

    A chain is divided at the point that is farthest from the line between its ends while that is farther than the
    tolerance (D. H. Douglas and T. K. Peucker, "Algorithms for the reduction of the number of points required to
    represent a digitized line or its caricature", Cartographica 10, 1973). All points are within the radius.
    """
    if len(chain) == 1:
        return [(chain, 0.0)]
    start, along = chain[0], chain[-1] - chain[0]
    square = float((along * along).sum())
    share = np.clip(((chain - start) * along).sum(axis=1) / (square or 1.0), 0.0, 1.0)
    away = chain - (start + share[:, None] * along)
    distance = np.sqrt((away * away).sum(axis=1))
    farthest = int(distance.argmax())
    if distance[farthest] <= tolerance or len(chain) == 2:
        return [(chain[[0, -1]] if square else chain[:1], float(distance[farthest]))]
    farthest = min(max(farthest, 1), len(chain) - 2)
    return [*straightened(chain[: farthest + 1], tolerance), *straightened(chain[farthest:], tolerance)]
