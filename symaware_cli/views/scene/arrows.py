"""Arrows as lines that curve to the right, so that arrows in both directions of a link do not coincide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Distance of the middle of an arrow from the straight line, in lengths of that line.
_BOW = 0.16
#: Number of pieces of a curve.
_PIECES = 6
#: Half the width of a head, in lengths of the head.
_SPREAD = 0.45
#: Number of points of an arrow, and of an interrupted one.
POINTS, BROKEN_POINTS = _PIECES + 4, _PIECES + 6
_UP = np.array([0.0, 0.0, 1.0])


def arrows(origins: Array, targets: Array, begins: Array, ends: Array, sizes: Array, curvature: float = _BOW) -> Array:
    """Return arrows between points as lines: a curve, and a head of two strokes.

    Args:
        origins: Start points, (m, 3) [m].
        targets: End points, (m, 3) [m].
        begins: Share of the distance at which each arrow begins, (m,).
        ends: Share of the distance at which it ends, (m,).
        sizes: Lengths of the heads, (m,) [m].
        curvature: Distance of the middle from the straight line, in lengths of that line.

    Returns:
        (m, POINTS, 3) [m].
    """
    bow, ahead, aside = _bows(origins, targets, begins, ends, curvature)
    tip, back = bow[:, -1:], sizes[:, None, None] * ahead[:, None]
    out = _SPREAD * sizes[:, None, None] * aside[:, None]
    return np.concatenate([bow, tip - back + out, tip, tip - back - out], axis=1)


def broken(origins: Array, targets: Array, begins: Array, ends: Array, sizes: Array) -> Array:
    """Return interrupted arrows that end at a cross; arguments as for `arrows`.

    Returns:
        (m, BROKEN_POINTS, 3) [m].
    """
    bow, ahead, aside = _bows(origins, targets, begins, ends, _BOW)
    tip, one, other = bow[:, -1:], (ahead + aside)[:, None], (ahead - aside)[:, None]
    arm = 0.5 * sizes[:, None, None]
    cross = [tip + arm * one, tip - arm * one, tip, tip + arm * other, tip - arm * other]
    return np.concatenate([bow, *cross], axis=1)


def _bows(origins: Array, targets: Array, begins: Array, ends: Array, curvature: float) -> tuple[Array, Array, Array]:
    """Return parabolas between points.

    Returns:
        Their points (m, pieces + 1, 3) [m], their directions at the end, and the horizontal directions to the right of
        these, both of length 1, (m, 3).
    """
    way = targets - origins
    right = _right(way)
    share = begins[:, None] + (ends - begins)[:, None] * np.linspace(0.0, 1.0, _PIECES + 1)
    height = 4.0 * curvature * np.linalg.norm(way, axis=1)[:, None] * share * (1.0 - share)
    points = origins[:, None] + share[..., None] * way[:, None] + height[..., None] * right[:, None]
    ahead = points[:, -1] - points[:, -2]
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    return points, ahead, _right(ahead)


def _right(way: Array) -> Array:
    """Return the horizontal directions to the right of some directions, of length 1; (m, 3)."""
    right = np.cross(way, _UP)
    length = np.linalg.norm(right, axis=1)[:, None]
    # For vertical directions, the choice is arbitrary.
    upright = length <= 1e-9 * np.linalg.norm(way, axis=1)[:, None]
    return np.where(upright, [1.0, 0.0, 0.0], right / np.where(upright, 1.0, length))
