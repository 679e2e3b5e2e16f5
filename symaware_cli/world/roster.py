"""Rosters: all agents of a world, in an order that does not depend on the order in the scenario.

Reasons: docs/decisions/0005-agent-ids-and-the-roster.md
"""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Collection, Mapping, Sequence
from operator import is_
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world.chance import Numbers, agent_numbers
from symaware_cli.world.model import Model
from symaware_cli.world.motion_layout import motions_of

Array = NDArray[np.float64]

#: The row of each agent by id, the motions, shape (k, 2d), and their rows by id.
MotionTable: TypeAlias = tuple[dict[str, int], Array, dict[str, Array]]

_NOBODY = np.empty(0, np.uint64)


class SharedStates(Protocol):
    """The true states of all agents by id, with their motions; see `StatesById`."""

    @property
    def motions(self) -> Array:
        """Their motions by index; shape (n, 2d)."""

    @property
    def rows(self) -> dict[str, Array]:
        """Their motions by id."""

    def get(self, id: str) -> Array | None:
        """Return the state of an agent."""

    def __len__(self) -> int: ...


class Roster:
    """All agents of a world, in an order that does not depend on the scenario file.

    Groups are ordered by name, and their agents by row. The position of an agent in
    this order is its *index*.

    Attributes:
        groups: The names of the groups, sorted.
        ids: The ids of all agents, by index.
        indices: The index of each agent, by id; not to be changed.
        starts: The index of each group's first agent.
        dimensions: The greatest number of dimensions in which they move.
        runs: The agents of each run by index, if the world is that of a batch of runs; shape (runs, n). None otherwise.
        shared: The true states that were last asked for by id, whose rows `motions` recognises.
    """

    __slots__ = (
        "_models",
        "_numbers",
        "_order",
        "_places",
        "_tables",
        "counts",
        "dimensions",
        "groups",
        "ids",
        "indices",
        "runs",
        "shared",
        "starts",
    )

    #: No state: without them, motions are computed again.
    uncaptured: ClassVar[Collection[str]] = ("shared",)

    def __init__(
        self,
        members: Mapping[str, Sequence[str]],
        models: Mapping[str, Model] | None = None,
        numbers: Mapping[str, Numbers] | None = None,
        runs: int = 0,
    ) -> None:
        """Create the order.

        Args:
            members: The ids of the agents of each group.
            models: The model of each group, if known.
            numbers: The numbers of the agents of each group, from `agent_numbers`; by default those of the ids.
            runs: The number of runs that the agents of each group belong to, as in `EntityGroup.seeds`; 0 for no batch.
        """
        self._models = dict(models or {})
        self.dimensions = max((len(model.position) for model in self._models.values()), default=2)
        self.groups = tuple(sorted(members))
        self._order = {group: number for number, group in enumerate(self.groups)}
        self.counts = tuple(len(members[group]) for group in self.groups)
        self.ids = tuple(id for group in self.groups for id in members[group])
        self.indices = {id: index for index, id in enumerate(self.ids)}
        self.starts = tuple(int(start) for start in np.cumsum([0, *self.counts])[:-1])
        self._numbers = None if numbers is None else np.concatenate([_NOBODY, *(numbers[each] for each in self.groups)])
        self.runs: NDArray[np.intp] | None = None
        if runs:
            shares = [
                start + np.arange(count).reshape(runs, -1)
                for start, count in zip(self.starts, self.counts, strict=True)
            ]
            self.runs = np.concatenate(shares, axis=1)
        self.shared: SharedStates | None = None
        self._tables: dict[tuple[str, ...], _MotionLayout] = {}
        self._places = {
            id: (number, row) for number, group in enumerate(self.groups) for row, id in enumerate(members[group])
        }

    def __getstate__(self) -> Any:
        """Return the state for another process, without states of one instant."""
        return None, {name: None if name == "shared" else getattr(self, name) for name in self.__slots__}

    @property
    def numbers(self) -> Numbers:
        """The numbers of the agents for random draws, by index; shape (n,)."""
        if self._numbers is None:
            self._numbers = agent_numbers(self.ids)
        return self._numbers

    def place(self, id: str) -> tuple[int, int]:
        """Return the number of an agent's group (in `groups`) and its row there.

        Raises:
            KeyError: The agent does not exist.
        """
        return self._places[id]

    def model(self, id: str) -> Model | None:
        """Return the model of an agent; None if the agent does not exist or its model is unknown."""
        place = self._places.get(id)
        return None if place is None else self._models.get(self.groups[place[0]])

    def index(self, id: str) -> int:
        """Return the index of an agent.

        Raises:
            KeyError: The agent does not exist.
        """
        return self.indices[id]

    def motions(
        self, states: Mapping[str, ArrayLike], check: Callable[[Array], object] = lambda motions: None
    ) -> MotionTable | None:
        """Convert beliefs about many agents to the common layout of beliefs about others.

        Args:
            states: The state of its model, the motion or the position of each, by id.
            check: Called with the motions, except with those of `shared`.

        Returns:
            The row of each by id, their motions, shape (k, 2d), and the rows by id; none of them may be changed. None
            unless all ids are agents and the arrays for each model have the same shape.
        """
        shared = self.shared
        if (
            shared is not None
            and len(shared) == len(states) == len(self.ids)
            and all(map(is_, map(shared.get, states), states.values()))
        ):
            return self.indices, shared.motions, shared.rows
        ids = tuple(states)
        table = self._tables.get(ids)
        if table is None:
            if not self._places.keys() >= states.keys():
                return None
            self._tables.clear()  # of no use if the set of agents changes often
            table = self._tables[ids] = _MotionLayout(self, ids)
        motions = table.motions([*states.values()], self.dimensions)
        if motions is None:
            return None
        check(motions)
        return table.places, motions, dict(zip(ids, motions, strict=True))

    def matching(self, pattern: str) -> list[int]:
        """Return the indices of the agents that an id, the name of a group or a pattern matches, ascending.

        Raises:
            KeyError: It matches no agent.
        """
        if pattern in self:
            return [self.index(pattern)]
        if pattern in self.groups:
            number = self.number(pattern)
            return list(range(self.starts[number], self.starts[number] + self.counts[number]))
        found = [index for index, id in enumerate(self.ids) if fnmatch.fnmatchcase(id, pattern)]
        if not found:
            raise KeyError(pattern)
        return found

    def start(self, group: str) -> int:
        """Return the index of the first agent of a group."""
        return self.starts[self._order[group]]

    def number(self, group: str) -> int:
        """Return the number of a group in `groups`."""
        return self._order[group]

    def __contains__(self, id: object) -> bool:
        return id in self._places

    def __len__(self) -> int:
        return len(self.ids)


