"""Articulations: what a body consists of, links with joints between them, and what each link looks like.

Lengths are metres, angles radians; an orientation is a unit quaternion in the order x, y, z, w.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from symaware_cli.geometry.rotation import about, composed, rotated

Array = NDArray[np.float64]

_Number = Annotated[float, Field(ge=-1e9, le=1e9)]
_Share = Annotated[float, Field(ge=0, le=1)]
_Vector = tuple[_Number, _Number, _Number]
_Quaternion = tuple[_Number, _Number, _Number, _Number]

#: How many numbers say how large each kind is.
_SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "prism": 1, "mesh": 3}


class _Placed(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    position: _Vector = (0.0, 0.0, 0.0)
    orientation: _Quaternion = (0.0, 0.0, 0.0, 1.0)


class Visual(_Placed):
    """A part of what a link looks like.

    Attributes:
        position: Where its origin is in the frame of the link.
        orientation: How it is turned there.
        kind: What it is. All but meshes have their origin in their middle, and stand along the z axis.
        size: Of a box its extents; of a sphere its radius; of a cylinder its radius and length; of a capsule the same
            without the caps; of a prism its height; of a mesh how many metres a unit of the file is, along each axis.
        outline: The convex base of a prism, counter-clockwise.
        mesh: The file of a mesh: a path, in the log the name of an attachment.
        colour: Red, green, blue and opacity, from 0 to 1; None where nothing is said.
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
        position: Where the joint that carries it is, in the frame of the parent.
        orientation: How its frame is turned there while the joint is at 0.
        name: Its name.
        parent: The link that carries it, by place; -1 for the base.
        joint: The name of the joint that carries it, if that moves.
        motion: How the joint moves it.
        axis: About or along which, in its own frame; of length 1.
        visuals: What it looks like.
    """

    name: str
    parent: int = -1
    joint: str = ""
    motion: Literal["fixed", "turn", "slide"] = "fixed"
    axis: _Vector = (1.0, 0.0, 0.0)
    visuals: tuple[Visual, ...] = ()


class Articulation(BaseModel):
    """A tree of links, each behind its parent; the first is the base, which the pose of the body says where it is."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)

    name: str
    links: tuple[Link, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _is_a_tree(self) -> Articulation:
        for place, link in enumerate(self.links):
            if not (link.parent == -1 if place == 0 else 0 <= link.parent < place):
                raise ValueError("a link stands behind its parent, and the base has none")
        return self

    @property
    def joints(self) -> dict[str, str]:
        """The joints that move, in order, and the unit of each."""
        return {link.joint: "rad" if link.motion == "turn" else "m" for link in self.links if link.motion != "fixed"}

    def frames(self, joints: ArrayLike | None = None) -> tuple[Array, Array]:
        """Where the links are in the frame of the base, by forward kinematics.

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
        for place, link in enumerate(self.links):
            position, orientation = np.array(link.position), np.array(link.orientation)
            if link.motion == "turn":
                orientation = composed(orientation, about(link.axis, known[..., order.index(link.joint)]))
            elif link.motion == "slide":
                way = known[..., order.index(link.joint), None] * np.array(link.axis)
                position = position + rotated(orientation, way)
            if place:
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
