"""Scopes of specifications: the names that a formula may refer to, their units, and their values in columns.

There are four scopes: the true states of the agents of a group, their beliefs, pairs of agents, and the world.
`docs/specifications.md` has the tables of names.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, EntityGroup, Model, Snapshot, seconds
from symaware_cli.geometry import Proximity, Region, lengths
from symaware_cli.specification.formula import Array
from symaware_cli.specification.parser import Keys, Names
from symaware_cli.specification.region import PlacedRegion
from symaware_cli.specification.region_keys import region_names

#: The unit of each name of `AgentScope`; "" where it depends on the model.
AGENT_UNITS: Mapping[str, str] = {
    "control_input": "",
    "knowledge": "",
    "nearest": "m",
    "position": "m",
    "speed": "m/s",
    "state": "",
    "time": "s",
    "velocity": "m/s",
}
#: Additional names of `BeliefScope`.
BELIEF_UNITS: Mapping[str, str] = {"has_intent": "", "risk": "", "uncertainty": ""}
#: Names of `PairScope`.
PAIR_UNITS: Mapping[str, str] = {
    "closing_speed": "m/s",
    "distance": "m",
    "position": "m",
    "speed": "m/s",
    "time": "s",
    "velocity": "m/s",
}


#: The name of the positions of links, ``link["gripper"]``, of groups whose model has `Model.links`.
LINK = "link"

#: The agents of a pair.
SIDES = ("first", "second")


class World(Protocol):
    """The interface that scopes need of a world: an `Environment`, or one read from a log."""

    @property
    def groups(self) -> Sequence[EntityGroup]:
        """The groups in roster order."""

    @property
    def proximity(self) -> Proximity:
        """Finds the pairs of agents that are near each other, with results shared by all callers."""

    def state(self, group: EntityGroup) -> Array:
        """Return the true states of a group; shape (n, nx)."""

    def applied_input(self, group: EntityGroup) -> Array:
        """Return the control inputs applied to a group in the step that just ended; shape (n, nu)."""

    def snapshot(self) -> Snapshot:
        """Return a snapshot of the whole world."""


class Anchors:
    """Returns the true pose of agents; see `region.Anchor`."""

    def __init__(self, world: World, groups: Iterable[EntityGroup]) -> None:
        self._world = world
        self._groups = tuple(groups)

    @cached_property
    def _rows(self) -> Mapping[str, tuple[EntityGroup, int]]:
        return {id: (group, row) for group in self._groups for row, id in enumerate(group.ids)}

    def __call__(self, id: str) -> tuple[Array, float | None]:
        """Return the pose of an agent."""
        group, row = self._rows[id]
        state, heading = self._world.state(group)[row], group.model.heading
        position = group.model.positions(state[None])[0]
        if group.present is not None and not group.present[row]:
            position = np.full_like(position, np.nan)
        return position, None if heading is None else float(state[heading])


class Scope(ABC):
    """Provides the values of names at the present instant.

    Attributes:
        rows: Number of rows: agents, pairs, or 1 for the world.
        units: The unit of each name; "" where it is unknown.
        regions: The regions by name.
        ambiguous: Names with several meanings, each with a description of these.
    """

    units: Mapping[str, str]

    def __init__(self, rows: int, world: World, groups: Sequence[EntityGroup], regions: Mapping[str, Region]) -> None:
        self.rows = rows
        self.ambiguous: dict[str, str] = {}
        self._world = world
        self._anchors = Anchors(world, groups)
        self.regions = {name: PlacedRegion(name, regions, self.anchor) for name in sorted(regions)}

    @property
    def names(self) -> Names:
        """All names that a specification may refer to."""
        return {**self._region_names, **dict.fromkeys(self.units)}

    @cached_property
    def _region_names(self) -> Names:
        return region_names(self.regions)

    @property
    def present(self) -> NDArray[np.bool_] | None:
        """Which rows are present; None for all."""
        return None

    @abstractmethod
    def agents(self, row: int) -> tuple[str, ...]:
        """Return the ids of the agents that a row is about."""

    def subjects(self, row: int) -> tuple[str, ...]:
        """Return the ids of the agents that read the status of a row as their own: by default all it is about."""
        return self.agents(row)

    @property
    def lacking(self) -> NDArray[np.bool_] | None:
        """The rows without a value for the names of the last instant; None if all have one.

        Predicates without a value do not hold for these rows.
        """
        return None

    @property
    def momentary_agents(self) -> tuple[str, ...]:
        """The ids of the agents that the only row is about at the instant of the last `look_up`, if they change."""
        return ()

    def getter(self, name: str) -> Callable[[], Any]:
        """Return a function that returns the present values of a name, as `look_up`; it is resolved here, once."""
        return partial(self.look_up, name)

    def look_up(self, name: str) -> Any:
        """Return the values of a name for all rows."""
        if name == "time":
            return seconds(self._world.snapshot().time)
        return self.regions[name] if name in self.regions else self._look_up(name)

    @abstractmethod
    def _look_up(self, name: str) -> Any:
        """Return the values of a name in `units`."""

    def anchor(self, id: str) -> tuple[Array, Any]:
        """Return the true pose of an agent; see `region.Anchor`."""
        return self._anchors(id)


class AgentScope(Scope):
    """The true states of the agents of a group."""

    _units: ClassVar[Mapping[str, str]] = AGENT_UNITS

    def __init__(
        self, group: AgentGroup, world: World, groups: Sequence[EntityGroup], regions: Mapping[str, Region]
    ) -> None:
        super().__init__(len(group), world, groups, regions)
        self.group = group
        own = {quantity.name for quantity in group.model.state}
        fixed = {
            name: unit
            for name, unit in {**self._units, **self._parts()}.items()
            if not (name == "speed" and name in own)
        }
        #: The keys of `LINK`; None where the agents have no links, or something else has this name.
        self._links = None if LINK in {*own, *fixed, *regions} else link_keys(group.model)
        if self._links is not None:
            fixed[LINK] = "m"
        self._elements = {
            quantity.name: column for column, quantity in enumerate(group.model.state) if quantity.name not in fixed
        }
        known = {name for each in group.knowledge for name in each if name.isidentifier()} - fixed.keys()
        kinds = (
            (self._elements, "an element of the state"),
            (known, "a piece of knowledge"),
            (self.regions, "a region"),
        )
        for name in sorted({*self._elements, *known}):
            meanings = [meaning for names, meaning in kinds if name in names]
            if len(meanings) > 1:
                self.ambiguous[name] = " and ".join(meanings)
        self._known = known - self._elements.keys() - self.regions.keys()
        units = {name: group.model.state[column].unit for name, column in self._elements.items()}
        self.units = {**fixed, **units, **dict.fromkeys(self._known, "")}

    def _parts(self) -> Mapping[str, str]:
        """Return additional names with their units."""
        return {}

    @property
    def names(self) -> Names:
        """See the base class."""
        return super().names if self._links is None else {**super().names, LINK: self._links}

    @property
    def present(self) -> NDArray[np.bool_] | None:
        """Which agents are in the world; None for all."""
        return self.group.present

    def agents(self, row: int) -> tuple[str, ...]:
        """Return the id of an agent."""
        return (self.group.ids[row],)

    def getter(self, name: str) -> Callable[[], Any]:
        """See the base class."""
        if name in self._known:
            return partial(KnownValues(self.group).__getitem__, name)
        if name in self.regions:
            return super().getter(name)
        if name in self._elements:
            column = self._elements[name]
            return lambda: self.states[:, column]
        if name == "position":
            return lambda: self.group.model.positions(self.states)
        return self._nearest if name == "nearest" else super().getter(name)

    @property
    def states(self) -> Array:
        """The states that names refer to; shape (n, nx)."""
        return self._world.state(self.group)

    @property
    def inputs(self) -> Array:
        """The control inputs that names refer to; shape (n, nu)."""
        return self._world.applied_input(self.group)

    def _look_up(self, name: str) -> Any:
        group = self.group
        if name in self._elements:
            return self.states[:, self._elements[name]]
        if name in self._known:
            return KnownValues(group)[name]
        match name:
            case "control_input":
                return self.inputs
            case "knowledge":
                return KnownValues(group)
            case "link":
                return LinkPositions(group.model, self.states)
            case "nearest":
                return self._nearest()
            case "position":
                return group.model.positions(self.states)
            case "speed":
                return lengths(self.look_up("velocity"))
            case "state":
                return self.states
            case "velocity":
                return group.model.velocity(self.states, self.inputs)
        raise KeyError(name)

    def _nearest(self) -> Array:
        """Return the distance of each agent to the nearest other [m], between centres; infinity if there is none."""
        return self._world.proximity.nearest_to_each(self._world.snapshot().positions)[self._span]

    @cached_property
    def _span(self) -> slice:
        """The indices of the agents in the roster."""
        start = self._world.snapshot().roster.start(self.group.name)
        return slice(start, start + self.rows)


class BeliefScope(AgentScope):
    """The beliefs of the agents of a group about themselves and others."""

    _units: ClassVar[Mapping[str, str]] = {**AGENT_UNITS, **BELIEF_UNITS}

    def _parts(self) -> Mapping[str, str]:
        awareness = self.group.awareness
        return dict.fromkeys(awareness.columns.keys() - self._units.keys() - {"intent"}, "")

    @property
    def states(self) -> Array:
        """The agents' beliefs of their own states."""
        return self.group.awareness.state

    @property
    def inputs(self) -> Array:
        """The control inputs that they request."""
        return self.group.control_input

    def anchor(self, id: str) -> tuple[Array, float | None]:
        """Raise an error: beliefs have no regions around the true position of an agent."""
        raise ValueError(f"a region around `{id}` is where that truly is; beliefs have no such regions")

    def _look_up(self, name: str) -> Any:
        awareness = self.group.awareness
        match name:
            case "has_intent":
                return np.array([len(awareness.intent.row(row)) > 0 for row in range(self.rows)])
            case "risk" | "uncertainty":
                column = awareness.risk if name == "risk" else awareness.uncertainty
                return column.maxima()
        if name in awareness.columns and name not in AGENT_UNITS:
            return np.array([awareness.columns[name].present(row) for row in range(self.rows)])
        return super()._look_up(name)

    def _nearest(self) -> Array:
        return np.array([nearest_believed(self.group, row) for row in range(self.rows)])


