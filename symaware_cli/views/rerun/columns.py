"""Columns of values for Rerun: what takes them, and arrays as they expect them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.views.palette import ReplayTheme, faded
from symaware_cli.views.scene.marks import Bodies, Colours, Solid, Times

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]

TIMELINE = "time"
"""The name of the timeline of simulated time."""


class ColumnReceiver(Protocol):
    """Takes columns for a recording, as `RerunOutput` does; below, k is a number of instants.

    Attributes:
        theme: The colours of the surroundings of agents.
    """

    theme: ReplayTheme

    def label(self, mark: Bodies, positions: Array) -> None:
        """Take bodies at (k, n, 3) positions [m], whose labels are placed later, with those of others."""

    def label_area(self, mark: Solid) -> None:
        """Take an area, whose label is placed later, with those of others."""

    def static(self, path: str, *archetypes: rr.AsComponents) -> None:
        """Log archetypes that are valid at all times."""

    def is_new(self, path: str) -> bool:
        """Whether this is the first call for a path, so that its static components must be logged."""

    def send(self, path: str, times: Times, columns: Any, counts: ArrayLike | None = None) -> None:
        """Send values at (k,) times [ns].

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            columns: The columns of a Rerun archetype.
            counts: (k,) number of values of each instant; None for one each.
        """


def flat(points: Array) -> NDArray[np.float32]:
    """Reshape points (..., 3) to (m, 3)."""
    return np.ascontiguousarray(points, np.float32).reshape(-1, 3)


def turns(orientations: Array) -> NDArray[np.float32]:
    """Reshape quaternions (..., 4) to (m, 4)."""
    return np.ascontiguousarray(orientations, np.float32).reshape(-1, 4)


def each(points: Array) -> list[int]:
    """Return the number of points of each of k instants; (k, n, 3)."""
    return [points.shape[1]] * len(points)


def shades(colours: ArrayLike, transparency: ArrayLike, count: int, theme: ReplayTheme) -> Colours:
    """Return colours (count, 3), mixed with the background in place of transparency, which Rerun does not support."""
    own = np.broadcast_to(np.asarray(colours, np.uint8), (count, 3))
    share = np.asarray(transparency, float)
    return faded(own, share, theme.background) if share.any() else own


def packed(colours: Colours) -> NDArray[np.uint32]:
    """Convert colours (..., 3) to 0xRRGGBBAA, (m,)."""
    red, green, blue = np.moveaxis(colours.reshape(-1, 3).astype(np.uint32), -1, 0)
    return (red << 24 | green << 16 | blue << 8 | 0xFF).astype(np.uint32)
