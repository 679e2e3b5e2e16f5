"""The backlog: how much waits for each link, in bytes and in messages."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core.message import Indices, Times
from symaware_cli.world.chance import Array


class Backlog:
    """What waits for links or is on its way into them, by rows of `LinkStates`.

    When a message gets into its link is decided as it is sent. So where the bandwidth has changed since, the first part
    of what waits gets in at the old pace and the rest at the new one; each part evenly.
    """

    def __init__(self) -> None:
        """Begin without links; `grow` makes room for some."""
        #: What gets in evenly between `_seen` and `_turn`, and between then and the end, at `_pace` [bytes/s].
        self._early = np.zeros(0)
        self._late = np.zeros(0)
        self._pace = np.zeros(0)
        self._seen = np.zeros(0, np.int64)
        self._turn = np.zeros(0, np.int64)

    def grow(self, room: int) -> None:
        """Make room for so many links more, for which nothing waits."""
        self._early, self._late, self._pace = (
            np.concatenate([each, np.zeros(room)]) for each in (self._early, self._late, self._pace)
        )
        self._seen, self._turn = (np.concatenate([each, np.zeros(room, np.int64)]) for each in (self._seen, self._turn))

    def settle(self, links: Indices, now: int, free: Times) -> Array:
        """Let go of what has got in, and return how much still waits, in bytes.

        Args:
            links: Rows; shape (m,).
            now: In nanoseconds.
            free: When all of it is in, in nanoseconds; shape (m,).
        """
        seen, turn = self._seen[links], self._turn[links]
        early = self._early[links] * _remaining(now, seen, turn)
        late = self._late[links] * _remaining(now, np.maximum(seen, turn), free)
        self._early[links], self._late[links], self._seen[links] = early, late, now
        waiting: Array = early + late
        return waiting

    def add(self, links: Indices, sizes: NDArray[np.int64], bandwidth: Array, begin: Times) -> None:
        """Let more wait; call `settle` first.

        Args:
            links: Rows; shape (m,).
            sizes: In bytes; shape (m,).
            bandwidth: At what pace it gets in [bytes/s]; shape (m,).
            begin: When it begins to, in nanoseconds; shape (m,).
        """
        late = self._late[links]
        turns = (late == 0.0) | (self._pace[links] != bandwidth)
        self._early[links] += np.where(turns, late, 0.0)
        self._late[links] = np.where(turns, 0.0, late) + sizes
        self._turn[links] = np.where(turns, begin, self._turn[links])
        self._pace[links] = bandwidth


class RecentTransmissions:
    """When the last messages are in their links, as many of each as any queue counts, by rows of `LinkStates`.

    The times of a link ascend. So there are n messages or more that wait or are on their way into it, if and only if
    the n-th last is not in it yet.
    """

    def __init__(self) -> None:
        """Begin without links, and remember nothing until somebody asks."""
        #: In nanoseconds, the last message first; 0 where there was none.
        self._times = np.zeros((0, 0), np.int64)

    def grow(self, room: int) -> None:
        """Make room for so many links more, for which nothing waits."""
        self._times = np.pad(self._times, ((0, room), (0, 0)))

    def last(self, links: Indices, number: int) -> Times:
        """When the message was in its link, or will be, that is so many back, in nanoseconds; shape (m,).

        Args:
            links: Rows; shape (m,).
            number: 1 is the last message.
        """
        if number > self._times.shape[1]:
            self._times = np.pad(self._times, ((0, 0), (0, number - self._times.shape[1])))
        times: Times = self._times[links, number - 1]
        return times

    def add(self, links: Indices, leaving: Times) -> None:
        """Remember messages, at most one for each link.

        Args:
            links: Rows; shape (m,).
            leaving: When each is in its link, in nanoseconds; shape (m,).
        """
        times = self._times[links]
        self._times[links] = np.concatenate([leaving[:, None], times[:, :-1]], axis=1)


def _remaining(now: int, begin: Times, end: Times) -> Array:
    """Which share of phases of time is still to come."""
    length = np.maximum(end - begin, 1)
    share: Array = np.where(now >= end, 0.0, np.minimum((end - now) / length, 1.0))
    return share
