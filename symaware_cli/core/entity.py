"""Bodies: the shape and mass of an agent or an obstacle."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Circle(_Part):
    """A disc around the entity's position."""

    radius: Positive = Field(description="Radius [m].")


class Shape(_Part):
    """The outline of an entity; exactly one kind."""

    circle: Circle = Field(description="A disc.")

    @property
    def radius(self) -> float:
        """The radius of the smallest circle around the position that holds the shape [m]."""
        return self.circle.radius


class Entity(_Part):
    """A body in the world."""

    shape: Shape | None = Field(
        None, description="The outline; without one the entity is a point that touches nothing."
    )
    mass: Positive = Field(1.0, description="Mass [kg].")

    @property
    def radius(self) -> float:
        """The radius of the smallest circle around the position that holds the shape; 0 for a point [m]."""
        return self.shape.radius if self.shape else 0.0


class Obstacle(Entity):
    """A body that is part of the environment and stays where it is."""

    shape: Shape = Field(description="The outline.")
    position: tuple[float, ...] = Field(description="Where it stands: [x, y] or [x, y, z] [m].")

    @model_validator(mode="after")
    def _two_or_three_dimensions(self) -> Obstacle:
        if len(self.position) not in (2, 3):
            raise ValueError(f"a position has 2 or 3 coordinates, not {len(self.position)}")
        return self
