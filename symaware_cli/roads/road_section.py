"""The section `roads` of scenarios: lanes from points or from a file, as regions and as a network for controllers.

Reasons: docs/decisions/0096-roads.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.assets import AssetError, asset
from symaware_cli.core import WorldError
from symaware_cli.geometry import AssetPath, Length, Region, RegionShape
from symaware_cli.geometry.shape import Point
from symaware_cli.language import Additions, Identifier, ScenarioSection, Section, SectionContext, Source, quoted
from symaware_cli.roads.lane import Lane, crossing, lane_sides
from symaware_cli.roads.road_file import MOST_BYTES
from symaware_cli.roads.road_network import RoadNetwork, UnreadRoads, derived_links, derived_neighbours

#: The greatest number of lanes, and of points of all their boundaries.
MOST_LANES, MOST_POINTS = 2_000, 50_000

#: How the names of regions of centres end.
_CENTRE = "_centre"

#: A stand-in for the regions of roads that cannot be read.
_NOWHERE = Region(box=(0.0, 1.0, 0.0, 1.0))

Width = Annotated[float, Field(gt=0, le=100.0)]


class LaneForm(Section):
    """A lane from the points of its centre line."""

    points: tuple[Point, ...] = Field(
        json_schema_extra={"minItems": 2},
        description="Points of the centre line, in the direction of travel [m].",
    )
    width: Width | tuple[Width, ...] = Field(3.5, description="The width [m]: one for all points, or one for each.")
    speed_limit: Length | None = Field(None, description="The speed limit [m/s]; none if left out.")
    successors: tuple[str, ...] | None = Field(
        None,
        description="Lanes that continue it; by default those that begin where it ends. "
        "The first is the default route.",
    )
    left: str | None = Field(None, description="The lane to its left with the same direction; by default one there.")
    right: str | None = Field(None, description="The lane to its right with the same direction; by default one there.")

    @model_validator(mode="after")
    def _is_a_line(self) -> Self:
        if len(self.points) < 2:
            raise ValueError("a lane has at least 2 points")
        for number, (one, other) in enumerate(pairwise(self.points)):
            if one == other:
                raise ValueError(f"points {number} and {number + 1} are the same")
        if isinstance(self.width, tuple) and len(self.width) != len(self.points):
            raise ValueError(f"there are {len(self.width)} widths for {len(self.points)} points")
        return self


class RoadsForm(Section):
    """Roads."""

    file: AssetPath | None = Field(
        None,
        description="Lanes from an OpenDRIVE file (.xodr) or a CommonRoad file (.xml), below the scenario's folder or "
        "one of `assets`.",
    )
    lanes: dict[Identifier, LaneForm] = Field(default_factory=dict, description="Lanes from points, by name.")
    step: Annotated[float, Field(ge=0.01, le=100.0)] = Field(
        2.0, description="The greatest distance between two points of a curve of an OpenDRIVE file [m]."
    )

    centre: Annotated[float, Field(ge=0.01, le=100.0)] | None = Field(
        None,
        description="If stated, `lane_<name>_centre` is the region within this distance of the centre of a lane [m].",
    )

    @model_validator(mode="after")
    def _has_content(self) -> Self:
        if self.file is None and not self.lanes:
            raise ValueError("roads have a `file`, or `lanes`, or both")
        return self


class RoadSection(ScenarioSection):
    """Adds the regions `road`, `lane_<name>` and `lane_<name>_centre`, and the network of lanes for components."""

    form: ClassVar[Any] = RoadsForm | None
    description: ClassVar[str] = "Roads, whose lanes are regions, and on which agents drive, follow and change lanes."

    def __init__(self) -> None:
        self._network: RoadNetwork | None = None
        self._files: dict[str, bytes] = {}

    def additions(self, written: Any, context: SectionContext) -> Additions:
        """Read the lanes."""
        form: RoadsForm | None = context.document.roads
        if form is None:
            return Additions()
        lanes: list[Lane] = []
        names = {f"lane_{name}{part}" for name in form.lanes for part in (("", _CENTRE) if form.centre else ("",))}
        if form.file is not None:
            lanes += self._of_file(form.file, form.step, context)
        is_read = form.file is None or bool(lanes)
        if _check(form, lanes, context) and is_read:
            self._network = RoadNetwork(_joined(form, lanes))
            return Additions(regions=_regions(self._network.lanes, form.centre))
        # References to the regions of roads that cannot be read are not reported as further problems.
        return Additions(regions=dict.fromkeys(("road", *sorted(names)), _NOWHERE))

    def _of_file(self, name: str, step: float, context: SectionContext) -> list[Lane]:
        """Read the file; report a problem at its place in the file, and return no lanes then."""
        data = b""
        try:
            path = asset.find(name, context.folders)
            if (as_written := context.folder / name).is_file():
                path = as_written  # messages use a shorter name
            if path.stat().st_size > MOST_BYTES:
                raise WorldError(f"it has {path.stat().st_size:,} bytes, and a file of roads may have {MOST_BYTES:,}")
            data = path.read_bytes()
            lanes = _read(name, step, data)
        except AssetError as error:
            if error.line:
                source = Source(str(path), data, data.decode("utf-8", "replace"))
                place = source.text_span(error.line, max(1, error.column), error.line, error.column + 1)
                source.report("unsuitable", str(error), place)
                context.add(source.problems)
            else:
                context.report(f"the roads `{name}` cannot be used: {error}", "file")
            return []
        except (WorldError, OSError) as error:
            context.report(f"the roads `{name}` cannot be used: {error}", "file")
            return []
        self._files[name] = data
        return lanes

    def build(self, written: Any, context: SectionContext) -> RoadNetwork | UnreadRoads | None:
        """Return the network."""
        return UnreadRoads() if self._network is None and written is not None else self._network

    def files(self, built: Any) -> Mapping[str, bytes]:
        """Return the file of the roads."""
        return self._files


def _read(name: str, step: float, data: bytes) -> list[Lane]:
    """Read a file.

    Raises:
        AssetError: The file cannot be used.
    """
    from symaware_cli.roads import commonroad, opendrive

    suffix = PurePosixPath(name).suffix.lower()
    if suffix == ".xodr":
        return opendrive.lanes_of(data, step)
    if suffix == ".xml":
        return commonroad.lanes_of(data)
    raise AssetError("its suffix is neither .xodr (OpenDRIVE) nor .xml (CommonRoad)")


def _check(form: RoadsForm, lanes: Sequence[Lane], context: SectionContext) -> bool:
    """Report problems of the lanes from points; return whether there are none."""
    is_sound = True
    known = {lane.name for lane in lanes}
    every = {*known, *form.lanes}

    def report(message: str, *place: str | int, key: bool = False) -> None:
        nonlocal is_sound
        is_sound = False
        context.report(message, "lanes", *place, key=key)

    points = sum(len(lane.left) for lane in lanes) + sum(len(lane.points) for lane in form.lanes.values())
    if form.centre is not None:
        for name in sorted(every):
            if f"{name}{_CENTRE}" in every:
                said = f"the centre of the lane {quoted(name)} would be called as the lane {quoted(name + _CENTRE)}"
                context.report(said, "centre")
                is_sound = False
    if len(every) > MOST_LANES or points > MOST_POINTS:
        said = f"there are {len(every):,} lanes with {points:,} points"
        context.report(f"{said}, and roads may have {MOST_LANES:,} lanes and {MOST_POINTS:,} points")
        return False
    for name, lane in form.lanes.items():
        if name in known:
            report(f"the file has a lane {quoted(name)} as well", name, key=True)
        for key in ("left", "right"):
            other = getattr(lane, key)
            if other is not None and (other not in every or other == name):
                report(f"there is no other lane {quoted(other)}", name, key)
        for number, other in enumerate(lane.successors or ()):
            if other not in every:
                report(f"there is no lane {quoted(other)}", name, "successors", number)
        leg = crossing(np.array(lane.points))
        if leg is not None:
            report("the centre line crosses itself here", name, "points", leg)
    return is_sound


def _joined(form: RoadsForm, lanes: Sequence[Lane]) -> list[Lane]:
    """Return the lanes of the file and those from points, with links that are derived if they are not given."""
    every = list(lanes)
    for name, each in form.lanes.items():
        centre = np.array(each.points)
        width = np.broadcast_to(np.array(each.width, float), len(centre))
        limit = np.inf if each.speed_limit is None else each.speed_limit
        every.append(Lane(name, *lane_sides(centre, width), limit, each.successors or (), each.left, each.right))
    if not form.lanes:
        return every
    neighbours = derived_neighbours(every)
    for place in range(len(lanes), len(every)):
        lane, given = every[place], form.lanes[every[place].name]
        if given.successors is None:
            found = tuple(every[other].name for one, other in derived_links(every, 0.5) if one == place)
            lane = replace(lane, successors=found)
        left, right = (None if each < 0 else every[each].name for each in neighbours[place])
        every[place] = replace(lane, left_lane=given.left or left, right_lane=given.right or right)
    return every


def _regions(lanes: Sequence[Lane], centre: float | None) -> dict[str, Region]:
    """Return the regions of lanes and of their centres, each as an intersection of a single union.

    Only `LaneDrawing` draws such regions, and those of lanes alone, as those of centres are nested more deeply.
    """
    areas = {f"lane_{lane.name}": RegionShape(union=tuple(lane.areas())) for lane in lanes}
    strips: dict[str, RegionShape] = {}
    if centre is not None:
        for lane in lanes:
            strip = RegionShape(union=tuple(lane.strip(centre).areas()))
            strips[f"lane_{lane.name}{_CENTRE}"] = RegionShape(intersection=(strip,))
    regions = {name: Region(intersection=(shape,)) for name, shape in {**areas, **strips}.items()}
    return {"road": Region(intersection=(RegionShape(union=tuple(areas)),)), **regions}
