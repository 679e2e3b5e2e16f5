"""Shapes: the outlines of agents and obstacles, also of tilted ones; lengths are metres, in coordinates of the body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    WithJsonSchema,
    field_validator,
    model_serializer,
    model_validator,
)

from symaware_cli.geometry.rotation import attitude, rotated

#: The greatest numbers in scenarios [m], [s]: larger than needed, and far from arithmetic overflow.
LARGEST = 1e9

Length = Annotated[float, Field(gt=0, le=LARGEST)]

#: The radius of the disc that components take a body for [m].
DiscRadius = Annotated[
    float | None,
    Field(
        gt=0,
        le=LARGEST,
        description="Radius of the disc that represents the body [m]. By default that of the circle around it; "
        "half the width of a long body lets it into gaps that it fits into lengthwise.",
    ),
]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


def _coordinates(*counts: int) -> tuple[AfterValidator, WithJsonSchema]:
    """Return a validator of the number of coordinates; unlike `Field`, it reports nothing for non-numbers."""

    def check(values: tuple[float, ...]) -> tuple[float, ...]:
        if len(values) not in counts:
            raise ValueError(f"{' or '.join(map(str, counts))} coordinates are needed, not {len(values)}")
        return values

    number = {"type": "number", "minimum": -LARGEST, "maximum": LARGEST}
    numbers = {"type": "array", "items": number, "minItems": min(counts), "maxItems": max(counts)}
    return AfterValidator(check), WithJsonSchema(numbers)


Point = Annotated[tuple[Number, ...], *_coordinates(2)]
Position = Annotated[tuple[Number, ...], *_coordinates(2, 3)]

#: Relative to the extent of a polygon: smaller distances and deviations count as rounding errors.
_TOLERANCE = 1e-9


class StrictModel(BaseModel):
    """An immutable part of a scenario, checked when it is created."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class Circle(StrictModel):
    """A disc around the entity's position; a ball for agents that move in space."""

    radius: Length = Field(description="Radius [m].")


class Box(StrictModel):
    """A rectangle around the entity's position that turns with its heading."""

    length: Length = Field(description="Extent along the heading [m].")
    width: Length = Field(description="Extent across the heading [m].")
    height: Length | None = Field(None, description="Extent upwards [m]; planar worlds ignore it.")

    @property
    def upright(self) -> float:
        """Its height in space; without `height` the shorter of its sides [m]."""
        return self.height or min(self.length, self.width)


class Cylinder(StrictModel):
    """An upright cylinder around the entity's position; a disc for agents that move in a plane."""

    radius: Length = Field(description="Radius [m].")
    height: Length = Field(description="Extent upwards [m]; planar worlds ignore it.")


class Polygon(StrictModel):
    """A convex polygon that turns with the entity's heading.

    Clockwise vertices are reversed, so that `vertices` always run counter-clockwise.
    """

    vertices: tuple[Point, ...] = Field(
        json_schema_extra={"minItems": 3},
        description="Corners in order [m], relative to the entity's position, x along its heading; convex.",
    )

    @field_validator("vertices")
    @classmethod
    def _is_convex(cls, vertices: tuple[Point, ...]) -> tuple[Point, ...]:
        if len(vertices) < 3:
            raise ValueError(f"a polygon has at least 3 corners, not {len(vertices)}")
        farthest = max(vertices, key=lambda vertex: math.dist(vertex, vertices[0]))
        extent = math.dist(farthest, vertices[0])
        for number, (one, other) in enumerate(pairwise([*vertices, vertices[0]])):
            if math.dist(one, other) <= _TOLERANCE * extent:
                raise ValueError(
                    f"corners {number} and {(number + 1) % len(vertices)} are the same point"
                    " (a polygon closes by itself)"
                )
        if all(abs(_area((vertices[0], farthest, vertex))) <= _TOLERANCE * extent**2 for vertex in vertices):
            raise ValueError("the corners lie on a line")
        if _area(vertices) < 0:
            vertices = vertices[::-1]
        if not _turns_left_once(vertices):
            raise ValueError("the polygon is not convex; put it together from convex ones")
        return vertices


class Wall(StrictModel):
    """A chain of straight segments with a thickness, rounded at its ends and corners; scenery only."""

    points: tuple[Point, ...] = Field(
        json_schema_extra={"minItems": 2},
        description="Points that the middle line of the wall joins in order [m], relative to the entity's position.",
    )
    thickness: Length = Field(0.1, description="Thickness, half of it to either side of the middle line [m].")

    @field_validator("points")
    @classmethod
    def _goes_somewhere(cls, points: tuple[Point, ...]) -> tuple[Point, ...]:
        if len(points) < 2:
            raise ValueError(f"a wall goes through at least 2 points, not {len(points)}")
        for number, (one, other) in enumerate(pairwise(points)):
            if one == other:
                raise ValueError(f"points {number} and {number + 1} are the same")
        return points


