"""The base of planners of paths that are not bound to the cells of a grid.

Reasons: docs/decisions/0095-planners-off-the-grid.md
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup
from symaware_cli.geometry import Array
from symaware_cli.maps.floor import boxes_of
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.path_planner import PathPlanner, PathRequest, floor_of_group, region_of
from symaware_cli.maps.planned_path import PlannedPath, no_path, polyline
from symaware_cli.maps.raster import UNKNOWN
from symaware_cli.maps.rectangles import merged
from symaware_cli.specification import PlacedRegion

#: Distances from obstacles are computed up to this limit, relative to the greater extent of the area.
_REACH = 0.05


class FreePlanner(PathPlanner):
    """Plans paths in an area on which the body touches no obstacle; unknown cells of the map count as obstacles."""

    class Parameters(PathPlanner.Parameters):
        """The body, the area, and closed regions."""

        through_unknown: bool = Field(
            False, description="Whether paths may lead through unknown cells of the map. If not, they are obstacles."
        )

    uncaptured: ClassVar[tuple[str, ...]] = ("_space", "_area_within")

    def check(self, group: AgentGroup) -> None:
        """Check that there is an area, that goals are positions, and that closed regions exist."""
        self._area(group)
        super().check(group)

    def initialise_component(self, group: AgentGroup) -> None:
        """Place the obstacles."""
        super().initialise_component(group)
        self._area_within = self._area(group)
        west, east, south, north = self._area_within
        obstacles, floor = dict(self._fixed()), floor_of_group(group)
        if floor is not None and floor.raster is not None and not self.parameters.through_unknown:
            unknown = merged(floor.raster.cells == UNKNOWN)
            obstacles |= {
                f"unknown {number}": box for number, box in enumerate(boxes_of(floor.raster, unknown, height=1.0))
            }
        radius = self._radius_of(group)
        self._space = FreeSpace(obstacles, radius, radius + _REACH * max(east - west, north - south))

    def _is_within(self, position: Array) -> bool:
        west, east, south, north = self._area_within
        return bool(west <= position[0] <= east and south <= position[1] <= north)

    def _regions(self, closed: tuple[str, ...]) -> list[PlacedRegion]:
        return [region_of(self._group, name) for name in closed]


class SamplingPlanner(FreePlanner):
    """Plans paths between positions by way of random positions in the area.

    If the body is nearer to an obstacle than the `margin` at its start, the path first leads away from the obstacle; if
    it is at its goal, the end of the path leads up to the obstacle.
    """

    def _find(self, row: int, start: Array, request: PathRequest) -> PlannedPath:
        space, goal, regions = self._space, np.array(request.goal), self._regions(request.closed)
        first, last = space.freed(start), space.freed(goal)
        if first is None or last is None or not self._is_within(goal):
            return no_path(0)
        if space.clear(first[None], last[None])[0] and space.outside(first[None], last[None], regions)[0]:
            found = PlannedPath(np.stack([first, last]), float(np.sqrt(((last - first) ** 2).sum())), 0, False)
        else:
            found = self._between(row, first, last, request)
        if not np.isfinite(found.cost):
            return found
        points = polyline([start[None], found.points, goal[None]])
        beside = sum(float(np.sqrt(((one - other) ** 2).sum())) for one, other in ((start, first), (goal, last)))
        return found._replace(points=points, cost=found.cost + beside)

    @abstractmethod
    def _between(self, row: int, start: Array, goal: Array, request: PathRequest) -> PlannedPath:
        """Return the path of an agent between positions that its body fits in, (2,) each [m].

        Called if the straight line between them is blocked.
        """

    @property
    def _extent(self) -> float:
        """The area to plan in [m^2]."""
        west, east, south, north = self._area_within
        return (east - west) * (north - south)

    def _placed(self, shares: Array) -> Array:
        """Return the positions in the area of shares of its width and height, (m, 2) each [m]."""
        west, east, south, north = self._area_within
        return np.array([west, south]) + shares * [east - west, north - south]
