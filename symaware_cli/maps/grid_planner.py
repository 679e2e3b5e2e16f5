"""Planning of paths on a grid over the map.

Reasons: docs/decisions/0084-maps.md, docs/decisions/0110-held-up-on-a-path.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Obstacle, ScenarioView
from symaware_cli.engine import ScanOptions, ScanSurfaces, check_scan
from symaware_cli.geometry import LARGEST, Array
from symaware_cli.geometry.vectors import Mask
from symaware_cli.maps.believed_floor import BelievedFloor, rest_of_path
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.map_perception import MAP, MapPerception
from symaware_cli.maps.path_planner import Distance, PathPlanner, PathPlans, PathRequest, floor_of_group, region_of
from symaware_cli.maps.path_progress import PathProgress, lengths_left
from symaware_cli.maps.path_search import PathSearch
from symaware_cli.maps.planned_path import PlannedPath
from symaware_cli.maps.planning_grid import MOST_CELLS, GridFrame, PlanningGrid
from symaware_cli.maps.raster import UNKNOWN
from symaware_cli.world import ParameterError, nanoseconds


class GridPlanner(PathPlanner):
    """Plans a path to the ``goal`` by A* on a grid, and writes it as ``waypoints`` and ``path_cost``.

    The grid is that of the map, or covers an area at a declared resolution. Its cells and moves are those on which a
    disc around the agent, widened by a margin, touches no fixed obstacle; so paths cut no corners. Costs are lengths,
    increased near obstacles (see `symaware_cli.maps.planning_grid`); where they are lengths alone, because
    `clearance_weight` or `comfort` is 0, the search is by jump points (`symaware_cli.maps.jump_points`), which finds
    paths of the same cost and expands fewer cells. Plans ignore moving obstacles and other agents; the controller has
    to avoid them.

    With `on`, agents do not know the obstacles, but only their beliefs about the map: the occupied areas of a
    `perception.map`. Unknown areas count as free. When the belief has changed, an agent plans again if its disc would
    touch an area on the rest of its path, or if it has no path.

    With `scan`, agents see each other, and whatever else is not known, by a lidar. One that has come hardly nearer to
    its goal for the time `patience` plans again, around everything that its lidar sees at that moment; if there is no
    such path, it keeps to its present one.

    An agent plans in its first turn, and again when its goal or its knowledge of ``closed`` regions changes. The
    waypoints begin where it is and end at the goal. If no path exists, or none is found within the greatest number of
    cells, its list of waypoints is empty, its ``path_cost`` is -1, and ``goal-unreachable`` is fired; until it has a
    path again, it does not count among the agents that reached their goals.
    """

    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` and `length` [m] are those of the path, `expanded` the cells.",
        "goal-unreachable": "There is no path to the goal of an agent, or none was found within the limit.",
    }

    class Parameters(PathPlanner.Parameters):
        """The grid, the body and the costs."""

        resolution: float | None = Field(
            None, gt=0, le=LARGEST, description="Side of the cells [m]. By default that of the map."
        )
        comfort: Distance = Field(0.3, description="Distance from obstacles within which moves cost more [m].")
        clearance_weight: float = Field(
            2.0, ge=0, le=1e6, description="Additional cost per metre where the widened body touches an obstacle."
        )
        on: str | None = Field(
            None,
            min_length=1,
            description="The `perception.map` on whose belief to plan. By default all fixed obstacles are known.",
        )
        scan: str | None = Field(
            None, min_length=1, description="The lidar that shows what holds an agent up, to be planned around."
        )
        patience: float = Field(
            5.0, gt=0, le=LARGEST, description="Time without progress after which an agent plans around it [s]."
        )
        through_unknown: bool | None = Field(
            None, description="Whether paths may lead through unknown cells. By default only through those of a belief."
        )
        most_cells: int = Field(
            200_000, ge=1, le=MOST_CELLS, description="The greatest number of cells that a search expands."
        )

    # The grids, which follow from the scenario.
    uncaptured = ("_searches", "_grid", "_cells")

    def check(self, group: AgentGroup) -> None:
        """Check that there is a grid, that goals are positions, and that closed regions exist."""
        self._frame(group)
        super().check(group)

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that the belief and the scan exist."""
        check_scan(view, self.parameters.scan)
        name = self.parameters.on
        if name is None:
            return
        own = {each.name: each for each in view.own_entries}
        if name not in own:
            known = [each.name for each in view.own_entries if isinstance(each.components[0], MapPerception)]
            view.report_unknown("component", name, "with", "on", known=known)
        elif not isinstance(own[name].components[0], MapPerception):
            view.report(f"`{name}` is no belief about the map, but a `{own[name].use}`", "with", "on")

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the grid, unless it depends on beliefs."""
        super().initialise_component(group)
        scan = self.parameters.scan
        self._surfaces = None if scan is None else ScanSurfaces(scan, ScanOptions(), self._radius)
        self._progress = PathProgress.none(len(group))
        floor, self._cells = floor_of_group(group), self._frame(group)
        self._searches: dict[tuple[str, ...], PathSearch] = {}
        self._grid: PlanningGrid | None = None
        if self.parameters.on is None:
            hidden: Mask | None = None
            if floor is not None and floor.raster is not None and not self.parameters.through_unknown:
                hidden = floor.raster.at(self._cells.centres()) == UNKNOWN
            self._grid = self._grid_of(self._fixed(), hidden)

    def _compute(self) -> PathPlans:
        plans = super()._compute()
        group = self._group
        if self._surfaces is None or not all("waypoints" in known for known in group.knowledge):
            return plans
        positions = group.model.positions(group.awareness.state)
        left = lengths_left(*group.known_lists("waypoints"), positions)
        progress = self._progress.restarted(np.array(list(plans.paths), np.intp), self.now)
        progress = progress.after(left, self.now, self._radius)
        # Whoever is nearer than its radius only waits for its place to become free.
        late = (self.now - progress.since >= nanoseconds(self.parameters.patience)) & (left > self._radius)
        held_up = np.flatnonzero(late)
        for row in held_up.tolist():
            path = self._search_of(row, plans.requests[row], self._seen(row)).path(
                positions[row], np.array(plans.requests[row].goal), self.parameters.most_cells
            )
            if np.isfinite(path.cost):
                plans.paths[row] = path
        return plans._replace(progress=progress.restarted(held_up, self.now))

    def _update(self, value: PathPlans) -> None:
        super()._update(value)
        if self._surfaces is not None and value.progress is not None:
            self._surfaces.remember(
                self._group, self.computed_at, self._surfaces.returns(self._group, self.computed_at)
            )
            self._progress = value.progress

    def _seen(self, row: int) -> Array:
        """Return the points that the last scan of an agent hit [m]; shape (k, 2)."""
        assert self._surfaces is not None
        points = self._surfaces.returns(self._group, self.now).points[row]
        seen: Array = points[np.isfinite(points).all(axis=1)]
        return seen

    def _find(self, row: int, start: Array, request: PathRequest) -> PlannedPath:
        return self._search_of(row, request).path(start, np.array(request.goal), self.parameters.most_cells)

    def _search_of(self, row: int, request: PathRequest, seen: Array | None = None) -> PathSearch:
        """Return the search for an agent, whose paths also avoid points that it sees (k, 2) [m]."""
        if self._grid is None:
            believed, hidden = BelievedFloor(self._beliefs()[row]), None
            if self.parameters.through_unknown is False:
                hidden = ~believed.is_free(self._cells.centres())
            grid = self._grid_of(believed.obstacles(), hidden)
        elif seen is None:
            return self._search(self._grid, request.closed)
        else:
            grid = self._grid
        if seen is not None:
            grid = grid.without(grid.near(seen))
        return PathSearch(without_regions(grid, self._group, request.closed))

    def _beliefs(self) -> list[Array]:
        if self.parameters.on is None:
            return []
        tables: list[Array] = list(self._group.awareness[MAP.field(self.parameters.on)])
        return tables

    def _is_outdated(self, row: int, position: Array) -> bool:
        beliefs = self._beliefs()
        if not beliefs or np.array_equal(beliefs[row], self._compared[row]):
            return False
        waypoints = np.array(self._group.knowledge[row]["waypoints"], float).reshape(-1, 2)
        if not len(waypoints):
            return True
        rest = rest_of_path(waypoints, position)
        space = FreeSpace(BelievedFloor(beliefs[row]).obstacles(), self._radius, 2.0 * self._radius)
        here = min(self._radius, max(float(space.clearances(position[None])[0]), 0.0))
        is_free = space.clear(rest[:1], rest[1:2], here).all() and space.clear(rest[1:-1], rest[2:]).all()
        return not is_free

    @property
    def _radius(self) -> float:
        """The radius of the disc [m]."""
        return self._radius_of(self._group)

    def _grid_of(self, obstacles: Mapping[str, Obstacle], hidden: Mask | None) -> PlanningGrid:
        given = self.parameters
        return PlanningGrid(self._cells, obstacles, self._radius, given.comfort, given.clearance_weight, hidden)

    def _search(self, grid: PlanningGrid, closed: tuple[str, ...]) -> PathSearch:
        """Return the search on the grid without some regions."""
        if closed not in self._searches:
            self._searches[closed] = PathSearch(without_regions(grid, self._group, closed))
        return self._searches[closed]

    def _frame(self, group: AgentGroup) -> GridFrame:
        """Return the frame of the grid."""
        given, floor = self.parameters, floor_of_group(group)
        raster = None if floor is None else floor.raster
        side = given.resolution or (raster.resolution if raster is not None else None)
        if side is None:
            raise ParameterError(
                "the side of the cells is needed, as the scenario has no map of cells", ("resolution",)
            )
        if raster is not None and given.within is None:
            width, height = raster.cells.shape[1] * raster.resolution, raster.cells.shape[0] * raster.resolution
            return frame_of(raster.origin, raster.yaw, side, width, height)
        within = self._area(group)
        return frame_of((within[0], within[2]), 0.0, side, within[1] - within[0], within[3] - within[2])


def without_regions(grid: PlanningGrid, group: AgentGroup, closed: Sequence[str]) -> PlanningGrid:
    """Return a grid without the cells and moves on which the disc could reach into regions, given by their names."""
    if not closed:
        return grid
    reach = grid.radius + 0.5**0.5 * grid.frame.resolution
    hidden = np.zeros(len(grid.centres), bool)
    for name in closed:
        hidden |= region_of(group, name).robustness(grid.centres) > -reach
    return grid.without(hidden)


def frame_of(origin: tuple[float, float], yaw: float, side: float, width: float, height: float) -> GridFrame:
    """Return the frame of a grid that covers a rectangle.

    Args:
        origin: The lower left corner of the rectangle [m].
        yaw: The direction of the rows [rad].
        side: The side of the cells [m].
        width: The extent along the rows [m].
        height: The extent across the rows [m].

    Raises:
        ParameterError: There would be too many cells.
    """
    # Enough cells to cover the area, but no additional one because of a rounding error.
    shape = (max(1, int(np.ceil(height / side - 1e-6))), max(1, int(np.ceil(width / side - 1e-6))))
    if shape[0] * shape[1] > MOST_CELLS:
        said = f"the grid would have {shape[0]} x {shape[1]} cells, and may have {MOST_CELLS:,}"
        raise ParameterError(said, ("resolution",))
    return GridFrame(origin, yaw, side, shape)
