"""Tracks: the beliefs of the agents of a group about others, as plain values in columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symaware_cli.world import SECOND, frozen

if TYPE_CHECKING:
    from symaware_cli.world import Snapshot

Array = NDArray[np.float64]


class Tracks:
    """The beliefs of the agents of a group about others, sparsely: a row for each agent and each other that it knows.

    Rows are ordered by agent, then by the other's index in the roster. Arrays are read-only.

    Attributes:
        time: The instant that the beliefs refer to, in nanoseconds.
        pointers: The first row of each agent, then the number of rows; shape (n + 1,).
        others: The index in the roster of the other agent of each row; shape (m,).
        positions: The believed position of the other [m]; shape (m, d).
        velocities: The believed velocity of the other [m/s]; shape (m, d).
        covariances: Covariance of position and velocity, in this order [m^2, m^2/s, m^2/s^2]; shape (m, 2d, 2d), or
            None if they are not known.
        ages: Time from the last measurement of the other, or its last message, until that instant [s]; shape (m,).
    """

    __slots__ = ("_motions", "ages", "covariances", "others", "pointers", "positions", "time", "velocities")

    def __init__(
        self,
        time: int,
        pointers: NDArray[np.intp],
        others: NDArray[np.intp],
        positions: Array,
        velocities: Array,
        covariances: Array | None = None,
        ages: Array | None = None,
    ) -> None:
        self.time = time
        self.pointers = pointers
        self.others = others
        self.positions = frozen(positions)
        self.velocities = frozen(velocities)
        self.covariances = None if covariances is None else frozen(covariances)
        self.ages = frozen(np.zeros(len(others)) if ages is None else ages)
        self._motions: Array | None = None

    @property
    def motions(self) -> Array:
        """Positions, then velocities, read-only; shape (m, 2d)."""
        if self._motions is None:
            self._motions = frozen(np.concatenate([self.positions, self.velocities], axis=1))
        return self._motions

    def repeats(self, other: Tracks) -> bool:
        """Return whether these are the same tracks as others, of the same instant; NaN equals NaN."""
        return self.time == other.time and all(
            np.array_equal(getattr(self, name), getattr(other, name), equal_nan=True)
            for name in ("others", "pointers", "positions", "velocities", "ages")
        )

    @classmethod
    def of(
        cls,
        time: int,
        count: int,
        observers: NDArray[np.intp],
        others: NDArray[np.intp],
        positions: Array,
        velocities: Array,
        covariances: Array | None = None,
        ages: Array | None = None,
    ) -> Tracks:
        """Create tracks from the observer of each row.

        Args:
            time: See the class, also for the arguments without a description.
            count: The number of agents of the group.
            observers: The agent of each row, ascending; shape (m,).
            others: Within an agent ascending; shape (m,).
            positions: Shape (m, d).
            velocities: Shape (m, d).
            covariances: Shape (m, 2d, 2d).
            ages: Shape (m,).
        """
        pointers = np.zeros(count + 1, np.intp)
        np.cumsum(np.bincount(observers, minlength=count), out=pointers[1:])
        return cls(time, pointers, others, positions, velocities, covariances, ages)

    @classmethod
    def of_everybody(cls, snapshot: Snapshot, start: int, count: int) -> Tracks:
        """Expand a snapshot into the beliefs of agents that perceive everything: of each about all others.

        Args:
            snapshot: The perceived snapshot.
            start: The index of the first agent in the roster.
            count: The number of agents.
        """
        positions, everybody = snapshot.positions, np.arange(len(snapshot.positions))
        observers, others = np.repeat(np.arange(count), len(everybody)), np.tile(everybody, count)
        apart = observers + start != others
        runs = snapshot.roster.runs
        if runs is not None:
            of = np.empty(len(everybody), np.intp)
            of[runs] = np.arange(len(runs))[:, None]
            apart &= of[observers + start] == of[others]
        if snapshot.present is not None:
            apart &= snapshot.present[others] & snapshot.present[observers + start]
        observers, others = observers[apart], others[apart]
        return cls.of(snapshot.time, count, observers, others, positions[others], snapshot.velocities[others])

    @classmethod
    def joined(cls, time: int, parts: Sequence[Tracks]) -> Tracks:
        """Concatenate the tracks of several agents, all of the same instant."""
        return cls(
            time,
            np.cumsum([0, *(len(each) for each in parts)]),
            np.concatenate([each.others for each in parts]),
            np.concatenate([each.positions for each in parts]),
            np.concatenate([each.velocities for each in parts]),
            covariances=joined_covariances(parts),
            ages=np.concatenate([each.ages for each in parts]),
        )

    @property
    def observers(self) -> NDArray[np.intp]:
        """The agent that each row belongs to, as a row of the group; shape (m,)."""
        return np.repeat(np.arange(len(self.pointers) - 1), np.diff(self.pointers))

    def __len__(self) -> int:
        return len(self.others)

    @property
    def instants(self) -> NDArray[np.int64]:
        """The time of the last measurement or message of each other, in nanoseconds; shape (m,)."""
        return self.time - np.rint(self.ages * SECOND).astype(np.int64)

    def select(self, rows: NDArray[np.bool_]) -> Tracks:
        """Return the tracks that a mask selects; shape (m,)."""
        return Tracks.of(
            self.time,
            len(self.pointers) - 1,
            self.observers[rows],
            self.others[rows],
            self.positions[rows],
            self.velocities[rows],
            covariances=None if self.covariances is None else self.covariances[rows],
            ages=self.ages[rows],
        )

    def at(self, time: int) -> Tracks:
        """Return the tracks extrapolated to another instant at constant velocity.

        Args:
            time: In nanoseconds.
        """
        if time == self.time:
            return self
        duration, covariances = (time - self.time) / SECOND, self.covariances
        if covariances is not None:
            dimensions = self.positions.shape[1]
            transition = np.eye(2 * dimensions)
            transition[:dimensions, dimensions:] = duration * np.eye(dimensions)
            covariances = transition @ covariances @ transition.T
        return Tracks(
            time,
            self.pointers,
            self.others,
            self.positions + duration * self.velocities,
            self.velocities,
            covariances=covariances,
            ages=(time - self.instants) / SECOND,
        )

    def updated(self, told: Tracks) -> Tracks:
        """Return these tracks, updated by those of another source of the same agents that are more recent.

        Args:
            told: The tracks of the other source.

        Returns:
            The tracks at the later instant of the two.
        """
        time = max(self.time, told.time)
        parts = [self.at(time), told.at(time)]
        instants = np.concatenate([each.instants for each in (self, told)])
        observers = np.concatenate([each.observers for each in parts])
        others = np.concatenate([each.others for each in parts])
        # The sort is stable: of equally recent ones, the first is used.
        order = np.lexsort((-instants, others, observers))
        first = np.ones(len(order), bool)
        first[1:] = (np.diff(observers[order]) != 0) | (np.diff(others[order]) != 0)
        chosen = order[first]
        covariances = joined_covariances(parts)
        return Tracks.of(
            time,
            len(self.pointers) - 1,
            observers[chosen],
            others[chosen],
            np.concatenate([each.positions for each in parts])[chosen],
            np.concatenate([each.velocities for each in parts])[chosen],
            covariances=None if covariances is None else covariances[chosen],
            ages=np.concatenate([each.ages for each in parts])[chosen],
        )


def joined_covariances(parts: Sequence[Tracks]) -> Array | None:
    """Return the covariances of several tracks one after another; None if none of them has any.

    Zeros stand for covariances that are unknown, or that measurements without error do not need.
    """
    if all(each.covariances is None for each in parts):
        return None
    size = 2 * parts[0].positions.shape[1]
    return np.concatenate(
        [np.zeros((len(each), size, size)) if each.covariances is None else each.covariances for each in parts]
    )
