"""Vectors in space whose elements are arrays or symbols, so that formulas apply to many bodies and to solvers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = tuple[Any, Any, Any]

#: The axes of a body in the world's coordinates, which are the columns of its rotation matrix.
Axes = tuple[Vector, Vector, Vector]


#: The factors of x x, y y, z z, x y, x z, y z, w x, w y and w z.
_FACTORS = np.array([[0, 1, 2, 0, 0, 1, 3, 3, 3], [0, 1, 2, 1, 2, 2, 0, 1, 2]])
#: Each element of the axes is a sum of two of these products, or a difference.
_TERMS = np.array([[1, 3, 4, 3, 0, 5, 4, 5, 0], [2, 8, 7, 8, 2, 6, 7, 6, 1]])
_SIGNS = np.array([1.0, 1, -1, -1, 1, 1, 1, -1, 1])[:, None]


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


def quaternion_axes(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes of bodies turned by unit quaternions (x, y, z, w), as an array, with which few bodies cost less.

    Args:
        quaternions: Shape (n, 4).

    Returns:
        The elements of the axes x, y and z; shape (3, 3, n).
    """
    elements = quaternions.T
    products = elements[_FACTORS[0]] * elements[_FACTORS[1]]
    axes: NDArray[np.float64] = products[_TERMS[0]] + products[_TERMS[1]] * _SIGNS
    axes *= 2.0
    on_diagonal = axes[::4]
    np.subtract(1.0, on_diagonal, out=on_diagonal)
    return axes.reshape(3, 3, -1)


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
