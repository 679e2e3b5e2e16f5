"""Arrows as lines that bow to the right of their way: in a row they lie side by side, and so do there and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: How far from the straight line an arrow is in its middle, in lengths of that line.
_BOW = 0.16
#: How many pieces a bow has.
_PIECES = 6
#: How wide half a head is, in lengths of it.
_SPREAD = 0.45
#: How many points an arrow has, and one that breaks off.
POINTS, BROKEN_POINTS = _PIECES + 4, _PIECES + 6
_UP = np.array([0.0, 0.0, 1.0])


def arrows(origins: Array, targets: Array, begins: Array, ends: Array, sizes: Array) -> Array:
    """Arrows on the ways between points, each a line: a bow, and a head of two strokes.

    Args:
        origins: Where the ways begin, (m, 3) [m].
        targets: Where they end, (m, 3) [m].
        begins: At which share of its way each arrow begins, (m,).
        ends: At which share it ends, (m,).
        sizes: How long the heads are, (m,) [m].

    Returns:
        (m, POINTS, 3) [m].
    """
    bow, ahead, aside = _bows(origins, targets, begins, ends)
    tip, back = bow[:, -1:], sizes[:, None, None] * ahead[:, None]
    out = _SPREAD * sizes[:, None, None] * aside[:, None]
    return np.concatenate([bow, tip - back + out, tip, tip - back - out], axis=1)


def broken(origins: Array, targets: Array, begins: Array, ends: Array, sizes: Array) -> Array:
    """Ways that break off, with a cross where they do; as `arrows`.

    Returns:
        (m, BROKEN_POINTS, 3) [m].
    """
    bow, ahead, aside = _bows(origins, targets, begins, ends)
    tip, one, other = bow[:, -1:], (ahead + aside)[:, None], (ahead - aside)[:, None]
    arm = 0.5 * sizes[:, None, None]
    cross = [tip + arm * one, tip - arm * one, tip, tip + arm * other, tip - arm * other]
    return np.concatenate([bow, *cross], axis=1)


def _bows(origins: Array, targets: Array, begins: Array, ends: Array) -> tuple[Array, Array, Array]:
    """Parabolas over the ways.

    Returns:
        Their points (m, pieces + 1, 3) [m], and where each points at its end and what is level to the right of that,
        both of length 1, (m, 3).
    """
    way = targets - origins
    right = _right(way)
    share = begins[:, None] + (ends - begins)[:, None] * np.linspace(0.0, 1.0, _PIECES + 1)
    height = 4.0 * _BOW * np.linalg.norm(way, axis=1)[:, None] * share * (1.0 - share)
    points = origins[:, None] + share[..., None] * way[:, None] + height[..., None] * right[:, None]
    ahead = points[:, -1] - points[:, -2]
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    return points, ahead, _right(ahead)


def _right(way: Array) -> Array:
    """What is level to the right of some directions, of length 1; (m, 3)."""
    right = np.cross(way, _UP)
    length = np.linalg.norm(right, axis=1)[:, None]
    # Who goes straight up or down has no right.
    upright = length <= 1e-9 * np.linalg.norm(way, axis=1)[:, None]
    return np.where(upright, [1.0, 0.0, 0.0], right / np.where(upright, 1.0, length))
