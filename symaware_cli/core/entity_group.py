"""Entity groups: the data of a group that an environment uses: ids, body, dynamics and requested control inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness import Column
from symaware_cli.world import Entity, Model, Roster, agent_numbers

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
        returning: Which of them have left, and return; shape (n,). None if none has.
        control_column: The control input that each requests.
        seeds: The seeds of the runs that the rows belong to, if there are several: first come all rows of the first
            run, then those of the second, and so on. Empty for one run, whose seed the group does not know.
        numbers: The numbers of the entities in draws, from `agent_numbers`; shape (n,).
    """

    def __init__(
        self,
        name: str,
        ids: Sequence[str],
        model: Model,
        entity: Entity,
        initial_state: Array,
        seeds: Sequence[int] = (),
    ) -> None:
        """Create a group.

        Args:
            name: See the class, also for the arguments without a description.
            ids: The ids within one run.
            model: The dynamics.
            entity: The body.
            initial_state: Shape (n, nx), of all runs.
            seeds: See the class.
        """
        self.name = name
        self.seeds = tuple(seeds)
        self.ids = tuple(f"{run}:{id}" for run in range(self.runs) for id in ids) if seeds else tuple(ids)
        self.numbers = np.tile(agent_numbers(ids), self.runs)
        self.model = model
        self.entity = model.embodied(entity)
        self.initial_state = initial_state
        self.present: NDArray[np.bool_] | None = None
        self.returning: NDArray[np.bool_] | None = None
        self.control_column = Column(np.zeros((len(self.ids), len(model.control_input))))

    def set_roster(self, roster: Roster) -> None:
        """Receive the roster of all agents; called once all groups are initialised."""

    @property
    def runs(self) -> int:
        """The number of runs that the rows belong to."""
        return len(self.seeds) or 1

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def rows(self) -> NDArray[np.intp]:
        """The rows of the entities that are in the world, ascending."""
        return np.arange(len(self)) if self.present is None else np.flatnonzero(self.present)

    @property
    def in_world(self) -> NDArray[np.bool_]:
        """Whether each entity is in the world; shape (n,)."""
        return np.ones(len(self), bool) if self.present is None else self.present

    @property
    def control_input(self) -> Array:
        """The control input that each requests, read-only; shape (n, nu)."""
        return self.control_column.values

    @control_input.setter
    def control_input(self, values: ArrayLike) -> None:
        self.control_column.values = values
