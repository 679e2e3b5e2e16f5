"""The floor that a map describes: its bodies, its regions, and where they lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array, Region, RegionShape
from symaware_cli.geometry.shape import Box, Polygon, Shape
from symaware_cli.maps.map_error import MapError
from symaware_cli.maps.raster import OCCUPIED, UNKNOWN, Raster
from symaware_cli.maps.rectangles import Rectangles, merged

#: The greatest number of bodies of a map: each is tested at each step.
MOST_BODIES = 5000


@dataclass(frozen=True)
class Floor:
    """A map as components find it in `group.sections["map"]`.

    Attributes:
        bodies: Its bodies, by the names that they have in the world.
        regions: Its regions, by name: `free`, and `occupied` and `unknown` if something is.
        bounds: The least and greatest coordinates of what it describes [m]: [x, x, y, y]; None if it has no bounds.
        raster: Its cells; None for one without.
    """

    bodies: Mapping[str, Obstacle] = field(default_factory=dict)
    regions: Mapping[str, Region] = field(default_factory=dict)
    bounds: tuple[float, float, float, float] | None = None
    raster: Raster | None = None


def of_raster(raster: Raster, height: float, is_unknown_solid: bool) -> Floor:
    """Return the floor of a raster.

    Args:
        raster: The map.
        height: The height of its bodies [m].
        is_unknown_solid: Whether unknown cells are bodies as well.

    Raises:
        MapError: It has too many bodies.
    """
    cells = raster.cells
    occupied, unknown = merged(cells == OCCUPIED), merged(cells == UNKNOWN)
    solid = merged(cells != 0) if is_unknown_solid else occupied
    if len(solid) > MOST_BODIES:
        raise MapError(
            f"its cells make {len(solid):,} rectangles, and a map may have {MOST_BODIES:,}; "
            "remove single pixels from its picture, or reduce its resolution"
        )
    rows, columns = cells.shape
    whole = np.array([[0, 0, columns, rows]], np.intp)
    corners = raster.placed(np.array([0.0, columns, columns, 0.0]), np.array([0.0, 0.0, rows, rows]))
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    regions: dict[str, Region] = {}
    outside: list[str | RegionShape] = []
    for name, found in (("occupied", occupied), ("unknown", unknown)):
        if len(found):
            regions[name] = Region(union=tuple(_areas(raster, found)))
            outside.append(RegionShape(complement=name))
    (everything,) = _areas(raster, whole)
    free: Sequence[str | RegionShape] = (everything, *outside)
    regions["free"] = Region(intersection=tuple(free))
    boxes = _boxes(raster, solid, height)
    bodies = {f"map_{number}": body for number, body in enumerate(boxes)}
    return Floor(bodies, regions, (low_x, high_x, low_y, high_y), raster)


def of_polygons(polygons: Sequence[NDArray[np.float64]], height: float) -> Floor:
    """Return the floor of convex polygons, which has no bounds.

    Args:
        polygons: The corners of each, counter-clockwise [m]; shape (k, 2).
        height: Their height [m]; worlds in space cannot extrude polygons of another height than their own.

    Raises:
        MapError: There are too many.
    """
    if len(polygons) > MOST_BODIES:
        raise MapError(f"they consist of {len(polygons):,} convex pieces, and a map may have {MOST_BODIES:,}")
    bodies, areas = {}, []
    for number, corners in enumerate(polygons):
        middle = corners.mean(axis=0)
        shape = Shape(polygon=Polygon(vertices=_points(corners - middle)))
        bodies[f"map_{number}"] = Obstacle(shape=shape, position=tuple(middle.tolist()))
        areas.append(RegionShape(polygon=_points(corners)))
    if not areas:
        return Floor()
    regions = {"occupied": Region(union=tuple(areas)), "free": Region(complement="occupied")}
    every = np.concatenate(polygons)
    (low_x, low_y), (high_x, high_y) = every.min(axis=0).tolist(), every.max(axis=0).tolist()
    return Floor(bodies, regions, (low_x, high_x, low_y, high_y))


def _points(corners: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(corner) for corner in corners.tolist())


def _boxes(raster: Raster, rectangles: Rectangles, height: float) -> list[Obstacle]:
    """Return bodies that stand where rectangles of cells are."""
    middles = raster.placed(rectangles[:, [0, 2]].mean(axis=1), rectangles[:, [1, 3]].mean(axis=1))
    sizes = (rectangles[:, 2:] - rectangles[:, :2]) * raster.resolution
    return [
        Obstacle(shape=Shape(box=Box(length=length, width=width, height=height)), position=(x, y), heading=raster.yaw)
        for (x, y), (length, width) in zip(middles.tolist(), sizes.tolist(), strict=True)
    ]


def _areas(raster: Raster, rectangles: Rectangles) -> list[RegionShape]:
    """Return the areas of rectangles of cells."""
    first, last = rectangles[:, :2].astype(float), rectangles[:, 2:].astype(float)
    corners = np.stack(
        [
            raster.placed(first[:, 0], first[:, 1]),
            raster.placed(last[:, 0], first[:, 1]),
            raster.placed(last[:, 0], last[:, 1]),
            raster.placed(first[:, 0], last[:, 1]),
        ],
        axis=1,
    )
    if raster.yaw:
        return [RegionShape(polygon=_points(each)) for each in corners]
    return [
        RegionShape(box=(low[0], high[0], low[1], high[1]))
        for low, high in zip(corners[:, 0].tolist(), corners[:, 2].tolist(), strict=True)
    ]
