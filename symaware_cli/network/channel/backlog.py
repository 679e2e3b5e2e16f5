"""The backlog of links: how many bytes and messages wait for each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices, Times
from symaware_cli.world.chance import Array


class Backlog:
    """The bytes that wait for links or are entering them, by rows of `LinkStates`.

    The time when a message enters its link is decided when it is sent. If the bandwidth has changed since, the first
    part of the backlog enters at the old rate and the rest at the new one, each at a constant rate.
    """

    def __init__(self) -> None:
        """Start without links; `grow` adds some."""
        #: The bytes that enter evenly between `_seen` and `_turn`, and those from then on, at `_pace` [bytes/s].
        self._early = np.zeros(0)
        self._late = np.zeros(0)
        self._pace = np.zeros(0)
        self._seen = np.zeros(0, np.int64)
        self._turn = np.zeros(0, np.int64)

    def grow(self, room: int) -> None:
        """Add a number of links without a backlog."""
        self._early, self._late, self._pace = (
            np.concatenate([each, np.zeros(room)]) for each in (self._early, self._late, self._pace)
        )
        self._seen, self._turn = (np.concatenate([each, np.zeros(room, np.int64)]) for each in (self._seen, self._turn))

    def settle(self, links: Indices, now: int, free: Times) -> Array:
        """Remove what has entered the links, and return how much still waits, in bytes.

        Args:
            links: The rows of the links; shape (m,).
            now: The present time, in nanoseconds.
            free: When the whole backlog has entered, in nanoseconds; shape (m,).
        """
        seen, turn = self._seen[links], self._turn[links]
        early = self._early[links] * _remaining(now, seen, turn)
        late = self._late[links] * _remaining(now, np.maximum(seen, turn), free)
        self._early[links], self._late[links], self._seen[links] = early, late, now
        waiting: Array = early + late
        return waiting

    def add(self, links: Indices, sizes: NDArray[np.int64], bandwidth: Array, begin: Times) -> None:
        """Add to the backlog; call `settle` first.

        Args:
            links: The rows of the links; shape (m,).
            sizes: In bytes; shape (m,).
            bandwidth: The rate at which it enters [bytes/s]; shape (m,).
            begin: When it starts to enter, in nanoseconds; shape (m,).
        """
        late = self._late[links]
        turns = (late == 0.0) | (self._pace[links] != bandwidth)
        self._early[links] += np.where(turns, late, 0.0)
        self._late[links] = np.where(turns, 0.0, late) + sizes
        self._turn[links] = np.where(turns, begin, self._turn[links])
        self._pace[links] = bandwidth


class RecentTransmissions:
    """The times when the last messages have entered their links, for limits of queue lengths, by rows of `LinkStates`.

    The times of a link ascend. So n or more messages wait for a link or are entering it if and only if the n-th last
    has not entered yet.
    """

    def __init__(self) -> None:
        """Start without links; times are stored from the first call of `last` on."""
        #: In nanoseconds, the last message first; 0 where there was none.
        self._times = np.zeros((0, 0), np.int64)

    def grow(self, room: int) -> None:
        """Add a number of links without messages."""
        self._times = np.pad(self._times, ((0, room), (0, 0)))

    def last(self, links: Indices, number: int) -> Times:
        """Return when the message with a number from the end has entered its link, in nanoseconds; shape (m,).

        Args:
            links: The rows of the links; shape (m,).
            number: 1 is the last message.
        """
        if number > self._times.shape[1]:
            self._times = np.pad(self._times, ((0, 0), (0, number - self._times.shape[1])))
        times: Times = self._times[links, number - 1]
        return times

    def add(self, links: Indices, leaving: Times) -> None:
        """Store messages, at most one for each link.

        Args:
            links: The rows of the links; shape (m,).
            leaving: When each has entered its link, in nanoseconds; shape (m,).
        """
        times = self._times[links]
        self._times[links] = np.concatenate([leaving[:, None], times[:, :-1]], axis=1)


def _remaining(now: int, begin: Times, end: Times) -> Array:
    """Return the remaining fractions of time spans."""
    length = np.maximum(end - begin, 1)
    share: Array = np.where(now >= end, 0.0, np.minimum((end - now) / length, 1.0))
    return share
