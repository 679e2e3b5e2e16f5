"""The section `map` of scenarios: the bodies and regions of a floor.

Reasons: docs/decisions/0084-maps.md
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any, ClassVar, Literal

from pydantic import Field

from symaware_cli.core import WorldError
from symaware_cli.geometry import AssetPath, Length, Region
from symaware_cli.language import Additions, ScenarioError, ScenarioSection, Section, SectionContext
from symaware_cli.maps.floor import Floor
from symaware_cli.maps.map_error import MapError

#: A stand-in for the regions of a map that cannot be read.
_NOWHERE = Region(box=(0.0, 1.0, 0.0, 1.0))


class MapForm(Section):
    """A map."""

    file: AssetPath = Field(
        description="The map, below the scenario's folder or one of `assets`: a .yaml file of ROS.",
    )
    height: Length = Field(1.0, description="The height of its bodies, for worlds in space [m].")
    unknown: Literal["passable", "solid"] = Field(
        "passable", description="Whether unknown cells are bodies like occupied ones, or nothing is there."
    )


class MapSection(ScenarioSection):
    """Adds the bodies `map_0`, `map_1`, ... and the regions `free`, `occupied` and `unknown` of a map."""

    form: ClassVar[Any] = MapForm | None
    description: ClassVar[str] = "A map, whose walls are bodies of the world, and whose areas are regions."

    def __init__(self) -> None:
        self._floor: Floor | None = None

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Read the map."""
        form: MapForm | None = context.document.map
        if form is None:
            return Additions()
        try:
            floor, files = self._read(form, context)
        except ScenarioError as error:
            context.add(error.problems)
        except (MapError, WorldError) as error:
            context.report(f"the map `{form.file}` cannot be used: {error}", "file")
        else:
            self._floor = floor
            return Additions(floor.bodies, floor.regions, files)
        # What refers to the regions of a map that cannot be read is not wrong as well.
        return Additions(regions=dict.fromkeys(("free", "occupied", "unknown"), _NOWHERE))

    def build(self, written: Any, context: SectionContext) -> Floor | None:
        """Return the floor."""
        return self._floor

    def _read(self, form: MapForm, context: SectionContext) -> tuple[Floor, dict[str, bytes]]:
        from symaware_cli.assets import asset
        from symaware_cli.maps import floor, ros_map

        suffix = PurePosixPath(form.file).suffix.lower()
        path = asset.find(form.file, context.folders)
        if suffix in ros_map.SUFFIXES:
            raster, files = ros_map.read_ros_map(form.file, path, context.folders)
            return floor.of_raster(raster, form.height, form.unknown == "solid"), files
        raise MapError("its suffix is none of .yaml and .yml")
