"""Names in the expressions of a scenario: for agents, awareness and knowledge; for runs, the state of the world."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cached_property, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import PARTS, AgentGroup, TimeSeries, seconds
from symaware_cli.core.verdict import SpecificationStatuses
from symaware_cli.geometry import Pose, Region
from symaware_cli.specification import (
    LINK,
    AbsentError,
    Anchors,
    FurtherNames,
    Keys,
    LinkPositions,
    Names,
    PlacedRegion,
    Scope,
    World,
    link_keys,
    nearest_believed,
    region_names,
)
from symaware_cli.specification.columns import FUNCTIONS
from symaware_cli.specification.expression import one_row

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.run_summary import Observer
    from symaware_cli.engine.runtime.simulation import Simulation

Array = NDArray[np.float64]

#: What every agent's condition may refer to, with what each means.
AGENT_NAMES: Mapping[str, str] = {
    "control_input": "the control input that the agent requests",
    "has_intent": "whether it has an intent",
    "knowledge": 'what it knows, by name: knowledge["goal"]',
    "nearest": "distance to the nearest other that it is aware of [m]; infinite if there is none",
    "position": "where it believes to be [m]",
    "risk": "the greatest risk it sees; 0 if none was estimated",
    "robustness": 'the robustness of a specification, as far as it is known: robustness["safe"]',
    "satisfied": 'whether a specification is satisfied: satisfied["safe"]',
    "state": "what it believes of its own state, as every further part of its awareness by its name: attention[0]",
    "time": "simulated time [s]",
    "uncertainty": "the greatest number of its uncertainty; 0 if none was estimated",
    "velocity": "how fast it believes to move [m/s]",
    "violated": 'whether a specification is violated: violated["safe"]',
}

#: What `run.until` may refer to.
WORLD_NAMES: Mapping[str, str] = {
    "agents": "how many agents are in the world now",
    "contacts": "how many contacts began so far",
    "goals_reached": "for each agent with a goal that has not left, whether it reached it: all(goals_reached)",
    "highest_risk": "the greatest risk that an agent sees now; 0 if none was estimated",
    "link": 'where a link of a robot from a file, or of each of a group, truly is [m]: link["arm"]["gripper"]',
    "min_separation": "the least distance between the centres of two agents now [m]; infinite if there is one agent",
    "position": 'where an agent, each of a group, or an entity truly is [m]: position["robot.2"]',
    "present": 'whether an agent, or each of a group, is in the world now: present["robot.2"]',
    "robustness": 'the least robustness of a specification, as far as it is known: robustness["safe"]',
    "satisfied": 'whether a specification is satisfied by all: satisfied["safe"]',
    "state": 'the true state of an agent or of each of a group, the position and heading of an entity: state["leader"]',
    "time": "simulated time [s]",
    "violated": 'whether a specification is violated by any: violated["safe"]',
}

#: The names that tell what has become of specifications.
STATUS_NAMES = ("robustness", "satisfied", "violated")


def world_names(
    groups: Iterable[AgentGroup],
    regions: Iterable[str],
    entities: Iterable[str],
    specifications: Collection[str] | None,
) -> Names:
    """Return the names that expressions about the world may refer to.

    Args:
        groups: All groups.
        regions: The names of the regions.
        entities: The names of the other bodies.
        specifications: The names of the specifications; None if those that are named need no check.
    """
    groups, regions = tuple(groups), tuple(regions)
    of = tuple(dict.fromkeys([*(id for group in groups for id in group.ids), *(group.name for group in groups)]))
    agents, bodies = Keys("agent or group", of), Keys("agent, group or entity", (*of, *entities))
    statuses = None if specifications is None else Keys("specification", specifications)
    others = {*regions, *further_parts(groups)}
    links = None if LINK in others else _keys_of_links(groups, entities)
    return {
        **region_names(regions),
        **dict.fromkeys(further_parts(groups), agents),
        **dict.fromkeys(name for name in WORLD_NAMES if name != LINK),
        **({} if links is None else {LINK: links}),
        **dict.fromkeys(STATUS_NAMES, statuses),
        "position": bodies,
        "present": agents,
        "state": bodies,
    }


def _keys_of_links(groups: Sequence[AgentGroup], entities: Iterable[str]) -> Keys | None:
    """The keys that follow `link`: agents and groups, then links; None if no agents have links."""
    found: dict[str, Keys] = {}
    refused = {
        name: f"`{name}` has no joints with motors: of it, only the position of the whole body is known"
        for name in entities
    }
    for group in groups:
        keys = link_keys(group.model)
        for name in (*group.ids, group.name):
            if keys is None:
                refused[name] = f"`{name}` has no links: its model drives no joints of a robot from a file"
            else:
                found[name] = keys
    return Keys("agent or group with links", found, refused) if found else None


class ConditionScope:
    """Tells what names stand for in the conditions of a group's agents."""

    def __init__(self, group: AgentGroup) -> None:
        self._group = group
        #: Parts of awareness, of which those of every agent have a meaning of their own in `AGENT_NAMES`.
        self._parts = group.awareness.columns.keys() - AGENT_NAMES.keys() | {"state"}
        # Where an agent truly is, is no belief; so a region around one has no place here.
        self._regions = {
            name: PlacedRegion(name, group.regions, _nowhere)
            for name, region in group.regions.items()
            if region.around is None
        }
        taken = {*self._parts, *AGENT_NAMES, *FUNCTIONS}
        self._elements = {
            quantity.name: index for index, quantity in enumerate(group.model.state) if quantity.name not in taken
        }
        known = {name for each in group.knowledge for name in each if name.isidentifier()}
        self._known = known - set(self._elements) - taken
        others = {*self._elements, *self._known, *self._parts, *self._regions}
        self._links = None if LINK in others else link_keys(group.model)
        self._regions = {
            name: each for name, each in self._regions.items() if name not in {*self._known, *self._elements}
        }
        sections = [each for _, each in sorted(group.sections.items()) if isinstance(each, FurtherNames)]
        others |= taken
        self._further = {
            name: (keys, each) for each in sections for name, keys in each.names(group).items() if name not in others
        }

    def names(self, specifications: Collection[str]) -> Names:
        """All that a condition may refer to, with the names of the specifications."""
        return {
            **region_names(self._regions),
            **dict.fromkeys([*self._elements, *AGENT_NAMES, *self._parts, *self._known]),
            **({} if self._links is None else {LINK: self._links}),
            **{name: keys for name, (keys, _) in self._further.items()},
            **dict.fromkeys(STATUS_NAMES, Keys("specification", specifications)),
        }

    def look_up(self, row: int, name: str) -> Any:
        """The value of a name for one agent."""
        group = self._group
        element = self._elements.get(name)
        if element is not None:
            return float(group.awareness.state[row, element])
        if name in self._known:
            return group.knowledge[row][name]
        if name in self._parts:
            return group.awareness.columns[name].present(row)
        if name in self._regions:
            return self._regions[name]
        if name in self._further:
            return self._further[name][1].look_up(group, row, name)
        if name in STATUS_NAMES:
            return _StatusByName(group.specifications, name, group.ids[row])
        match name:
            case "control_input":
                return group.control_input[row]
            case "has_intent":
                return len(group.awareness.intent.row(row)) > 0
            case "knowledge":
                return group.knowledge[row]
            case "link":
                return _LinksOfOne(group.model, group.awareness.state[row : row + 1])
            case "nearest":
                return nearest_believed(group, row)
            case "position":
                return group.model.positions(group.awareness.state)[row]
            case "risk":
                return _greatest(group.awareness.risk.row(row))
            case "time":
                return seconds(group.surroundings.clock.now)
            case "uncertainty":
                return _greatest(group.awareness.uncertainty.row(row))
            case "velocity":
                one = slice(row, row + 1)
                return group.model.velocity(group.awareness.state[one], group.control_input[one])[0]
        raise KeyError(name)


