"""Transmission: the effects of the network and of faults on sent messages, at once or after a queue; see `channel`."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery
from symaware_cli.core.message import Indices, Times
from symaware_cli.engine.network.channel.channel import Channel
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.channel.fates import NO_LINK, REASONS, WAITS, Fates, Impairment
from symaware_cli.engine.network.channel.link_states import FOREVER, LinkStates
from symaware_cli.engine.network.disturbance import Disturbance
from symaware_cli.engine.network.network import Network
from symaware_cli.world import key_of, message_fractions

Content = TypeVar("Content")
#: The first page of a message's random draws after those of its channel.
_OWN_PAGE = 2


class LinkQueue(Generic[Content]):
    """The messages that wait for one link, which drops the oldest when its queue is full.

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
        self._waiting: deque[tuple[int, int, Content]] = deque()
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

    def join(self, now: int, size: int, queued: Content) -> list[Content]:
        """Queue a message, and return the messages dropped from a full queue: older ones, or itself if it is too big.

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

    def advance(self, now: int, bandwidth: float = math.inf) -> list[tuple[Content, int]]:
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


#: The channel without a network.
_PERFECT = Channel(ChannelParameters())


@dataclass(frozen=True, slots=True)
class QueuedMessage:
    """A message that is queued at a link.

    Attributes:
        content: The message, as a delivery of one.
        sizes: The size of the message in each row of its batch, in bytes; shape (s,).
        row: The row of the link in the states.
        number: The number of the message on the link.
        sent: The time of sending, in nanoseconds.
    """

    content: Delivery
    sizes: NDArray[np.int64]
    row: int
    number: int
    sent: int


class Transmission:
    """Decides the fates of messages.

    Attributes:
        network: The links and channels; None for perfect links between all agents.
        disturbances: The active disturbances.
        reasons: The reasons of drops by their numbers.
    """

    def __init__(self, seed: int, ids: Sequence[str]) -> None:
        self.network: Network | None = None
        self.disturbances: list[Disturbance] = []
        self.reasons = list(REASONS)
        self._seed = seed
        self._ids = ids
        self._queues: dict[int, LinkQueue[QueuedMessage]] = {}

    def reseed(self, seed: int) -> None:
        """Draw the fates of messages from another seed from now on."""
        self._seed = seed

    def disturb(self, disturbances: Sequence[Disturbance]) -> None:
        """Add disturbances from now on."""
        self.disturbances.extend(disturbances)
        if any(each.draw for each in disturbances):
            self._states.redraw([each for each in self.disturbances if each.draw])

    def relieve(self, disturbances: Sequence[Disturbance]) -> None:
        """Remove disturbances."""
        for each in disturbances:
            self.disturbances.remove(each)
        if any(each.draw for each in disturbances):
            self._states.redraw([each for each in self.disturbances if each.draw])

    @cached_property
    def _states(self) -> LinkStates:
        return LinkStates(self._seed, self._ids)

    def is_free(self, now: int) -> bool:
        """Return whether all messages pass without delay."""
        return self.network is None and self._is_undisturbed(now)

    def _is_undisturbed(self, now: int) -> bool:
        """Return whether no disturbance is active, and no message still waits because of an ended one."""
        return not self.disturbances and self._states.congestion <= now

    @property
    def waiting(self) -> int:
        """The number of messages queued at links."""
        return sum(len(queue) for queue in self._queues.values())

    @property
    def next_time(self) -> int | None:
        """The next time at which one of them enters its link, in nanoseconds."""
        times = [time for queue in self._queues.values() if (time := queue.next_time) is not None]
        return min(times, default=None)

    def decide(
        self, sent: Delivery, sizes: NDArray[np.int64], now: int, *, linked: bool
    ) -> tuple[Fates, list[QueuedMessage]]:
        """Decide the fates of messages that are sent now, at most one over each link.

        Args:
            sent: The messages.
            sizes: The size of the message in each row of their batch, in bytes; shape (s,).
            now: The present time, in nanoseconds.
            linked: Whether all of them go over present links.

        Returns:
            The fates, with the reason `WAITS` for messages that `advance` will decide, and the messages that are
            dropped from full queues now.
        """
        network, senders, receivers = self.network, sent.senders, sent.receivers
        if network is not None and network.is_perfect and self._is_undisturbed(now):
            return _immediate_fates(None if linked else network.has(senders, receivers), len(senders), now), []
        states = self._states
        rows, new = states.rows(senders, receivers)
        if new is not None and network is not None:
            network.enter(states, new)
        numbers, each = states.number(rows, now), sizes[sent.rows]
        impairment = self._impairment(senders, receivers, rows, numbers)
        victims: list[QueuedMessage] = []
        timely = self._timely(senders, receivers)
        if network is None:
            return _in_time(_PERFECT.carry(states, rows, numbers, now, each, impairment), timely, now), victims
        has = None if linked else network.has(senders, receivers)
        waits = network.waits(states, rows, has) if network.has_queues else np.zeros(len(rows), bool)
        fates = network.carry(states, rows, numbers, now, each, has, waits if waits.any() else None, impairment)
        for place in np.flatnonzero(waits if timely is None else waits & ~timely).tolist():
            queued = QueuedMessage(
                sent.some(slice(place, place + 1)), sizes, int(rows[place]), int(numbers[place]), now
            )
            victims += self._wait(network, queued, int(each[place]), now)
            fates.reason[place] = WAITS
        return _in_time(fates, timely, now), victims

    def _timely(self, senders: Indices, receivers: Indices) -> NDArray[np.bool_] | None:
        """Return which messages faults deliver in time; None for none."""
        hits = [each.concerned(self._ids, senders, receivers) for each in self.disturbances if each.in_time]
        return np.any(hits, axis=0) if hits else None

    def _wait(self, network: Network, queued: QueuedMessage, size: int, now: int) -> list[QueuedMessage]:
        queue = self._queues.get(queued.row)
        if queue is None:
            channel = network.channel(int(self._states.channel[queued.row]))
            queue = self._queues[queued.row] = LinkQueue(channel.parameters)
        return queue.join(now, size, queued)

    def advance(self, now: int) -> list[tuple[QueuedMessage, Fates]]:
        """Decide the fates of queued messages that have entered their links by now."""
        states, network = self._states if self._queues else None, self.network
        if states is None or network is None:
            return []
        done = []
        for row in sorted(self._queues):
            queue = self._queues[row]
            if queue.is_over(now):
                del self._queues[row]
                continue
            channel, rows = network.channel(int(states.channel[row])), np.array([row])
            ends = states.ends(slice(row, row + 1))
            for queued, leaving in queue.advance(now, self._bandwidth(*ends)):
                numbers, sent = np.array([queued.number]), np.array([queued.sent])
                impairment = self._impairment(*ends, rows, numbers)
                fates = channel.transmit(states, rows, numbers, sent, np.array([leaving]), impairment=impairment)
                done.append((queued, fates))
        return done

    def _bandwidth(self, sender: Indices, receiver: Indices) -> float:
        """Return the limit that disturbances set on a link's bandwidth [bytes/s]."""
        limits = [each.bandwidth for each in self.disturbances if each.concerned(self._ids, sender, receiver)[0]]
        return min(limits, default=math.inf)

    def _impairment(self, senders: Indices, receivers: Indices, rows: Indices, numbers: Times) -> Impairment | None:
        """Return the effect of the disturbances on messages; None without disturbances."""
        if not self.disturbances:
            return None
        delay, bandwidth, reason = Impairment.none(len(rows))
        for disturbance in self.disturbances:
            hit = disturbance.concerned(self._ids, senders, receivers)
            if not hit.any():
                continue
            delay[hit] += disturbance.delay
            bandwidth[hit] = np.minimum(bandwidth[hit], disturbance.bandwidth)
            if disturbance.loss:
                struck = hit & (reason == 0) & self._draw_losses(disturbance, rows, numbers)
                reason[struck] = self._reason(disturbance.name)
        return Impairment(delay, bandwidth, reason)

    def _draw_losses(self, disturbance: Disturbance, rows: Indices, numbers: Times) -> NDArray[np.bool_]:
        """Draw which messages a disturbance loses, keyed by the link, so that draws of other links do not matter."""
        keys = self._states.keys[rows] ^ np.uint64(key_of(self._seed, "disturbances", disturbance.name))
        struck: NDArray[np.bool_] = message_fractions(keys, numbers, _OWN_PAGE)[0] < disturbance.loss
        return struck

    def _reason(self, name: str) -> int:
        """Return the number of a reason."""
        if name not in self.reasons:
            self.reasons.append(name)
        return self.reasons.index(name)


def _in_time(fates: Fates, timely: NDArray[np.bool_] | None, now: int) -> Fates:
    """Let messages arrive without a delay if they have a link; what their links remember of them stays."""
    if timely is None:
        return fates
    chosen = timely & (fates.reason != NO_LINK)
    due, reason = np.where(chosen, now, fates.due), np.where(chosen, np.uint8(0), fates.reason)
    return fates._replace(due=due, reason=reason)


def _immediate_fates(linked: NDArray[np.bool_] | None, count: int, now: int) -> Fates:
    """Return the fates of messages that are delivered without delay if they have a link."""
    reason = np.zeros(count, np.uint8)
    if linked is not None:
        reason[~linked] = NO_LINK
    return Fates(np.full(count, now), reason, np.empty(0, np.intp), np.empty(0, np.int64))
