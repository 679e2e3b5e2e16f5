"""Scenery: the entities of the environment, and the ground."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import REGION_COLOURS, Region, RegionShape, about
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.outline import Piece, outlines
from symaware_cli.views.palette import REGIONS
from symaware_cli.views.region_windows import phases
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Ground, Solid
from symaware_cli.views.views import ObstacleView, RunView

Array = NDArray[np.float64]

#: Height of obstacles without a height in spatial worlds [m].
_HEIGHT = 2.0
#: Share of the background in the colour of obstacles that do not move.
_FADED = 0.45


class SceneryDrawing(Drawing):
    """Draws walls, boxes and other obstacles as solid bodies, flat in planar worlds; and the ground."""

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 10

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._begun = False

    def marks(self, chunk: Chunk) -> Iterator[Solid | Ground]:
        """Yield obstacles without a figure: at the beginning, and whenever one moves."""
        start = np.array([chunk.start])
        if not self._begun and self.run_view.ground is not None:
            yield Ground(path="world/ground", times=start, height=self.run_view.ground)
        for obstacle_view in self.run_view.obstacle_views.values():
            if obstacle_view.figure is not None:
                continue
            frames = chunk.frames.get(f"/world/{obstacle_view.name}/state")
            if not self._begun and (frames is None or chunk.start not in frames.times[:1]):
                yield self._solid(obstacle_view, start, obstacle_view.position[None], np.array([obstacle_view.heading]))
            if frames is not None and len(frames.times):
                values = frames.values[:, 0]
                yield self._solid(obstacle_view, frames.times, obstacle_view.positions(values), values[:, -1])
        self._begun = True

    def _solid(self, obstacle_view: ObstacleView, times: NDArray[np.int64], positions: Array, headings: Array) -> Solid:
        low, high = self._extent(obstacle_view)
        return Solid(
            path=f"world/scenery/{obstacle_view.name}",
            layer="scenery",
            times=times,
            name=obstacle_view.name,
            pieces=obstacle_view.shape.pieces,
            low=low,
            high=high,
            colour=obstacle_view.colour,
            faded=0.0 if obstacle_view.moves else _FADED,
            positions=positions,
            orientations=about((0.0, 0.0, 1.0), headings),
            movable=obstacle_view.movable,
        )

    def _extent(self, obstacle_view: ObstacleView) -> tuple[float, float]:
        """Return the lower and upper end of an obstacle [m]; in planar worlds it is just below the agents."""
        if not self.run_view.is_spatial:
            return -0.05, -0.05
        height = _HEIGHT
        if obstacle_view.shape.box and obstacle_view.shape.box.height:
            height = obstacle_view.shape.box.height
        elif obstacle_view.shape.cylinder:
            height = obstacle_view.shape.cylinder.height
        return (0.0, height) if obstacle_view.stands else (-0.5 * height, 0.5 * height)


#: Offset of regions below a planar world, so that bodies are drawn above them [m].
_BELOW = -0.5
#: Offset of a smaller region above a larger one [m].
_STEP = 0.01
_TRANSPARENCY = 0.7


def region_pieces(region: RegionShape, regions: Mapping[str, Region]) -> list[Piece]:
    """Return the primitives whose union is a region; empty for intersections and complements."""
    if region.box is not None:
        if len(region.box) < 4:
            return []
        west, east, south, north = region.box[:4]
        return [([(west, south), (east, south), (east, north), (west, north)], 0.0)]
    if region.circle is not None:
        return [([region.circle.centre[:2]], region.circle.radius)]
    if region.polygon is not None:
        return [(region.polygon, 0.0)]
    members = [regions[each] if isinstance(each, str) else each for each in region.union or ()]
    return [piece for member in members for piece in region_pieces(member, regions)]


def _size(pieces: list[Piece]) -> float:
    """Return the longer side of the bounding box of pieces [m]."""
    return float(np.ptp(np.concatenate(outlines(pieces)), axis=0).max())


class RegionsDrawing(Drawing):
    """Draws the regions of a scenario, and whether what specifications say of them is to come, counts, or is past."""

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 20

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        found = {name: region_pieces(region, run_view.regions) for name, region in run_view.regions.items()}
        # The largest is drawn lowest, so that all are visible.
        drawn = sorted((name for name in found if found[name]), key=lambda name: _size(found[name]), reverse=True)
        self._found = {name: found[name] for name in drawn}
        named: Mapping[str, tuple[int, int, int]] = {str(each): tint for each, tint in REGION_COLOURS.items()}
        self._colours = {
            name: named.get(run_view.regions[name].colour or name, REGIONS[number % len(REGIONS)])
            for number, name in enumerate(drawn)
        }
        self._begun, self._end = False, 0

    def marks(self, chunk: Chunk) -> Iterator[Solid]:
        """Yield static regions at the beginning, and moving ones at each instant."""
        for name, found in self._found.items():
            region = self.run_view.regions[name]
            if region.around is None:
                times = self._moments(name, chunk)
                if len(times):
                    yield self._solid(name, found, times, np.zeros((len(times), 3)), np.zeros(len(times)))
                continue
            group, row = self.run_view.place[region.around]
            group_view = self.run_view.group_views[group]
            frames = chunk.frames.get(group_view.state_topic)
            if frames is not None and len(frames.times):
                headings = np.zeros(len(frames.times))
                if group_view.heading is not None and region.turns:
                    headings = frames.values[:, row, group_view.heading]
                yield self._solid(name, found, frames.times, self.places(region.around, frames.times, chunk), headings)
        self._begun, self._end = True, chunk.end

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield how an area shows when specifications about it count."""
        if self.run_view.windows:
            yield "areas", "filled while a specification about them counts; dashed before, faint after"

    def _moments(self, name: str, chunk: Chunk) -> NDArray[np.int64]:
        """Return the instants of a chunk from which on a static region is drawn, or drawn otherwise [ns]."""
        changes = {chunk.start} if not self._begun else set()
        for start, end in self.run_view.windows.get(name, ()):
            changes |= {start} if end is None else {start, end + 1}
        first = chunk.start if not self._begun else self._end + 1
        return np.array(sorted(time for time in changes if first <= time <= chunk.end), np.int64)

    def _solid(
        self, name: str, pieces: list[Piece], times: NDArray[np.int64], positions: Array, headings: Array
    ) -> Solid:
        number = list(self._found).index(name)
        level = _BELOW + _STEP * number
        corners = np.concatenate(outlines(pieces))
        # Agents that are to be in an area, or that it is around, would hide a label in its middle.
        middle, top = corners.mean(axis=0), corners[:, 1].max()
        is_aside = name in self.run_view.windows or self.run_view.regions[name].around is not None
        return Solid(
            path=f"world/regions/{name}",
            layer="regions",
            times=times,
            name=name,
            pieces=pieces,
            low=level,
            high=level,
            colour=self._colours[name],
            transparency=_TRANSPARENCY,
            phases=phases(self.run_view.windows[name], times) if name in self.run_view.windows else None,
            label=name,
            label_at=(float(middle[0]), float(top if is_aside else middle[1])),
            positions=positions,
            orientations=about((0.0, 0.0, 1.0), headings),
        )
