"""What the rows of a vector environment return, as arrays that its sources of episodes write."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Truths = NDArray[np.bool_]
Rows = NDArray[np.intp]


class RowArrays:
    """The last results of all rows of a vector environment; a row is one environment.

    Attributes:
        observations: Shape (rows, n, k), for n agents.
        rewards: Shape (rows, n).
        terminated: Whether the agent has left for good, or its condition holds; shape (rows, n).
        present: Whether the agent is in the world; shape (rows, n).
        ended: Whether the run of the row is over; shape (rows,).
        complete: Whether it is over because all of its steps were made; shape (rows,).
    """

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
        """Begin an episode in some rows; each seed is that of its run."""

    def step(self, rows: Rows, actions: Array, given: Truths) -> None:
        """Make a step in some rows.

        Args:
            rows: The rows.
            actions: The control inputs of all rows; shape (all rows, n, nu).
            given: The agents that they are for; components drive all others. Shape (all rows, n).
        """

    def close(self) -> None:
        """End all episodes."""