class PairScope(Scope):
    """True relations between pairs of agents."""

    units = PAIR_UNITS

    def __init__(
        self,
        pairs: Sequence[tuple[str, str]],
        world: World,
        groups: Sequence[EntityGroup],
        regions: Mapping[str, Region],
    ) -> None:
        super().__init__(len(pairs), world, groups, regions)
        self._pairs = tuple(pairs)
        self._groups = groups
        #: The keys of `LINK`; None where it has no meaning.
        self._links: Keys | None = None
        if self._pairs and LINK not in regions and any(group.model.links is not None for group in groups):
            self._links = self._link_keys()
        if self._links is not None:
            self.units = {**PAIR_UNITS, LINK: "m"}

    @cached_property
    def _members(self) -> Sequence[_Members]:
        """The groups of the first and of the second agents."""
        places = {id: (number, row) for number, group in enumerate(self._groups) for row, id in enumerate(group.ids)}
        return [_Members(self._groups, [places[pair[side]] for pair in self._pairs]) for side in (0, 1)]

    def _link_keys(self) -> Keys | None:
        """Return the keys that follow `LINK`; None if neither all first nor all second agents have links."""
        keys = {side: each.link_keys() for side, each in zip(SIDES, self._members, strict=True)}
        found = {side: each for side, each in keys.items() if each is not None}
        refused = {
            side: f"not all of the {side} agents have links: the model of some drives no joints of a robot from a file"
            for side in keys.keys() - found.keys()
        }
        return Keys("agent of the pair", found, refused) if found else None

    @cached_property
    def _first(self) -> NDArray[np.intp]:
        """The index of the first agent of each pair."""
        indices = self._world.snapshot().roster.indices
        return np.array([indices[first] for first, _ in self._pairs], np.intp)

    @cached_property
    def _second(self) -> NDArray[np.intp]:
        indices = self._world.snapshot().roster.indices
        return np.array([indices[second] for _, second in self._pairs], np.intp)

    @property
    def names(self) -> Names:
        """See the base class."""
        each = Keys("agent of the pair", SIDES)
        links = {} if self._links is None else {LINK: self._links}
        return {**super().names, **links, "position": each, "speed": each, "velocity": each}

    @property
    def present(self) -> NDArray[np.bool_] | None:
        """Which pairs have both agents in the world; None for all."""
        here = self._world.snapshot().present
        return None if here is None else here[self._first] & here[self._second]

    def agents(self, row: int) -> tuple[str, ...]:
        """Return the ids of a pair."""
        return self._pairs[row]

    def _look_up(self, name: str) -> Any:
        match name:
            case "closing_speed":
                apart = self._apart()
                first, second = self._velocities()
                total = np.zeros(self.rows)
                for axis in range(apart.shape[1]):
                    total = total + apart[:, axis] * (second - first)[:, axis]
                distance = lengths(apart)
                return np.divide(-total, distance, out=np.zeros(self.rows), where=distance > 0.0)
            case "distance":
                return lengths(self._apart())
            case "link":
                return {
                    side: _LinksOfMembers(each, self._world) for side, each in zip(SIDES, self._members, strict=True)
                }
            case "position":
                return self._of_each(self._positions())
            case "speed":
                first, second = self._velocities()
                return self._of_each((lengths(first), lengths(second)))
            case "velocity":
                return self._of_each(self._velocities())
        raise KeyError(name)

    def _apart(self) -> Array:
        """Return the position of the second agent of each pair relative to the first [m]; shape (n, d)."""
        first, second = self._positions()
        return np.asarray(second - first)

    def _positions(self) -> tuple[Array, Array]:
        """Return the positions of the first and of the second agents [m]; each of shape (n, d)."""
        positions = self._world.snapshot().positions
        return positions[self._first], positions[self._second]

    def _velocities(self) -> tuple[Array, Array]:
        """Return the velocities of the first and of the second agents [m/s]; each of shape (n, d)."""
        snapshot = self._world.snapshot()
        velocities = np.zeros(snapshot.positions.shape)
        for group, start in zip(self._world.groups, snapshot.roster.starts, strict=True):
            of_group = group.model.velocity(self._world.state(group), self._world.applied_input(group))
            velocities[start : start + len(group), : of_group.shape[1]] = of_group
        return velocities[self._first], velocities[self._second]

    @staticmethod
    def _of_each(values: tuple[Array, Array]) -> Mapping[str, Array]:
        return dict(zip(SIDES, values, strict=True))