class _MotionLayout:
    """Converts the states of a fixed set of agents to rows of motions.

    Attributes:
        places: The row of each agent by id.
    """

    __slots__ = ("_models", "places")

    def __init__(self, roster: Roster, ids: Sequence[str]) -> None:
        self.places = {id: row for row, id in enumerate(ids)}
        rows: dict[str, list[int]] = {}
        for row, id in enumerate(ids):
            rows.setdefault(roster.groups[roster.place(id)[0]], []).append(row)
        self._models = [(roster.model(ids[chosen[0]]), chosen) for chosen in rows.values()]

    def motions(self, states: Sequence[ArrayLike], dimensions: int) -> Array | None:
        """Return their motions, read-only; shape (k, 2d). None if arrays of a group do not have one suitable shape."""
        motions = np.empty((len(states), 2 * dimensions))
        for model, rows in self._models:
            chosen = [states[row] for row in rows]
            first = chosen[0]
            if not isinstance(first, np.ndarray) or first.ndim != 1 or first.dtype != float:
                return None
            if {(type(each), getattr(each, "shape", ())) for each in chosen} != {(type(first), first.shape)}:
                return None
            values = np.concatenate(chosen).reshape(len(chosen), -1)
            if values.dtype != float:
                return None
            if model is not None and values.shape[1] == len(model.state):
                motions[rows] = motions_of(model, values, dimensions)
            elif values.shape[1] == 2 * dimensions:
                motions[rows] = values
            else:
                return None
        motions.flags.writeable = False
        return motions
