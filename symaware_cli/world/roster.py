"""Rosters: who is in a world, in an order that does not depend on the order of a file."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.world.chance import Numbers, agent_numbers
from symaware_cli.world.model import Model
from symaware_cli.world.motion import motions_of

Array = NDArray[np.float64]


class Roster:
    """The agents of a world in an order that does not depend on the order of the scenario file.

    Groups stand in the order of their names, agents in the order of their rows. The position of an agent in
    this order is its *index*.

    Attributes:
        groups: The names of the groups, sorted.
        ids: The ids of all agents, by index.
        indices: The index of each agent, by id; not to be changed.
        starts: The index of each group's first agent.
        dimensions: In how many dimensions they move, at most.
    """

    __slots__ = (
        "_models",
        "_numbers",
        "_places",
        "_tables",
        "counts",
        "dimensions",
        "groups",
        "ids",
        "indices",
        "starts",
    )

    def __init__(self, members: Mapping[str, Sequence[str]], models: Mapping[str, Model] | None = None) -> None:
        """Put them in order.

        Args:
            members: The ids of the agents of each group.
            models: The model of each group, where they are known.
        """
        self._models = dict(models or {})
        self.dimensions = max((len(model.position) for model in self._models.values()), default=2)
        self.groups = tuple(sorted(members))
        self.counts = tuple(len(members[group]) for group in self.groups)
        self.ids = tuple(id for group in self.groups for id in members[group])
        self.indices = {id: index for index, id in enumerate(self.ids)}
        self.starts = tuple(int(start) for start in np.cumsum([0, *self.counts])[:-1])
        self._numbers: Numbers | None = None
        self._tables: dict[tuple[str, ...], _MotionLayout] = {}
        self._places = {
            id: (number, row) for number, group in enumerate(self.groups) for row, id in enumerate(members[group])
        }

    @property
    def numbers(self) -> Numbers:
        """What stands for the agents where something is drawn, by index; shape (n,)."""
        if self._numbers is None:
            self._numbers = agent_numbers(self.ids)
        return self._numbers

    def place(self, id: str) -> tuple[int, int]:
        """Return the number of an agent's group (in `groups`) and its row there.

        Raises:
            KeyError: There is no such agent.
        """
        return self._places[id]

    def model(self, id: str) -> Model | None:
        """Return the model of an agent; None where there is no such agent, or nothing is known of its model."""
        place = self._places.get(id)
        return None if place is None else self._models.get(self.groups[place[0]])

    def index(self, id: str) -> int:
        """Return the index of an agent.

        Raises:
            KeyError: There is no such agent.
        """
        return self.indices[id]

    def motions(self, states: Mapping[str, ArrayLike]) -> tuple[dict[str, int], Array, dict[str, Array]] | None:
        """Bring what somebody says of many agents at once into the layout of all beliefs of others.

        Args:
            states: For each the state of its model, its motion or its position.

        Returns:
            The row of each by id, their motions, shape (k, 2d), and the rows by id; None unless all are agents, and
            those of each model are told of in arrays of the same shape.
        """
        ids = tuple(states)
        table = self._tables.get(ids)
        if table is None:
            if not self._places.keys() >= states.keys():
                return None
            self._tables.clear()  # whoever perceives some agents now and others then gains nothing by it
            table = self._tables[ids] = _MotionLayout(self, ids)
        motions = table.motions(list(states.values()), self.dimensions)
        return None if motions is None else (table.places, motions, dict(zip(ids, motions, strict=True)))

    def matching(self, pattern: str) -> list[int]:
        """The indices of those whom an id, the name of a group or a pattern means, ascending.

        Raises:
            KeyError: There is nobody.
        """
        if pattern in self:
            return [self.index(pattern)]
        if pattern in self.groups:
            number = self.groups.index(pattern)
            return list(range(self.starts[number], self.starts[number] + self.counts[number]))
        found = [index for index, id in enumerate(self.ids) if fnmatch.fnmatchcase(id, pattern)]
        if not found:
            raise KeyError(pattern)
        return found

    def start(self, group: str) -> int:
        """Return the index of the first agent of a group."""
        return self.starts[self.groups.index(group)]

    def __contains__(self, id: object) -> bool:
        return id in self._places

    def __len__(self) -> int:
        return len(self.ids)


class _MotionLayout:
    """How the states of certain agents become rows of motions.

    Attributes:
        places: The row of each by id.
    """

    __slots__ = ("_models", "places")

    def __init__(self, roster: Roster, ids: Sequence[str]) -> None:
        self.places = {id: row for row, id in enumerate(ids)}
        rows: dict[str, list[int]] = {}
        for row, id in enumerate(ids):
            rows.setdefault(roster.groups[roster.place(id)[0]], []).append(row)
        self._models = [(roster.model(ids[chosen[0]]), chosen) for chosen in rows.values()]

    def motions(self, states: Sequence[ArrayLike], dimensions: int) -> Array | None:
        """Their motions, read-only; shape (k, 2d). None if those of a group are not arrays of one shape that fits."""
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
