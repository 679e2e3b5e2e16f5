"""The map that an agent believes in, as obstacles for planners.

Reasons: docs/decisions/0095-planners-off-the-grid.md
"""

from __future__ import annotations

import numpy as np

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array, Mask
from symaware_cli.geometry.shape import Box, Shape


class BelievedFloor:
    """The believed areas of one agent.

    Attributes:
        areas: Rows of [x, x, y, y, occupied], as those of the signal `map` of `perception.map`; shape (m, 5).
    """

    def __init__(self, areas: Array) -> None:
        self.areas = areas

    def obstacles(self) -> dict[str, Obstacle]:
        """Return the occupied areas as bodies."""
        found = {}
        for number, (west, east, south, north) in enumerate(self.areas[self.areas[:, 4] == 1.0, :4].tolist()):
            shape = Shape(box=Box(length=east - west, width=north - south))
            found[f"area {number}"] = Obstacle(shape=shape, position=(0.5 * (west + east), 0.5 * (south + north)))
        return found

    def is_free(self, points: Array) -> Mask:
        """Return which points (n, 2) are in areas that are believed to be free; shape (n,)."""
        free = np.zeros(len(points), bool)
        for west, east, south, north in self.areas[self.areas[:, 4] == 0.0, :4].tolist():
            free |= (points[:, 0] >= west) & (points[:, 0] <= east) & (points[:, 1] >= south) & (points[:, 1] <= north)
        return free


def rest_of_path(waypoints: Array, position: Array) -> Array:
    """Return the rest of a path: a position (2,), and the waypoints after the segment nearest to it; (k, 2)."""
    legs = np.diff(waypoints, axis=0)
    if not len(legs):
        return np.concatenate([position[None], waypoints])
    square = np.maximum((legs**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((position - waypoints[:-1]) * legs).sum(axis=1) / square, 0.0, 1.0)
    away = waypoints[:-1] + share[:, None] * legs - position
    nearest = int((away**2).sum(axis=1).argmin())
    return np.concatenate([position[None], waypoints[nearest + 1 :]])