def _nowhere(agent: str) -> tuple[Array, float | None]:
    raise ValueError(f"the region moves with `{agent}`")


class _StatusByName:
    """One figure of the status of each specification."""

    def __init__(self, statuses: Mapping[str, SpecificationStatuses], figure: str, agent: str | None = None) -> None:
        self._statuses = statuses
        self._figure = figure
        self._agent = agent

    def __getitem__(self, name: str) -> bool | float:
        statuses = self._statuses[name]
        status = statuses.worst if self._agent is None else statuses.of(self._agent)
        if status is None:
            raise KeyError(f"the specification `{name}` does not concern `{self._agent}`")
        if self._figure == "robustness":
            return status.robustness
        return status.verdict is (self._figure == "satisfied")


def further_parts(groups: Iterable[AgentGroup]) -> list[str]:
    """The names of the parts of awareness that components declare, in their order."""
    every = {part.name for part in PARTS}
    return list(dict.fromkeys(name for group in groups for name in group.awareness.parts if name not in every))


class WorldScope:
    """Tells what names stand for in `run.until`."""

    def __init__(self, simulation: Simulation, observer: Observer) -> None:
        self._simulation = simulation
        self._observer = observer
        self._parts = frozenset(further_parts(simulation.groups))
        regions = simulation.groups[0].regions if simulation.groups else {}
        anchors = Anchors(simulation.environment, simulation.groups)
        self._regions = {name: PlacedRegion(name, regions, anchors) for name in regions if name not in WORLD_NAMES}
        self._with_goal = sorted(
            {
                id
                for entry in simulation.entries
                if not entry.is_substitute and "goal-reached" in entry.components[0].events
                for id in entry.group.ids
            }
        )

    @cached_property
    def _rows(self) -> Mapping[str, tuple[AgentGroup, int]]:
        return {id: (group, row) for group in self._simulation.groups for row, id in enumerate(group.ids)}

    @property
    def _statuses(self) -> Mapping[str, SpecificationStatuses]:
        return self._simulation.groups[0].specifications

    def look_up(self, name: str) -> Any:
        """The value of a name."""
        simulation = self._simulation
        if name in self._parts:
            return _ByName(self._rows, simulation, partial(_part_of, name))
        if name in self._regions:
            return self._regions[name]
        if name in STATUS_NAMES:
            return _StatusByName(self._statuses, name)
        match name:
            case "agents":
                return sum(len(group.rows) for group in simulation.groups)
            case "contacts":
                return self._observer.contacts
            case "goals_reached":
                world, left = simulation.environment.snapshot(), self._observer.left
                # Who enters later has yet to reach its goal.
                counted = [id for id in self._with_goal if id in world or id not in left]
                return np.array([id in self._observer.goals for id in counted], bool)
            case "highest_risk":
                peak = self._observer.peak()
                return 0.0 if peak is None else peak[0]
            case "link":
                return _LinksByName(self._rows, simulation, simulation.environment.state)
            case "min_separation":
                positions = simulation.environment.snapshot().positions
                return simulation.environment.proximity.nearest(positions) if len(positions) > 1 else np.inf
            case "position":
                return _ByName(
                    self._rows,
                    simulation,
                    lambda group: group.model.positions(simulation.environment.state(group)),
                    lambda pose: np.array(pose.position),
                )
            case "present":
                return _ByName(self._rows, simulation, attrgetter("in_world"), counts_absent=True)
            case "state":
                return _ByName(
                    self._rows,
                    simulation,
                    simulation.environment.state,
                    lambda pose: np.array([*pose.position, pose.heading]),
                )
            case "time":
                return seconds(simulation.clock.now)
        raise KeyError(name)


