"""Entity groups: the data of a group that an environment uses: ids, body, dynamics and requested control inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness.column import Column
from symaware_cli.world.entity import Entity
from symaware_cli.world.model import Model
from symaware_cli.world.roster import Roster

Array = NDArray[np.float64]


class EntityGroup:
    """Entities that share a model and a body; an environment moves them by their control inputs.

    Attributes:
        name: The key under ``agents:``.
        ids: The id of each.
        model: The dynamics of all of them.
        entity: The body of each of them.
        initial_state: The initial state of each, read-only; shape (n, nx).
        present: Which of them are in the world, read-only; shape (n,). None for all of them.
        control_column: The control input that each requests.
    """

    def __init__(self, name: str, ids: Sequence[str], model: Model, entity: Entity, initial_state: Array) -> None:
        self.name = name
        self.ids = tuple(ids)
        self.model = model
        self.entity = model.embodied(entity)
        self.initial_state = initial_state
        self.present: NDArray[np.bool_] | None = None
        self.control_column = Column(np.zeros((len(self.ids), len(model.control_input))))

    def set_roster(self, roster: Roster) -> None:
        """Receive the roster of all agents; called once all groups are initialised."""

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def rows(self) -> NDArray[np.intp]:
        """The rows of those that are in the world, ascending."""
        return np.arange(len(self)) if self.present is None else np.flatnonzero(self.present)

    @property
    def control_input(self) -> Array:
        """The control input that each requests, read-only; shape (n, nu)."""
        return self.control_column.values

    @control_input.setter
    def control_input(self, values: ArrayLike) -> None:
        self.control_column.values = values
