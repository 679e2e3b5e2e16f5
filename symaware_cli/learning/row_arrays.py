"""The results of the rows of a vector environment, as arrays that its sources of episodes write."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Truths = NDArray[np.bool_]
Rows = NDArray[np.intp]


class RowSizes(NamedTuple):
    """The sizes of the arrays of rows.

    Attributes:
        rows: The number of rows.
        agents: The number of agents in each row.
        observed: The number of values that an agent observes.
        inputs: The number of control inputs of an agent.
    """

    rows: int
    agents: int
    observed: int
    inputs: int


class RowArrays:
    """The last results of all rows of a vector environment; a row is one environment.

    Attributes:
        observations: The observations; shape (rows, n, k), for n agents.
        rewards: The rewards; shape (rows, n).
        terminated: Whether the agent has left for good, or its condition holds; shape (rows, n).
        present: Whether the agent is in the world; shape (rows, n).
        ended: Whether the run of the row is over; shape (rows,).
        complete: Whether the run is over because all of its steps were made; shape (rows,).
    """

    FIELDS: ClassVar = ("observations", "rewards", "terminated", "present", "ended", "complete")

    def __init__(self, rows: int, agents: int, width: int) -> None:
        """Begin with zeros."""
        self.observations: Array = np.zeros((rows, agents, width))
        self.rewards: Array = np.zeros((rows, agents))
        self.terminated: Truths = np.zeros((rows, agents), bool)
        self.present: Truths = np.zeros((rows, agents), bool)
        self.ended: Truths = np.zeros(rows, bool)
        self.complete: Truths = np.zeros(rows, bool)


class EpisodeSource(Protocol):
    """Makes the episodes of the rows of a vector environment.

    Attributes:
        arrays: The last results of all rows.
    """

    arrays: RowArrays

    def begin(self, rows: Rows, seeds: Sequence[int]) -> None:
        """Begin an episode in some rows, each with the seed of its run."""

    def step(self, rows: Rows, actions: Array, given: Truths) -> None:
        """Make a step in some rows.

        Args:
            rows: The rows.
            actions: The control inputs of all rows; shape (all rows, n, nu).
            given: Whether each agent gets its control input from `actions`; components drive all others. Shape (all
                rows, n).
        """

    def close(self) -> None:
        """End all episodes."""
