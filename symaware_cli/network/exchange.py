"""The exchange within a process: from one agent's component to the inbox of another's."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Links, Message, MessageBatch
from symaware_cli.core.message import EVERYBODY, Indices, Times, copied
from symaware_cli.network.channel.channel import ABSENT, QUEUE_FULL, TOO_OLD, Fates
from symaware_cli.network.disturbance import Disturbance
from symaware_cli.network.in_transit import MessagesInTransit
from symaware_cli.network.inboxes import Inboxes
from symaware_cli.network.neighbours import Neighbours
from symaware_cli.network.network import Change, Network
from symaware_cli.network.outbox import Outbox
from symaware_cli.network.size import message_sizes
from symaware_cli.network.traffic import Traffic
from symaware_cli.network.transmission import WAITS, QueuedMessage, Transmission

#: Of what each row of a batch says, in bytes; shape (s,).
Sizes = NDArray[np.int64]


class UnknownReceiverError(Exception):
    """A message was sent to somebody who does not exist."""


class MessageExchange:
    """Carries messages in memory, over the links and channels of a network.

    Without a network, everybody reaches everybody: sent in one step, readable in the next, none ever lost but by a
    disturbance. What arrives is ordered by when it does, then by the sender's place in the roster, then by the sender's
    own order, so that it does not depend on who took its turn first.

    All messages travel in batches: what is sent singly is joined to such as are sent at the same instant, and sets out
    at its end. Each message that has set out, and each copy that the network made of one, is delivered, dropped or in
    flight.

    Attributes:
        now: Simulated time of the present instant, in nanoseconds.
        inboxes: What arrived and was not read yet.
        sent: How many messages have set out so far.
        duplicated: How many more were made of them under way.
        delivered: How many arrived.
        dropped: How many never will.
    """

    def __init__(
        self,
        ids: Sequence[str],
        listening: Container[str] | None = None,
        *,
        on_traffic: Callable[[Traffic], Any] = lambda traffic: None,
        on_change: Callable[[Change], Any] = lambda change: None,
        seed: int = 0,
        time_step: int,
    ) -> None:
        """Open an inbox for everybody who listens.

        Args:
            ids: All agents, in the roster's order.
            listening: Those who read whatever no other component reads; None for everybody. What arrives for others is
                delivered, too, but not kept: a run of any length would fill the memory with it.
            on_traffic: Called with messages that have set out, are readable, or are lost.
            on_change: Called when the links have changed.
            seed: The seed of the run.
            time_step: Between two steps of the world, in nanoseconds: what travels for no time arrives at the next one.
        """
        self._ids = tuple(ids)
        self._rank = {id: rank for rank, id in enumerate(ids)}
        self._sent_by = np.zeros(len(self._ids), np.int64)
        self._time_step = time_step
        self._muted: NDArray[np.bool_] | None = None
        self._present: NDArray[np.bool_] | None = None
        self._outbox = Outbox()
        self._outlet: Callable[[MessageBatch], Any] | None = None
        self._check: Callable[[Mapping[str, Any]], Any] = lambda payload: None
        self._away: NDArray[np.bool_] | None = None
        self._forward: Callable[[Delivery], Any] = lambda arrived: None
        self._transmission = Transmission(seed, self._ids)
        self._in_transit = MessagesInTransit()
        self.inboxes = Inboxes(self._ids, listening)
        self.now = 0
        self.sent = self.duplicated = self.delivered = self.dropped = 0
        self._on_traffic = on_traffic
        self._on_change = on_change

    @property
    def network(self) -> Network | None:
        """Who reaches whom, and how; None for everybody, at once and without fail."""
        return self._transmission.network

    @network.setter
    def network(self, network: Network | None) -> None:
        self._transmission.network = network
        if network is not None:
            network.present = self._present

    @property
    def present(self) -> NDArray[np.bool_] | None:
        """Who is there, by index, not to be changed in place; shape (n,). None for everybody.

        There are no links to those who are not, and what arrives for them is dropped. Links change with the next step.
        """
        return self._present

    @present.setter
    def present(self, present: NDArray[np.bool_] | None) -> None:
        self._present = present
        if self.network is not None:
            self.network.present = present

    def disturb(self, disturbances: Sequence[Disturbance]) -> None:
        """Let something happen to messages from now on, besides."""
        self.flush()
        self._transmission.disturbances.extend(disturbances)

    def relieve(self, disturbances: Sequence[Disturbance]) -> None:
        """Let something happen to messages no more."""
        self.flush()
        for disturbance in disturbances:
            self._transmission.disturbances.remove(disturbance)

    @property
    def in_flight(self) -> int:
        """How many messages are under way."""
        return len(self._in_transit) + self._transmission.waiting

    @property
    def next_time(self) -> int | None:
        """The next instant at which something is to be delivered, in nanoseconds."""
        times = [time for time in (self._in_transit.next_time, self._transmission.next_time) if time is not None]
        return min(times, default=None)

    @property
    def links(self) -> Links | None:
        """Who reaches whom now; None where everybody reaches everybody."""
        return None if self.network is None else self.network.links

    def neighbours(self, sender: str) -> Sequence[str]:
        """The ids of all whom an agent reaches now, in the roster's order.

        Raises:
            UnknownReceiverError: There is no such agent.
        """
        return Neighbours(self._ids, self._reached(self._known(sender)))

    def _reached(self, sender: int) -> Indices:
        network = self.network
        if network is not None and network.links is not None:
            return network.links.of_sender(sender)
        everybody = self._everybody
        others: Indices = everybody[everybody != sender]
        return others

    @property
    def _everybody(self) -> Indices:
        """All who are there."""
        return np.arange(len(self._ids)) if self._present is None else np.flatnonzero(self._present)

    def _known(self, id: str) -> int:
        rank = self._rank.get(id)
        if rank is None:
            raise UnknownReceiverError(f"there is no agent `{id}` to exchange messages with")
        return rank

    def _arrival(self, due: int) -> int:
        """When something can be read: what travels for no time, at the next step."""
        if due > self.now:
            return due
        return (self.now // self._time_step + 1) * self._time_step

    def _postponed(self, fates: Fates) -> Fates:
        """The fates of messages that are sent now, of which none arrives now."""
        soon = self._arrival(self.now)
        due, copies_due = (np.where(each <= self.now, soon, each) for each in (fates.due, fates.copies_due))
        return fates._replace(due=due, copies_due=copies_due)

    @contextmanager
    def muted(self, agents: Sequence[str]) -> Iterator[None]:
        """Let some agents say nothing for a while, in batches of their groups.

        A component of a whole group speaks for all its agents, and knows nothing of those that take no part any more.
        """
        before = self._muted
        if agents:
            self._muted = np.zeros(len(self._ids), bool)
            self._muted[[self._known(id) for id in agents]] = True
        try:
            yield
        finally:
            self._muted = before

    def divert(self, outlet: Callable[[MessageBatch], Any], check: Callable[[Mapping[str, Any]], Any]) -> None:
        """Hand on all that is sent from now on, instead of carrying it: another process does. See `arrive`.

        Args:
            outlet: Called with what was sent.
            check: Called with the payload of each message that is sent singly, at once; raises if it cannot be sent.
        """
        self._outlet = outlet
        self._check = check

    def forward(self, away: Sequence[str], forward: Callable[[Delivery], Any]) -> None:
        """Hand on all that arrives for some agents from now on: another process keeps their inboxes."""
        self._away = np.zeros(len(self._ids), bool)
        self._away[[self._known(id) for id in away]] = True
        self._forward = forward

    def send(self, message: Message) -> None:
        """Take a message, which sets out with the next `flush`; what its payload refers to is copied.

        Raises:
            UnknownReceiverError: There is no agent of the receiver's id, or of the sender's.
        """
        sender = self._known(message.sender)
        receiver = None if message.receiver == EVERYBODY else self._known(message.receiver)
        payload = {name: copied(value) for name, value in message.payload.items()}
        self._check(payload)
        self._outbox.put(sender, receiver, payload, message.kind)

    def flush(self) -> bool:
        """Let what was sent singly set out, at the latest at the end of the instant at which it was sent.

        Returns:
            Whether there was anything.
        """
        if not len(self._outbox):
            return False
        for batch in self._outbox.empty():
            self._dispatch(batch, self.now)
        return True

    def post(self, batch: MessageBatch, at: int | None = None) -> None:
        """Take the messages of many agents at once, after all that was sent before.

        Args:
            batch: What is said, by whom, to whom; not to be changed any more.
            at: When it was sent, if that was before now, in nanoseconds.
        """
        self.flush()
        if self._muted is not None:
            batch = batch.some(~self._muted[batch.senders])
        if len(batch.senders):
            self._dispatch(batch, self.now if at is None else at)

    def _dispatch(self, batch: MessageBatch, at: int) -> None:
        """Let a batch set out."""
        if self._outlet is not None:
            self._outlet(batch)
            return
        rows, receivers = self._addressed(batch)
        if not len(rows):
            return
        senders = batch.senders.take(rows)
        sequences = self._numbered(senders)
        sizes = message_sizes(batch)
        due = np.full(len(rows), self._arrival(self.now))
        sent = Delivery(batch, rows, receivers, sequences, at, due)
        self.sent += len(rows)
        self._on_traffic(Traffic("sent", sent, sizes))
        if self._transmission.is_free(self.now):
            self._in_transit.launch(sent, np.zeros(len(rows), np.uint8), sizes)
            return
        linked = batch.receivers is None
        fates, victims = self._transmission.decide(sent, sizes, self.now, linked=linked)
        self._push_out(victims)
        self._launch(sent, sizes, self._postponed(fates))
        self._advance()

    def _numbered(self, senders: Indices) -> Times:
        """Give each message, by its sender, ascending, its number among those of that sender."""
        begins = np.flatnonzero(np.concatenate([[True], senders[1:] != senders[:-1]]))
        counts = np.diff(begins, append=len(senders))
        numbers: Times = self._sent_by[senders] + np.arange(len(senders)) - np.repeat(begins, counts)
        self._sent_by[senders[begins]] += counts
        return numbers

    def _addressed(self, batch: MessageBatch) -> tuple[Indices, Indices]:
        """For each message of a batch its row there, ascending, and its receiver."""
        if batch.receivers is not None:
            return np.arange(len(batch.senders)), batch.receivers
        network = self.network
        if network is not None and network.links is not None:
            return network.reached(batch.senders)
        everybody = self._everybody
        rows = np.repeat(np.arange(len(batch.senders)), len(everybody))
        receivers = np.tile(everybody, len(batch.senders))
        others = batch.senders.take(rows) != receivers
        return rows[others], receivers[others]

    def _launch(self, sent: Delivery, sizes: Sizes, fates: Fates) -> None:
        """Let messages meet their fates."""
        flying = (fates.reason == 0) | (fates.reason == TOO_OLD)
        if flying.all() and not len(fates.copies):
            self._in_transit.launch(replace(sent, due=fates.due), fates.reason, sizes)
            return
        self._lose(sent, sizes, fates.reason, ~flying & (fates.reason != WAITS))
        places, due, reason = np.flatnonzero(flying), fates.due[flying], fates.reason[flying]
        if len(fates.copies):
            self.duplicated += len(fates.copies)
            places, due = np.concatenate([places, fates.copies]), np.concatenate([due, fates.copies_due])
            reason = np.concatenate([reason, np.zeros(len(fates.copies), np.uint8)])
        if len(places):
            self._in_transit.launch(replace(sent.some(places), due=due), reason, sizes)

    def _lose(self, delivery: Delivery, sizes: Sizes, reason: NDArray[np.uint8], lost: NDArray[np.bool_]) -> None:
        """Drop some messages."""
        places = np.flatnonzero(lost)
        if len(places):
            self.dropped += len(places)
            reasons = tuple(self._transmission.reasons)
            self._on_traffic(Traffic("dropped", delivery.some(places), sizes, reasons, reason[places]))

    def _push_out(self, victims: Sequence[QueuedMessage]) -> None:
        """Drop what is pushed out of full queues."""
        for queued in victims:
            self._lose(queued.content, queued.sizes, np.array([QUEUE_FULL], np.uint8), np.ones(1, bool))

    def _advance(self) -> None:
        """Let what waited before links go on its way, as far as its time has come."""
        for queued, fates in self._transmission.advance(self.now):
            self._launch(queued.content, queued.sizes, fates)

    def renew_links(self) -> None:
        """Look who reaches whom now."""
        change = None if self.network is None else self.network.update(self.now)
        if change is not None:
            self._on_change(change)

    def deliver(self, now: int) -> None:
        """Come to an instant: what arrived before or arrives now becomes readable.

        Steps of the world are the instants at which links change.
        """
        self.flush()
        self.now = now
        if now % self._time_step == 0:
            self.renew_links()
        self._advance()
        for delivery, reason, sizes in self._in_transit.take(now):
            if self._present is not None:
                reason = np.where((reason == 0) & ~self._present[delivery.receivers], np.uint8(ABSENT), reason)
            late = reason != 0
            arriving = delivery
            if late.any():
                self._lose(delivery, sizes, reason, late)
                arriving = delivery.some(~late)
            if len(arriving):
                self._hand_over(arriving, sizes)

    def arrive(self, arrived: Sequence[Delivery]) -> None:
        """Make readable what another process has carried here."""
        for delivery in arrived:
            self._hand_over(delivery, message_sizes(delivery.batch))

    def _hand_over(self, delivery: Delivery, sizes: Sizes) -> None:
        self.delivered += len(delivery)
        here = delivery
        if self._away is not None:
            away = self._away[delivery.receivers]
            if away.any():
                self._forward(delivery.some(away))
                here = delivery.some(~away)
        if len(here):
            self.inboxes.put(here)
        self._on_traffic(Traffic("delivered", delivery, sizes))

    def has_mail(self, receiver: str, reader: str = "") -> bool:
        """Whether something arrived since the last time it was handed over."""
        return self.inboxes.has(receiver, reader)

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Hand over what arrived since the last call, oldest first; see `Inboxes`."""
        return self.inboxes.receive(receiver, reader)

    def collect(self, reader: str) -> Sequence[Delivery]:
        """Hand over what arrived for a whole group since the last call, in columns; see `Inboxes`."""
        return self.inboxes.collect(reader)
