"""The section `map` of scenarios: the bodies and regions of a floor.

Reasons: docs/decisions/0084-maps.md
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from symaware_cli.core import WorldError
from symaware_cli.geometry import AssetPath, Length, Region
from symaware_cli.language import Additions, ScenarioError, ScenarioSection, Section, SectionContext
from symaware_cli.maps.floor import Floor, FloorPart, floor_of, of_polygons, of_raster
from symaware_cli.maps.map_error import MapError
from symaware_cli.maps.scatter import Scatter, scattered

#: A stand-in for the regions of a map that cannot be read.
_NOWHERE = Region(box=(0.0, 1.0, 0.0, 1.0))


class MapForm(Section):
    """A map."""

    file: AssetPath | None = Field(
        None,
        description="The map, below the scenario's folder or one of `assets`: the .yaml file of a map of ROS, "
        "polygons as .wkt or .geojson, in metres, or the .map file of a map of Moving AI.",
    )
    resolution: Length = Field(1.0, description="The side of the cells of a .map file [m].")
    height: Length = Field(1.0, description="The height of the bodies of a map of cells, for worlds in space [m].")
    unknown: Literal["passable", "solid"] = Field(
        "passable", description="Whether unknown cells are bodies like occupied ones, or nothing is there."
    )
    scatter: Scatter | None = Field(None, description="A random field of obstacles, another one for each seed.")

    @model_validator(mode="after")
    def _has_content(self) -> Self:
        if self.file is None and self.scatter is None:
            raise ValueError("a map has a `file`, a `scatter`, or both")
        return self


class MapSection(ScenarioSection):
    """Adds the bodies `map_0`, `map_1`, ... and the regions `free`, `occupied` and `unknown` of a map."""

    form: ClassVar[Any] = MapForm | None
    description: ClassVar[str] = "A map, whose walls are bodies of the world, and whose areas are regions."

    def __init__(self) -> None:
        self._floor: Floor | None = None
        self._files: dict[str, bytes] = {}

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Read the map, and draw the field of obstacles."""
        form: MapForm | None = context.document.map
        if form is None:
            return Additions()
        parts: list[FloorPart] = []
        try:
            if form.file is not None:
                part, self._files = _read(form.file, form, context)
                parts.append(part)
            if form.scatter is not None:
                parts.append(_scattered(form.scatter, parts, context))
            self._floor = floor = floor_of(parts)
        except ScenarioError as error:
            context.add(error.problems)
        except (MapError, WorldError) as error:
            # Problems of the file are found before anything is drawn.
            place = "scatter" if form.file is None or parts else "file"
            subject = (
                "the obstacles cannot be placed" if place == "scatter" else f"the map `{form.file}` cannot be used"
            )
            context.report(f"{subject}: {error}", place)
        else:
            bounds = floor.bounds or (form.scatter.within if form.scatter else None)
            free = "free" if "free" in floor.regions else None
            return Additions(floor.bodies, floor.regions, bounds=bounds, free=free, is_drawn=form.scatter is not None)
        # References to the regions of a map that cannot be read are not reported as further problems.
        return Additions(regions=dict.fromkeys(("free", "occupied", "unknown"), _NOWHERE))

    def build(self, written: Any, context: SectionContext) -> Floor | None:
        """Return the floor."""
        return self._floor

    def files(self, built: Floor | None) -> Mapping[str, bytes]:
        """Return the files of the map."""
        return self._files


def _read(name: str, form: MapForm, context: SectionContext) -> tuple[FloorPart, dict[str, bytes]]:
    """Read the file of a map; return its part of the floor, and the files."""
    from symaware_cli.assets import asset
    from symaware_cli.maps import movingai, polygon_file, ros_map
    from symaware_cli.maps.convex import convex_pieces

    suffix = PurePosixPath(name).suffix.lower()
    path = asset.find(name, context.folders)
    if (as_written := context.folder / name).is_file():
        path = as_written  # messages use a shorter name
    if suffix in ros_map.SUFFIXES:
        raster, files = ros_map.read_ros_map(name, path, context.folders)
        part = of_raster(raster, form.height, form.unknown == "solid")
    elif suffix in movingai.SUFFIXES:
        raster, content = movingai.read_map(path, form.resolution)
        part, files = of_raster(raster, form.height, form.unknown == "solid"), {name: content}
    elif suffix in polygon_file.SUFFIXES:
        found = polygon_file.PolygonFile(path)
        pieces = [piece for rings in found.polygons for piece in convex_pieces([ring.corners for ring in rings])]
        part, files = of_polygons(pieces), {name: found.content}
    else:
        suffixes = (*ros_map.SUFFIXES, *polygon_file.SUFFIXES, *movingai.SUFFIXES)
        raise MapError(f"its suffix is none of {', '.join(suffixes)}")
    return part, files


def _scattered(scatter: Scatter, parts: list[FloorPart], context: SectionContext) -> FloorPart:
    within = scatter.within or (parts[0].bounds if parts else None)
    if within is None:
        raise MapError("without a file, the area is needed: `within: [x, x, y, y]`")
    others = dict(context.document.environment.entities)
    for part in parts:
        others |= part.bodies
    return scattered(scatter, within, context.document.seed, context.agents(), others)