def _asset(path: str) -> str:
    """Check that a path stays below the folder that it is relative to."""
    if "\\" in path or ":" in path or "\0" in path:
        raise ValueError("a path is written with plain names and `/` between them")
    parts = PurePosixPath(path).parts
    if not parts or path.startswith("/") or ".." in parts:
        raise ValueError(
            "a file lies below the scenario's folder: the path is relative, and `..` does not lead out of it"
        )
    return path


#: A file below the folder of the scenario, or of the package pybullet_data where the path begins with that name.
AssetPath = Annotated[str, AfterValidator(_asset)]
_ASSET = "below the scenario's folder, or `pybullet_data/...`"


class Mesh(StrictModel):
    """A body with a surface from a file; it collides as its convex hull."""

    file: AssetPath = Field(description=f"An .obj or .stl file {_ASSET}.")
    scale: Length = Field(1.0, description="Metres per unit of the file.")
    radius: Length = Field(description="Radius of the disc that represents it, as seen from above [m].")

    @field_validator("file")
    @classmethod
    def _is_a_surface(cls, file: str) -> str:
        if not file.lower().endswith((".obj", ".stl")):
            raise ValueError("a mesh is an .obj or .stl file")
        return file


class Urdf(StrictModel):
    """A body of links and joints from a URDF file, with the masses of the file."""

    file: AssetPath = Field(description=f"A .urdf file {_ASSET}.")
    scale: Length = Field(1.0, description="Scale factor of all lengths.")
    radius: Length = Field(description="Radius of the disc that represents it, as seen from above [m].")
    missing: Literal["refuse", "leave-out"] = Field(
        "refuse",
        description="Handling of collision shapes whose meshes are missing. `leave-out` loads the "
        "robot without them: it collides there with nothing, and a warning names them.",
    )

    @field_validator("file")
    @classmethod
    def _is_a_description(cls, file: str) -> str:
        if not file.lower().endswith(".urdf"):
            raise ValueError("it is a .urdf file")
        return file


class Mjcf(StrictModel):
    """A body of links and joints from a file in the format of MuJoCo, with the masses of the file."""

    file: AssetPath = Field(description=f"An .xml file {_ASSET}.")
    radius: Length = Field(description="Radius of the disc that represents it, as seen from above [m].")

    @field_validator("file")
    @classmethod
    def _is_a_model(cls, file: str) -> str:
        if not file.lower().endswith(".xml"):
            raise ValueError("it is an .xml file")
        return file

    @property
    def scale(self) -> float:
        """The scale factor of all lengths; always 1."""
        return 1.0

    @property
    def missing(self) -> Literal["refuse"]:
        """The handling of shapes whose meshes are missing; they are always refused."""
        return "refuse"


Kind = Literal["circle", "box", "cylinder", "polygon", "wall", "mesh", "urdf", "mjcf"]
KINDS: tuple[Kind, ...] = ("circle", "box", "cylinder", "polygon", "wall", "mesh", "urdf", "mjcf")


