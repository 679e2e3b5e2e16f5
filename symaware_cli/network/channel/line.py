"""A waiting line before a link, from which the oldest message is dropped when it is full."""

from __future__ import annotations

import math
from collections import deque
from typing import Generic, TypeVar

from symaware_cli.network.channel.parameters import ChannelParameters

Parcel = TypeVar("Parcel")


class Line(Generic[Parcel]):
    """What waits for one link.

    What is dropped depends on what is sent later, so nothing can be decided when a message is sent, and each is an
    object of its own here.
    """

    def __init__(self, parameters: ChannelParameters) -> None:
        assert parameters.bandwidth is not None
        self._bandwidth = parameters.bandwidth
        self._rate = parameters.bandwidth / 1e9
        self._limit = parameters.queue or 0.0
        self._free = 0
        self._waiting: deque[tuple[int, int, Parcel]] = deque()
        self._waiting_size = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def next_time(self) -> int | None:
        """When the link takes the next message, in nanoseconds."""
        return max(self._free, self._waiting[0][0]) if self._waiting else None

    def join(self, now: int, size: int, parcel: Parcel) -> list[Parcel]:
        """Let a message wait, and return what is dropped for want of room: older ones, or it itself if it is too big.

        Call `advance` first.
        """
        dropped = []
        carried = max(self._free - now, 0) * self._rate
        if carried + size > self._limit:
            return [parcel]
        while carried + self._waiting_size + size > self._limit:
            _, oldest, victim = self._waiting.popleft()
            self._waiting_size -= oldest
            dropped.append(victim)
        self._waiting.append((now, size, parcel))
        self._waiting_size += size
        return dropped

    def advance(self, now: int, bandwidth: float = math.inf) -> list[tuple[Parcel, int]]:
        """Return what the link has taken until now, with when each is in the link, in nanoseconds.

        Args:
            now: In nanoseconds.
            bandwidth: How much gets into the link at most, if that is less than usual [bytes/s].
        """
        taken = []
        self._rate = min(self._bandwidth, bandwidth) / 1e9
        while self._waiting and (begins := max(self._free, self._waiting[0][0])) <= now:
            _, size, parcel = self._waiting.popleft()
            self._waiting_size -= size
            self._free = begins + round(size / self._rate)
            taken.append((parcel, self._free))
        return taken