def link_keys(model: Model) -> Keys | None:
    """Return the keys that follow `LINK` for agents of a model; None if it has no links."""
    links = model.links
    return None if links is None else Keys("link", links.names, links.unknown)


class LinkPositions:
    """The positions of the links of agents [m] by name, each of shape (n, d); computed when they are looked up."""

    def __init__(self, model: Model, states: Array) -> None:
        """Remember what they follow from.

        Args:
            model: A model with links.
            states: Shape (n, nx).
        """
        self._model = model
        self._states = states

    def __getitem__(self, link: str) -> Array:
        assert self._model.links is not None
        return self._model.links.positions(self._states, link)


class _Members:
    """The groups of some agents, which may be several times among them.

    Attributes:
        count: How many agents.
        groups: Each group with the indices of its agents among these, and their rows in the group.
    """

    def __init__(self, groups: Sequence[EntityGroup], places: Sequence[tuple[int, int]]) -> None:
        self.count = len(places)
        numbers, rows = np.array(places, np.intp).reshape(-1, 2).T
        self.groups = [
            (group, chosen, rows[chosen])
            for number, group in enumerate(groups)
            if len(chosen := np.flatnonzero(numbers == number))
        ]

    def link_keys(self) -> Keys | None:
        """Return the links that all of the agents have; None if some have none."""
        every = [link_keys(group.model) for group, _, _ in self.groups]
        known = [each for each in every if each is not None]
        if not known or len(known) < len(every):
            return None
        unknown = {link: reason for each in known for link, reason in each.refused.items()}
        common = [link for link in known[0].names if all(link in each.names for each in known)]
        return Keys("link", common, unknown)


