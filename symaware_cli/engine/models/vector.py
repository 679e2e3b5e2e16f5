"""Vectors in space whose elements are arrays or symbols, so that formulas apply to many bodies and to solvers."""

from __future__ import annotations

from typing import Any

import numpy as np

Vector = tuple[Any, Any, Any]

#: The axes of a body in the world's coordinates, which are the columns of its rotation matrix.
Axes = tuple[Vector, Vector, Vector]


def body_axes(roll: Any, pitch: Any, yaw: Any, math: Any) -> Axes:
    """Return the axes of a body turned by a yaw about z, then a pitch about y, then a roll about x [rad]."""
    sine_r, cosine_r = math.sin(roll), math.cos(roll)
    sine_p, cosine_p = math.sin(pitch), math.cos(pitch)
    sine_y, cosine_y = math.sin(yaw), math.cos(yaw)
    return (
        (cosine_y * cosine_p, sine_y * cosine_p, -sine_p),
        (
            cosine_y * sine_p * sine_r - sine_y * cosine_r,
            sine_y * sine_p * sine_r + cosine_y * cosine_r,
            cosine_p * sine_r,
        ),
        (
            cosine_y * sine_p * cosine_r + sine_y * sine_r,
            sine_y * sine_p * cosine_r - cosine_y * sine_r,
            cosine_p * cosine_r,
        ),
    )


def quaternion_axes(x: Any, y: Any, z: Any, w: Any) -> Axes:
    """Return the axes of a body turned by a unit quaternion."""
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def dot(one: Vector, other: Vector) -> Any:
    """Return the scalar product."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def cross(one: Vector, other: Vector) -> Vector:
    """Return the vector product."""
    return (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )


def added(one: Vector, other: Vector) -> Vector:
    """Return the sum."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def to_world(axes: Axes, vector: Vector) -> Vector:
    """Convert a vector from the axes of the body to the world's coordinates."""
    x, y, z = axes
    turned = [vector[0] * x[axis] + vector[1] * y[axis] + vector[2] * z[axis] for axis in range(3)]
    return turned[0], turned[1], turned[2]


def unit(vector: Vector) -> Vector:
    """Return the unit vector of a direction."""
    length = np.maximum(np.sqrt(dot(vector, vector)), 1e-9)
    return vector[0] / length, vector[1] / length, vector[2] / length
