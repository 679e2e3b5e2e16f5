"""Bodies: the shape and mass of an agent or an obstacle, and where an obstacle is at a time.

Lengths are metres, angles radians, masses kilograms; an orientation is a unit quaternion in the order x, y, z, w.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal, NamedTuple

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

#: [m] and [s]: far from where arithmetic overflows, and farther and longer than anybody goes.
_LARGEST = 1e9

Length = Annotated[float, Field(gt=0, le=_LARGEST)]
Mass = Annotated[float, Field(gt=0, le=_LARGEST)]
Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]


def _coordinates(*counts: int) -> tuple[AfterValidator, WithJsonSchema]:
    """What says how many coordinates a tuple has; unlike `Field`, it is silent where they are no numbers."""

    def check(values: tuple[float, ...]) -> tuple[float, ...]:
        if len(values) not in counts:
            raise ValueError(f"{' or '.join(map(str, counts))} coordinates are needed, not {len(values)}")
        return values

    number = {"type": "number", "minimum": -_LARGEST, "maximum": _LARGEST}
    numbers = {"type": "array", "items": number, "minItems": min(counts), "maxItems": max(counts)}
    return AfterValidator(check), WithJsonSchema(numbers)


Point = Annotated[tuple[Number, ...], *_coordinates(2)]
Position = Annotated[tuple[Number, ...], *_coordinates(2, 3)]

#: Relative to the extent of a polygon: what is straighter, nearer or thinner than this is so by rounding.
_TOLERANCE = 1e-9


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Circle(_Part):
    """A disc around the entity's position; a ball for agents that move in space."""

    radius: Length = Field(description="Radius [m].")


class Box(_Part):
    """A rectangle around the entity's position that turns with its heading."""

    length: Length = Field(description="Extent along the heading [m].")
    width: Length = Field(description="Extent across the heading [m].")
    height: Length | None = Field(None, description="Extent upwards [m]; worlds of a plane leave it out of account.")

    @property
    def upright(self) -> float:
        """How high it is in space; without a height of its own, as high as it is thin [m]."""
        return self.height or min(self.length, self.width)


class Cylinder(_Part):
    """An upright cylinder around the entity's position; a disc for agents that move in a plane."""

    radius: Length = Field(description="Radius [m].")
    height: Length = Field(description="Extent upwards [m]; worlds of a plane leave it out of account.")


