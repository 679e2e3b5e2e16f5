"""The exchange within a process: from one agent's component to the inbox of another's."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AwarenessVector, Delivery, Links, Mailing, Message
from symaware_cli.core.message import EVERYBODY, Indices
from symaware_cli.network.channel.channel import QUEUE_FULL, TOO_OLD, Fates
from symaware_cli.network.disturbance import Disturbance
from symaware_cli.network.inbox import Inboxes
from symaware_cli.network.neighbours import Neighbours
from symaware_cli.network.network import Change, Network
from symaware_cli.network.passage import WAITS, Parcel, Passage
from symaware_cli.network.size import mailing_size, message_size
from symaware_cli.network.traffic import Traffic, chosen, spoken
from symaware_cli.network.underway import Letter, UnderWay


class UnknownReceiverError(Exception):
    """A message was sent to somebody who does not exist."""


class MemoryExchange:
    """Carries messages in memory, over the links and channels of a network.

    Without a network, everybody reaches everybody: sent in one step, readable in the next, none ever lost but by a
    disturbance. What arrives is ordered by when it does, then by the sender's place in the roster, then by the sender's
    own order, so that it does not depend on who took its turn first.

    Each message that was sent, and each copy that the network made of one, is delivered, dropped or in flight.

    Attributes:
        now: Simulated time of the present instant, in nanoseconds.
        inboxes: What arrived and was not read yet.
        sent: How many messages were sent so far.
        duplicated: How many more were made of them under way.
        delivered: How many arrived.
        dropped: How many never will.
    """

    def __init__(
        self,
        ids: Sequence[str],
        on_sent: Callable[[Message], Any],
        on_delivered: Callable[[Message], Any],
        listening: Container[str] | None = None,
        on_dropped: Callable[[Message, str], Any] = lambda message, reason: None,
        *,
        on_traffic: Callable[[Traffic], Any] = lambda traffic: None,
        on_change: Callable[[Change], Any] = lambda change: None,
        seed: int = 0,
        time_step: int,
    ) -> None:
        """Open an inbox for everybody who listens.

        Args:
            ids: All agents, in the roster's order.
            on_sent: Called with each single message once it is on its way.
            on_delivered: Called with each once it is readable.
            listening: Those who read whatever no other component reads; None for everybody. What arrives for others is
                delivered, too, but not kept: a run of any length would fill the memory with it.
            on_dropped: Called with each that is lost, and the reason.
            on_traffic: Called at these occasions with the messages of mailings, in columns.
            on_change: Called when the links have changed.
            seed: The seed of the run.
            time_step: Between two steps of the world, in nanoseconds: what travels for no time arrives at the next one.
        """
        self._ids = tuple(ids)
        self._rank = {id: rank for rank, id in enumerate(ids)}
        self._sent_by = np.zeros(len(self._ids), np.int64)
        self._time_step = time_step
        self._muted: NDArray[np.bool_] | None = None
        self._outlet: Callable[[Message | Mailing], Any] | None = None
        self._away: NDArray[np.bool_] | None = None
        self._forward: Callable[[Message | Delivery], Any] = lambda arrived: None
        self._passage = Passage(seed, self._ids)
        self._under_way = UnderWay()
        self.inboxes = Inboxes(self._ids, listening)
        self.now = 0
        self.sent = self.duplicated = self.delivered = self.dropped = 0
        self._on_sent = on_sent
        self._on_dropped = on_dropped
        self._on_delivered = on_delivered
        self._on_traffic = on_traffic
        self._on_change = on_change

    @property
    def network(self) -> Network | None:
        """Who reaches whom, and how; None for everybody, at once and without fail."""
        return self._passage.network

    @network.setter
    def network(self, network: Network | None) -> None:
        self._passage.network = network

    @property
    def disturbances(self) -> list[Disturbance]:
        """What happens to messages at present, besides."""
        return self._passage.disturbances

    @property
    def in_flight(self) -> int:
        """How many messages are under way."""
        return len(self._under_way) + self._passage.waiting

    @property
    def next_time(self) -> int | None:
        """The next instant at which something is to be delivered, in nanoseconds."""
        times = [time for time in (self._under_way.next_time, self._passage.next_time) if time is not None]
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
        return np.delete(np.arange(len(self._ids)), sender)

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
        """Let some agents say nothing for a while, in mailings of their groups.

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

    def divert(self, outlet: Callable[[Message | Mailing], Any]) -> None:
        """Hand on all that is sent from now on, instead of carrying it: another process does. See `arrive`."""
        self._outlet = outlet

    def forward(self, away: Sequence[str], forward: Callable[[Message | Delivery], Any]) -> None:
        """Hand on all that arrives for some agents from now on: another process keeps their inboxes."""
        self._away = np.zeros(len(self._ids), bool)
        self._away[[self._known(id) for id in away]] = True
        self._forward = forward

    def send(self, message: Message, at: int | None = None) -> None:
        """Take a message; what its payload refers to is copied.

        Args:
            message: What is said, by whom, to whom.
            at: When it was sent, if that was before now, in nanoseconds.

        Raises:
            UnknownReceiverError: There is no agent of the receiver's id, or of the sender's.
        """
        sender = self._known(message.sender)
        if self._outlet is not None:
            if message.receiver != EVERYBODY:
                self._known(message.receiver)
            self._outlet(replace(message, payload={name: _copied(value) for name, value in message.payload.items()}))
            return
        if message.receiver == EVERYBODY:
            receivers = self._reached(sender).tolist()
        else:
            receivers = [self._known(message.receiver)]
        letters = []
        for receiver in receivers:
            payload = {name: _copied(value) for name, value in message.payload.items()}
            sequence = int(self._sent_by[sender])
            self._sent_by[sender] += 1
            id = self._ids[receiver]
            sent_time = self.now if at is None else at
            letter = replace(message, receiver=id, payload=payload, sequence=sequence, sent_time=sent_time)
            letters.append(letter)
            self.sent += 1
            self._on_sent(letter)
        if self._passage.is_free(self.now):
            due = self._arrival(self.now)
            for letter, receiver in zip(letters, receivers, strict=True):
                self._under_way.put(letter, sender, receiver, due)
        elif letters:
            size, linked = message_size(message.payload), message.receiver == EVERYBODY
            ends = np.full(len(letters), sender), np.array(receivers)
            fates, victims = self._passage.decide(letters, *ends, size, self.now, linked=linked)
            self._push_out(victims)
            self._send_off(letters, sender, receivers, self._postponed(fates))
            self._advance()

    def _send_off(self, letters: Sequence[Message], sender: int, receivers: Sequence[int], fates: Fates) -> None:
        """Let single messages meet their fates."""
        for place, letter in enumerate(letters):
            reason = int(fates.reason[place])
            if reason in (0, TOO_OLD):
                self._under_way.put(letter, sender, receivers[place], int(fates.due[place]), reason)
            elif reason != WAITS:
                self._drop(letter, reason)
        for place, due in zip(fates.copies.tolist(), fates.copies_due.tolist(), strict=True):
            self.duplicated += 1
            self._under_way.put(letters[place], sender, receivers[place], due)

    def _drop(self, letter: Message, reason: int) -> None:
        self.dropped += 1
        self._on_dropped(letter, self._passage.reasons[reason])

    def post(self, mailing: Mailing, at: int | None = None) -> None:
        """Take the messages of many agents at once; its columns must not be changed any more. See `send`."""
        if self._muted is not None:
            mailing = spoken(mailing, ~self._muted[mailing.senders])
        if self._outlet is not None:
            if len(mailing.senders):
                self._outlet(mailing)
            return
        rows, receivers = self._addressed(mailing)
        if not len(rows):
            return
        senders = mailing.senders.take(rows)
        counts = np.bincount(rows, minlength=len(mailing.senders))
        within = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        sequences = self._sent_by[senders] + within
        self._sent_by[mailing.senders] += counts
        size = mailing_size(mailing)
        due = np.full(len(rows), self._arrival(self.now))
        sent = Delivery(mailing, rows, receivers, sequences, self.now if at is None else at, due)
        self.sent += len(rows)
        self._on_traffic(Traffic("sent", sent, size))
        if self._passage.is_free(self.now):
            self._under_way.launch(sent, np.zeros(len(rows), np.uint8), size)
            return
        linked = mailing.receivers is None
        fates, victims = self._passage.decide((sent, size), senders, receivers, size, self.now, linked=linked)
        self._push_out(victims)
        self._launch(sent, size, self._postponed(fates))
        self._advance()

    def _addressed(self, mailing: Mailing) -> tuple[Indices, Indices]:
        """For each message of a mailing its row there, ascending, and its receiver."""
        if mailing.receivers is not None:
            return np.arange(len(mailing.senders)), mailing.receivers
        network = self.network
        if network is not None and network.links is not None:
            return network.reached(mailing.senders)
        everybody = np.arange(len(self._ids))
        rows = np.repeat(np.arange(len(mailing.senders)), len(everybody))
        receivers = np.tile(everybody, len(mailing.senders))
        others = mailing.senders.take(rows) != receivers
        return rows[others], receivers[others]

    def _launch(self, sent: Delivery, size: int, fates: Fates) -> None:
        """Let messages of a mailing meet their fates."""
        flying = (fates.reason == 0) | (fates.reason == TOO_OLD)
        if flying.all() and not len(fates.copies):
            self._under_way.launch(replace(sent, due=fates.due), fates.reason, size)
            return
        self._lose(sent, size, fates.reason, ~flying & (fates.reason != WAITS))
        places, due, reason = np.flatnonzero(flying), fates.due[flying], fates.reason[flying]
        if len(fates.copies):
            self.duplicated += len(fates.copies)
            places, due = np.concatenate([places, fates.copies]), np.concatenate([due, fates.copies_due])
            reason = np.concatenate([reason, np.zeros(len(fates.copies), np.uint8)])
        if len(places):
            self._under_way.launch(replace(chosen(sent, places), due=due), reason, size)

    def _lose(self, delivery: Delivery, size: int, reason: NDArray[np.uint8], lost: NDArray[np.bool_]) -> None:
        """Drop some messages of a mailing."""
        places = np.flatnonzero(lost)
        if len(places):
            self.dropped += len(places)
            reasons = tuple(self._passage.reasons)
            self._on_traffic(Traffic("dropped", chosen(delivery, places), size, reasons, reason[places]))

    def _push_out(self, victims: Sequence[Parcel]) -> None:
        """Drop what is pushed out of full queues."""
        for parcel in victims:
            if isinstance(parcel.content, list):
                self._drop(parcel.content[parcel.place], QUEUE_FULL)
            else:
                sent, size = parcel.content
                one = chosen(sent, np.array([parcel.place]))
                self._lose(one, size, np.array([QUEUE_FULL], np.uint8), np.ones(1, bool))

    def _advance(self) -> None:
        """Let what waited before links go on its way, as far as its time has come."""
        for parcel, fates in self._passage.advance(self.now):
            if isinstance(parcel.content, list):
                self._send_off([parcel.content[parcel.place]], parcel.sender, [parcel.receiver], fates)
            else:
                sent, size = parcel.content
                self._launch(chosen(sent, np.array([parcel.place])), size, fates)

    def renew_links(self) -> None:
        """Look who reaches whom now."""
        change = None if self.network is None else self.network.update(self.now)
        if change is not None:
            self._on_change(change)

    def deliver(self, now: int) -> None:
        """Come to an instant: what arrived before or arrives now becomes readable.

        Steps of the world are the instants at which links change.
        """
        self.now = now
        if now % self._time_step == 0:
            self.renew_links()
        self._advance()
        for arrival in self._under_way.take(now):
            if isinstance(arrival, Letter):
                if arrival.reason:
                    self._drop(arrival.message, arrival.reason)
                else:
                    self._hand_over(replace(arrival.message, arrival_time=arrival.due), arrival.receiver)
                continue
            delivery, reason, size = arrival
            late = reason != 0
            arriving = delivery
            if late.any():
                self._lose(delivery, size, reason, late)
                arriving = chosen(delivery, ~late)
            if len(arriving):
                self._hand_over_columns(arriving, size)

    def arrive(self, arrived: Sequence[Message | Delivery]) -> None:
        """Make readable what another process has carried here."""
        for each in arrived:
            if isinstance(each, Message):
                self._hand_over(each, self._known(each.receiver))
            else:
                self._hand_over_columns(each, mailing_size(each.mailing))

    def _hand_over(self, letter: Message, receiver: int) -> None:
        self.delivered += 1
        if self._away is not None and self._away[receiver]:
            self._forward(letter)
        else:
            self.inboxes.put(letter, receiver)
        self._on_delivered(letter)

    def _hand_over_columns(self, delivery: Delivery, size: int) -> None:
        self.delivered += len(delivery)
        here = delivery
        if self._away is not None:
            away = self._away[delivery.receivers]
            if away.any():
                self._forward(chosen(delivery, away))
                here = chosen(delivery, ~away)
        if len(here):
            self.inboxes.put_columns(here)
        self._on_traffic(Traffic("delivered", delivery, size))

    def has_mail(self, receiver: str, reader: str = "") -> bool:
        """Whether something arrived since the last time it was handed over."""
        return self.inboxes.has(receiver, reader)

    def receive(self, receiver: str, reader: str = "") -> Sequence[Message]:
        """Hand over what arrived since the last call, oldest first; see `Inboxes`."""
        return self.inboxes.receive(receiver, reader)

    def collect(self, reader: str) -> Sequence[Delivery | Message]:
        """Hand over what arrived for a whole group since the last call, in columns; see `Inboxes`."""
        return self.inboxes.collect(reader)


def _copied(value: Any) -> Any:
    """Return a value that the sender cannot change any more."""
    if isinstance(value, np.ndarray):
        copy = value.copy()
        copy.flags.writeable = False
        return copy
    if isinstance(value, AwarenessVector):
        return AwarenessVector(value.id, value.state, value.intent, value.uncertainty, value.risk)
    if isinstance(value, Mapping):
        return {name: _copied(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_copied(each) for each in value]
    if isinstance(value, tuple):
        copies = [_copied(each) for each in value]
        return value._make(copies) if hasattr(value, "_make") else tuple(copies)
    if isinstance(value, set | frozenset):
        return frozenset(value)
    return value
