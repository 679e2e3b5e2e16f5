"""Regions: named sets of points in the workspace, the depth of points in them, and their faces; lengths are metres."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from symaware_cli.geometry.shape import Length, Number, Point, Polygon, Position, StrictModel
from symaware_cli.geometry.vectors import Array, lengths

Kind = Literal["box", "circle", "polygon", "union", "intersection", "complement"]
KINDS: tuple[Kind, ...] = ("box", "circle", "polygon", "union", "intersection", "complement")
#: The numbers of sides of the polygons within and around a disc.
_INNER, _OUTER = 16, 8


def _is_box(bounds: tuple[float, ...]) -> tuple[float, ...]:
    if len(bounds) not in (2, 4, 6):
        raise ValueError(f"2, 4 or 6 bounds are needed, the least and greatest of each coordinate, not {len(bounds)}")
    for axis, (low, high) in enumerate(zip(bounds[::2], bounds[1::2], strict=True)):
        if low >= high:
            raise ValueError(f"the least of coordinate {axis} is not below its greatest")
    return bounds


class Disc(StrictModel):
    """All points within a distance of its centre: a disc, or a ball where the centre has three coordinates."""

    centre: Position = Field(description="Centre [x, y] or [x, y, z] [m].")
    radius: Length = Field(description="Radius [m].")


class RegularPolygon(StrictModel):
    """A polygon with equal sides and angles, given by the circle inside it that touches all its sides."""

    centre: Point = Field((0.0, 0.0), description="Centre [x, y] [m].")
    sides: int = Field(ge=3, le=100, description="The number of sides.")
    apothem: Length = Field(description="Distance of each side from the centre [m].")
    rotation: Number = Field(0.0, description="Direction from the centre to the middle of a side [rad].")

    @property
    def corners(self) -> tuple[Point, ...]:
        """The corners, counter-clockwise [m]."""
        half = math.pi / self.sides
        radius, (x, y) = self.apothem / math.cos(half), self.centre
        angles = [self.rotation + half * (2 * side + 1) for side in range(self.sides)]
        return tuple((x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles)


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _as_corners(value: Any) -> Any:
    """Return the corners of a regular polygon; of anything else lists as tuples, which strict validation asks for."""
    if isinstance(value, RegularPolygon):
        return value.corners
    if not isinstance(value, Mapping):
        return tuple(map(_as_tuple, value)) if isinstance(value, list) else value
    try:
        said = {key: _as_tuple(each) for key, each in value.items()}
        return RegularPolygon.model_validate(said, strict=True).corners
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"a regular polygon: `{place}`: {first['msg'][0].lower()}{first['msg'][1:]}") from None


def _is_polygon(vertices: tuple[Point, ...]) -> tuple[Point, ...]:
    return Polygon(vertices=vertices).vertices


#: Corners of a convex polygon, counter-clockwise [m].
ConvexPolygon: TypeAlias = Annotated[
    tuple[Point, ...],
    AfterValidator(_is_polygon),
    BeforeValidator(_as_corners, json_schema_input_type=tuple[Point, ...] | RegularPolygon),
]


class RegionShape(StrictModel):
    """A set of points; exactly one kind.

    Primitive kinds (`box`, `circle`, `polygon`) contain their boundaries. Coordinates of a point beyond those of the
    region are ignored.
    """

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    box: Annotated[tuple[Number, ...], AfterValidator(_is_box)] | None = Field(
        None, description="Least and greatest of each coordinate: [x, x, y, y] or [x, x, y, y, z, z] [m]."
    )
    circle: Disc | None = Field(None, description="A disc or, with three coordinates, a ball.")
    polygon: ConvexPolygon | None = Field(
        None,
        description="The corners of a convex polygon in order [m]; or a regular one, as `sides` and `apothem`, with a "
        "`centre` and a `rotation`.",
    )
    union: tuple[str | RegionShape, ...] | None = Field(
        None, min_length=1, description="Points in any of several regions: names of regions, or regions."
    )
    intersection: tuple[str | RegionShape, ...] | None = Field(
        None, min_length=1, description="Points in all of several regions: names of regions, or regions."
    )
    complement: str | RegionShape | None = Field(
        None, description="Points outside of a region: the name of one, or a region."
    )

    @model_validator(mode="after")
    def _is_one_kind(self) -> RegionShape:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            said = f"{', '.join(given[:-1])} and {given[-1]}" if given else "none"
            raise ValueError(f"a region has exactly one kind of {', '.join(KINDS)}; this one has {said}")
        return self

    @model_serializer(mode="wrap")
    def _without_the_other_kinds(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: content for key, content in dump(self).items() if content is not None}

    @property
    def kind(self) -> Kind:
        """The kind of the region."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def members(self) -> Sequence[str | RegionShape]:
        """The regions that it is composed of; empty for a primitive."""
        if self.complement is not None:
            return (self.complement,)
        return self.union or self.intersection or ()

    @property
    def dimensions(self) -> int:
        """The number of coordinates of a primitive."""
        if self.box is not None:
            return len(self.box) // 2
        return len(self.circle.centre) if self.circle is not None else 2

    def depth(self, points: Array) -> Array:
        """Return the depth of points in a primitive [m]: the distance to its boundary, negative outside.

        Args:
            points: Points with at least as many coordinates as the region; shape (n, d).

        Returns:
            Exact Euclidean distances; shape (n,).
        """
        if self.circle is not None:
            return self.circle.radius - lengths(points - np.array(self.circle.centre))
        if self.box is not None:
            bounds = np.array(self.box).reshape(-1, 2)
            middle, half = bounds.mean(axis=1), 0.5 * (bounds[:, 1] - bounds[:, 0])
            # Axis by axis: reducing along an axis of two or three elements is several times as slow. In place: half the
            # time of new arrays.
            farthest = squared = np.empty(0)
            for axis in range(len(middle)):
                beyond = np.asarray(points[:, axis] - middle[axis])
                np.abs(beyond, out=beyond)
                beyond -= half[axis]
                outside = np.maximum(beyond, 0.0)
                outside *= outside
                if axis:
                    np.maximum(farthest, beyond, out=farthest)
                    squared += outside
                else:
                    farthest, squared = beyond, outside
            np.sqrt(squared, out=squared)
            np.negative(squared, out=squared)
            squared -= np.minimum(farthest, 0.0, out=farthest)
            return squared
        assert self.polygon is not None
        return _polygon_depth(self.polygon, points)

    def names(self) -> Iterator[str]:
        """Yield the names of the regions that it is composed of."""
        for member in self.members:
            if isinstance(member, str):
                yield member
            else:
                yield from member.names()


