"""The recorder: decides what of a run goes into the log, and when."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from symaware_cli.core import (
    AgentGroup,
    AwarenessDatabase,
    Contact,
    Environment,
    Event,
    Level,
    Message,
    Quantity,
    Tracks,
)
from symaware_cli.core.column import Column, SeriesColumn
from symaware_cli.network.traffic import Traffic
from symaware_cli.recording import symaware_v1_pb2 as v1
from symaware_cli.recording import wire
from symaware_cli.recording.sensing import SensorChannels
from symaware_cli.recording.writer import LogWriter, PaceFigures

_LEVELS = {
    Level.DEBUG: v1.Event.DEBUG,
    Level.INFO: v1.Event.INFO,
    Level.WARNING: v1.Event.WARNING,
    Level.ERROR: v1.Event.ERROR,
}

#: Which events to record.
EventKinds = Literal["all", "notable", "none"]

#: Which messages between agents to record.
MessageKinds = Literal["all", "dropped", "none"]

_STAGES = {
    "sent": v1.Message.SENT,
    "delivered": v1.Message.DELIVERED,
    "dropped": v1.Message.DROPPED,
}

#: The last event of a run.
ENDINGS = frozenset({"failed", "finished", "interrupted"})

#: What `Recorder` can be told to leave out.
KINDS = ("state", "intent", "uncertainty", "risk", "control", "knowledge", "awareness", "sensors", "world")


class Recorder:
    """Writes every update of the situational awareness of every group into a log, row by row that changed.

    Attributes:
        writer: The log.
        updates: How many rows of awareness, control and knowledge were recorded so far.
        pace: Tells how well the pace is kept, as `LogWriter.add_timing` takes it; None where none is asked for.
    """

    def __init__(
        self,
        writer: LogWriter,
        environment: Environment,
        groups: Sequence[AgentGroup],
        *,
        interval: int = 0,
        omit: Sequence[str] = (),
        quantities: Mapping[str, Mapping[str, Sequence[Quantity]]] | None = None,
        events: EventKinds = "notable",
        messages: MessageKinds = "all",
    ) -> None:
        """Open a channel for each group and kind.

        Args:
            writer: The log, whose attachments are written already.
            environment: The world, initialised.
            groups: All groups.
            interval: Least simulated time between two records of the same group, in nanoseconds; 0 for every step.
            omit: Which of `KINDS` to leave out.
            quantities: By group, and by ``intent``, ``uncertainty`` and ``risk``, what the columns of these are, where
                that is known.
            events: Which events to record: those that do not recur, all, or none but the last one.
            messages: Which messages to record: all stages of all of them, those that are dropped, or none.
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
        self._messages = writer.channel("/messages", "Message")
        self._message_columns: int | None = None
        self._stages = {"all": ("sent", "delivered", "dropped"), "dropped": ("dropped",), "none": ()}[messages]
        self._contacts = writer.channel("/contacts", "Contact", {"units": "m"})
        self._groups = [
            _GroupChannels(writer, environment, group, omit, (quantities or {}).get(group.name, {}))
            for group in sorted(groups, key=lambda group: group.name)
        ]
        self._movers = [
            _MoverChannel(writer, environment, name)
            for name in environment.obstacles
            if environment.moves(name) and "world" not in omit
        ]
        self._rank = {id: rank for rank, id in enumerate(environment.roster.ids)}
        writer.flush_in_background()

    @property
    def wants_recurring(self) -> bool:
        """Whether events that recur with every step, turn or message are to be recorded."""
        return self._recurring is not None

    def record(self, now: int, steps: int) -> None:
        """Record what changed.

        Args:
            now: Simulated time in nanoseconds.
            steps: How many steps were made.
        """
        self._write_recurring(now)
        if now >= self._due:
            self._due = now + self._interval
            for group in self._groups:
                self.updates += group.record(now)
            for mover in self._movers:
                mover.record(now)
        monotonic = time.monotonic()
        if monotonic >= self._timing_due:
            self._timing_due = monotonic + 1.0
            self._record_timing(now, steps, monotonic)

    def event(self, event: Event) -> None:
        """Record an event, if it is among those that are wanted; how a run ends is told in any case."""
        if self._kinds == "none" and event.name not in ENDINGS:
            return
        self._write_recurring(event.time)
        data = json.dumps(plain(event.data), sort_keys=True) if event.data else ""
        record = v1.Event(name=event.name, source=event.source, level=_LEVELS[event.level], text=event.text, data=data)
        self.writer.add(self._events, event.time, record.SerializeToString(deterministic=True))

    def recurring(self, event: Event) -> None:
        """Take note of an event that recurs; those of one instant are recorded together."""
        self._write_recurring(event.time)
        self._pending_time = event.time
        self._pending.append((event.name, event.source))

    def _write_recurring(self, now: int | None = None) -> None:
        """Record the recurring events of an instant, once there is something to say about a later one."""
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
        """Record that two bodies touch, or cease to."""
        self._write_recurring(now)
        stage = v1.Contact.BEGIN if contact.begins else v1.Contact.END
        record = v1.Contact(
            a=contact.first,
            b=contact.second,
            point=contact.point,
            depth=contact.depth,
            stage=stage,
            impulse=contact.impulse,
        )
        self.writer.add(self._contacts, now, record.SerializeToString(deterministic=True))

    def message(self, message: Message, now: int, *, delivered: bool) -> None:
        """Record that a message was sent, or delivered."""
        if ("delivered" if delivered else "sent") not in self._stages:
            return
        record = self._stage(message, v1.Message.DELIVERED if delivered else v1.Message.SENT)
        if not delivered:
            record.payload = json.dumps(plain(message.payload), sort_keys=True)
            record.size = len(record.payload)
        self._add_message(record, now)

    def lost(self, message: Message, now: int, reason: str) -> None:
        """Record that a message was lost on its way."""
        if "dropped" not in self._stages:
            return
        record = self._stage(message, v1.Message.DROPPED)
        record.reason = reason
        self._add_message(record, now)

    def traffic(self, traffic: Traffic, now: int) -> None:
        """Record messages of a mailing that reached a stage together."""
        if traffic.stage not in self._stages:
            return
        if self._message_columns is None:
            self._message_columns = self.writer.channel("/messages/columns", "MessageColumns")
        delivery, mailing = traffic.delivery, traffic.delivery.mailing
        record = v1.MessageColumns(
            stage=_STAGES[traffic.stage], kind=mailing.kind, sent_time=delivery.sent_time, size=traffic.size
        )
        reason = None
        if traffic.reason is not None:
            numbers, reason = np.unique(traffic.reason, return_inverse=True)
            record.reasons.extend(traffic.reasons[number] for number in numbers.tolist())
        says = None
        if traffic.stage == "sent":
            says = mailing.senders
            for name, values in mailing.columns.items():
                record.said.add(name=name, shape=values.shape[1:], values=values.reshape(-1).tolist())
        columns = wire.encode_message_columns(delivery.senders, delivery.receivers, delivery.sequences, reason, says)
        self._write_recurring(now)
        # Fields may stand in any order, and these are written without an object for each number.
        self.writer.add(self._message_columns, now, record.SerializeToString(deterministic=True) + columns)

    def _stage(self, message: Message, stage: v1.Message.Stage) -> v1.Message:
        return v1.Message(
            id=(self._rank[message.sender] << 32) | message.sequence,
            sender=message.sender,
            receiver=message.receiver,
            kind=message.kind,
            stage=stage,
            sent_time=message.sent_time,
        )

    def _add_message(self, record: v1.Message, now: int) -> None:
        self._write_recurring(now)
        self.writer.add(self._messages, now, record.SerializeToString(deterministic=True))

    def finish(self, now: int, steps: int, outcome: Mapping[str, Any]) -> None:
        """End the log."""
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


