"""Bodies: the shape and mass of an agent or an obstacle, and the pose of an obstacle over time.

Lengths are metres, angles radians, masses kilograms; an orientation is a unit quaternion in the order x, y, z, w.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator, model_validator

from symaware_cli.geometry import LARGEST, Number, Pose, Position, ScriptedPath, Shape, StrictModel, footprint

Mass = Annotated[float, Field(gt=0, le=LARGEST)]


class Surface(StrictModel):
    """Surface properties for contacts in physics worlds; a contact uses the product of both surfaces."""

    friction: float = Field(
        0.5, ge=0, le=LARGEST, description="Coefficient of friction; a contact uses the product of both bodies."
    )
    elasticity: float = Field(
        0.0, ge=0, le=1, description="Coefficient of restitution; a contact uses the product of both bodies."
    )


class Entity(Surface):
    """A body in the world."""

    shape: Shape | None = Field(None, description="The outline; without one the entity is a point without contacts.")
    mass: Mass = Field(1.0, description="Mass [kg].")
    max_force: Mass | None = Field(
        None, description="Greatest force of its drive, in physics worlds [N]; no limit if null."
    )
    max_torque: Mass | None = Field(
        None, description="Greatest torque of its drive, in physics worlds [N m]; no limit if null."
    )

    @field_validator("shape")
    @classmethod
    def _suits(cls, shape: Shape | None) -> Shape | None:
        if shape and shape.wall:
            raise ValueError("an agent cannot be a wall; walls are entities of the environment")
        return shape

    @property
    def radius(self) -> float:
        """The radius of the bounding circle around the position; 0 for a point [m]."""
        return self.shape.radius if self.shape else 0.0


class Obstacle(Surface):
    """A body that is part of the environment.

    It is static, moves along a path that nothing diverts, or, in physics worlds and with a mass, is moved by forces.
    """

    shape: Shape = Field(description="The outline.")
    mass: Mass | None = Field(
        None,
        description="Mass [kg]. Physics worlds move an entity with a mass, unless it has a path; "
        "null for a static one. Links of a URDF file always have the masses of the file; with "
        "null its base is fixed, and its joints move.",
    )
    position: Position | None = Field(
        None,
        description="Position: [x, y] or [x, y, z] [m]. Optional for a wall, whose points are then "
        "positions in the world. A moving entity has a path instead.",
    )
    heading: Number = Field(0.0, description="Direction of its x axis [rad], counter-clockwise from that of the world.")
    roll: Number = Field(
        0.0,
        description="Initial rotation about its own x axis, applied before the pitch and the "
        "heading, in worlds in space [rad].",
    )
    pitch: Number = Field(
        0.0,
        description="Initial rotation about its own y axis, applied before the heading, in worlds in "
        "space [rad]; a positive one lowers the front.",
    )
    velocity: Position | None = Field(
        None, description="Initial velocity, in physics worlds: [x, y] or [x, y, z] [m/s]; requires a mass."
    )
    turn_rate: Number = Field(0.0, description="Initial turn rate, in physics worlds [rad/s]; requires a mass.")
    path: ScriptedPath | None = Field(None, description="Its positions over time; without a path it does not move.")

    @model_validator(mode="after")
    def _is_somewhere(self) -> Obstacle:
        if self.position and self.path:
            raise ValueError("the path says where it is; leave position out")
        if self.position is None and self.path is None and self.shape.wall is None:
            raise ValueError("it needs a position, or a path if it moves")
        if (self.velocity or self.turn_rate) and not self.is_free:
            raise ValueError("an entity that moves at the start needs a mass, and no path")
        if self.velocity and self.position and len(self.velocity) != len(self.position):
            # Only the velocity is named: that is the value to show.
            raise ValueError(f"velocity has {len(self.velocity)} coordinates, and the place {len(self.position)}")
        if self.is_free and self.shape.wall:
            raise ValueError("a wall stays put; leave mass out")
        if self.is_tilted and (self.shape.wall or self.shape.polygon):
            raise ValueError(f"a {self.shape.kind} stands upright; leave roll and pitch out, or take a box")
        return self

    @property
    def is_tilted(self) -> bool:
        """Whether it has a roll or a pitch."""
        return bool(self.roll or self.pitch)

    @property
    def outline(self) -> Shape:
        """Its outline seen from above; that of a free body, which may tumble, as if it were upright."""
        return self.shape if self.is_free else footprint(self.shape, self.roll, self.pitch)

    @property
    def is_free(self) -> bool:
        """Whether physics worlds move it: it has a mass, and no path."""
        return self.mass is not None and self.path is None

    @property
    def radius(self) -> float:
        """The radius of the bounding circle around the position [m]."""
        return self.outline.radius

    def pose(self, time: float = 0.0) -> Pose:
        """Return its pose at a time, and its velocities from there on.

        Args:
            time: Simulated time [s].
        """
        if self.path:
            return self.path.pose(time, self.heading)
        position = self.position or (0.0, 0.0)
        return Pose(position, self.heading, (0.0,) * len(position))