#: Names of colours of regions, and what they are: red, green and blue.
RegionColour: TypeAlias = Literal["red", "orange", "yellow", "green", "teal", "blue", "purple", "pink", "brown", "grey"]
REGION_COLOURS: Mapping[RegionColour, tuple[int, int, int]] = {
    "red": (205, 70, 70),
    "orange": (215, 135, 50),
    "yellow": (205, 180, 50),
    "green": (90, 150, 90),
    "teal": (70, 150, 150),
    "blue": (80, 120, 180),
    "purple": (140, 100, 170),
    "pink": (205, 120, 160),
    "brown": (150, 110, 70),
    "grey": (125, 130, 140),
}


class Region(RegionShape):
    """A named set of points of the workspace, which may move with an agent."""

    colour: RegionColour | None = Field(
        None, description="Its colour in pictures. If left out, each region has a different one."
    )
    around: str | None = Field(
        None,
        description="The agent that it moves with: coordinates are relative to it. If left out, they are the world's.",
    )
    turns: bool = Field(
        True,
        description="Whether the x axis of a region around an agent points along the agent's heading, if it has one.",
    )


@lru_cache(maxsize=1024)
def _edges(vertices: tuple[Point, ...]) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return where each edge begins, its direction, its squared length and its length; each of shape (m, 1)."""
    corners = np.array(vertices)
    along = np.roll(corners, -1, axis=0) - corners
    squared = along[:, :1] * along[:, :1] + along[:, 1:] * along[:, 1:]
    return corners[:, :1], corners[:, 1:], along[:, :1], along[:, 1:], squared, np.sqrt(squared)


def _polygon_depth(vertices: tuple[Point, ...], points: Array) -> Array:
    """Return the depth in a convex polygon with counter-clockwise corners."""
    corner_x, corner_y, along_x, along_y, squared, length = _edges(vertices)
    x, y = points[:, 0] - corner_x, points[:, 1] - corner_y  # (m, n)
    inward: Array = np.minimum.reduce((along_x * y - along_y * x) / length)
    outside = inward < 0.0
    if not outside.any():
        return inward
    share = np.minimum(np.maximum((along_x * x + along_y * y) / squared, 0.0), 1.0)
    x, y = x - share * along_x, y - share * along_y
    return np.where(outside, -np.minimum.reduce(np.sqrt(x * x + y * y)), inward)


def polygon_depths(polygons: tuple[tuple[Point, ...], ...], points: Array) -> Array:
    """Return the depth of points in each of some convex polygons, as `RegionShape.depth` does, bit for bit.

    Args:
        polygons: The corners of each, counter-clockwise [m].
        points: Shape (n, d), of which two coordinates count.

    Returns:
        Shape (m, n).
    """
    depths = np.empty((len(polygons), len(points)))
    for rows, corner_x, corner_y, along_x, along_y, squared, length in _stacked_edges(polygons):
        x, y = points[:, 0] - corner_x, points[:, 1] - corner_y  # (m, k, n)
        inward: Array = np.minimum.reduce((along_x * y - along_y * x) / length, axis=1)
        share = np.minimum(np.maximum((along_x * x + along_y * y) / squared, 0.0), 1.0)
        x, y = x - share * along_x, y - share * along_y
        outward = -np.minimum.reduce(np.sqrt(x * x + y * y), axis=1)
        depths[rows] = np.where(inward < 0.0, outward, inward)
    return depths


@lru_cache(maxsize=64)
def _stacked_edges(polygons: tuple[tuple[Point, ...], ...]) -> list[tuple[Any, ...]]:
    """Return the rows of the polygons of each number of corners, and their edges as in `_edges`, stacked."""
    rows_of: dict[int, list[int]] = {}
    for row, vertices in enumerate(polygons):
        rows_of.setdefault(len(vertices), []).append(row)
    # Not by `_edges`: it would forget those of other regions.
    return [
        (rows, *(np.stack(each) for each in zip(*(_edges.__wrapped__(polygons[row]) for row in rows), strict=True)))
        for rows in rows_of.values()
    ]


class Faces(NamedTuple):
    """Half spaces ``normals @ point + offsets >= 0``; the left sides are the distances to the planes.

    Attributes:
        normals: Unit normals that point inwards; shape (k, d).
        offsets: Shape (k,) [m].
    """

    normals: Array
    offsets: Array


def region_faces(shape: RegionShape) -> Faces:
    """Return the faces of a box or a convex polygon.

    Args:
        shape: A primitive that is not a circle.
    """
    if shape.box is not None:
        bounds = np.array(shape.box).reshape(-1, 2)
        axes = np.eye(len(bounds))
        return Faces(np.concatenate([axes, -axes]), np.concatenate([-bounds[:, 0], bounds[:, 1]]))
    assert shape.polygon is not None
    corners = np.array(shape.polygon)
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.sqrt((along * along).sum(axis=1))
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1) / lengths[:, None]
    return Faces(normals, -(normals * corners).sum(axis=1))


def ball_faces(dimensions: int, radius: float, around: bool = False) -> Faces:
    """Return the faces of a polytope with the origin as its centre.

    Args:
        dimensions: One, two or three.
        radius: The radius of the ball [m].
        around: Whether the polytope contains the ball, and does not lie within it.
    """
    if dimensions == 2:
        count = _OUTER if around else _INNER
        angles = 2.0 * np.pi * np.arange(count) / count
        outward, within = np.stack([np.cos(angles), np.sin(angles)], axis=1), float(np.cos(np.pi / count))
    else:
        # The corners of a cube are at a distance of at most 1 if its faces are at one over the root of 3.
        outward = np.concatenate([np.eye(dimensions), -np.eye(dimensions)])
        within = 1.0 / np.sqrt(dimensions)
    return Faces(-outward, np.full(len(outward), radius if around else radius * within))
