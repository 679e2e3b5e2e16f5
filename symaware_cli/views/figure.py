"""Figures: the visuals of bodies with links and joints, from the geometry of a log, and their poses in space."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from symaware_cli.assets import MEDIA_TYPES, AssetError, parse_mesh
from symaware_cli.geometry import Articulation, Visual, composed, rotated

Array = NDArray[np.float64]

_CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


class Figure:
    """The visuals of bodies of one kind.

    Attributes:
        number: Its index among the figures of a log.
        articulation: Its links and joints.
        surfaces: The attachments with its meshes.
    """

    def __init__(self, number: int, articulation: Articulation, attachments: Mapping[str, bytes]) -> None:
        """Collect the visuals; meshes that the log does not have, or viewers cannot read, are omitted.

        Args:
            number: Its index among the figures of a log.
            articulation: Its links and joints.
            attachments: The attachments of the log.
        """
        self.number = number
        self.articulation = articulation
        #: Each visual, with the index of its link.
        self.visuals = [
            (visual, place)
            for place, link in enumerate(articulation.links)
            for visual in link.visuals
            if visual.kind != "mesh" or (visual.mesh in attachments and media_type(visual))
        ]
        self.surfaces = tuple(dict.fromkeys(visual.mesh for visual, _ in self.visuals if visual.mesh))
        self._attachments = attachments

    @property
    def name(self) -> str:
        """The name of the figure, which is unique."""
        return f"{self.articulation.name}.{self.number}"

    @property
    def path(self) -> str:
        """The name as a part of a path."""
        return _path_part(self.name)

    def visual_path(self, number: int) -> str:
        """Return the path of a visual: link and number."""
        _, place = self.visuals[number]
        return f"{_path_part(self.articulation.links[place].name)}/{number}"

    @cached_property
    def looks(self) -> list[list[int]]:
        """Visuals that look the same, such as the wheels of a car: lists of indices in `visuals`."""
        alike: dict[Visual, list[int]] = {}
        for place, (visual, _) in enumerate(self.visuals):
            look = visual.model_copy(update={"position": (0.0, 0.0, 0.0), "orientation": (0.0, 0.0, 0.0, 1.0)})
            alike.setdefault(look, []).append(place)
        return list(alike.values())

    def places(self, positions: Array, orientations: Array, joints: Array | None) -> list[tuple[Array, Array]]:
        """Compute the poses of the visuals.

        Args:
            positions: Positions of the base, (..., 3) [m].
            orientations: Orientations of the base, (..., 4).
            joints: Joint positions, (..., joints); None for 0.

        Returns:
            For each of `visuals` positions (..., 3) [m] and orientations (..., 4).
        """
        inner, turned = self.articulation.frames(joints)
        placed = []
        for visual, place in self.visuals:
            at = inner[..., place, :] + rotated(turned[..., place, :], visual.position)
            orientation = composed(turned[..., place, :], visual.orientation)
            placed.append((positions + rotated(orientations, at), composed(orientations, orientation)))
        return placed

    @cached_property
    def corners(self) -> Array:
        """Corners of the boxes around its visuals, with all joints at 0, in the frame of its base; (m, 3) [m]."""
        corners = [np.zeros((1, 3))]
        origin, level = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
        for (visual, _), (position, orientation) in zip(self.visuals, self.places(origin, level, None), strict=True):
            low, high = self._box(visual)
            own = 0.5 * (low + high) + (high - low) * _CORNERS
            corners.append(position + rotated(orientation, own))
        return np.concatenate(corners[1:] or corners)

    def boxes(self, placed: Sequence[tuple[Array, Array]]) -> Iterator[Array]:
        """Yield the corners of the box around each visual, (..., 8, 3) [m], at the poses that `places` returns."""
        for (visual, _), (position, orientation) in zip(self.visuals, placed, strict=True):
            low, high = self._box(visual)
            own = 0.5 * (low + high) + (high - low) * _CORNERS
            yield position[..., None, :] + rotated(orientation[..., None, :], own)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """The bounding box: lower and upper corner, (3,) each [m]."""
        return self.corners.min(axis=0), self.corners.max(axis=0)

    @property
    def middle(self) -> Array:
        """The centre of the bottom of the bounding box, (3,) [m]."""
        low, high = self.bounds
        return np.array([*(0.5 * (low + high))[:2], low[2]])

    @property
    def radius(self) -> float:
        """The radius of a circle around `middle` that contains the bounding box, seen from above [m]."""
        low, high = self.bounds
        return 0.5 * float(np.linalg.norm((high - low)[:2]))

    def _box(self, visual: Visual) -> tuple[Array, Array]:
        size = np.array(visual.size)
        match visual.kind:
            case "box":
                half = 0.5 * size
            case "sphere":
                half = np.repeat(size, 3)
            case "cylinder":
                half = np.array([size[0], size[0], 0.5 * size[1]])
            case "capsule":
                half = np.array([size[0], size[0], 0.5 * size[1] + size[0]])
            case "prism":
                outline = np.array(visual.outline)
                low, high = outline.min(axis=0), outline.max(axis=0)
                return np.array([*low, -0.5 * size[0]]), np.array([*high, 0.5 * size[0]])
            case "mesh":
                suffix = PurePosixPath(visual.mesh).suffix
                try:
                    corners = parse_mesh(self._attachments[visual.mesh], suffix).bounds()
                except AssetError:
                    # Such as GLB, which only viewers read.
                    corners = np.zeros(3), np.zeros(3)
                scaled = np.sort(np.stack(corners) * size, axis=0)
                return scaled[0], scaled[1]
        return -half, half


def media_type(visual: Visual) -> str | None:
    """Return the media type of a mesh; None if viewers cannot read it."""
    return MEDIA_TYPES.get(PurePosixPath(visual.mesh).suffix.lower())


def _path_part(name: str) -> str:
    return re.sub(r"[^\w.-]", "_", name) or "_"
