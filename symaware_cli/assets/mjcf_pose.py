"""Poses in MJCF: positions and orientations, which attributes give in several ways."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from symaware_cli.assets.urdf import numbers_of
from symaware_cli.assets.xml_tree import XmlElement
from symaware_cli.geometry import Array, about, composed

#: Ways to write an orientation, and the number of values of each.
ORIENTATIONS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}

#: No rotation, as a quaternion (x, y, z, w).
UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class MjcfPoses:
    """Reads positions and orientations by the settings of the compiler."""

    def __init__(self, degrees: bool, sequence: str) -> None:
        """Read poses by settings.

        Args:
            degrees: Whether angles are in degrees; otherwise, they are in radians.
            sequence: The axes of Euler angles: three letters, lower case for axes that turn along.
        """
        self._degrees, self._sequence = degrees, sequence

    def pose(self, element: XmlElement, given: Mapping[str, str]) -> tuple[Array, Array]:
        """Return the position [m] and the orientation, as a quaternion (x, y, z, w), that attributes give.

        Args:
            element: The element, for messages.
            given: Its attributes, with defaults.

        Raises:
            AssetError: The attributes give no pose, or several orientations.
        """
        position = np.array(numbers_in(element, given, "pos", 3)) if "pos" in given else np.zeros(3)
        ways = [key for key in ORIENTATIONS if key in given]
        if len(ways) > 1:
            # An element's own attribute takes precedence over a default.
            ways = [key for key in ways if key in element.attrib] or ways
        if not ways:
            return position, UNTURNED
        if len(ways) > 1:
            element.refuse(f"it has one orientation, not `{ways[0]}` and `{ways[1]}`")
        values = np.array(numbers_in(element, given, ways[0], ORIENTATIONS[ways[0]]))
        return position, self._orientation(element, ways[0], values)

    def _orientation(self, element: XmlElement, way: str, values: Array) -> Array:
        factor = math.pi / 180.0 if self._degrees else 1.0
        if way == "euler":
            turned = UNTURNED
            for letter, angle in zip(self._sequence, values.tolist(), strict=True):
                part = about(_AXES[letter.lower()], factor * angle)
                turned = composed(turned, part) if letter.islower() else composed(part, turned)
            return turned
        parts = {"quat": values, "axisangle": values[:3], "zaxis": values, "xyaxes": values[:3]}[way]
        if not parts.any():
            element.refuse(f"the `{way}` of a `{element.tag}` has no direction")
        if way == "quat":
            unit = values / np.linalg.norm(values)
            return np.roll(unit, -1)
        if way == "axisangle":
            return about(parts / np.linalg.norm(parts), factor * float(values[3]))
        if way == "zaxis":
            return along(values)
        x = values[:3] / np.linalg.norm(values[:3])
        y = values[3:] - x * float(x @ values[3:])
        if not np.linalg.norm(y) > 1e-9:
            element.refuse(f"the axes in `{way}` are parallel")
        y = y / np.linalg.norm(y)
        return _from_axes(np.column_stack([x, y, np.cross(x, y)]))


def numbers_in(element: XmlElement, given: Mapping[str, str], key: str, count: int) -> tuple[float, ...]:
    """Return the numbers of an attribute, of which there have to be as many as stated.

    Raises:
        AssetError: The attribute is missing, or has other values.
    """
    return numbers_of(element, key, given.get(key, ""), count)


def along(direction: Array) -> Array:
    """Return the least rotation that turns the z axis into a direction, as a quaternion (x, y, z, w)."""
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    across = math.hypot(x, y)
    if across < 1e-12:
        return UNTURNED if z > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])
    return about((-y / across, x / across, 0.0), float(np.arctan2(across, z)))


def _from_axes(matrix: Array) -> Array:
    """Return the quaternion (x, y, z, w) of a rotation matrix, by its greatest component."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix.tolist()
    found = [
        np.array([1.0 + xx - yy - zz, xy + yx, xz + zx, zy - yz]),
        np.array([xy + yx, 1.0 - xx + yy - zz, yz + zy, xz - zx]),
        np.array([xz + zx, yz + zy, 1.0 - xx - yy + zz, yx - xy]),
        np.array([zy - yz, xz - zx, yx - xy, 1.0 + xx + yy + zz]),
    ]
    best = max(range(4), key=lambda number: float(found[number][number]))
    unit: Array = found[best] / np.linalg.norm(found[best])
    return unit


def triple(values: Array) -> tuple[float, float, float]:
    """Return the numbers of a vector; shape (3,)."""
    x, y, z = values.tolist()
    return x, y, z


def quadruple(values: Array) -> tuple[float, float, float, float]:
    """Return the numbers of a quaternion; shape (4,)."""
    x, y, z, w = values.tolist()
    return x, y, z, w
