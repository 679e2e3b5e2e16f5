"""The queue of a link that drops its oldest message when full."""

from __future__ import annotations

import math
from collections import deque
from typing import Generic, TypeVar

from symaware_cli.network.channel.channel_parameters import ChannelParameters
from symaware_cli.network.channel.link_states import FOREVER

QueuedMessage = TypeVar("QueuedMessage")


class LinkQueue(Generic[QueuedMessage]):
    """The messages that wait for one link.

    Which messages are dropped depends on later ones, so nothing can be decided when a message is sent, and messages are
    stored as single objects here.
    """

    def __init__(self, parameters: ChannelParameters) -> None:
        self._bandwidth = math.inf if parameters.bandwidth is None else parameters.bandwidth
        #: The present bandwidth [bytes/s].
        self._present = self._bandwidth
        self._limit = math.inf if parameters.queue is None else parameters.queue
        self._most = math.inf if parameters.queue_length is None else parameters.queue_length
        #: The message that is entering the link: start, end with its sub-nanosecond residue, and size.
        self._begun = self._free = 0
        self._residue = 0.0
        self._size = 0
        self._waiting: deque[tuple[int, int, QueuedMessage]] = deque()
        self._waiting_size = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def next_time(self) -> int | None:
        """The time at which the next message starts to enter the link, in nanoseconds."""
        return max(self._free, self._waiting[0][0]) if self._waiting else None

    def is_over(self, now: int) -> bool:
        """Return whether nothing waits, and all messages have entered the link."""
        return not self._waiting and self._free < now

    def join(self, now: int, size: int, queued: QueuedMessage) -> list[QueuedMessage]:
        """Queue a message, and return what is dropped from a full queue: older ones, or itself if too big.

        Call `advance` first.
        """
        dropped = []
        carried = self._size * (self._free - now) / (self._free - self._begun) if self._free > now else 0.0
        # Tolerate an excess of less than a nanosecond's worth; see `Channel.carry`.
        limit = self._limit + (self._present / 1e9 if self._present < math.inf else 0.0)
        if carried + size > limit:
            return [queued]
        under_way = int(self._free > now)
        if under_way >= self._most:
            return [queued]
        while carried + self._waiting_size + size > limit or under_way + len(self._waiting) >= self._most:
            _, oldest, victim = self._waiting.popleft()
            self._waiting_size -= oldest
            dropped.append(victim)
        self._waiting.append((now, size, queued))
        self._waiting_size += size
        return dropped

    def advance(self, now: int, bandwidth: float = math.inf) -> list[tuple[QueuedMessage, int]]:
        """Return the messages that have started to enter the link by now, with the times when they have entered [ns].

        Args:
            now: The present time, in nanoseconds.
            bandwidth: A limit of the bandwidth [bytes/s].
        """
        taken = []
        self._present = min(self._bandwidth, bandwidth)
        while self._waiting and (begins := max(self._free, self._waiting[0][0])) <= now:
            _, size, queued = self._waiting.popleft()
            self._waiting_size -= size
            lasts = min(size * (1e9 / self._present) + (self._residue if begins == self._free else 0.0), FOREVER)
            self._begun, self._size, self._free = begins, size, min(begins + round(lasts), FOREVER)
            self._residue = lasts - round(lasts)
            taken.append((queued, self._free))
        return taken
