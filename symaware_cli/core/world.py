"""The world as the environment has it: who is in it, and where everybody truly is."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.chance import Numbers, agent_numbers
from symaware_cli.core.column import frozen
from symaware_cli.core.model import Model

Array = NDArray[np.float64]


class Roster:
    """The agents of a world in an order that does not depend on the order of the scenario file.

    Groups stand in the order of their names, agents in the order of their rows. The position of an agent in
    this order is its *index*.

    Attributes:
        groups: The names of the groups, sorted.
        ids: The ids of all agents, by index.
        starts: The index of each group's first agent.
        dimensions: In how many dimensions they move, at most.
    """

    __slots__ = ("_models", "_numbers", "_places", "counts", "dimensions", "groups", "ids", "starts")

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
        self.starts = tuple(int(start) for start in np.cumsum([0, *self.counts])[:-1])
        self._numbers: Numbers | None = None
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
        group, row = self._places[id]
        return self.starts[group] + row

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


class Snapshot:
    """Where everybody is at one instant; read-only, and never changed by a later step.

    Attributes:
        time: The instant, in nanoseconds.
        roster: Who is who.
        states: The states of each group, in the roster's order of groups; each of shape (n, nx). Of agents that are not
            there: those in which they will enter, or left.
        present: Which agents are there, by index, read-only; shape (N,). None for all of them.
    """

    __slots__ = ("_headings", "_inputs", "_models", "_positions", "_velocities", "present", "roster", "states", "time")

    def __init__(
        self,
        time: int,
        roster: Roster,
        models: Sequence[Model],
        states: Sequence[Array],
        control_inputs: Sequence[Array],
        velocities: Array | None = None,
        present: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take the state of everything.

        Args:
            time: The instant, in nanoseconds.
            roster: Who is who.
            models: The model of each group.
            states: The states of each group, read-only.
            control_inputs: The control inputs in force of each group.
            velocities: The velocities of all agents by index [m/s], read-only; by default what the models say.
            present: See the class.
        """
        self.time = time
        self.present = present
        self.roster = roster
        self.states = tuple(states)
        self._models = models
        self._inputs = tuple(control_inputs)
        self._headings: Array | None = None
        self._positions: Array | None = None
        self._velocities = None if velocities is None else self._of_present(velocities)

    def __contains__(self, id: object) -> bool:
        return id in self.roster and (self.present is None or bool(self.present[self.roster.index(str(id))]))

    @property
    def ids(self) -> Sequence[str]:
        """The ids of all who are there, in the roster's order."""
        ids = self.roster.ids
        return ids if self.present is None else [ids[index] for index in np.flatnonzero(self.present).tolist()]

    def _of_present(self, values: Array) -> Array:
        """Values by index, NaN for those who are not there."""
        if self.present is None:
            return values
        values = values.copy()
        values[~self.present] = np.nan
        values.flags.writeable = False
        return values

    def _index(self, id: str) -> int:
        if id not in self:
            raise KeyError(id)
        return self.roster.index(id)

    def state(self, id: str) -> Array:
        """The state of one agent, read-only; shape (nx,).

        Raises:
            KeyError: There is no such agent, or it is not there.
        """
        self._index(id)
        group, row = self.roster.place(id)
        state: Array = self.states[group][row]
        return state

    def motion(self, id: str) -> Array:
        """Position [m] and velocity [m/s] of one agent; shape (2d,).

        Raises:
            KeyError: There is no such agent, or it is not there.
        """
        index = self._index(id)
        return np.concatenate([self.positions[index], self.velocities[index]])

    @property
    def positions(self) -> Array:
        """The positions of all agents by index [m], NaN where they are not there; shape (N, d), read-only."""
        if self._positions is None:
            self._positions = self._of_present(
                _stacked([model.positions(state) for model, state in zip(self._models, self.states, strict=True)])
            )
        return self._positions

    @property
    def velocities(self) -> Array:
        """The velocities of all agents by index [m/s], NaN where they are not there; shape (N, d), read-only."""
        if self._velocities is None:
            self._velocities = self._of_present(
                _stacked(
                    [
                        model.velocity(state, control_input)
                        for model, state, control_input in zip(self._models, self.states, self._inputs, strict=True)
                    ]
                )
            )
        return self._velocities

    @property
    def headings(self) -> Array:
        """The headings of all agents by index [rad], 0 without one, NaN where they are not there; shape (N,)."""
        if self._headings is None:
            headings = [
                np.zeros(len(state)) if model.heading is None else state[:, model.heading]
                for model, state in zip(self._models, self.states, strict=True)
            ]
            self._headings = self._of_present(frozen(np.concatenate([np.empty(0), *headings])))
        return self._headings

    @property
    def turn_rates(self) -> Array:
        """How fast the headings of all agents change, by index [rad/s]; shape (N,)."""
        rates = [
            model.turn_rate(state, control_input)
            for model, state, control_input in zip(self._models, self.states, self._inputs, strict=True)
        ]
        return np.concatenate([np.empty(0), *rates])


def _stacked(parts: Sequence[Array]) -> Array:
    """Join the rows of all groups; a group of a plane among groups of space stands at height 0."""
    if not parts:
        return frozen(np.empty((0, 2)))
    if len(parts) == 1:
        return frozen(parts[0]) if parts[0].flags.writeable else parts[0]
    dimensions = max(part.shape[1] for part in parts)
    parts = [
        np.pad(part, ((0, 0), (0, dimensions - part.shape[1]))) if part.shape[1] < dimensions else part
        for part in parts
    ]
    whole = np.concatenate(parts)
    whole.flags.writeable = False
    return whole


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies that touch, or cease to.

    Attributes:
        first: The id or name of one body; the lesser of the two by name.
        second: The other.
        point: Where they touch [m].
        depth: How far they overlap [m].
        impulse: How hard they hit each other in the step in which it begins, along the line of contact [N s]; 0 in
            worlds without forces, and where it ends.
        begins: They touch from now on; False when they part.
    """

    first: str
    second: str
    point: tuple[float, ...]
    depth: float
    begins: bool = True
    impulse: float = 0.0
