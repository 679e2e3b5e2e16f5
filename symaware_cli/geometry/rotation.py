"""Rotations as unit quaternions (x, y, z, w), in arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from symaware_cli.geometry.vectors import Array

#: Without axes, as an operation on few elements takes half as long again if it has to convert a `float`.
_HALF_TURN, _TURN = np.array(np.pi), np.array(2 * np.pi)


def about(axis: ArrayLike, angles: ArrayLike) -> Array:
    """Return rotations (..., 4) about a unit vector (3,) by angles (...) [rad]."""
    half = 0.5 * np.asarray(angles, float)[..., None]
    return np.concatenate([np.sin(half) * np.asarray(axis, float), np.cos(half)], axis=-1)


def attitude(roll: ArrayLike, pitch: ArrayLike, yaw: ArrayLike) -> Array:
    """Return rotations by a yaw about z, then a pitch about the new y, then a roll about the new x [rad].

    This equals rotations about the fixed axes x, y and z, in this order, as in the ``rpy`` of URDF. (...) to (..., 4).
    """
    turned = composed(about((0.0, 0.0, 1.0), yaw), about((0.0, 1.0, 0.0), pitch))
    return composed(turned, about((1.0, 0.0, 0.0), roll))


def attitude_columns(names: Sequence[str]) -> tuple[int, int, int] | None:
    """Return the columns of roll, pitch and yaw in a state with these elements; None without an attitude."""
    known = list(names)
    if not {"roll", "pitch", "yaw"} <= set(known):
        return None
    return known.index("roll"), known.index("pitch"), known.index("yaw")


def composed(outer: ArrayLike, inner: ArrayLike) -> Array:
    """Compose rotations: the inner one is in the frame that the outer one has turned; (..., 4) both."""
    a, b = np.moveaxis(np.asarray(outer, float), -1, 0), np.moveaxis(np.asarray(inner, float), -1, 0)
    return np.stack(
        [
            a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
            a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
            a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
            a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
        ],
        axis=-1,
    )


def rotated(orientations: ArrayLike, vectors: ArrayLike) -> Array:
    """Turn vectors (..., 3) by rotations (..., 4)."""
    turns, vectors = np.asarray(orientations, float), np.asarray(vectors, float)
    axis, scalar = turns[..., :3], turns[..., 3:]
    twice = 2.0 * np.cross(axis, vectors)
    return vectors + scalar * twice + np.cross(axis, twice)


def yaws(orientations: Array) -> Array:
    """Return the heading of the x axis as seen from above, in (-pi, pi] [rad]; (n, 4) to (n,)."""
    x, y, z, w = orientations.T
    turned: Array = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return turned


def wrapped(angles: Array) -> Array:
    """Wrap angles to [-pi, pi) [rad]; any shape."""
    between: Array = np.remainder(angles + _HALF_TURN, _TURN) - _HALF_TURN
    return between


def continued(before: Array, angles: Array) -> Array:
    """Unwrap angles, given the previous unwrapped ones [rad]; any shape."""
    # Not `before + wrapped(...)`, which rounds differently.
    return before + np.remainder(angles - before + np.pi, 2 * np.pi) - np.pi
