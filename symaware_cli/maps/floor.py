"""The floor that a map describes: its bodies, regions and bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array, Region, RegionShape
from symaware_cli.geometry.shape import Box, Polygon, Shape
from symaware_cli.maps.map_error import MapError
from symaware_cli.maps.raster import FREE, OCCUPIED, UNKNOWN, Raster
from symaware_cli.maps.rectangles import Rectangles, merged

#: The greatest number of bodies of a map: each is tested at each step.
MOST_BODIES = 5000


@dataclass(frozen=True)
class Floor:
    """A map as components find it in `group.sections["map"]`.

    Attributes:
        bodies: Its bodies, by the names that they have in the world.
        regions: Its regions, by name: `free`, and `occupied` and `unknown` if there are such areas.
        bounds: The least and greatest coordinates of the map [m]: [x, x, y, y]; None if it has no bounds.
        raster: The cells of the map; None for a map without cells.
    """

    bodies: Mapping[str, Obstacle] = field(default_factory=dict)
    regions: Mapping[str, Region] = field(default_factory=dict)
    bounds: tuple[float, float, float, float] | None = None
    raster: Raster | None = None


@dataclass(frozen=True)
class FloorPart:
    """The contribution of one file, or of one field of obstacles, to a floor.

    Attributes:
        bodies: Its bodies.
        occupied: The areas that they occupy.
        unknown: Areas with unknown content.
        whole: The area that the part describes; None if it has no bounds.
        bounds: See `Floor`.
        raster: See `Floor`.
    """

    bodies: Mapping[str, Obstacle]
    occupied: Sequence[RegionShape]
    unknown: Sequence[RegionShape] = ()
    whole: RegionShape | None = None
    bounds: tuple[float, float, float, float] | None = None
    raster: Raster | None = None


def floor_of(parts: Sequence[FloorPart]) -> Floor:
    """Combine parts to a floor.

    The region `free` is the area of the map without its occupied and unknown areas.

    Raises:
        MapError: The floor has too many bodies.
    """
    bodies = {name: body for part in parts for name, body in part.bodies.items()}
    if len(bodies) > MOST_BODIES:
        raise MapError(f"it consists of {len(bodies):,} convex bodies, and a map may have {MOST_BODIES:,}")
    regions: dict[str, Region] = {}
    free: list[str | RegionShape] = [part.whole for part in parts if part.whole is not None]
    areas = {
        "occupied": [area for part in parts for area in part.occupied],
        "unknown": [area for part in parts for area in part.unknown],
    }
    for name, found in areas.items():
        if found:
            area = RegionShape(union=tuple(found))
            # Pictures draw unions as areas; occupied areas are drawn as bodies already.
            regions[name] = Region(intersection=(area,)) if name == "occupied" else Region(union=area.union)
            free.append(RegionShape(complement=name))
    if free:
        regions["free"] = Region(intersection=tuple(free))
    raster = next((part.raster for part in parts if part.raster is not None), None)
    every = [part.bounds for part in parts if part.bounds is not None]
    if not every:
        return Floor(bodies, regions)
    west, east, south, north = zip(*every, strict=True)
    return Floor(bodies, regions, (min(west), max(east), min(south), max(north)), raster)


def of_raster(raster: Raster, height: float, is_unknown_solid: bool) -> FloorPart:
    """Return the part of a floor that a raster describes.

    Args:
        raster: The map.
        height: The height of its bodies [m].
        is_unknown_solid: Whether unknown cells are bodies as well.
    """
    cells = raster.cells
    occupied, unknown = merged(cells == OCCUPIED), merged(cells == UNKNOWN)
    solid = merged(cells != FREE) if is_unknown_solid else occupied
    if len(solid) > MOST_BODIES:
        raise MapError(
            f"its cells make {len(solid):,} rectangles, and a map may have {MOST_BODIES:,}; "
            "remove single pixels from its picture, or reduce its resolution"
        )
    rows, columns = cells.shape
    corners = raster.placed(np.array([0.0, columns, columns, 0.0]), np.array([0.0, 0.0, rows, rows]))
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    (whole,) = _areas(raster, np.array([[0, 0, columns, rows]], np.intp))
    boxes = boxes_of(raster, solid, height)
    return FloorPart(
        bodies={f"map_{number}": body for number, body in enumerate(boxes)},
        occupied=_areas(raster, occupied),
        unknown=_areas(raster, unknown),
        whole=whole,
        bounds=(low_x, high_x, low_y, high_y),
        raster=raster,
    )


def of_polygons(polygons: Sequence[Array]) -> FloorPart:
    """Return the part of a floor that convex polygons occupy; it has no bounds, and the default height of the world.

    Args:
        polygons: The corners of each, counter-clockwise [m]; shape (k, 2).
    """
    bodies = {}
    for number, corners in enumerate(polygons):
        middle = corners.mean(axis=0)
        shape = Shape(polygon=Polygon(vertices=_points(corners - middle)))
        bodies[f"map_{number}"] = Obstacle(shape=shape, position=tuple(middle.tolist()))
    every = np.concatenate(polygons)
    (low_x, low_y), (high_x, high_y) = every.min(axis=0).tolist(), every.max(axis=0).tolist()
    areas = [RegionShape(polygon=_points(corners)) for corners in polygons]
    return FloorPart(bodies, areas, bounds=(low_x, high_x, low_y, high_y))


def _points(corners: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(corner) for corner in corners.tolist())


def boxes_of(raster: Raster, rectangles: Rectangles, height: float) -> list[Obstacle]:
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