class Polygon(_Part):
    """A convex polygon that turns with the entity's heading.

    Vertices that run clockwise are turned round, so that `vertices` always run counter-clockwise.
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


class Wall(_Part):
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
    """Check that a path can only lead to below the folder that it is relative to."""
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


class Mesh(_Part):
    """A body whose surface a file describes; it collides as the convex hull of that."""

    file: AssetPath = Field(description=f"An .obj or .stl file {_ASSET}.")
    scale: Length = Field(1.0, description="How many metres a unit of the file is.")
    radius: Length = Field(description="The disc that it counts as where it is seen from above [m].")

    @field_validator("file")
    @classmethod
    def _is_a_surface(cls, file: str) -> str:
        if not file.lower().endswith((".obj", ".stl")):
            raise ValueError("a mesh is an .obj or .stl file")
        return file


class Urdf(_Part):
    """A body of links and joints that a URDF file describes; its own masses count."""

    file: AssetPath = Field(description=f"A .urdf file {_ASSET}.")
    scale: Length = Field(1.0, description="By how much everything in it is enlarged.")
    radius: Length = Field(description="The disc that it counts as where it is seen from above [m].")

    @field_validator("file")
    @classmethod
    def _is_a_description(cls, file: str) -> str:
        if not file.lower().endswith(".urdf"):
            raise ValueError("it is a .urdf file")
        return file


Kind = Literal["circle", "box", "cylinder", "polygon", "wall", "mesh", "urdf"]
KINDS: tuple[Kind, ...] = ("circle", "box", "cylinder", "polygon", "wall", "mesh", "urdf")


class Shape(_Part):
    """The outline of an entity; exactly one kind."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    circle: Circle | None = Field(None, description="A disc.")
    box: Box | None = Field(None, description="A rectangle that turns with the heading.")
    cylinder: Cylinder | None = Field(None, description="An upright cylinder; a disc in a plane.")
    polygon: Polygon | None = Field(None, description="A convex polygon that turns with the heading.")
    wall: Wall | None = Field(None, description="A chain of segments with a thickness; for entities of the world only.")
    mesh: Mesh | None = Field(None, description="A surface from a file, for worlds of space; a disc elsewhere.")
    urdf: Urdf | None = Field(None, description="Links and joints from a file, for worlds of space; a disc elsewhere.")

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
        """Which of the kinds it is."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def radius(self) -> float:
        """The radius of the smallest circle around the position that holds the shape [m]."""
        return max(math.hypot(*point) + rounding for piece, rounding in self.pieces for point in piece)

    @property
    def pieces(self) -> Sequence[tuple[Sequence[Point], float]]:
        """The convex pieces that the shape consists of, relative to the position, x along the heading.

        Each is a core, one point, two or a convex polygon (counter-clockwise), and the radius by which the core is
        rounded, both in metres: a disc is a rounded point, a segment of a wall a rounded line.
        """
        for round_ in (self.circle, self.cylinder, self.mesh, self.urdf):
            if round_:
                return [([(0.0, 0.0)], round_.radius)]
        if self.box:
            x, y = 0.5 * self.box.length, 0.5 * self.box.width
            return [([(-x, -y), (x, -y), (x, y), (-x, y)], 0.0)]
        if self.polygon:
            return [(self.polygon.vertices, 0.0)]
        assert self.wall
        return [(segment, 0.5 * self.wall.thickness) for segment in pairwise(self.wall.points)]


class Surface(_Part):
    """What happens where bodies touch, in worlds of forces; of two surfaces the product counts."""

    friction: float = Field(0.5, ge=0, le=_LARGEST, description="Coefficient of friction; of two bodies, the product.")
    elasticity: float = Field(
        0.0, ge=0, le=1, description="Part of the closing speed with which bodies part; of two bodies, the product."
    )


class Entity(Surface):
    """A body in the world."""

    shape: Shape | None = Field(
        None, description="The outline; without one the entity is a point that touches nothing."
    )
    mass: Mass = Field(1.0, description="Mass [kg].")
    max_force: Mass | None = Field(
        None,
        description="Greatest force with which it does what its model says, in worlds of forces [N]; no limit if null.",
    )
    max_torque: Mass | None = Field(
        None,
        description="Greatest torque with which it turns as its model says, in worlds of forces [N m]; no limit if "
        "null.",
    )

    @field_validator("shape")
    @classmethod
    def _suits(cls, shape: Shape | None) -> Shape | None:
        if shape and shape.wall:
            raise ValueError("an agent cannot be a wall; walls are entities of the environment")
        return shape

    @property
    def radius(self) -> float:
        """The radius of the smallest circle around the position that holds the shape; 0 for a point [m]."""
        return self.shape.radius if self.shape else 0.0


class Pose(NamedTuple):
    """Where a body is and how it moves.

    Attributes:
        position: Coordinates [m]; 2 or 3 of them.
        heading: Heading [rad].
        velocity: Velocity of the position [m/s], as many coordinates.
        turn_rate: Rate of the heading [rad/s].
    """

    position: tuple[float, ...]
    heading: float = 0.0
    velocity: tuple[float, ...] = (0.0, 0.0)
    turn_rate: float = 0.0


class ScriptedPath(_Part):
    """Where a moving obstacle is at which time; straight and even in between.

    Before the first time it rests at the first position. After the last it rests at the last, or begins anew.
    """

    times: tuple[Number, ...] = Field(
        json_schema_extra={"minItems": 2}, description="Simulated times, ascending [s]; at least 2."
    )
    positions: tuple[Position, ...] = Field(
        json_schema_extra={"minItems": 2}, description="The position at each time: [x, y] or [x, y, z] [m]."
    )
    headings: tuple[Number, ...] | None = Field(
        None, description="The heading at each time [rad]; without them the obstacle keeps its `heading`."
    )
    repeat: bool = Field(
        False,
        description="Begin anew at the last time, for ever; where the last position is not the first, it jumps there.",
    )

    @model_validator(mode="after")
    def _fits_together(self) -> ScriptedPath:
        if len(self.times) < 2:
            raise ValueError(f"a path has at least 2 times, not {len(self.times)}")
        for one, other in pairwise(self.times):
            if other - one < 1e-9:
                raise ValueError(f"the times do not ascend: {other:.10g} s follows {one:.10g} s")
        for name, values in (("positions", self.positions), ("headings", self.headings)):
            if values is not None and len(values) != len(self.times):
                raise ValueError(f"there are {len(values)} {name} for {len(self.times)} times")
        if len({len(position) for position in self.positions}) > 1:
            raise ValueError("some positions have 2 coordinates, others 3")
        return self

    def pose(self, time: float, heading: float = 0.0) -> Pose:
        """Return where the obstacle is, and how it moves from there on.

        Args:
            time: Simulated time [s].
            heading: Its heading if the path states none [rad].
        """
        times, positions, headings = self.times, self.positions, self.headings
        if self.repeat and time > times[-1]:
            time = times[0] + (time - times[0]) % (times[-1] - times[0])
        elif self.repeat and time == times[-1]:
            time = times[0]
        after = bisect_right(times, time)
        if after in (0, len(times)):
            end = 0 if after == 0 else -1
            still = (0.0,) * len(positions[end])
            return Pose(positions[end], headings[end] if headings else heading, still)
        before, span = after - 1, times[after] - times[after - 1]
        share = (time - times[before]) / span
        change = [other - one for one, other in zip(positions[before], positions[after], strict=True)]
        position = tuple(one + share * by for one, by in zip(positions[before], change, strict=True))
        velocity = tuple(by / span for by in change)
        if headings is None:
            return Pose(position, heading, velocity)
        turn = headings[after] - headings[before]
        return Pose(position, headings[before] + share * turn, velocity, turn / span)


class Obstacle(Surface):
    """A body that is part of the environment.

    It stays where it is, moves along a path that nothing diverts, or, in worlds of forces and with a mass, is pushed
    around by what it meets.
    """

    shape: Shape = Field(description="The outline.")
    mass: Mass | None = Field(
        None, description="Mass [kg]. Worlds of forces move what has one, unless it has a path; null: it stays put."
    )
    position: Position | None = Field(
        None,
        description="Where it stands: [x, y] or [x, y, z] [m]. A wall may leave it out: its points then are positions "
        "in the world. Something that moves has a path in its place.",
    )
    heading: Number = Field(0.0, description="Where its x axis points [rad], counter-clockwise from that of the world.")
    velocity: Position | None = Field(
        None, description="How it moves at the start, in worlds of forces: [x, y] or [x, y, z] [m/s]; needs a mass."
    )
    turn_rate: Number = Field(0.0, description="How it turns at the start, in worlds of forces [rad/s]; needs a mass.")
    path: ScriptedPath | None = Field(None, description="Where it is at which time; without one it does not move.")

    @model_validator(mode="after")
    def _is_somewhere(self) -> Obstacle:
        if self.position and self.path:
            raise ValueError("the path says where it is; leave position out")
        if self.position is None and self.path is None and self.shape.wall is None:
            raise ValueError("it needs a position, or a path if it moves")
        if (self.velocity or self.turn_rate) and not self.is_free:
            raise ValueError("what moves at the start needs a mass, and no path")
        if self.velocity and self.position and len(self.velocity) != len(self.position):
            raise ValueError(f"position has {len(self.position)} coordinates and velocity {len(self.velocity)}")
        if self.is_free and self.shape.wall:
            raise ValueError("a wall stays put; leave mass out")
        return self

    @property
    def is_free(self) -> bool:
        """Whether worlds of forces move it: it has a mass, and no path."""
        return self.mass is not None and self.path is None

    @property
    def radius(self) -> float:
        """The radius of the smallest circle around the position that holds the shape [m]."""
        return self.shape.radius

    def pose(self, time: float = 0.0) -> Pose:
        """Return where it is, and how it moves from there on.

        Args:
            time: Simulated time [s].
        """
        if self.path:
            return self.path.pose(time, self.heading)
        position = self.position or (0.0, 0.0)
        return Pose(position, self.heading, (0.0,) * len(position))


def _area(vertices: Sequence[Point]) -> float:
    """The area of a polygon, negative if it runs clockwise [m^2]; relative to its first vertex, for precision."""
    (x, y), *_ = vertices
    return 0.5 * sum(
        (one[0] - x) * (other[1] - y) - (other[0] - x) * (one[1] - y)
        for one, other in pairwise([*vertices, vertices[0]])
    )


def _turns_left_once(vertices: Sequence[Point]) -> bool:
    """Whether a polygon is convex and runs counter-clockwise: no corner turns right, and it goes round once."""
    around = [*vertices, vertices[0], vertices[1]]
    turned = 0.0
    for (x0, y0), (x1, y1), (x2, y2) in zip(around, around[1:], around[2:], strict=False):
        ahead, aside = (x1 - x0, y1 - y0), (x2 - x1, y2 - y1)
        turn = math.atan2(ahead[0] * aside[1] - ahead[1] * aside[0], ahead[0] * aside[0] + ahead[1] * aside[1])
        if turn < -_TOLERANCE or turn > math.pi - _TOLERANCE:
            return False
        turned += turn
    return turned < 3 * math.pi
