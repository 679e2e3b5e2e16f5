"""Snapshots: the true states of all agents at an instant."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.world.arrays import frozen
from symaware_cli.world.model import Model
from symaware_cli.world.motion_layout import motions_of
from symaware_cli.world.roster import Roster

Array = NDArray[np.float64]


class Snapshot:
    """The true states of all agents at one instant; read-only, and not changed by later steps.

    Attributes:
        time: The instant, in nanoseconds.
        roster: All agents.
        states: The states of each group, in the roster's order of groups; each of shape (n, nx). Those of
            absent agents are the states in which they will enter, or have left.
        present: Which agents are present, by index, read-only; shape (N,). None for all.
    """

    __slots__ = (
        "_by_id",
        "_headings",
        "_inputs",
        "_models",
        "_motions",
        "_positions",
        "_velocities",
        "present",
        "roster",
        "states",
        "time",
    )

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
        """Store the states.

        Args:
            time: The instant, in nanoseconds.
            roster: All agents.
            models: The model of each group.
            states: The states of each group, read-only.
            control_inputs: The control inputs in force of each group.
            velocities: The velocities of all agents by index [m/s], read-only; by default from the models.
            present: As in the class.
        """
        self.time = time
        self.present = present
        self.roster = roster
        self.states = tuple(states)
        self._models = models
        self._inputs = tuple(control_inputs)
        self._by_id: StatesById | None = None
        self._headings: Array | None = None
        self._motions: dict[str, Array] | None = None
        self._positions: Array | None = None
        self._velocities = None if velocities is None else self._of_present(velocities)

    def __contains__(self, id: object) -> bool:
        return id in self.roster and (self.present is None or bool(self.present[self.roster.index(str(id))]))

    @property
    def ids(self) -> Sequence[str]:
        """The ids of all present agents, in the roster's order."""
        ids = self.roster.ids
        return ids if self.present is None else [ids[index] for index in np.flatnonzero(self.present).tolist()]

    def _of_present(self, values: Array) -> Array:
        """Return values by index, NaN for absent agents."""
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
        """Return the state of one agent, read-only; shape (nx,).

        Raises:
            KeyError: The agent does not exist or is absent.
        """
        if self.present is not None and id not in self:
            raise KeyError(id)
        group, row = self.roster.place(id)
        state: Array = self.states[group][row]
        return state

    def __getstate__(self) -> Any:
        """Return the state for another process, without values that can be computed again."""
        made = {"_by_id", "_motions"}
        return None, {name: None if name in made else getattr(self, name) for name in self.__slots__}

    @property
    def states_by_id(self) -> StatesById:
        """The states of all present agents as one shared mapping."""
        if self._by_id is None:
            self._by_id = self.roster.shared = StatesById(self, self._models)
        return self._by_id

    def motion(self, id: str) -> Array:
        """Return position [m] and velocity [m/s] of one agent, read-only; shape (2d,).

        Raises:
            KeyError: The agent does not exist or is absent.
        """
        self._index(id)
        return self.motions[id]

    @property
    def motions(self) -> dict[str, Array]:
        """Position [m] and velocity [m/s] of each present agent by id, read-only, shape (2d,); not to be changed."""
        if self._motions is None:
            motions = frozen(np.concatenate([self.positions, self.velocities], axis=1))
            if self.present is not None:
                motions = motions[self.present]
                motions.flags.writeable = False
            self._motions = dict(zip(self.ids, motions, strict=True))
        return self._motions

    @property
    def positions(self) -> Array:
        """The positions of all agents by index [m], NaN for absent ones; shape (N, d), read-only."""
        if self._positions is None:
            self._positions = self._of_present(
                _stacked([model.positions(state) for model, state in zip(self._models, self.states, strict=True)])
            )
        return self._positions

    @property
    def velocities(self) -> Array:
        """The velocities of all agents by index [m/s], NaN for absent ones; shape (N, d), read-only."""
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
        """The headings of all agents by index [rad], 0 without one, NaN for absent ones; shape (N,)."""
        if self._headings is None:
            headings = [
                np.zeros(len(state)) if model.heading is None else state[:, model.heading]
                for model, state in zip(self._models, self.states, strict=True)
            ]
            self._headings = self._of_present(frozen(np.concatenate([np.empty(0), *headings])))
        return self._headings

    @property
    def turn_rates(self) -> Array:
        """The turn rates of all agents by index [rad/s]; shape (N,)."""
        rates = [
            model.turn_rate(state, control_input)
            for model, state, control_input in zip(self._models, self.states, self._inputs, strict=True)
        ]
        return np.concatenate([np.empty(0), *rates])


def _refuse(states: StatesById, *_: Any, **__: Any) -> Any:
    raise TypeError("these states are shared by all agents: change a copy, dict(states)")


class StatesById(dict[str, Array]):
    """The states of all present agents at one instant, by id in the roster's order: rows of shared arrays, read-only.

    A perception may return it; storing it then costs one reference for any number of agents. It is a dictionary because
    Python copies dictionaries many times faster than other mappings.

    Attributes:
        snapshot: The snapshot.
    """

    __slots__ = ("_models", "_motions", "_rows", "snapshot")

    def __init__(self, snapshot: Snapshot, models: Sequence[Model]) -> None:
        rows = zip(snapshot.roster.ids, chain.from_iterable(snapshot.states), strict=True)
        super().__init__(rows if snapshot.present is None else compress(rows, snapshot.present.tolist()))
        self.snapshot = snapshot
        self._models = models
        self._motions: Array | None = None
        self._rows: dict[str, Array] | None = None

    @property
    def motions(self) -> Array:
        """The motions of all agents by index, NaN where unknown; shape (N, 2d)."""
        if self._motions is None:
            dimensions = self.snapshot.roster.dimensions
            self._motions = frozen(
                np.concatenate(
                    [
                        motions_of(model, states, dimensions)
                        for model, states in zip(self._models, self.snapshot.states, strict=True)
                    ]
                )
            )
        return self._motions

    @property
    def rows(self) -> dict[str, Array]:
        """Return the rows of `motions` by id, read-only; not to be changed."""
        if self._rows is None:
            self._rows = dict(zip(self.snapshot.roster.ids, self.motions, strict=True))
        return self._rows

    def __reduce__(self) -> Any:
        """Return the states for another process."""
        return _states_of, (self.snapshot,)

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = setdefault = pop = popitem = clear = _refuse


def _states_of(snapshot: Snapshot) -> StatesById:
    return snapshot.states_by_id


def _stacked(parts: Sequence[Array]) -> Array:
    """Join the rows of all groups; planar groups among groups in space are at height 0."""
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