class _ByName:
    """A property of each agent by its id, of each group by its name, and of each other body by its name."""

    def __init__(
        self,
        rows: Mapping[str, tuple[AgentGroup, int]],
        simulation: Simulation,
        pick: Callable[[AgentGroup], NDArray[Any]],
        of_pose: Callable[[Pose], Array] | None = None,
        counts_absent: bool = False,
    ) -> None:
        self._rows = rows
        self._simulation = simulation
        self._pick = pick
        self._of_pose = of_pose
        self._counts_absent = counts_absent

    def __getitem__(self, name: str) -> Any:
        if name in self._rows:
            group, row = self._rows[name]
            if not self._counts_absent and group.present is not None and not group.present[row]:
                raise AbsentError(f"`{name}` is not in the world")
            return self._of_agent(group, row)
        environment = self._simulation.environment
        if self._of_pose is not None and name in environment.obstacles:
            return self._of_pose(environment.pose(name))
        for group in self._simulation.groups:
            if group.name == name:
                return self._of_group(group)
        raise KeyError(f"there is no agent or group `{name}`")

    def _of_agent(self, group: AgentGroup, row: int) -> Any:
        return self._pick(group)[row]

    def _of_group(self, group: AgentGroup) -> Any:
        every = self._pick(group)
        return every if self._counts_absent or group.present is None else every[group.present]


class _LinksByName(_ByName):
    """The links of each agent by its id, and of each group by its name; picks are the states."""

    def _of_agent(self, group: AgentGroup, row: int) -> Any:
        return _LinksOfOne(group.model, self._pick(group)[row : row + 1])

    def _of_group(self, group: AgentGroup) -> Any:
        return LinkPositions(group.model, super()._of_group(group))


class _LinksOfOne(LinkPositions):
    """The positions of the links of one agent, each of shape (d,)."""

    def __getitem__(self, link: str) -> Array:
        found: Array = super().__getitem__(link)[0]
        return found


def _part_of(name: str, group: AgentGroup) -> Array:
    """A part of the awareness of each agent of a group; of a series, the first point."""
    column = group.awareness.columns.get(name)
    if column is None:
        raise KeyError(f"the agents of `{group.name}` have no part `{name}`")
    return np.array([column.present(row) for row in range(len(group))])


def _greatest(series: TimeSeries) -> float:
    return float(series.values.max(initial=0.0)) if len(series) else 0.0


#: The units of `WORLD_NAMES`; "" where it depends.
_WORLD_UNITS: Mapping[str, str] = {
    **dict.fromkeys(WORLD_NAMES, ""),
    "link": "m",
    "min_separation": "m",
    "position": "m",
    "time": "s",
}


class WorldColumns(Scope):
    """What specifications of the world are about: one row, of the values of `WorldScope`."""

    def __init__(
        self,
        world: World,
        groups: Sequence[AgentGroup],
        regions: Mapping[str, Region],
        entities: Iterable[str],
        specifications: Collection[str],
    ) -> None:
        super().__init__(1, world, groups, regions)
        self.units = {**_WORLD_UNITS, **dict.fromkeys(further_parts(groups), "")}
        self._names = world_names(groups, self.regions, entities, specifications)
        #: Tells what names stand for; set where a run begins.
        self.source: WorldScope | None = None

    @property
    def names(self) -> Names:
        """See the base class."""
        return self._names

    def agents(self, row: int) -> tuple[str, ...]:
        """Nobody in particular."""
        return ()

    def _look_up(self, name: str) -> Any:
        assert self.source is not None
        return one_row(self.source.look_up(name))
