"""Placements of a group's agents: on a grid and on a circle."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.geometry import Length, Number
from symaware_cli.language.section import Section

Array = NDArray[np.float64]
Plane = Annotated[list[Number], Field(min_length=2, max_length=3)]


class GridPlacement(Section):
    """Agents in rows and columns, in the order of their index."""

    origin: Plane = Field(default_factory=lambda: [0.0, 0.0], description="Position of the first agent [m].")
    spacing: Number | Plane = Field(1.0, description="Distance between neighbours, the same or for each axis [m].")
    columns: int | None = Field(None, ge=1, description="Agents in a row; if left out, as many as there are rows.")
    heading: Number = Field(0.0, description="Heading of all [rad], for models that have one.")

    def poses(self, count: int) -> tuple[Array, Array]:
        """The positions [m] and headings [rad] of `count` agents; shapes (n, d) and (n,)."""
        columns = self.columns or math.ceil(math.sqrt(count))
        spacing = self.spacing if isinstance(self.spacing, list) else [self.spacing] * 2
        rows, positions = np.arange(count), np.tile(np.array(self.origin, float), (count, 1))
        for axis, steps in enumerate((rows % columns, rows // columns)):
            positions[:, axis] += steps * spacing[axis]
        return positions, np.full(count, self.heading)


class CirclePlacement(Section):
    """Agents evenly on a circle, counter-clockwise in the order of their index."""

    centre: Plane = Field(default_factory=lambda: [0.0, 0.0], description="Centre [m].")
    radius: Length = Field(description="Radius [m].")
    phase: Number = Field(
        0.0, description="Direction from the centre to the first agent [rad]; pi more is the far side."
    )
    heading: Literal["inward", "outward", "along"] = Field(
        "inward", description="Direction in which agents face, for models that have a heading."
    )

    def poses(self, count: int) -> tuple[Array, Array]:
        """The positions [m] and headings [rad] of `count` agents; shapes (n, d) and (n,)."""
        angles = (self.phase + 2 * math.pi * np.arange(count) / count).tolist()
        turn = {"inward": math.pi, "outward": 0.0, "along": math.pi / 2}[self.heading]
        positions = np.tile(np.array(self.centre, float), (count, 1))
        # `math`, because its last bits do not depend on NumPy's kernels.
        positions[:, 0] += self.radius * np.array([math.cos(angle) for angle in angles])
        positions[:, 1] += self.radius * np.array([math.sin(angle) for angle in angles])
        return positions, np.array([math.remainder(angle + turn, 2 * math.pi) for angle in angles])


#: The regular placements by the name that a scenario gives them.
REGULAR: dict[str, type[GridPlacement] | type[CirclePlacement]] = {"grid": GridPlacement, "circle": CirclePlacement}
