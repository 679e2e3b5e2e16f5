"""The message exchange of a process: carries messages from components of agents to inboxes of others.

Channels decide when a message arrives (`channel/`), `in_transit` holds it until then, and `deliver` hands it over.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery, Links, Message, MessageBatch
from symaware_cli.core.message import EVERYBODY, Indices, Times, copied
from symaware_cli.engine.network.channel.fates import ABSENT, QUEUE_FULL, REASONS, TOO_OLD, WAITS, Fates
from symaware_cli.engine.network.in_transit import MessagesInTransit
from symaware_cli.engine.network.inboxes import Inboxes
from symaware_cli.engine.network.outbox import Outbox
from symaware_cli.engine.network.size import message_sizes
from symaware_cli.engine.network.traffic import Traffic

if TYPE_CHECKING:
    from symaware_cli.engine.network.disturbance import Disturbance
    from symaware_cli.engine.network.network import Change, Network
    from symaware_cli.engine.network.transmission import QueuedMessage, Transmission


class Neighbours(Sequence[str]):
    """Ids that are looked up on access, as often only few of many are used."""

    def __init__(self, ids: Sequence[str], indices: Indices) -> None:
        self._ids = ids
        self._indices = indices

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return [self._ids[index] for index in self._indices[place].tolist()]
        return self._ids[self._indices[place]]

    def __len__(self) -> int:
        return len(self._indices)

    def __eq__(self, other: object) -> bool:
        return list(self) == other

    __hash__ = None  # type: ignore[assignment]


#: The size of the payload in each row of a batch, in bytes; shape (s,).
Sizes = NDArray[np.int64]


class UnknownReceiverError(Exception):
    """A message was sent to an agent that does not exist."""


class MessageExchange:
    """Carries messages in memory, over the links and channels of a network.

    Without a network, every agent reaches all others: a message sent in one step is readable in the next, and only
    disturbances lose messages. Arrivals are ordered by time, then by the sender's index in the roster, then by the
    sender's own order, so the order does not depend on the order of turns.

    All messages travel in batches: messages that are sent singly are joined to batches at the end of the instant, and
    dispatched then. Each dispatched message, and each copy that the network made of one, is delivered, dropped or in
    flight.

    Attributes:
        now: Simulated time of the present instant, in nanoseconds.
        inboxes: Messages that arrived and have not been read yet.
        sent: The number of messages dispatched so far.
        duplicated: The number of copies that the network made of them.
        delivered: The number of messages that arrived.
        dropped: The number of messages that were dropped.
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
        """Open an inbox for each listening agent.

        Args:
            ids: All agents, in the roster's order.
            listening: The agents that read all messages that no other component reads; None for all. Messages to other
                agents are delivered, too, but not kept: they would fill the memory in a long run.
            on_traffic: Called with messages that are sent, delivered or dropped.
            on_change: Called when the links have changed.
            seed: The seed of the run.
            time_step: The time step of the world, in nanoseconds: messages without a delay arrive at the next step.
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
        self._seed = seed
        #: None as long as neither a network nor a disturbance has changed the fate of any message.
        self._transmission: Transmission | None = None
        self._in_transit = MessagesInTransit()
        self.inboxes = Inboxes(self._ids, listening)
        self.now = 0
        self.sent = self.duplicated = self.delivered = self.dropped = 0
        self._on_traffic = on_traffic
        self._on_change = on_change

    @property
    def network(self) -> Network | None:
        """The links and channels; None for perfect links between all agents."""
        return None if self._transmission is None else self._transmission.network

    @network.setter
    def network(self, network: Network | None) -> None:
        self._decider().network = network
        if network is not None:
            network.present = self._present

    @property
    def present(self) -> NDArray[np.bool_] | None:
        """Which agents are present, by index, not to be changed in place; shape (n,). None for all.

        Absent agents have no links, and messages that arrive for them are dropped. Links change with the next step.
        """
        return self._present

    @present.setter
    def present(self, present: NDArray[np.bool_] | None) -> None:
        self._present = present
        if self.network is not None:
            self.network.present = present

    def add_disturbances(self, disturbances: Sequence[Disturbance]) -> None:
        """Add disturbances from now on."""
        self.flush()
        self._decider().disturb(disturbances)

    def remove_disturbances(self, disturbances: Sequence[Disturbance]) -> None:
        """Remove disturbances."""
        self.flush()
        self._decider().relieve(disturbances)

    def reseed(self, seed: int) -> None:
        """Draw the fates of messages from another seed from now on."""
        self._seed = seed

    def _decider(self) -> Transmission:
        """Return what decides the fates of messages; create it if nothing has changed any so far."""
        if self._transmission is None:
            from symaware_cli.engine.network.transmission import Transmission

            self._transmission = Transmission(self._seed, self._ids)
        return self._transmission

    @property
    def in_flight(self) -> int:
        """The number of messages in flight."""
        return len(self._in_transit) + (0 if self._transmission is None else self._transmission.waiting)

    @property
    def next_time(self) -> int | None:
        """The next instant at which a message arrives, in nanoseconds."""
        times = [each.next_time for each in (self._in_transit, self._transmission) if each is not None]
        return min((time for time in times if time is not None), default=None)

    @property
    def links(self) -> Links | None:
        """The present links; None if every agent reaches all others."""
        return None if self.network is None else self.network.links

    def neighbours(self, sender: str) -> Sequence[str]:
        """Return the ids of all agents that an agent reaches now, in the roster's order.

        Raises:
            UnknownReceiverError: The agent does not exist.
        """
        return Neighbours(self._ids, self._reached(self._known(sender)))

    def _reached(self, sender: int) -> Indices:
        network = self.network
        if network is not None and network.links is not None:
            return network.links.of_sender(sender)
        all_present = self.present_indices
        others: Indices = all_present[all_present != sender]
        return others

    @property
    def present_indices(self) -> Indices:
        """The indices of all present agents, ascending, which every agent reaches without a network."""
        return np.arange(len(self._ids)) if self._present is None else np.flatnonzero(self._present)

    def _known(self, id: str) -> int:
        rank = self._rank.get(id)
        if rank is None:
            raise UnknownReceiverError(f"there is no agent `{id}` to exchange messages with")
        return rank

    def _arrival(self, due: int) -> int:
        """Return when a message can be read: at the next step if it has no delay."""
        if due > self.now:
            return due
        return (self.now // self._time_step + 1) * self._time_step

    def _postponed(self, fates: Fates) -> Fates:
        """Postpone arrivals at the present instant to the next step."""
        soon = self._arrival(self.now)
        due, copies_due = (np.where(each <= self.now, soon, each) for each in (fates.due, fates.copies_due))
        return fates._replace(due=due, copies_due=copies_due)

    def mute(self, senders: NDArray[np.bool_] | None) -> None:
        """Suppress messages of some agents in batches of their groups from now on, and of no others.

        A component of a whole group sends for all its agents, including those that do not take part any more.

        Args:
            senders: Which agents, by index; shape (n,). None for none.
        """
        self._muted = senders

    def redirect_sent(self, outlet: Callable[[MessageBatch], Any], check: Callable[[Mapping[str, Any]], Any]) -> None:
        """From now on, give all sent messages to `outlet`, as another process carries them; see `arrive`.

        Args:
            outlet: Called with each batch.
            check: Called at once with the payload of each message that is sent singly; raises if it cannot be sent.
        """
        self._outlet = outlet
        self._check = check

    def redirect_arrivals(self, away: Sequence[str], forward: Callable[[Delivery], Any]) -> None:
        """From now on, give all arrivals for some agents to `forward`: another process keeps their inboxes."""
        self._away = np.zeros(len(self._ids), bool)
        self._away[[self._known(id) for id in away]] = True
        self._forward = forward

    def send(self, message: Message) -> None:
        """Queue a message, which is dispatched with the next `flush`; its payload is copied.

        Raises:
            UnknownReceiverError: No agent has the receiver's id, or the sender's.
        """
        sender = self._known(message.sender)
        receiver = None if message.receiver == EVERYBODY else self._known(message.receiver)
        payload = {name: copied(value) for name, value in message.payload.items()}
        self._check(payload)
        self._outbox.put(sender, receiver, payload, message.kind)

    def flush(self) -> bool:
        """Dispatch messages that were sent singly, at the latest at the end of their instant.

        Returns:
            Whether there were any.
        """
        if not self._outbox.drafts:
            return False
        for batch in self._outbox.empty():
            self._dispatch(batch, self.now)
        return True

    def post(self, batch: MessageBatch, at: int | None = None) -> None:
        """Dispatch a batch of messages, after all that were sent before.

        Args:
            batch: The messages; not to be changed any more.
            at: The time of sending, if before now, in nanoseconds.
        """
        self.flush()
        if self._muted is not None:
            batch = batch.some(~self._muted[batch.senders])
        if len(batch.senders):
            self._dispatch(batch, self.now if at is None else at)

    def _dispatch(self, batch: MessageBatch, at: int) -> None:
        """Dispatch a batch."""
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
        if self._transmission is None or self._transmission.is_free(self.now):
            self._in_transit.launch(sent, np.zeros(len(rows), np.uint8), sizes)
            return
        linked = batch.receivers is None
        fates, victims = self._transmission.decide(sent, sizes, self.now, linked=linked)
        self._drop_displaced(victims)
        self._put_in_transit(sent, sizes, self._postponed(fates))
        self._advance()

    def _numbered(self, senders: Indices) -> Times:
        """Number messages, given in ascending order of senders, consecutively for each sender."""
        begins = np.flatnonzero(np.concatenate([[True], senders[1:] != senders[:-1]]))
        counts = np.diff(begins, append=len(senders))
        numbers: Times = self._sent_by[senders] + np.arange(len(senders)) - np.repeat(begins, counts)
        self._sent_by[senders[begins]] += counts
        return numbers

    def _addressed(self, batch: MessageBatch) -> tuple[Indices, Indices]:
        """Return the row in the batch, ascending, and the receiver of each message."""
        if batch.receivers is not None:
            return np.arange(len(batch.senders)), batch.receivers
        network = self.network
        if network is not None and network.links is not None:
            return network.reached(batch.senders)
        all_present = self.present_indices
        rows = np.repeat(np.arange(len(batch.senders)), len(all_present))
        receivers = np.tile(all_present, len(batch.senders))
        others = batch.senders.take(rows) != receivers
        return rows[others], receivers[others]

    def _put_in_transit(self, sent: Delivery, sizes: Sizes, fates: Fates) -> None:
        """Put messages in transit or drop them, by their fates."""
        flying = (fates.reason == 0) | (fates.reason == TOO_OLD)
        if flying.all() and not len(fates.copies):
            self._in_transit.launch(replace(sent, due=fates.due), fates.reason, sizes)
            return
        self._drop(sent, sizes, fates.reason, ~flying & (fates.reason != WAITS))
        indices, due, reason = np.flatnonzero(flying), fates.due[flying], fates.reason[flying]
        if len(fates.copies):
            self.duplicated += len(fates.copies)
            indices, due = np.concatenate([indices, fates.copies]), np.concatenate([due, fates.copies_due])
            reason = np.concatenate([reason, np.zeros(len(fates.copies), np.uint8)])
        if len(indices):
            self._in_transit.launch(replace(sent.some(indices), due=due), reason, sizes)

    def _drop(self, delivery: Delivery, sizes: Sizes, reason: NDArray[np.uint8], lost: NDArray[np.bool_]) -> None:
        """Drop some messages."""
        indices = np.flatnonzero(lost)
        if len(indices):
            self.dropped += len(indices)
            reasons = REASONS if self._transmission is None else tuple(self._transmission.reasons)
            self._on_traffic(Traffic("dropped", delivery.some(indices), sizes, reasons, reason[indices]))

    def _drop_displaced(self, victims: Sequence[QueuedMessage]) -> None:
        """Drop messages that are displaced from full queues."""
        for queued in victims:
            self._drop(queued.content, queued.sizes, np.array([QUEUE_FULL], np.uint8), np.ones(1, bool))

    def _advance(self) -> None:
        """Put queued messages in transit that have entered their links by now."""
        for queued, fates in self._decider().advance(self.now):
            self._put_in_transit(queued.content, queued.sizes, fates)

    def renew_links(self) -> None:
        """Update the links."""
        change = None if self.network is None else self.network.update(self.now)
        if change is not None:
            self._on_change(change)

    def deliver(self, now: int) -> None:
        """Advance to an instant: messages that have arrived by then become readable.

        Links change at steps of the world only.
        """
        self.flush()
        self.now = now
        if self.network is not None:
            if now % self._time_step == 0:
                self.renew_links()
            self._advance()
        for delivery, reason, sizes in self._in_transit.take(now):
            if self._present is not None:
                reason = np.where((reason == 0) & ~self._present[delivery.receivers], np.uint8(ABSENT), reason)
            late = reason != 0
            arriving = delivery
            if late.any():
                self._drop(delivery, sizes, reason, late)
                arriving = delivery.some(~late)
            if len(arriving):
                self._store(arriving, sizes)

    def arrive(self, arrived: Sequence[Delivery]) -> None:
        """Deliver messages that another process has carried here."""
        for delivery in arrived:
            self._store(delivery, message_sizes(delivery.batch))

    def _store(self, delivery: Delivery, sizes: Sizes) -> None:
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
        """Return whether messages have arrived since the last call of `receive`."""
        return self.inboxes.has(receiver, reader)

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Return the messages that arrived since the last call, oldest first; see `Inboxes`."""
        return self.inboxes.receive(receiver, reader)

    def collect(self, reader: str) -> Sequence[Delivery]:
        """Return the messages that arrived for a whole group since the last call, in columns; see `Inboxes`."""
        return self.inboxes.collect(reader)
