"""The transmission: what network and disturbances together make of messages that are sent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery
from symaware_cli.core.message import Indices, Times
from symaware_cli.network.channel.channel import NO_LINK, REASONS, Channel, Fates
from symaware_cli.network.channel.channel_parameters import ChannelParameters
from symaware_cli.network.channel.impairment import Impairment
from symaware_cli.network.channel.link_queue import LinkQueue
from symaware_cli.network.channel.link_states import LinkStates
from symaware_cli.network.disturbance import Disturbance
from symaware_cli.network.network import Network
from symaware_cli.world.chance import key_of, message_fractions

#: Stands among the reasons for what is not decided yet.
WAITS = 255

#: Where there is no network.
_PERFECT = Channel(ChannelParameters())

#: The pages of a message's draws before this one belong to its channel.
_OWN_PAGE = 2


@dataclass(frozen=True, slots=True)
class QueuedMessage:
    """A message that waits before a link.

    Attributes:
        content: It, on its own.
        sizes: Of what each row of its batch says, in bytes; shape (s,).
        row: The link, as a row in the states.
        number: Its number on the link.
        sent: When it was sent, in nanoseconds.
    """

    content: Delivery
    sizes: NDArray[np.int64]
    row: int
    number: int
    sent: int


class Transmission:
    """Decides what becomes of messages.

    Attributes:
        network: Who reaches whom, and how; None for everybody, at once and without fail.
        disturbances: What happens to messages besides.
        reasons: What the numbers stand for that tell why messages are dropped.
    """

    def __init__(self, seed: int, ids: Sequence[str]) -> None:
        self.network: Network | None = None
        self.disturbances: list[Disturbance] = []
        self.reasons = list(REASONS)
        self._seed = seed
        self._ids = ids
        self._queues: dict[int, LinkQueue[QueuedMessage]] = {}

    @cached_property
    def _states(self) -> LinkStates:
        return LinkStates(self._seed, self._ids)

    def is_free(self, now: int) -> bool:
        """Whether all messages pass, at once."""
        return self.network is None and self._is_undisturbed(now)

    def _is_undisturbed(self, now: int) -> bool:
        """Whether there is no disturbance, and no message waits for a link because of one that is over."""
        return not self.disturbances and self._states.congestion <= now

    @property
    def waiting(self) -> int:
        """How many messages wait before links."""
        return sum(len(queue) for queue in self._queues.values())

    @property
    def next_time(self) -> int | None:
        """When the next of them gets into its link, in nanoseconds."""
        times = [time for queue in self._queues.values() if (time := queue.next_time) is not None]
        return min(times, default=None)

    def decide(
        self, sent: Delivery, sizes: NDArray[np.int64], now: int, *, linked: bool
    ) -> tuple[Fates, list[QueuedMessage]]:
        """Decide the fates of messages that are sent now, at most one over each link.

        Args:
            sent: The messages.
            sizes: Of what each row of their batch says, in bytes; shape (s,).
            now: In nanoseconds.
            linked: Whether all of them go over links that there are at present.

        Returns:
            The fates, in which `WAITS` is the reason of what will come out of `advance`; and what waited before and is
            dropped from a full queue now.
        """
        network, senders, receivers = self.network, sent.senders, sent.receivers
        if network is not None and network.is_perfect and self._is_undisturbed(now):
            return _at_once(None if linked else network.has(senders, receivers), len(senders), now), []
        states = self._states
        rows, new = states.rows(senders, receivers)
        if new is not None and network is not None:
            network.enter(states, new)
        numbers, each = states.number(rows, now), sizes[sent.rows]
        impairment = self._impairment(senders, receivers, rows, numbers)
        victims: list[QueuedMessage] = []
        if network is None:
            return _PERFECT.carry(states, rows, numbers, now, each, impairment), victims
        has = None if linked else network.has(senders, receivers)
        waits = network.waits(states, rows, has) if network.has_queues else np.zeros(len(rows), bool)
        fates = network.carry(states, rows, numbers, now, each, has, waits if waits.any() else None, impairment)
        for place in np.flatnonzero(waits).tolist():
            queued = QueuedMessage(
                sent.some(slice(place, place + 1)), sizes, int(rows[place]), int(numbers[place]), now
            )
            victims += self._wait(network, queued, int(each[place]), now)
            fates.reason[place] = WAITS
        return fates, victims

    def _wait(self, network: Network, queued: QueuedMessage, size: int, now: int) -> list[QueuedMessage]:
        queue = self._queues.get(queued.row)
        if queue is None:
            channel = network.channel(int(self._states.channel[queued.row]))
            queue = self._queues[queued.row] = LinkQueue(channel.parameters)
        return queue.join(now, size, queued)

    def advance(self, now: int) -> list[tuple[QueuedMessage, Fates]]:
        """Decide the fates of what has got into its link until now."""
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
        """How much gets into a link at most, as far as disturbances go [bytes/s]."""
        limits = [each.bandwidth for each in self.disturbances if each.concerned(self._ids, sender, receiver)[0]]
        return min(limits, default=math.inf)

    def _impairment(self, senders: Indices, receivers: Indices, rows: Indices, numbers: Times) -> Impairment | None:
        """What disturbs messages; None if there are no disturbances."""
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
                struck = hit & (reason == 0) & self._struck(disturbance, rows, numbers)
                reason[struck] = self._reason(disturbance.name)
        return Impairment(delay, bandwidth, reason)

    def _struck(self, disturbance: Disturbance, rows: Indices, numbers: Times) -> NDArray[np.bool_]:
        """Which messages a disturbance would lose: drawn from the link's chance, so that nobody else's matters."""
        keys = self._states.keys[rows] ^ np.uint64(key_of(self._seed, "disturbances", disturbance.name))
        struck: NDArray[np.bool_] = message_fractions(keys, numbers, _OWN_PAGE)[0] < disturbance.loss
        return struck

    def _reason(self, name: str) -> int:
        """The number of a reason."""
        if name not in self.reasons:
            self.reasons.append(name)
        return self.reasons.index(name)


def _at_once(linked: NDArray[np.bool_] | None, count: int, now: int) -> Fates:
    """The fates of messages that get through at once, if they go over a link."""
    reason = np.zeros(count, np.uint8)
    if linked is not None:
        reason[~linked] = NO_LINK
    return Fates(np.full(count, now), reason, np.empty(0, np.intp), np.empty(0, np.int64))
