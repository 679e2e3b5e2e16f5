"""Planners for teams: paths on a grid that agents follow at the same time without contact.

Reasons: docs/decisions/0086-planners.md
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from itertools import groupby
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from symaware_cli.core import AgentGroup, GroupComponent, Level
from symaware_cli.geometry import LARGEST, Array
from symaware_cli.geometry.vectors import Indices, Mask
from symaware_cli.maps.conflict_search import ConflictSearch
from symaware_cli.maps.grid_planner import frame_of, without_regions
from symaware_cli.maps.path_planner import (
    Area,
    Distance,
    PathRequest,
    closed_regions,
    fixed_obstacles,
    floor_of_group,
    region_of,
)
from symaware_cli.maps.planning_grid import MOVES, GridFrame, PlanningGrid
from symaware_cli.maps.prioritised_search import prioritised_paths
from symaware_cli.maps.raster import UNKNOWN
from symaware_cli.maps.space_time import Neighbours, PlanningTeam, TeamPaths
from symaware_cli.world import SECOND, ParameterError, nanoseconds
from symaware_cli.world import Parameters as PluginParameters

#: The greatest number of cells: distances from each goal are computed for all of them.
MOST_CELLS = 100_000

#: Positions nearer to each other than this are the same [m].
_TINY = 1e-9

#: Straight moves: the bits of `PlanningGrid.moves`.
_STRAIGHT = (0, 2, 4, 6)


class Schedule(NamedTuple):
    """The planned positions of a team at the ends of equal steps, between which velocities are constant.

    Attributes:
        begin: The time at which the schedule begins [ns].
        points: The position of each agent at each step [m]; shape (n, s + 1, 2).
        cells: The cell of each agent at each step, -1 where it is at no centre of a cell; shape (n, s + 1).
    """

    begin: int
    points: Array
    cells: Array


class TeamPlan(NamedTuple):
    """The result of a turn with new requests.

    Attributes:
        requests: The request of each agent, by row.
        schedule: The steps until the plan begins, and the plan; without a plan, the agents stop after these steps.
        lead: The number of steps of the previous schedule that precede the plan.
        found: The result of the search.
    """

    requests: list[PathRequest]
    schedule: Schedule
    lead: int
    found: TeamPaths


class TeamPlanner(GroupComponent):
    """Plans paths of all agents of a group at once, on which they are never in contact with each other.

    Time is divided into steps, in each of which an agent moves to one of the four cells beside its own or waits; each
    cell holds one agent at most, and no two agents exchange cells. Two agents are nearest while one enters a cell that
    the other leaves around a corner: at the side of the cells divided by the square root of 2. So cells have at least
    the side 2 sqrt(2) (r + margin), with the radius r of the circle around the body, and agents that keep within the
    `margin` of their schedule do not touch.

    In a first step all agents move to the centres of cells, and in a last step from there to their goals; each of these
    steps is left out if it moves nobody.

    ``timed_waypoints`` is the schedule of each agent as a list of [t, x, y], which `control.timed-waypoints` follows,
    and ``waypoints`` its positions. ``path_cost`` is the time that the agent takes [s]. The agents plan together in the
    first turn, and again when the goal of an agent or its knowledge of ``closed`` regions changes; a new plan begins at
    the end of a step of the previous one.

    Without a plan all agents wait, at the ends of their present steps if they are moving; the ``path_cost`` is -1, and
    ``goal-unreachable`` says why.
    """

    sees_world = True

    knowledge: ClassVar = {"goal": "where to go, as a position [m]"}
    writes: ClassVar = {"waypoints": (), "timed_waypoints": ()}
    events: ClassVar = {
        "path-planned": "An agent has a path; `cost` [s] is the time that it takes, `team_cost` [s] that of all agents "
        "together, `expanded` the nodes of the search.",
        "goal-unreachable": "There is no plan for the team, or none was found within the limits.",
    }

    class Parameters(PluginParameters):
        """The grid, the speed and the body."""

        speed: float = Field(1.0, gt=0, le=LARGEST, description="Speed of moves [m/s].")
        margin: Distance = Field(
            0.05, description="Greatest distance of agents from their schedules without a contact [m]."
        )
        resolution: float | None = Field(
            None, gt=0, le=LARGEST, description="Side of the cells [m]. By default the least that bodies allow."
        )
        within: Area | None = Field(
            None, description="The area to plan in: [x, x, y, y] [m]. By default the extent of the map."
        )
        closed: str = Field(
            "closed",
            min_length=1,
            description="The name of the knowledge, if an agent has it, with a list of regions that cannot be entered.",
        )

        @field_validator("within")
        @classmethod
        def _is_area(cls, within: Area | None) -> Area | None:
            if within is not None and (within[0] >= within[1] or within[2] >= within[3]):
                raise ValueError("the least of a coordinate is not below its greatest")
            return within

    # The grid, which follows from the scenario.
    uncaptured = ("_grid", "_graphs")

    def check(self, group: AgentGroup) -> None:
        """Check that there is a grid, that its cells are large enough, and that goals are positions."""
        self._frame(group)
        goal = group.known("goal")
        if goal.ndim != 2 or goal.shape[1] != len(group.model.position) or goal.shape[1] != 2:
            raise ValueError("the knowledge `goal` of each agent must be a position of 2 numbers")
        for row in range(len(group)):
            for name in closed_regions(group, row, self.parameters.closed):
                region_of(group, name)

    def initialise_component(self, group: AgentGroup) -> None:
        """Compute the grid."""
        super().initialise_component(group)
        floor, frame = floor_of_group(group), self._frame(group)
        hidden: Mask | None = None
        if floor is not None and floor.raster is not None:
            hidden = floor.raster.at(frame.centres()) == UNKNOWN
        radius = group.entity.radius + self.parameters.margin
        self._grid = PlanningGrid(frame, fixed_obstacles(self.environment.obstacles), radius, 0.0, 0.0, hidden)
        self._graphs: dict[tuple[str, ...], Neighbours] = {}
        self._step = nanoseconds(frame.resolution / self.parameters.speed)
        self._requests: list[PathRequest] = []
        self._schedule: Schedule | None = None
        #: How long the last plan took [ns].
        self._delay = 0

    @abstractmethod
    def _search(self, team: PlanningTeam) -> TeamPaths:
        """Return paths of the team."""

    def _compute(self) -> TeamPlan | None:
        group = self._group
        goals: list[Any] = group.known("goal").tolist()
        requests = [
            PathRequest(tuple(goals[row]), closed_regions(group, row, self.parameters.closed))
            for row in range(len(group))
        ]
        if requests == self._requests:
            return None
        lead, before, here = self._beginning()
        graphs = [self._graph(request.closed) for request in requests]
        ends = np.array(goals)
        try:
            starts = before.cells[:, -1].tolist()
            if -1 in starts:
                starts = self._cells(here, graphs, "begins")
            stops = self._cells(ends, graphs, "is to go")
            self._check_legs(here, self._grid.centres[starts], "their places to the centres of cells")
            self._check_legs(self._grid.centres[stops], ends, "the centres of cells to their goals")
            found = self._search(PlanningTeam(graphs, starts, stops, group.ids))
        except _UnplannableError as error:
            found = TeamPaths([], 0, str(error), error.row)
        schedule = before if found.failure else self._continued(before, here, found, ends)
        return TeamPlan(requests, schedule, lead, found)

    def _update(self, value: TeamPlan | None) -> None:
        if value is None:
            return
        schedule = value.schedule
        self._delay = self.now - self.computed_at
        if self.now > schedule.begin + value.lead * self._step:
            if value.lead:
                return  # the agents have passed the begin of this plan, so they plan again, further ahead
            schedule = schedule._replace(begin=self.now)
        self._requests, self._schedule = value.requests, schedule
        points, moves = schedule.points, (np.diff(schedule.points, axis=1) != 0.0).any(axis=2)
        # The number of steps after which each agent rests.
        arrivals = (moves * np.arange(1, moves.shape[1] + 1)).max(axis=1, initial=0).tolist()
        costs = [max(arrival - value.lead, 0) * self._step / SECOND for arrival in arrivals]
        for row, arrival in enumerate(arrivals):
            known = self._group.knowledge[row]
            timed = self._timed(schedule.begin, points[row, : arrival + 1])
            known["timed_waypoints"] = timed
            known["waypoints"] = [place for place, _ in groupby(each[1:] for each in timed)]
            found = value.found
            if found.failure:
                known["path_cost"] = -1.0
                self.emit_for(row, "goal-unreachable", found.failure, level=Level.WARNING, expanded=found.nodes)
                continue
            known["path_cost"] = costs[row]
            said = f"found a path that takes {costs[row]:.4g} s"
            self.emit_for(row, "path-planned", said, cost=costs[row], team_cost=sum(costs), expanded=found.nodes)

    def _timed(self, begin: int, points: Array) -> list[list[float]]:
        """Return the points of an agent with their times [s], without those that it passes at constant velocity."""
        legs = np.diff(points, axis=0)
        kept = np.ones(len(points), bool)
        kept[1:-1] = (np.abs(legs[1:] - legs[:-1]) > 1e-9).any(axis=1)
        times = (begin + np.flatnonzero(kept) * self._step) / SECOND
        return [[time, x, y] for time, (x, y) in zip(times.tolist(), points[kept].tolist(), strict=True)]

    def _beginning(self) -> tuple[int, Schedule, Array]:
        """Return the steps and the positions from which a new plan begins.

        Returns:
            The number of steps of the present schedule until then, these steps as a schedule, and the positions of
            the agents then, (n, 2) [m].
        """
        now, schedule = self.now, self._schedule
        if schedule is not None:
            steps = schedule.points.shape[1] - 1
            if now < schedule.begin + steps * self._step:
                lead = min(steps, -(-(now + self._delay - schedule.begin) // self._step))
                first = (now - schedule.begin) // self._step
                kept = slice(first, lead + 1)
                begin = schedule.begin + first * self._step
                rest = Schedule(begin, schedule.points[:, kept], schedule.cells[:, kept])
                return lead - first, rest, schedule.points[:, lead]
        here = self._group.model.positions(self._group.awareness.state)[:, :2].copy()
        return 0, Schedule(now, here[:, None], np.full((len(here), 1), -1)), here

    def _continued(self, before: Schedule, here: Array, found: TeamPaths, ends: Array) -> Schedule:
        """Return a schedule that goes on with paths of cells."""
        longest = max(len(path) for path in found.paths)
        cells = np.array([[*path, *[path[-1]] * (longest - len(path))] for path in found.paths], np.intp)
        points = self._grid.centres[cells]
        if before.cells[:, -1].tolist() == cells[:, 0].tolist() or np.abs(here - points[:, 0]).max() <= _TINY:
            cells, points = cells[:, 1:], points[:, 1:]
        if np.abs(ends - (points[:, -1] if points.shape[1] else here)).max() > _TINY:
            cells = np.concatenate([cells, np.full((len(cells), 1), -1)], axis=1)
            points = np.concatenate([points, ends[:, None]], axis=1)
        return Schedule(
            before.begin,
            np.concatenate([before.points, points], axis=1),
            np.concatenate([before.cells, cells], axis=1),
        )

    def _graph(self, closed: tuple[str, ...]) -> Neighbours:
        """Return the graph of cells outside of some regions."""
        if closed not in self._graphs:
            grid = without_regions(self._grid, self._group, closed)
            columns = grid.frame.shape[1]
            changes = [(bit, MOVES[bit][1] * columns + MOVES[bit][0]) for bit in _STRAIGHT]
            self._graphs[closed] = [
                [cell + change for bit, change in changes if moves >> bit & 1]
                for cell, moves in enumerate(grid.moves.tolist())
            ]
        return self._graphs[closed]

    def _cells(self, places: Array, graphs: Sequence[Neighbours], what: str) -> list[int]:
        """Return the cell of each agent: the nearest one that its body fits in and a straight line leads to.

        Raises:
            _UnplannableError: An agent has no such cell, or two agents have the same.
        """
        grid, names = self._grid, self._group.ids
        rows, columns = grid.frame.shape
        found: dict[int, int] = {}
        for row, place in enumerate(places):
            x, y = grid.frame.cells(place[None])[0]
            across = np.arange(max(0, int(np.floor(x)) - 1), min(columns, int(np.floor(x)) + 2))
            up = np.arange(max(0, int(np.floor(y)) - 1), min(rows, int(np.floor(y)) + 2))
            near: Indices = (up[:, None] * columns + across).ravel()
            near = near[grid.passable[near]]
            away = grid.centres[near] - place
            distance = np.sqrt((away**2).sum(axis=1))
            radius = min(grid.radius, max(grid.clearance(place), 0.0))
            fits = (distance <= grid.frame.resolution) & grid.clear(
                np.broadcast_to(place, away.shape), grid.centres[near], radius
            )
            # The first of cells at the same distance.
            order = np.lexsort((near, np.round(distance / grid.frame.resolution, 9)))
            near = near[order][fits[order]]
            where = f"({place[0]:.4g}, {place[1]:.4g})"
            if not len(near):
                raise _UnplannableError(f"{names[row]} {what} at {where}, where its body fits in no cell", row)
            cell = int(near[0])
            if cell in found:
                raise _UnplannableError(
                    f"{names[row]} {what} at {where}, in the same cell as {names[found[cell]]}", row
                )
            found[cell] = row
        return list(found)

    def _check_legs(self, starts: Array, ends: Array, what: str) -> None:
        """Check that no two agents touch while all move evenly from starts to ends, (n, 2) each.

        Raises:
            _UnplannableError: Two agents touch.
        """
        least = 2.0 * self._group.entity.radius
        one, other = np.triu_indices(len(starts), 1)
        apart = starts[other] - starts[one]
        change = ends[other] - ends[one] - apart
        square = (change**2).sum(axis=1)
        share = np.clip(-(apart * change).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        nearest = np.sqrt(((apart + share[:, None] * change) ** 2).sum(axis=1))
        for pair in np.flatnonzero(nearest < least * (1.0 - 1e-9)).tolist():
            names = self._group.ids[one[pair]], self._group.ids[other[pair]]
            raise _UnplannableError(f"{names[0]} and {names[1]} would touch on the way from {what}", int(one[pair]))

    def _frame(self, group: AgentGroup) -> GridFrame:
        """Return the frame of the grid."""
        given, floor = self.parameters, floor_of_group(group)
        least = 2.0 * 2.0**0.5 * (group.entity.radius + given.margin)
        side = given.resolution or least
        if side <= 0.0:
            raise ParameterError("the side of the cells is needed, as the agents have no body", ("resolution",))
        if side < least * (1.0 - 1e-9):
            said = f"cells of {side:.4g} m are too small for these bodies, which need {least:.4g} m around corners"
            raise ParameterError(said, ("resolution",))
        raster = None if floor is None else floor.raster
        if raster is not None and given.within is None:
            width, height = raster.cells.shape[1] * raster.resolution, raster.cells.shape[0] * raster.resolution
            frame = frame_of(raster.origin, raster.yaw, side, width, height)
        else:
            within = given.within or (None if floor is None else floor.bounds)
            if within is None:
                raise ParameterError("the area to plan in is needed, as the map has no bounds", ("within",))
            frame = frame_of((within[0], within[2]), 0.0, side, within[1] - within[0], within[3] - within[2])
        if frame.shape[0] * frame.shape[1] > MOST_CELLS:
            said = (
                f"the grid would have {frame.shape[0]} x {frame.shape[1]} cells, and may have {MOST_CELLS:,} for a team"
            )
            raise ParameterError(said, ("resolution",))
        return frame


class _UnplannableError(Exception):
    """The reason why no plan can begin or end; `row` is the agent concerned."""

    def __init__(self, said: str, row: int) -> None:
        super().__init__(said)
        self.row = row


class PrioritisedPlanner(TeamPlanner):
    """Plans paths of all agents of a group, one after the other, each around the paths of those before it.

    Agents with farther goals plan first. An agent that finds no path is moved to the front, and all plan again. The
    search is fast for many agents, but neither complete nor optimal in the sum of the times; see `planning.cbs`, and
    `symaware_cli.maps.team_planner` for the schedule that both write.
    """

    class Parameters(TeamPlanner.Parameters):
        """The grid, the speed, the body and the limit."""

        most_nodes: int = Field(
            1_000_000,
            ge=1,
            le=100_000_000,
            description="The greatest number of cells at steps that all searches expand.",
        )

    def _search(self, team: PlanningTeam) -> TeamPaths:
        return prioritised_paths(team, self.parameters.most_nodes)


class ConflictPlanner(TeamPlanner):
    """Plans paths of all agents of a group whose sum of times is the least, by conflict-based search.

    Finds a schedule with the least sum of the arrival times, among all schedules on the grid in which agents stay at
    their goals. The effort grows exponentially with the cost of conflicts, so `planning.prioritised` is better for
    crowds. If there is no plan at all, the search ends at its limit.
    """

    class Parameters(TeamPlanner.Parameters):
        """The grid, the speed, the body and the limits."""

        most_nodes: int = Field(
            2_000, ge=1, le=10_000_000, description="The greatest number of nodes of the tree of constraints."
        )
        most_cells: int = Field(
            200_000, ge=1, le=100_000_000, description="The greatest number of cells at steps that one path expands."
        )

    def _search(self, team: PlanningTeam) -> TeamPaths:
        return ConflictSearch(team, self.parameters.most_nodes, self.parameters.most_cells).paths()