class Shape(StrictModel):
    """The outline of an entity; exactly one kind."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    circle: Circle | None = Field(None, description="A disc.")
    box: Box | None = Field(None, description="A rectangle that turns with the heading.")
    cylinder: Cylinder | None = Field(None, description="An upright cylinder; a disc in a plane.")
    polygon: Polygon | None = Field(None, description="A convex polygon that turns with the heading.")
    wall: Wall | None = Field(None, description="A chain of segments with a thickness; for entities of the world only.")
    mesh: Mesh | None = Field(None, description="A surface from a file, for worlds of space; a disc elsewhere.")
    urdf: Urdf | None = Field(None, description="Links and joints from a file, for worlds of space; a disc elsewhere.")
    mjcf: Mjcf | None = Field(None, description="The same from an MJCF file, for the world `mujoco`; a disc elsewhere.")

    @model_validator(mode="after")
    def _exactly_one_kind(self) -> Shape:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            said = f"{', '.join(given[:-1])} and {given[-1]}" if given else "none"
            raise ValueError(f"a shape has exactly one kind of {', '.join(KINDS)}; this one has {said}")
        return self

    @model_serializer(mode="wrap")
    def _without_the_other_kinds(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {kind: content for kind, content in dump(self).items() if content is not None}

    @property
    def kind(self) -> Kind:
        """The kind of the shape."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def robot(self) -> Urdf | Mjcf | None:
        """The file of links and joints, if it is one."""
        return self.urdf or self.mjcf

    @property
    def radius(self) -> float:
        """The radius of the bounding circle around the position [m]."""
        return max(math.hypot(*point) + rounding for piece, rounding in self.pieces for point in piece)

    @property
    def outer_radius(self) -> float:
        """The radius of the bounding ball around the position in space [m].

        Bodies of unknown height are assumed to be within their radius; a disc is a ball.
        """
        height = self.box.upright if self.box else self.cylinder.height if self.cylinder else 0.0
        return math.hypot(self.radius, 0.5 * height)

    @property
    def pieces(self) -> Sequence[tuple[Sequence[Point], float]]:
        """The convex pieces of the shape, relative to the position, x along the heading.

        Each has a core (one point, two points or a counter-clockwise convex polygon) and a radius by which the core is
        rounded, both in metres: a disc is a rounded point, a segment of a wall a rounded line.
        """
        for round_ in (self.circle, self.cylinder, self.mesh, self.robot):
            if round_:
                return [([(0.0, 0.0)], round_.radius)]
        if self.box:
            x, y = 0.5 * self.box.length, 0.5 * self.box.width
            return [([(-x, -y), (x, -y), (x, y), (-x, y)], 0.0)]
        if self.polygon:
            return [(self.polygon.vertices, 0.0)]
        assert self.wall
        return [(segment, 0.5 * self.wall.thickness) for segment in pairwise(self.wall.points)]


def _area(vertices: Sequence[Point]) -> float:
    """Return the area of a polygon, negative if clockwise [m^2]; relative to its first vertex, for precision."""
    (x, y), *_ = vertices
    return 0.5 * sum(
        (one[0] - x) * (other[1] - y) - (other[0] - x) * (one[1] - y)
        for one, other in pairwise([*vertices, vertices[0]])
    )


def _turns_left_once(vertices: Sequence[Point]) -> bool:
    """Return whether a polygon is convex and counter-clockwise: no corner turns right, and it winds once."""
    around = [*vertices, vertices[0], vertices[1]]
    turned = 0.0
    for (x0, y0), (x1, y1), (x2, y2) in zip(around, around[1:], around[2:], strict=False):
        ahead, aside = (x1 - x0, y1 - y0), (x2 - x1, y2 - y1)
        turn = math.atan2(ahead[0] * aside[1] - ahead[1] * aside[0], ahead[0] * aside[0] + ahead[1] * aside[1])
        if turn < -_TOLERANCE or turn > math.pi - _TOLERANCE:
            return False
        turned += turn
    return turned < 3 * math.pi


#: The number of corners of a round face; they lie outside of it, by less than 1 % of its radius.
_CORNERS = 24

#: [m] Corners nearer to each other, or to the line between two others, are dropped.
_FINE = 1e-6


def footprint(shape: Shape, roll: float, pitch: float) -> Shape:
    """Return the outline of a body turned by a roll about its x axis, and then by a pitch about the y axis [rad].

    Returns:
        An outline in the coordinates of the body, before its heading turns it. That of a ball does not change, nor do
        those of meshes and robots from files, which count as balls.
    """
    if not (roll or pitch) or not (shape.box or shape.cylinder):
        return shape
    if shape.box:
        sides = np.array([shape.box.length, shape.box.width, shape.box.upright])
        corners = 0.5 * sides * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    else:
        assert shape.cylinder
        angles = np.arange(_CORNERS) * 2 * np.pi / _CORNERS
        edge = shape.cylinder.radius / math.cos(np.pi / _CORNERS) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        half = 0.5 * shape.cylinder.height
        corners = np.array([[x, y, z] for x, y in edge.tolist() for z in (-half, half)])
    below = rotated(attitude(roll, pitch, 0.0), corners)[:, :2]
    return Shape(polygon=Polygon(vertices=tuple((x, y) for x, y in _hull(below.tolist()))))


def _hull(points: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull, counter-clockwise: A. M. Andrew's monotone chain (1979)."""
    ordered = sorted({(round(x / _FINE) * _FINE, round(y / _FINE) * _FINE) for x, y in points})

    def chain(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        found: list[tuple[float, float]] = []
        for x, y in ordered:
            while len(found) > 1:
                (from_x, from_y), (by_x, by_y) = found[-2:]
                turn = (by_x - from_x) * (y - from_y) - (by_y - from_y) * (x - from_x)
                if turn > _FINE * math.dist((x, y), (from_x, from_y)):
                    break
                found.pop()
            found.append((x, y))
        return found

    return chain(ordered)[:-1] + chain(ordered[::-1])[:-1]
