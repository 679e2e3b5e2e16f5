"""Images by rays: the first surface that the ray of each pixel meets, in flat colours, without a graphics library.

Reasons: docs/decisions/0081-vehicles-and-cameras.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Image
from symaware_cli.geometry import Array, Indices
from symaware_mujoco.scene import HIDDEN

#: [m] The greatest depth of images.
FAR = 100.0

#: [m] The greatest distance of a camera from the origin, beyond which floating-point numbers are too coarse.
_UTMOST = 1e7

#: The number of rays that are cast at once.
_BATCH = 1 << 16

#: The direction to the light, and the part of a colour that is seen without it.
_LIGHT = np.array([0.3, -0.4, 0.866])
_AMBIENT = 0.55

#: The relative brightness of every other square of the ground.
_SQUARES = 0.8

#: The colour of pixels without a surface.
_SKY = 255


def render(
    model: Any,
    data: Any,
    owners: Indices,
    colours: Array,
    unseen: Indices,
    ground: Indices,
    position: Sequence[float],
    target: Sequence[float],
    size: tuple[int, int],
    field_of_view: float,
) -> Image:
    """Make an image, with the world's z axis upwards; see `Environment.camera_image`.

    Shapes around the camera itself are not in the image.

    Args:
        model: The engine's model.
        data: The engine's data, with up-to-date poses of geometries.
        owners: The index of the agent, entity or ground that each geometry belongs to.
        colours: Red, green and blue of each geometry, from 0 to 1; shape (g, 3).
        unseen: Geometries that cameras do not see.
        ground: Geometries with a pattern of squares of 1 m, which makes the camera's own motion visible.
        position: The position of the camera [m].
        target: The point in the middle of the image [m].
        size: Width and height [pixels].
        field_of_view: The angle from the lower to the upper edge [rad].

    Raises:
        ValueError: The camera is too far away.
    """
    if not max(map(abs, position)) <= _UTMOST:
        raise ValueError(f"the camera is {max(map(abs, position)):.3g} m away; images are limited to {_UTMOST:g} m")
    width, height = size
    directions, share = _directions(np.array(target) - np.array(position), width, height, field_of_view)
    groups = model.geom_group.copy()
    model.geom_group[unseen] = HIDDEN
    try:
        while True:
            found, distances, normals = _cast(model, data, np.array(position, float), directions, FAR / share.min())
            leaving = (found >= 0) & ((normals * directions).sum(axis=1) > 0.0)
            around = np.unique(found[leaving])
            if not len(around):
                break
            model.geom_group[around] = HIDDEN
    finally:
        model.geom_group[:] = groups
    depth = np.where(found >= 0, distances * share, np.inf)
    hit = depth <= FAR
    colour = np.full((len(found), 3), _SKY, np.uint8)
    bright = _AMBIENT + (1.0 - _AMBIENT) * np.maximum((normals * _LIGHT).sum(axis=1), 0.0)
    on_ground = np.flatnonzero(hit & np.isin(found, ground))
    points = np.array(position)[:2] + distances[on_ground, None] * directions[on_ground, :2]
    bright[on_ground] *= np.where(np.floor(points).sum(axis=1) % 2.0 == 0.0, 1.0, _SQUARES)
    colour[hit] = np.rint(255.0 * np.minimum(colours[found[hit]] * bright[hit, None], 1.0)).astype(np.uint8)
    segments = np.where(hit, owners[found] + 1, 0).astype(np.uint16)
    return Image(
        colour.reshape(height, width, 3),
        np.where(hit, depth, np.inf).reshape(height, width),
        segments.reshape(height, width),
    )


def _directions(ahead: Array, width: int, height: int, field_of_view: float) -> tuple[Array, Array]:
    """Return the unit vectors through the middles of pixels, row by row from the upper left, and their parts ahead."""
    ahead = ahead / np.sqrt((ahead * ahead).sum())
    upwards = np.array([1.0, 0.0, 0.0] if np.abs(ahead[:2]).sum() < 1e-9 else [0.0, 0.0, 1.0])
    right = np.cross(ahead, upwards)
    right = right / np.sqrt((right * right).sum())
    upper = np.cross(right, ahead)
    half = np.tan(0.5 * field_of_view)
    across = half * (2.0 * np.arange(width) + 1.0 - width) / height
    along = half * (height - 1.0 - 2.0 * np.arange(height)) / height
    rays = ahead + across[None, :, None] * right + along[:, None, None] * upper
    share = 1.0 / np.sqrt((rays * rays).sum(axis=2))
    return (rays * share[..., None]).reshape(-1, 3), share.ravel()


def _cast(
    model: Any, data: Any, origin: Array, directions: Array, reach: float
) -> tuple[NDArray[np.int32], Array, Array]:
    """Return the first geometry that each ray meets, -1 for none, its distance [m], and the normal of its surface."""
    count = len(directions)
    visible = np.array([1, 1, 1, 1, 1, 0], np.uint8)
    found, distances, normals = np.empty(count, np.int32), np.empty(count), np.empty((count, 3))
    for first in range(0, count, _BATCH):
        some = slice(first, min(first + _BATCH, count))
        number = some.stop - first
        across = np.empty((3 * number, 1))
        mujoco.mj_multiRay(
            model,
            data,
            origin,
            directions[some].ravel(),
            visible,
            True,
            -1,
            found[some],
            distances[some],
            across,
            number,
            reach,
        )
        normals[some] = across.reshape(-1, 3)
    return found, distances, normals
