"""Draws lanes: their surface, and the lines between them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from symaware_cli.geometry import Region, RegionShape
from symaware_cli.roads.lane import outline
from symaware_cli.views import Chunk, Detail, Drawing, Lines, RunView, Solid

_SURFACE, _LINE = (150, 150, 150), np.array([90, 90, 90], np.uint8)
#: Offset below a planar world: under regions and bodies [m].
_BELOW = -0.55
#: The width of painted lines [m].
_PAINT = 0.15


class LaneDrawing(Drawing):
    """Draws the lanes of a scenario with `roads` once, at the beginning, as lanes do not move."""

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 15

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._begun = False

    def marks(self, chunk: Chunk) -> Iterator[Solid | Lines]:
        """Yield the surface of the lanes, and their boundaries."""
        if self._begun:
            return
        self._begun = True
        lanes = {name: parts for name, region in self.run_view.regions.items() if (parts := _parts(name, region))}
        if not lanes:
            return
        times = np.array([chunk.start])
        yield Solid(
            path="world/roads/surface",
            layer="regions",
            times=times,
            name="road",
            pieces=[(part.polygon, 0.0) for parts in lanes.values() for part in parts if part.polygon is not None],
            low=_BELOW,
            high=_BELOW,
            colour=_SURFACE,
            transparency=0.75,
            positions=np.zeros((1, 3)),
            orientations=np.array([[0.0, 0.0, 0.0, 1.0]]),
        )
        sides = [side for parts in lanes.values() for side in outline(parts)]
        legs = np.concatenate(sides)
        points = np.concatenate([legs, np.full((*legs.shape[:2], 1), _BELOW + 0.01)], axis=2).reshape(-1, 3)
        yield Lines(
            path="world/roads/lines",
            layer="roads",
            times=times,
            counts=np.array([len(legs)]),
            points=points,
            lengths=np.full(len(legs), 2),
            colours=_LINE,
            transparency=0.3,
            width=1.0,
            thickness=_PAINT,
        )

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the meaning of the lanes."""
        if any(_parts(name, region) for name, region in self.run_view.regions.items()):
            yield "grey areas with lines", "lanes of the road"


def _parts(name: str, region: Region) -> list[RegionShape]:
    """Return the areas of a lane; none for other regions."""
    if not name.startswith("lane_") or region.intersection is None or len(region.intersection) != 1:
        return []
    (inner,) = region.intersection
    if isinstance(inner, str) or inner.union is None:
        return []
    return [part for part in inner.union if not isinstance(part, str)]
