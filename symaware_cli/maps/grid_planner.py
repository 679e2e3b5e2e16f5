"""Planning of paths on a grid over the map.

Reasons: docs/decisions/0084-maps.md
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from symaware_cli.core import AgentGroup, GroupComponent, Level
from symaware_cli.geometry import LARGEST, Array, Number, Region
from symaware_cli.geometry.vectors import Mask
from symaware_cli.maps.floor import Floor
from symaware_cli.maps.path_search import GridPath, PathSearch
from symaware_cli.maps.planning_grid import MOST_CELLS, GridFrame, PlanningGrid
from symaware_cli.maps.raster import UNKNOWN
from symaware_cli.specification import PlacedRegion
from symaware_cli.world import ParameterError
from symaware_cli.world import Parameters as PluginParameters

Distance = Annotated[float, Field(ge=0, le=LARGEST)]


class PathRequest(NamedTuple):
    """What the path of an agent depends on, besides where it is.

    Attributes:
        goal: Its goal [m].
        closed: The names of the regions that it knows to be closed.
    """

    goal: tuple[float, ...]
    closed: tuple[str, ...]


class GridPlans(NamedTuple):
    """The result of a turn.

    Attributes:
        requests: What each agent asks for now, by row.
        paths: The paths of those that ask for something new, by row.
    """

    requests: list[PathRequest]
    paths: dict[int, GridPath]


class GridPlanner(GroupComponent):
    """Plans a path to the ``goal`` by A* on a grid, and writes it as ``waypoints`` and ``path_cost``.

    The grid is that of the map, or covers an area at a declared resolution. Its cells and moves are those on which a
    disc around the agent, widened by a margin, touches no fixed obstacle; so paths cut no corners. Costs are lengths,
    increased near obstacles (see `symaware_cli.maps.planning_grid`). Obstacles that move, and other agents, are not
    planned around; what steers the agent avoids them.

    An agent plans in its first turn, and again when its goal changes or the regions that it knows to be ``closed``.
    The waypoints begin where it is and end at the goal. If no path exists, or none is found within the greatest number
    of cells, it is to stay where it is: its waypoints are its own position (of a model with a heading, then a point
    1 cm ahead), its ``path_cost`` is -1, and ``goal-unreachable`` is fired; until it has a path again, it does not
    count among the agents that reached their goals.
    """

    #: In a process of its own, its copy of the world has the obstacles.
    sees_world = True

    knowledge: ClassVar = {
        "goal": "where to go, as a position [m]",
        "waypoints": "replaced by the path, as a list of positions [m]; anything that what follows them accepts",
    }
    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` and `length` [m] are those of the path, `expanded` the cells.",
        "goal-unreachable": "There is no path to the goal of an agent, or none was found within the limit.",
    }

    class Parameters(PluginParameters):
        """The grid, the body and the costs."""

        resolution: float | None = Field(
            None, gt=0, le=LARGEST, description="Side of the cells [m]. By default that of the map."
        )
        within: tuple[Number, Number, Number, Number] | None = Field(
            None, description="The area to plan in: [x, x, y, y] [m]. By default the extent of the map."
        )
        margin: Distance = Field(0.1, description="What the circle around the body is widened by [m].")
        comfort: Distance = Field(0.3, description="Distance from obstacles within which moves cost more [m].")
        clearance_weight: float = Field(
            2.0, ge=0, le=1e6, description="Additional cost per metre where the widened body touches an obstacle."
        )
        through_unknown: bool = Field(False, description="Whether paths may lead through unknown cells of the map.")
        closed: str = Field(
            "closed",
            min_length=1,
            description="The name of the knowledge, if an agent has it, with a list of regions that cannot be entered.",
        )
        most_cells: int = Field(
            200_000, ge=1, le=MOST_CELLS, description="The greatest number of cells that a search expands."
        )

        @field_validator("within")
        @classmethod
        def _is_area(cls, within: tuple[float, ...] | None) -> tuple[float, ...] | None:
            if within is not None and (within[0] >= within[1] or within[2] >= within[3]):
                raise ValueError("the least of a coordinate is not below its greatest")
            return within

    # The grids, which follow from the scenario.
    uncaptured = ("_searches", "_grid")

    def check(self, group: AgentGroup) -> None:
        """Check that there is a grid, that goals are positions, and that closed regions exist."""
        self._frame(group)
        goal = group.known("goal")
        if goal.ndim != 2 or goal.shape[1] != len(group.model.position) or goal.shape[1] != 2:
            raise ValueError("the knowledge `goal` of each agent must be a position of 2 numbers")
        for row in range(len(group)):
            for name in self._closed(group, row):
                self._region(group, name)

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the grid."""
        super().initialise_component(group)
        given, floor = self.parameters, self._floor(group)
        frame = self._frame(group)
        fixed = {name: each for name, each in self.environment.obstacles.items() if not each.path and not each.is_free}
        hidden: Mask | None = None
        if floor is not None and floor.raster is not None and not given.through_unknown:
            hidden = floor.raster.at(frame.centres()) == UNKNOWN
        radius = group.entity.radius + given.margin
        self._grid = PlanningGrid(frame, fixed, radius, given.comfort, given.clearance_weight, hidden)
        self._searches: dict[tuple[str, ...], PathSearch] = {}
        self._requests: list[PathRequest | None] = [None] * len(group)

    def _compute(self) -> GridPlans:
        group = self._group
        goals = group.known("goal").tolist()
        requests = [PathRequest(tuple(goals[row]), self._closed(group, row)) for row in range(len(group))]
        positions = group.model.positions(group.awareness.state)
        # A search is a loop in Python anyway, and few agents need one in a turn.
        paths = {
            row: self._search(request.closed).path(positions[row], np.array(request.goal), self.parameters.most_cells)
            for row, request in enumerate(requests)
            if request != self._requests[row]
        }
        return GridPlans(requests, paths)

    def _update(self, value: GridPlans) -> None:
        for row, path in value.paths.items():
            known = self._group.knowledge[row]
            if np.isfinite(path.cost):
                known["waypoints"], known["path_cost"] = path.points.tolist(), path.cost
                legs = np.diff(path.points, axis=0)
                length = float(np.sqrt(legs[:, 0] ** 2 + legs[:, 1] ** 2).sum())
                said = f"found a path of {length:.4g} m"
                self.emit_for(row, "path-planned", said, cost=path.cost, length=length, expanded=path.expanded)
                continue
            known["waypoints"], known["path_cost"] = self._staying(row).tolist(), -1.0
            reason = f"no path to its goal exists after {path.expanded} cells"
            if path.is_limited:
                reason = f"no path to its goal was found within {path.expanded} cells"
            self.emit_for(row, "goal-unreachable", reason, level=Level.WARNING, expanded=path.expanded)
        self._requests = list(value.requests)

    def _staying(self, row: int) -> Array:
        """Return waypoints at which an agent stays where it is."""
        model, state = self._group.model, self._group.awareness.state
        position: Array = model.positions(state)[row]
        if model.heading is None:
            return position[None]
        heading = state[row, model.heading]
        return np.stack([position, position + 0.01 * np.array([np.cos(heading), np.sin(heading)])])

    def _search(self, closed: tuple[str, ...]) -> PathSearch:
        """Return the search without some regions."""
        if closed not in self._searches:
            grid = self._grid
            if closed:
                # With moves on which the disc could reach into a region left out as well.
                reach = grid.radius + 0.5**0.5 * grid.frame.resolution
                hidden = np.zeros(len(grid.centres), bool)
                for name in closed:
                    region = self._region(self._group, name)
                    hidden |= region.robustness(grid.centres) > -reach
                grid = grid.without(hidden)
            self._searches[closed] = PathSearch(grid)
        return self._searches[closed]

    def _closed(self, group: AgentGroup, row: int) -> tuple[str, ...]:
        known: Any = group.knowledge[row].get(self.parameters.closed, ())
        if isinstance(known, str) or not isinstance(known, Sequence):
            raise ValueError(f"the knowledge `{self.parameters.closed}` is a list of names of regions")
        return tuple(sorted({str(each) for each in known}))

    def _region(self, group: AgentGroup, name: str) -> PlacedRegion:
        region: Region | None = group.regions.get(name)
        if region is None:
            known = ", ".join(sorted(group.regions)) or "none"
            raise ValueError(f"there is no region `{name}` to be closed; there are: {known}")
        if region.around is not None:
            raise ValueError(f"the region `{name}` moves with an agent, and cannot be closed")
        return PlacedRegion(name, group.regions, _nowhere)

    def _floor(self, group: AgentGroup) -> Floor | None:
        floor: Floor | None = group.sections.get("map")
        return floor

    def _frame(self, group: AgentGroup) -> GridFrame:
        """Return where the cells are."""
        given, floor = self.parameters, self._floor(group)
        raster = None if floor is None else floor.raster
        side = given.resolution or (raster.resolution if raster is not None else None)
        if side is None:
            raise ParameterError(
                "the side of the cells is needed, as the scenario has no map of cells", ("resolution",)
            )
        if raster is not None and given.within is None:
            width, height = raster.cells.shape[1] * raster.resolution, raster.cells.shape[0] * raster.resolution
            origin, yaw = raster.origin, raster.yaw
        else:
            within = given.within or (None if floor is None else floor.bounds)
            if within is None:
                raise ParameterError("the area to plan in is needed, as the map has no bounds", ("within",))
            origin, yaw = (within[0], within[2]), 0.0
            width, height = within[1] - within[0], within[3] - within[2]
        # As many cells as cover the area, but none for a rounding error.
        shape = (max(1, int(np.ceil(height / side - 1e-6))), max(1, int(np.ceil(width / side - 1e-6))))
        if shape[0] * shape[1] > MOST_CELLS:
            said = f"the grid would have {shape[0]} x {shape[1]} cells, and may have {MOST_CELLS:,}"
            raise ParameterError(said, ("resolution",))
        return GridFrame(origin, yaw, side, shape)


def _nowhere(agent: str) -> tuple[Array, float | Array | None]:
    return np.full(2, np.nan), None