class _MoverChannel:
    """The channel of an obstacle that moves."""

    def __init__(self, writer: LogWriter, environment: Environment, name: str) -> None:
        self._writer = writer
        self._environment = environment
        self._name = name
        self._last: list[float] | None = None
        columns = [*"xyz"[: len(environment.pose(name).position)], "heading"]
        units = ["m"] * (len(columns) - 1) + ["rad"]
        metadata = {"columns": ",".join(columns), "units": ",".join(units)}
        self._channel = writer.channel(f"/world/{name}/state", "Rows", metadata)

    def record(self, now: int) -> None:
        """Record where the obstacle is, unless it rests."""
        pose = self._environment.pose(self._name)
        values = [*pose.position, pose.heading]
        if values != self._last:
            self._last = values
            self._writer.add(self._channel, now, wire.encode_rows([values]))


class _GroupChannels:
    """The channels of one group."""

    def __init__(
        self,
        writer: LogWriter,
        environment: Environment,
        group: AgentGroup,
        omit: Sequence[str],
        quantities: Mapping[str, Sequence[Quantity]],
    ) -> None:
        self._writer = writer
        self._environment = environment
        self._group = group
        self._omit = frozenset(omit)
        self._count = len(group)
        self._last_truth: Any = None
        self._last_tracks: Any = None
        self._last_world: Any = None
        states = _columns(group.model.state)
        inputs = _columns(group.model.control_input)
        series = {kind: _columns(columns) for kind, columns in quantities.items()}
        topics = {
            "world": (f"/world/{group.name}/state", "Rows", states),
            "state": (f"/agents/{group.name}/state", "Rows", states),
            "control": (f"/agents/{group.name}/control", "Control", inputs),
            "intent": (f"/agents/{group.name}/intent", "SeriesRows", series.get("intent", {})),
            "uncertainty": (f"/agents/{group.name}/uncertainty", "SeriesRows", series.get("uncertainty", {})),
            "risk": (f"/agents/{group.name}/risk", "SeriesRows", series.get("risk", {})),
            "awareness": (f"/agents/{group.name}/awareness", "Awareness", {}),
            "knowledge": (f"/agents/{group.name}/knowledge", "Knowledge", {}),
        }
        self._channels = {kind: writer.channel(*topic) for kind, topic in topics.items() if kind not in self._omit}
        self._sensors = SensorChannels(writer, group) if "sensors" not in self._omit else None
        #: Series and the like are read only where their channel is open.
        self._series = [
            (self._channels[kind], column)
            for kind, column in (
                ("intent", group.awareness.intent),
                ("uncertainty", group.awareness.uncertainty),
                ("risk", group.awareness.risk),
            )
            if kind in self._channels
        ]

    def record(self, now: int) -> int:
        """Record the rows that changed and return how many there were, of all kinds but the world's."""
        writer, channels, awareness = self._writer, self._channels, self._group.awareness
        updates = 0
        if "world" in channels:
            truth = self._environment.state(self._group)
            if truth is not self._last_truth:
                self._last_truth = truth
                writer.add(channels["world"], now, wire.encode_rows(truth))
        if "state" in channels:
            updates += self._record_column(now, channels["state"], awareness.state_column)
        for channel, column in self._series:
            updates += self._record_series(now, channel, column)
        if "awareness" in channels:
            updates += self._record_awareness(now, channels["awareness"])
        if "control" in channels:
            updates += self._record_control(now, channels["control"])
        if "knowledge" in channels:
            updates += self._record_knowledge(now, channels["knowledge"])
        if self._sensors and awareness.readings:
            updates += self._sensors.record(now)
        return updates

    def _record_column(self, now: int, channel: int, column: Column) -> int:
        rows = column.take_changes()
        if rows is None:
            self._writer.add(channel, now, wire.encode_rows(column.values))
            return self._count
        if rows:
            self._writer.add(channel, now, wire.encode_rows(column.values[rows], rows))
        return len(rows)

    def _record_control(self, now: int, channel: int) -> int:
        column = self._group.control_column
        rows = column.take_changes()
        if rows is not None and not rows:
            return 0
        requested = column.values
        limited = self._group.model.limit(requested)
        applied = None if limited is requested or np.array_equal(limited, requested) else limited
        if rows is not None:
            requested = requested[rows]
            applied = None if applied is None else applied[rows]
        self._writer.add(channel, now, wire.encode_control(requested, applied, rows))
        return self._count if rows is None else len(rows)

    def _record_series(self, now: int, channel: int, column: SeriesColumn) -> int:
        rows = column.take_changes()
        if rows is not None and not rows:
            return 0
        shared = column.shared
        if rows is None and shared:
            self._writer.add(channel, now, wire.encode_series(*shared))
            return self._count
        chosen = range(self._count) if rows is None else rows
        series = [column.row(row) for row in chosen]
        width = max(each.values.shape[1] for each in series)
        lengths = [len(each) for each in series]
        times = np.concatenate([each.times for each in series])
        parts = [each.values for each in series if len(each)]
        values = np.concatenate(parts) if parts else np.empty((0, width))
        self._writer.add(channel, now, wire.encode_series(times, values, lengths, rows))
        return len(series)

    def _record_awareness(self, now: int, channel: int) -> int:
        awareness = self._group.awareness
        changed, tracks, world = awareness.others_changed, awareness.tracks, awareness.world
        if not changed and tracks is not None:
            return self._record_tracks(now, channel, tracks)
        if not changed and world is not None and world.time == now:
            self._last_world = world
            self._writer.add(channel, now, wire.WHOLE_WORLD)
            return self._count
        if not changed and world is not self._last_world:
            # The world as it was: /world at this instant does not tell it.
            changed = set(range(self._count))
        self._last_world = world
        if not changed:
            return 0
        awareness.others_changed = set()
        databases = [agent.awareness_database for agent in self._group.agents]
        if all(each.world is not None and each.world.time == now and not each.others for each in databases):
            self._writer.add(channel, now, wire.WHOLE_WORLD)
            return self._count
        return self._record_databases(now, channel, sorted(changed), databases)

    def _record_tracks(self, now: int, channel: int, tracks: Tracks) -> int:
        """Record what the group's perception believes of others, for all agents at once."""
        if tracks is self._last_tracks:
            return 0
        self._last_tracks = tracks
        values = np.concatenate([tracks.positions, tracks.velocities], axis=1)
        encoded = wire.encode_awareness(
            np.diff(tracks.pointers),
            tracks.others,
            [values.shape[1]],
            values,
            covariances=() if tracks.covariances is None else tracks.covariances,
            ages=tracks.ages if tracks.ages.any() else (),
        )
        self._writer.add(channel, now, encoded)
        return self._count

    def _record_databases(
        self, now: int, channel: int, rows: Sequence[int], databases: Sequence[AwarenessDatabase]
    ) -> int:
        """Record what the components of single agents know of others."""
        roster = self._environment.roster
        lengths, entities, columns, values = [], [], [], [np.empty(0)]
        for row in rows:
            database = databases[row]
            others = [id for id in database if id != self._group.ids[row] and id in roster]
            lengths.append(len(others))
            for id in others:
                state = database[id].state
                entities.append(roster.index(id))
                columns.append(len(state))
                values.append(state)
        self._writer.add(channel, now, wire.encode_awareness(lengths, entities, columns, np.concatenate(values), rows))
        return len(rows)

    def _record_knowledge(self, now: int, channel: int) -> int:
        if not self._group.knowledge_news:
            return 0
        rows = sorted(self._group.knowledge_news)
        self._group.knowledge_news.clear()
        record = v1.Knowledge(
            rows=[] if len(rows) == self._count else rows,
            values=[json.dumps(plain(self._group.knowledge[row]), sort_keys=True) for row in rows],
        )
        for row in rows:
            self._group.knowledge[row].changed = False
        self._writer.add(channel, now, record.SerializeToString(deterministic=True))
        return len(rows)


def plain(value: Any) -> Any:
    """Turn a value into what JSON can hold; what it cannot becomes text."""
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else str(value)
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, set | frozenset):
        return sorted((plain(each) for each in value), key=repr)
    if hasattr(value, "times") and hasattr(value, "values"):
        return {"times": plain(value.times), "values": plain(value.values)}
    if hasattr(value, "state") and hasattr(value, "id"):
        return {name: plain(getattr(value, name)) for name in ("id", "state", "intent", "uncertainty", "risk")}
    return f"<{type(value).__module__}.{type(value).__qualname__}>"


def _columns(quantities: Sequence[Quantity]) -> dict[str, str]:
    return {
        "columns": ",".join(quantity.name for quantity in quantities),
        "units": ",".join(quantity.unit for quantity in quantities),
    }
