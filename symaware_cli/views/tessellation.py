"""Tessellation: converts solids to triangles with normals for lighting."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.geometry import Visual

Array = NDArray[np.float64]

#: Number of segments around the axis; from pole to pole there are half as many.
_TURN = 32


class Triangles(NamedTuple):
    """A triangle mesh.

    Attributes:
        vertices: (v, 3) [m].
        normals: (v, 3), of length 1.
        corners: (t, 3) vertex indices, counter-clockwise as seen from outside.
    """

    vertices: Array
    normals: Array
    corners: NDArray[np.uint32]


def tessellated(visual: Visual) -> Triangles:
    """Return the surface of any visual except a mesh, in the frame of the visual."""
    size = visual.size
    match visual.kind:
        case "box":
            x, y = 0.5 * size[0], 0.5 * size[1]
            return _prism([(-x, -y), (x, -y), (x, y), (-x, y)], size[2])
        case "prism":
            return _prism(visual.outline, size[0])
        case "cylinder":
            return _joined(
                _round([(size[0], 0.5 * size[1] * side) for side in (-1, 1)], [(1.0, 0.0)] * 2), *_caps(size)
            )
        case _:
            return _ball(size[0], size[1] if visual.kind == "capsule" else 0.0)


def _prism(outline: ArrayLike, height: float) -> Triangles:
    """Return an upright prism around the origin over a convex, counter-clockwise outline."""
    corners = np.asarray(outline, float)
    following = np.roll(corners, -1, axis=0)
    count, half = len(corners), 0.5 * height
    along = following - corners
    outwards = np.column_stack([along[:, 1], -along[:, 0], np.zeros(count)])
    outwards /= np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-12)
    quads = np.stack(
        [_at(corners, -half), _at(following, -half), _at(following, half), _at(corners, half)], axis=1
    ).reshape(-1, 3)
    quad = np.array([(0, 1, 2), (0, 2, 3)])
    sides = (4 * np.arange(count)[:, None, None] + quad).reshape(-1, 3)
    walls = Triangles(quads, np.repeat(outwards, 4, axis=0), sides.astype(np.uint32))
    return _joined(walls, _lid(_at(corners, half), 1.0), _lid(_at(corners, -half), -1.0))


def _caps(size: ArrayLike) -> tuple[Triangles, Triangles]:
    radius, length = np.asarray(size, float)
    angles = 2.0 * np.pi * np.arange(_TURN) / _TURN
    rim = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return _lid(_at(rim, 0.5 * length), 1.0), _lid(_at(rim, -0.5 * length), -1.0)


def _lid(rim: Array, upwards: float) -> Triangles:
    """Return a flat convex face that faces up (1) or down (-1)."""
    fan = np.array([(0, index, index + 1) for index in range(1, len(rim) - 1)], np.uint32)
    return Triangles(rim, np.tile([0.0, 0.0, upwards], (len(rim), 1)), fan if upwards > 0 else fan[:, ::-1])


def _ball(radius: float, length: float) -> Triangles:
    """Return a sphere whose halves are separated along z by a length."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _TURN // 2 + 2)
    angles = np.sort(np.append(angles, [0.0, 0.0]) if length else angles)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    profile = radius * normals
    profile[:, 1] += 0.5 * length * np.where(np.arange(len(angles)) < len(angles) / 2, -1.0, 1.0)
    return _round(profile, normals)


def _round(profile: ArrayLike, normals: ArrayLike) -> Triangles:
    """Revolve a line (m, 2) of radii and heights, upwards, around the z axis."""
    line, facing = np.asarray(profile, float), np.asarray(normals, float)
    angles = 2.0 * np.pi * np.arange(_TURN + 1) / _TURN
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def turned(flat: Array) -> Array:
        rings = np.empty((len(angles), len(flat), 3))
        rings[..., :2] = around[:, None] * flat[:, :1]
        rings[..., 2] = flat[:, 1]
        return rings.reshape(-1, 3)

    count = len(line)
    step, level = np.meshgrid(np.arange(_TURN), np.arange(count - 1), indexing="ij")
    low = (step * count + level).ravel()
    corners = np.concatenate(
        [np.stack([low, low + count, low + count + 1], axis=1), np.stack([low, low + count + 1, low + 1], axis=1)]
    )
    return Triangles(turned(line), turned(facing), corners.astype(np.uint32))


def _joined(*parts: Triangles) -> Triangles:
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    corners = [part.corners + np.uint32(first) for part, first in zip(parts, firsts, strict=True)]
    return Triangles(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate(corners),
    )


def _at(points: Array, height: float) -> Array:
    return np.column_stack([points, np.full(len(points), height)])
