"""The channel of a link: delays, loses, duplicates and queues messages; disturbances may add to that."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import nanoseconds
from symaware_cli.core.message import Indices, Times
from symaware_cli.engine.network.channel.channel_parameters import Bursts, ChannelParameters
from symaware_cli.engine.network.channel.fates import LOSS, QUEUE_FULL, TOO_OLD, Fates, Impairment
from symaware_cli.engine.network.channel.link_states import FOREVER, LinkStates
from symaware_cli.world import Array, ProbabilityDistribution, message_fractions

_DELAY, _JITTER, _LOSS, _STATE = range(4)
_REPEATED, _AGAIN, _AGAIN_JITTER, _START = range(4)


class Channel:
    """Decides the fates of messages over any number of links, whose states are stored in `LinkStates`.

    A message first waits until those before it have entered the link; then it may be lost; it travels; it may arrive
    twice. So a lost message has used bandwidth.

    Attributes:
        parameters: The parameters of the channel.
    """

    def __init__(self, parameters: ChannelParameters) -> None:
        self.parameters = parameters
        delay = parameters.delay
        self._constant = nanoseconds(delay) if isinstance(delay, float) and not parameters.jitter else None
        self._is_sure = self._constant is not None and parameters.loss == 0.0 and parameters.duplication == 0.0
        self._oldest = None if parameters.max_age is None else nanoseconds(parameters.max_age)

    @property
    def bandwidth(self) -> float:
        """The bandwidth of each link [bytes/s]; infinite without a limit."""
        return math.inf if self.parameters.bandwidth is None else self.parameters.bandwidth

    @property
    def drops_heads(self) -> bool:
        """Whether a queued message may be dropped when another one is sent."""
        return self.parameters.is_bounded and self.parameters.drop == "head"

    def carry(
        self,
        states: LinkStates,
        links: Indices,
        numbers: Times,
        now: int,
        sizes: NDArray[np.int64],
        impairment: Impairment | None = None,
    ) -> Fates:
        """Decide the fates of messages that are sent now, at most one over each link.

        Args:
            states: The states of the links.
            links: The rows of the links; shape (m,).
            numbers: The numbers of the messages on their links; shape (m,).
            now: The present time, in nanoseconds.
            sizes: In bytes; shape (m,).
            impairment: Disturbances; None for none.
        """
        parameters = self.parameters
        leaving, full = np.full(len(links), now, np.int64), np.zeros(len(links), bool)
        if parameters.bandwidth is not None or impairment is not None or states.congestion > now:
            bandwidth = np.full(len(links), self.bandwidth)
            if impairment is not None:
                bandwidth = np.minimum(bandwidth, impairment.bandwidth)
            free = states.free[links]
            begin = np.maximum(free, now)
            if parameters.queue is not None:
                # Times are whole nanoseconds: tolerate an excess of less than a nanosecond's worth.
                grace = np.where(np.isfinite(bandwidth), bandwidth / 1e9, 0.0)
                full = states.backlog.settle(links, now, free) + sizes > parameters.queue + grace
            if parameters.queue_length is not None:
                full |= states.recent.last(links, parameters.queue_length) > now
            some = ~full
            if parameters.queue is not None:
                states.backlog.add(links[some], sizes[some], bandwidth[some], begin[some])
            # Rounding errors are carried over to the next message, or a busy link would be too slow.
            lasts = np.minimum(sizes * (1e9 / bandwidth) + np.where(free >= now, states.residue[links], 0.0), FOREVER)
            leaving = np.minimum(begin + np.rint(lasts).astype(np.int64), FOREVER)
            if parameters.queue_length is not None:
                states.recent.add(links[some], leaving[some])
            states.free[links] = np.where(full, free, leaving)
            states.residue[links] = np.where(full, states.residue[links], lasts - np.rint(lasts))
            if parameters.bandwidth is None:
                states.congestion = max(states.congestion, int(states.free[links].max(initial=0)))
        fates = self.transmit(states, links, numbers, np.full(len(links), now), leaving, ~full, impairment)
        fates.reason[full] = QUEUE_FULL
        return fates

    def transmit(
        self,
        states: LinkStates,
        links: Indices,
        numbers: Times,
        sent: Times,
        leaving: Times,
        counts: NDArray[np.bool_] | None = None,
        impairment: Impairment | None = None,
    ) -> Fates:
        """Decide the fates of messages that have entered their links.

        Args:
            states: The states of the links.
            links: The rows of the links; shape (m,).
            numbers: The numbers of the messages on their links; shape (m,).
            sent: The times of sending, in nanoseconds; shape (m,).
            leaving: The times when they have entered the link, in nanoseconds; shape (m,).
            counts: Which of them have actually entered; all if None.
            impairment: Disturbances; None for none.
        """
        parameters, no_copies = self.parameters, np.empty(0, np.intp)
        reason = np.zeros(len(links), np.uint8)
        copies, copies_due = no_copies, np.empty(0, np.int64)
        if self._is_sure:
            due = leaving + (self._constant or 0)
        else:
            drawn = message_fractions(states.keys[links], numbers, 0)
            more = message_fractions(states.keys[links], numbers, 1) if self._draws_more else None
            due = leaving + self._travel(drawn[_DELAY], drawn[_JITTER])
            lost = self._lost(states, links, drawn, more, counts)
            reason[lost] = LOSS
            if more is not None and parameters.duplication:
                copies = np.flatnonzero((more[_REPEATED] < parameters.duplication) & ~lost)
                copies_due = (leaving + self._travel(more[_AGAIN], more[_AGAIN_JITTER]))[copies]
        if impairment is not None:
            due = due + impairment.delay
            reason = np.where(reason == 0, impairment.reason, reason)
            kept = impairment.reason[copies] == 0
            copies, copies_due = copies[kept], (copies_due + impairment.delay[copies])[kept]
        if parameters.in_order:
            arriving = reason == 0 if counts is None else (reason == 0) & counts
            due = np.maximum(due, states.arrival[links])
            last = due.copy()
            if len(copies):
                copies_due = np.maximum(copies_due, due[copies])
                last[copies] = copies_due
            states.arrival[links] = np.where(arriving, last, states.arrival[links])
        if self._oldest is not None:
            late = (reason == 0) & (due - sent > self._oldest)
            reason[late] = TOO_OLD
            # A message and its copy may be too old independently of each other.
            timely = copies_due - sent[copies] <= self._oldest
            copies, copies_due = copies[timely], copies_due[timely]
        if counts is not None and len(copies):
            chosen = counts[copies]
            copies, copies_due = copies[chosen], copies_due[chosen]
        return Fates(due, reason, copies, copies_due)

    @property
    def _draws_more(self) -> bool:
        return bool(self.parameters.duplication) or isinstance(self.parameters.loss, Bursts)

    def _travel(self, delay: Array, jitter: Array) -> Times:
        """Return the travel times of messages, in nanoseconds."""
        if self._constant is not None:
            return np.full(len(delay), self._constant, np.int64)
        given = self.parameters.delay
        seconds = given.quantiles(delay) if isinstance(given, ProbabilityDistribution) else np.full(len(delay), given)
        if self.parameters.jitter:
            seconds = seconds + self.parameters.jitter * jitter
        return np.rint(np.minimum(seconds, 1e9) * 1e9).astype(np.int64)

    def _lost(
        self, states: LinkStates, links: Indices, drawn: Array, more: Array | None, counts: NDArray[np.bool_] | None
    ) -> NDArray[np.bool_]:
        loss, lost = self.parameters.loss, np.zeros(len(links), bool)
        if not isinstance(loss, Bursts):
            lost[:] = drawn[_LOSS] < loss
            return lost
        assert more is not None
        # Before the first message the state is drawn from its stationary distribution.
        share = loss.enter / (loss.enter + loss.leave)
        before = states.bad[links]
        was_bad = np.where(before < 0, more[_START] < share, before == 1)
        changes = drawn[_STATE] < np.where(was_bad, loss.leave, loss.enter)
        is_bad = np.where(before < 0, was_bad, was_bad ^ changes)
        states.bad[links] = is_bad if counts is None else np.where(counts, is_bad, before)
        lost[:] = drawn[_LOSS] < np.where(is_bad, loss.bad, loss.good)
        return lost
