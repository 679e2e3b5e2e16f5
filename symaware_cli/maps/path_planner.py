"""The base of planners for single agents: their times of planning, outputs and events.

Reasons: docs/decisions/0086-planners.md
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from symaware_cli.core import AgentGroup, GroupComponent, Level, Obstacle
from symaware_cli.geometry import LARGEST, Array, DiscRadius, Number, Region
from symaware_cli.maps.floor import Floor
from symaware_cli.maps.path_progress import PathProgress
from symaware_cli.maps.planned_path import PlannedPath
from symaware_cli.specification import PlacedRegion
from symaware_cli.world import ParameterError
from symaware_cli.world import Parameters as PluginParameters

Distance = Annotated[float, Field(ge=0, le=LARGEST)]
Area = tuple[Number, Number, Number, Number]


class PathRequest(NamedTuple):
    """The inputs of an agent's plan, besides its position.

    Attributes:
        goal: The goal [m].
        closed: The names of the regions that the agent knows to be closed, ascending.
    """

    goal: tuple[float, ...]
    closed: tuple[str, ...]


class PathPlans(NamedTuple):
    """The result of a turn.

    Attributes:
        requests: The present request of each agent, by row.
        paths: The paths of the agents with new requests, by row.
        beliefs: The belief of each agent about the map, by row; empty if the planner knows the obstacles.
        progress: The progress of the agents, if the planner watches it.
    """

    requests: list[PathRequest]
    paths: dict[int, PlannedPath]
    beliefs: list[Array]
    progress: PathProgress | None = None


class PathPlanner(GroupComponent):
    """Plans paths of single agents, and writes each as ``waypoints`` and ``path_cost``.

    An agent plans in its first turn, and again when its `PathRequest` changes: its goal, or the regions that it knows
    to be ``closed``. The path leads around fixed obstacles; moving obstacles and other agents are ignored. The
    waypoints begin at its position and end at the goal. Without a path, the list is empty, so that the controller
    waits, its ``path_cost`` is -1, and ``goal-unreachable`` is fired; until it has a path again, it does not count
    among the agents that reached their goals.
    """

    #: In another process, the copy of the world there has the obstacles.
    sees_world = True

    #: The units that a search expands, for messages.
    unit: ClassVar[str] = "cells"

    knowledge: ClassVar = {"goal": "where to go, as a position [m]"}
    writes: ClassVar = {"waypoints": ()}
    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` and `length` [m] are those of the path, `expanded` the effort.",
        "goal-unreachable": "There is no path to the goal of an agent, or none was found within the limit.",
    }

    class Parameters(PluginParameters):
        """The body, the area, and closed regions."""

        radius: DiscRadius = None
        margin: Distance = Field(0.1, description="Margin by which that disc is widened [m].")
        closed: str = Field(
            "closed",
            min_length=1,
            description="The name of the knowledge, if an agent has it, with a list of regions that cannot be entered.",
        )
        within: Area | None = Field(
            None, description="The area to plan in: [x, x, y, y] [m]. By default the extent of the map."
        )

        @field_validator("within")
        @classmethod
        def _is_area(cls, within: Area | None) -> Area | None:
            if within is not None and (within[0] >= within[1] or within[2] >= within[3]):
                raise ValueError("the least of a coordinate is not below its greatest")
            return within

    def check(self, group: AgentGroup) -> None:
        """Check that goals are positions, and that closed regions exist."""
        goal = group.known("goal")
        if goal.ndim != 2 or goal.shape[1] != len(group.model.position) or goal.shape[1] != 2:
            raise ValueError("the knowledge `goal` of each agent must be a position of 2 numbers")
        for row in range(len(group)):
            for name in self._closed(group, row):
                region_of(group, name)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without a path."""
        super().initialise_component(group)
        self._requests: list[PathRequest | None] = [None] * len(group)
        #: The beliefs against which paths were last checked.
        self._compared: list[Array] = []

    def _radius_of(self, group: AgentGroup) -> float:
        """Return the radius of the widened disc that represents the body [m]."""
        return float((self.parameters.radius or group.entity.radius) + self.parameters.margin)

    @abstractmethod
    def _find(self, row: int, start: Array, request: PathRequest) -> PlannedPath:
        """Return the path of an agent from a position (2,) [m]."""

    def _compute(self) -> PathPlans:
        group = self._group
        goals = group.known("goal").tolist()
        requests = [PathRequest(tuple(goals[row]), self._closed(group, row)) for row in range(len(group))]
        positions = group.model.positions(group.awareness.state)
        # A search is a loop in Python anyway, and few agents need one in a turn.
        paths = {
            row: self._find(row, positions[row], request)
            for row, request in enumerate(requests)
            if request != self._requests[row] or self._is_outdated(row, positions[row])
        }
        return PathPlans(requests, paths, self._beliefs())

    def _update(self, value: PathPlans) -> None:
        for row, path in value.paths.items():
            known = self._group.knowledge[row]
            if np.isfinite(path.cost):
                known["waypoints"], known["path_cost"] = path.points.tolist(), path.cost
                legs = np.diff(path.points, axis=0)
                length = float(np.sqrt(legs[:, 0] ** 2 + legs[:, 1] ** 2).sum())
                said = f"found a path of {length:.4g} m"
                self.emit_for(row, "path-planned", said, cost=path.cost, length=length, expanded=path.expanded)
                continue
            is_new = value.requests[row] != self._requests[row] or known["path_cost"] != -1.0
            known["waypoints"], known["path_cost"] = [], -1.0
            if not is_new:
                continue
            reason = f"no path to its goal exists after {path.expanded} {self.unit}"
            if path.is_limited:
                reason = f"no path to its goal was found within {path.expanded} {self.unit}"
            self.emit_for(row, "goal-unreachable", reason, level=Level.WARNING, expanded=path.expanded)
        self._requests, self._compared = list(value.requests), list(value.beliefs)

    def _beliefs(self) -> list[Array]:
        """Return the belief of each agent about the map, by row; empty if the planner knows the obstacles."""
        return []

    def _is_outdated(self, row: int, position: Array) -> bool:
        """Return whether the path of an agent at a position (2,) [m] has to be planned again for the same request."""
        return False

    def _closed(self, group: AgentGroup, row: int) -> tuple[str, ...]:
        return closed_regions(group, row, self.parameters.closed)

    def _fixed(self) -> Mapping[str, Obstacle]:
        """Return the obstacles that do not move."""
        return fixed_obstacles(self.environment.obstacles)

    def _area(self, group: AgentGroup) -> Area:
        """Return the area to plan in: [x, x, y, y] [m]."""
        floor = floor_of_group(group)
        within: Area | None = self.parameters.within or (None if floor is None else floor.bounds)
        if within is None:
            raise ParameterError("the area to plan in is needed, as the map has no bounds", ("within",))
        return within


