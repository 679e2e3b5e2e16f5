"""The recorder: writes the updates, events, messages and contacts of a run to its log.

Reasons: docs/decisions/0003-truth-beside-belief.md
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Contact, Environment, Event, EventBus
from symaware_cli.core.event import CHANNELS, RECURRING
from symaware_cli.engine import PaceFigures, Traffic
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.log.group_channels import EntityChannels, GroupChannels, PostureChannels
from symaware_cli.log.json_text import as_json
from symaware_cli.log.names import INPUTS, KINDS
from symaware_cli.log.writer import LogWriter, Message

if TYPE_CHECKING:
    from symaware_cli.log.specifications import SpecificationRecorder
    from symaware_cli.specification import SpecificationMonitor

#: Which events to record.
EventKinds = Literal["all", "notable", "none"]

#: Which messages between agents to record.
MessageKinds = Literal["all", "dropped", "none"]

#: The events that end a run.
ENDINGS = frozenset({"failed", "finished", "interrupted"})

#: The events of agents that enter or leave the world.
MEMBERSHIP = frozenset({"added", "removed"})


class Recorder:
    """Writes every update of the situational awareness of every group to a log, limited to the rows that changed.

    Attributes:
        writer: The log.
        updates: Number of rows of awareness, control and knowledge recorded so far.
        pace: Returns figures of how well the pace is kept, for `LogWriter.add_timing`; None without a pace.
    """

    uncaptured: ClassVar[Collection[str]] = ("pace", "_started", "_timing_due", "_cpu_started")

    def __init__(
        self,
        writer: LogWriter,
        environment: Environment,
        groups: Sequence[AgentGroup],
        *,
        interval: int = 0,
        omit: Sequence[str] = (),
        events: EventKinds = "notable",
        messages: MessageKinds = "all",
        own: Collection[str] | None = None,
    ) -> None:
        """Open a channel for each group and kind.

        Args:
            writer: The log; its attachments have been written.
            environment: The initialised world.
            groups: All groups.
            interval: Minimum simulated time between two records of a group, in nanoseconds; 0 for every step.
            omit: Parts of awareness and `KINDS` to omit.
            events: Events to record: ``notable`` for those that do not recur, ``all``, or ``none`` but the last one.
            messages: Messages to record: all stages of all messages, only dropped messages, or none.
            own: The ids of the agents whose awareness, control and knowledge are recorded; None for all.
        """
        self.writer = writer
        self.updates = 0
        self.pace: Callable[[], PaceFigures] | None = None
        self._environment = environment
        self._interval = interval
        self._due = 0
        self._started = self._timing_due = time.monotonic()
        self._cpu_started = time.process_time()
        self._events = writer.channel("/events", "Event")
        self._kinds = events
        self._recurring = writer.channel("/events/recurring", "Recurring") if events == "all" else None
        self._pending: list[tuple[str, str]] = []
        self._pending_time = 0
        self._messages = writer.channel("/messages", "MessageColumns")
        self._stages = {"all": ("sent", "delivered", "dropped"), "dropped": ("dropped",), "none": ()}[messages]
        self._contacts = writer.channel("/contacts", "Contact", {"units": "m"})
        #: Opened for the first one, so that logs without any have no channel for them.
        self._inputs: int | None = None
        self._groups = []
        for group in sorted(groups, key=lambda group: group.name):
            rows = [row for row, id in enumerate(group.ids) if own is None or id in own]
            every = {*KINDS, *group.awareness.parts, *group.awareness.signals}
            left_out = {*omit} if rows else {*omit, *every} - {"world", "applied_control"}
            if "control" in omit:
                left_out |= {"requested_control", "applied_control"}
            self._groups.append(GroupChannels(writer, environment, group, left_out, rows))
        self._entities = None if "world" in omit else EntityChannels(writer, environment)
        postures = [PostureChannels(writer, environment, name) for name in environment.obstacles if "world" not in omit]
        self._postures = [posture for posture in postures if posture.has_channels]
        writer.flush_in_background()

    @property
    def path(self) -> Path:
        """The log."""
        return self.writer.path

    @property
    def size(self) -> int:
        """Its size so far [bytes]."""
        return self.writer.size

    def abort(self) -> None:
        """Close the log without an outcome, from any thread."""
        self.writer.abort()

    def record(self, now: int, steps: int) -> None:
        """Record the changes.

        Args:
            now: Simulated time in nanoseconds.
            steps: Number of steps completed.
        """
        self._write_recurring(now)
        if now >= self._due:
            self._due = now + self._interval
            messages: list[Message] = []
            try:
                for group in self._groups:
                    self.updates += group.record(now, steps, messages)
                if self._entities:
                    self._entities.record(messages)
                for posture in self._postures:
                    posture.record(messages)
            finally:
                # Also if a series that was deferred turns out to be not finite.
                self.writer.add_all(now, messages)
        monotonic = time.monotonic()
        if monotonic >= self._timing_due:
            self._timing_due = monotonic + 1.0
            self._record_timing(now, steps, monotonic)

    def follow(
        self,
        events: EventBus,
        shielded: Callable[[Callable[[Event], Any]], Callable[[Event], None]],
        elsewhere: object | None = None,
    ) -> None:
        """Record the events of a run.

        Args:
            events: The bus of the run.
            shielded: Wraps the functions called for an event, so that no signal interrupts them.
            elsewhere: The subject of events that other processes record.
        """
        for name, record in (
            ("*", lambda event: None if elsewhere and event.subject is elsewhere else self.event(event)),
            ("touching", lambda event: self.contact(event.subject, event.time)),
            ("traffic", lambda event: self.traffic(event.subject, event.time)),
            ("external-input", self.input),
        ):
            events.subscribe(name, shielded(record))
        if self._recurring is not None:
            for name in sorted(RECURRING - CHANNELS):
                events.subscribe(name, shielded(self.recurring))

    def event(self, event: Event) -> None:
        """Record an event if it is selected; events of membership and of the end of a run always are."""
        if self._kinds == "none" and event.name not in ENDINGS | MEMBERSHIP:
            return
        self._write_recurring(event.time)
        data = as_json(event.data) if event.data else ""
        level = event.level.name
        record = v1.Event(name=event.name, source=event.source, level=level, text=event.text, data=data)
        self.writer.add(self._events, event.time, record.SerializeToString(deterministic=True))

    def input(self, event: Event) -> None:
        """Record an external input, regardless of all settings: without it the run could not be repeated."""
        self._write_recurring(event.time)
        if self._inputs is None:
            self._inputs = self.writer.channel(INPUTS, "Event")
        record = v1.Event(name=event.name, source=event.source, level=event.level.name, data=as_json(event.data))
        self.writer.add(self._inputs, event.time, record.SerializeToString(deterministic=True))

    def recurring(self, event: Event) -> None:
        """Add an event that recurs; those of one instant are recorded together."""
        self._write_recurring(event.time)
        self._pending_time = event.time
        self._pending.append((event.name, event.source))

    def _write_recurring(self, now: int | None = None) -> None:
        """Record the recurring events of an instant, once a later one is recorded."""
        if not self._pending or self._recurring is None or self._pending_time == now:
            return
        names, sources = (dict.fromkeys(column) for column in zip(*self._pending, strict=True))
        places = [{text: number for number, text in enumerate(texts)} for texts in (names, sources)]
        record = v1.Recurring(
            names=list(names),
            sources=list(sources),
            name=[places[0][name] for name, _ in self._pending],
            source=[places[1][source] for _, source in self._pending],
        )
        self._pending.clear()
        self.writer.add(self._recurring, self._pending_time, record.SerializeToString(deterministic=True))

    def contact(self, contact: Contact, now: int) -> None:
        """Record the beginning or end of a contact."""
        self._write_recurring(now)
        begins = v1.Contact.RESUME if contact.resumes else v1.Contact.BEGIN
        stage = begins if contact.begins else v1.Contact.END
        record = v1.Contact(
            a=contact.first,
            b=contact.second,
            point=contact.point,
            depth=contact.depth,
            stage=stage,
            impulse=contact.impulse,
        )
        self.writer.add(self._contacts, now, record.SerializeToString(deterministic=True))

    def traffic(self, traffic: Traffic, now: int) -> None:
        """Record messages of a batch that reached a stage together."""
        if traffic.stage not in self._stages:
            return
        delivery, batch = traffic.delivery, traffic.delivery.batch
        record = v1.MessageColumns(stage=traffic.stage.upper(), kind=batch.kind, sent_time=delivery.sent_time)
        reason = sizes = says = rows = None
        if len(np.unique(traffic.sizes)) == 1:
            record.size = int(traffic.sizes[0])
        else:
            sizes = traffic.sizes[delivery.rows]
        if traffic.reason is not None:
            numbers, reason = np.unique(traffic.reason, return_inverse=True)
            record.reasons.extend(traffic.reasons[number] for number in numbers.tolist())
        if traffic.stage == "sent":
            says = batch.senders
            rows = delivery.rows if (says[1:] == says[:-1]).any() else None
            for name, values in batch.columns.items():
                if values.dtype == object:
                    record.said.add(name=name, texts=_texts(values))
                else:
                    record.said.add(name=name, shape=values.shape[1:], values=values.reshape(-1).tolist())
        columns = wire.encode_message_columns(
            delivery.senders, delivery.receivers, delivery.sequences, reason, says, sizes, rows
        )
        self._write_recurring(now)
        # Protobuf fields may be in any order; the columns are encoded without a Python object per number.
        self.writer.add(self._messages, now, record.SerializeToString(deterministic=True) + columns)

    def specifications(self, monitors: Iterable[SpecificationMonitor]) -> SpecificationRecorder:
        """Open channels for specifications, and return their recorder."""
        from symaware_cli.log.specifications import SpecificationRecorder

        return SpecificationRecorder(self.writer, monitors)

    def finish(self, now: int, steps: int, outcome: Mapping[str, Any]) -> None:
        """Finish the log."""
        self._write_recurring()
        self._record_timing(now, steps, time.monotonic())
        self.writer.finish(outcome)

    def _record_timing(self, now: int, steps: int, monotonic: float) -> None:
        self.writer.add_timing(
            now,
            wall_time=monotonic - self._started,
            cpu_time=time.process_time() - self._cpu_started,
            steps=steps,
            pace=self.pace() if self.pace else (0.0, 0, 0, 0.0),
        )


def _texts(values: NDArray[Any]) -> list[str]:
    """Convert values to JSON; equal texts and shared objects are converted once."""
    written: dict[object, str] = {}
    texts = []
    for value in values.tolist():
        key = value if type(value) is str else id(value)
        text = written.get(key)
        if text is None:
            text = written[key] = as_json(value)
        texts.append(text)
    return texts
