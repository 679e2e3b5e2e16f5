"""The ground of spatial worlds."""

from __future__ import annotations

from pydantic import Field

from symaware_cli.core import Parameters


class GroundPlane(Parameters):
    """A plane that everything falls on."""

    height: float = Field(0.0, ge=-1e9, le=1e9, description="Height [m].")
    friction: float = Field(1.0, ge=0, description="Coefficient of friction, multiplied by that of the body on it.")
    elasticity: float = Field(
        1.0, ge=0, le=1, description="Elasticity, multiplied by that of the body that falls on it."
    )
