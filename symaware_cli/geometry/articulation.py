"""Articulations: bodies as trees of links with joints, and the visual shapes of each link.

Lengths are metres, angles radians; an orientation is a unit quaternion in the order x, y, z, w.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, model_validator

from symaware_cli.geometry.rotation import about, composed, rotated
from symaware_cli.geometry.vectors import Array

_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
_Share = Annotated[float, Field(ge=0, le=1)]
_Vector = tuple[_Number, _Number, _Number]
_Quaternion = tuple[_Number, _Number, _Number, _Number]

#: The number of sizes of each kind.
_SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "prism": 1, "mesh": 3}


class _Placed(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False, defer_build=True)

    position: _Vector = (0.0, 0.0, 0.0)
    orientation: _Quaternion = (0.0, 0.0, 0.0, 1.0)


class Visual(_Placed):
    """A visual shape of a link.

    Attributes:
        position: Its origin in the frame of the link.
        orientation: Its orientation in the frame of the link.
        kind: Its kind. All but meshes have their origin in their middle, and their axis along z.
        size: The extents of a box; the radius of a sphere; the radius and length of a cylinder; the same, without the
            caps, of a capsule; the height of a prism; the metres per unit of a mesh's file, along each axis.
        outline: The convex base of a prism, counter-clockwise.
        mesh: The file of a mesh: a path, in the log the name of an attachment.
        colour: Red, green, blue and opacity, from 0 to 1; None if not given.
    """

    kind: Literal["box", "sphere", "cylinder", "capsule", "prism", "mesh"]
    size: tuple[_Number, ...]
    outline: tuple[tuple[_Number, _Number], ...] = ()
    mesh: str = ""
    colour: tuple[_Share, _Share, _Share, _Share] | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> Visual:
        if len(self.size) != _SIZES[self.kind]:
            raise ValueError(f"a {self.kind} has {_SIZES[self.kind]} sizes, not {len(self.size)}")
        if (self.kind == "mesh") != bool(self.mesh) or (self.kind == "prism") != (len(self.outline) >= 3):
            raise ValueError("a mesh has a file, and a prism an outline")
        return self


class Link(_Placed):
    """A rigid part of a body.

    Attributes:
        position: The origin of its frame in the frame of the parent, while the joint is at 0.
        orientation: The orientation of its frame in that of the parent, while the joint is at 0.
        name: Its name.
        parent: The index of its parent; -1 for the base.
        joint: The name of the joint to the parent, if movable.
        motion: The motion of the joint.
        axis: The axis of the joint, in its own frame; a unit vector.
        visuals: Its visual shapes.
    """

    name: str
    parent: int = -1
    joint: str = ""
    motion: Literal["fixed", "turn", "slide"] = "fixed"
    axis: _Vector = (1.0, 0.0, 0.0)
    visuals: tuple[Visual, ...] = ()


class Articulation(BaseModel):
    """A tree of links, each listed after its parent; the first is the base, whose pose is that of the body."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False, defer_build=True)

    name: str
    links: tuple[Link, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _is_a_tree(self) -> Articulation:
        for index, link in enumerate(self.links):
            if not (link.parent == -1 if index == 0 else 0 <= link.parent < index):
                raise ValueError("a link comes after its parent, and the base has none")
        return self

    @property
    def joints(self) -> dict[str, str]:
        """The movable joints, in order, and the unit of each."""
        return {link.joint: "rad" if link.motion == "turn" else "m" for link in self.links if link.motion != "fixed"}

    def frames(self, joints: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return the poses of the links in the frame of the base, by forward kinematics.

        Args:
            joints: The positions of the joints in the order of `joints`, (..., number of joints) [rad] or [m]; None
                for 0.

        Returns:
            Positions (..., links, 3) [m] and orientations (..., links, 4).
        """
        order = list(self.joints)
        known = np.zeros(len(order)) if joints is None else np.asarray(joints, float)
        positions: list[Any] = []
        orientations: list[Any] = []
        for index, link in enumerate(self.links):
            position, orientation = np.array(link.position), np.array(link.orientation)
            if link.motion == "turn":
                orientation = composed(orientation, about(link.axis, known[..., order.index(link.joint)]))
            elif link.motion == "slide":
                way = known[..., order.index(link.joint), None] * np.array(link.axis)
                position = position + rotated(orientation, way)
            if index:
                outer = orientations[link.parent]
                position = positions[link.parent] + rotated(outer, position)
                orientation = composed(outer, orientation)
            positions.append(position)
            orientations.append(orientation)
        shape = known.shape[:-1]
        return (
            np.stack([np.broadcast_to(each, (*shape, 3)) for each in positions], axis=-2),
            np.stack([np.broadcast_to(each, (*shape, 4)) for each in orientations], axis=-2),
        )