class _LinksOfMembers:
    """The positions of the links of agents of several groups [m] by name, each of shape (n, d).

    Coordinates that a model does not have are 0.
    """

    def __init__(self, members: _Members, world: World) -> None:
        self._members = members
        self._world = world

    def __getitem__(self, link: str) -> Array:
        found = np.zeros((self._members.count, self._world.snapshot().positions.shape[1]))
        for group, chosen, rows in self._members.groups:
            of_group = LinkPositions(group.model, self._world.state(group))[link]
            found[chosen, : of_group.shape[1]] = of_group[rows]
        return found


class KnownValues(Mapping[str, Any]):
    """The knowledge of the agents of a group by name: numbers as columns, anything else as objects."""

    def __init__(self, group: AgentGroup) -> None:
        self._group = group

    def __getitem__(self, name: str) -> Any:
        if not isinstance(self._group.knowledge[0][name], bool):
            # Before anything else, because the column is kept while nothing changes.
            try:
                return self._group.known(name)
            except (TypeError, ValueError):
                pass  # not numbers of one shape
        every = [knowledge[name] for knowledge in self._group.knowledge]
        if all(isinstance(value, bool) for value in every):
            return np.array(every)
        try:
            return self._group.known(name)
        except (TypeError, ValueError):
            values = np.empty(len(every), object)
            values[:] = every
            return values

    def __iter__(self) -> Iterator[str]:
        return iter(self._group.knowledge[0])

    def __len__(self) -> int:
        return len(self._group.knowledge[0])


def nearest_believed(group: AgentGroup, row: int) -> float:
    """Return the distance from an agent's believed position to the nearest other it is aware of [m], or infinity."""
    tracks, world = group.awareness.tracks, group.awareness.world
    if row in group.awareness.holders:
        # Beliefs that the agent holds itself, beside those of the group's components.
        others = group.agents[row].awareness_database.tracks(0).positions
    elif tracks is not None:
        others = tracks.positions[tracks.pointers[row] : tracks.pointers[row + 1]]
    elif world is not None:
        own_index, runs = world.roster.start(group.name) + row, world.roster.runs
        known = np.arange(len(world.positions)) if runs is None else runs[row * len(runs) // len(group)]
        others = world.positions[known[known != own_index]]
        others = others if world.present is None else others[np.isfinite(others).all(axis=1)]
    else:
        return np.inf
    own = np.zeros(others.shape[1])
    position = group.model.positions(group.awareness.state)[row]
    own[: len(position)] = position
    return float(lengths(others - own).min(initial=np.inf))