def fixed_obstacles(obstacles: Mapping[str, Obstacle]) -> dict[str, Obstacle]:
    """Return the obstacles that do not move."""
    return {name: each for name, each in obstacles.items() if not each.path and not each.is_free}


def floor_of_group(group: AgentGroup) -> Floor | None:
    """Return the map of the scenario, if it has one."""
    floor: Floor | None = group.sections.get("map")
    return floor


def closed_regions(group: AgentGroup, row: int, name: str) -> tuple[str, ...]:
    """Return the regions that an agent knows to be closed, ascending, from the knowledge with that name.

    Raises:
        ValueError: The value of the knowledge is not a list.
    """
    known: Any = group.knowledge[row].get(name, ())
    if isinstance(known, str) or not isinstance(known, Sequence):
        raise ValueError(f"the knowledge `{name}` is a list of names of regions")
    return tuple(sorted({str(each) for each in known}))


def region_of(group: AgentGroup, name: str) -> PlacedRegion:
    """Return a region to be closed.

    Raises:
        ValueError: There is no region of that name, or it moves.
    """
    region: Region | None = group.regions.get(name)
    if region is None:
        known = ", ".join(sorted(group.regions)) or "none"
        raise ValueError(f"there is no region `{name}` to be closed; there are: {known}")
    if region.around is not None:
        raise ValueError(f"the region `{name}` moves with an agent, and cannot be closed")
    return PlacedRegion(name, group.regions, _nowhere)


def _nowhere(agent: str) -> tuple[Array, float | Array | None]:
    return np.full(2, np.nan), None
