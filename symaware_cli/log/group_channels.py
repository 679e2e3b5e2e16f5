"""Records groups and obstacles: channels of states, awareness, control inputs and knowledge, with the changed rows."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import MEASUREMENT, Column, SeriesColumn, SignalColumn, TableColumn
from symaware_cli.core import AgentGroup, Environment
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.log.fields import SIGNAL_MESSAGES, columns_metadata, signal_metadata, signal_topic
from symaware_cli.log.json_text import as_json
from symaware_cli.log.others_channel import OthersChannel
from symaware_cli.log.sensor_channels import SensorChannels
from symaware_cli.log.shared_channel import POSE, SHARED, shared_metadata
from symaware_cli.log.writer import LogWriter, Message
from symaware_cli.world import motion_quantities

#: A channel, the column that it records, and the function that encodes some rows of the column, None for all.
_Source: TypeAlias = tuple[int, SignalColumn, Callable[[Any, Sequence[int] | None], bytes]]


class EntityChannels:
    """The shared channels of moving entities, each of which holds many entities."""

    def __init__(self, writer: LogWriter, environment: Environment) -> None:
        """Open the channels that are needed.

        Args:
            writer: The log.
            environment: The initialised world.
        """
        self._environment = environment
        #: For each channel: the names of its entities, and the values last recorded.
        self._shared: dict[int, tuple[Sequence[str], NDArray[np.float64] | None]] = {}
        moving = [name for name in environment.obstacles if environment.moves(name)]
        width = {name: environment.entity_poses([name]).shape[1] for name in moving}
        for topic, columns in SHARED.items():
            names = [name for name in moving if width[name] == len(columns)]
            if names:
                channel = writer.channel(topic, "Rows", shared_metadata(names, columns))
                self._shared[channel] = names, None

    def record(self, messages: list[Message]) -> None:
        """Record the poses of the entities that moved."""
        for channel, (names, last) in self._shared.items():
            values = self._environment.entity_poses(names)
            self._shared[channel] = names, values
            _record_changes(messages, channel, values, last)


class PostureChannels:
    """The channels of the orientation and joint positions of bodies in a spatial world."""

    def __init__(self, writer: LogWriter, environment: Environment, name: str) -> None:
        """Open the channels for the quantities that `EntityChannels` does not record.

        Args:
            writer: The log.
            environment: The initialised world.
            name: The group or the obstacle.
        """
        self._name = name
        self._sources: list[tuple[int, Callable[[str], NDArray[np.float64] | None]]] = []
        self._last: dict[int, NDArray[np.float64]] = {}
        if name not in environment.obstacles and environment.body_poses(name) is not None:
            self._sources.append((writer.channel(f"/world/{name}/pose", "Rows", POSE), environment.body_poses))
        if environment.joint_positions(name) is not None:
            joints = environment.articulations()[name].joints
            metadata = {"columns": ",".join(joints), "units": ",".join(joints.values())}
            channel = writer.channel(f"/world/{name}/joints", "Rows", metadata)
            self._sources.append((channel, environment.joint_positions))

    @property
    def has_channels(self) -> bool:
        """Whether any channel was opened."""
        return bool(self._sources)

    def record(self, messages: list[Message], own: Sequence[int] | None = None) -> None:
        """Record the rows that changed; if some rows are given, all of these and no others."""
        for channel, read in self._sources:
            values, last = read(self._name), self._last.get(channel)
            if values is not None:
                self._last[channel] = values
                _record_changes(messages, channel, values, last, own)


class _PresentRows:
    """The rows of a group that are recorded at present: of the agents that run in this process and are present."""

    __slots__ = ("_group", "_now", "_own", "_present")

    def __init__(self, group: AgentGroup, own: Sequence[int] | None = None) -> None:
        """Initialise the selection.

        Args:
            group: The group.
            own: The rows of agents that run in this process, ascending; None for all.
        """
        self._group = group
        self._own = None if own is None or len(own) == len(group) else list(own)
        self._now = self._own
        self._present: Any = None

    @property
    def now(self) -> list[int] | None:
        """The rows recorded now, ascending; None for all."""
        present = self._group.present
        if present is not self._present:
            self._present = present
            rows = range(len(self._group)) if self._own is None else self._own
            chosen = [row for row in rows if present is None or present[row]]
            self._now = None if len(chosen) == len(self._group) else chosen
        return self._now


class GroupChannels:
    """The channels of one group."""

    def __init__(
        self,
        writer: LogWriter,
        environment: Environment,
        group: AgentGroup,
        omit: Collection[str],
        own: Sequence[int] | None = None,
    ) -> None:
        """Open the channels.

        Args:
            writer: The log.
            environment: The initialised world.
            group: The group.
            omit: Kinds to omit.
            own: The rows to record, ascending; None for all. The other rows run in another process.
        """
        self._rows = _PresentRows(group, own)
        self._there = _PresentRows(group)
        self._environment = environment
        self._group = group
        self._omit = frozenset(omit)
        self._count = len(group)
        self._last_truth: Any = None
        self._told_steps = 0
        awareness = group.awareness
        inputs = columns_metadata(group.model.control_input)
        motion = columns_metadata(motion_quantities(environment.roster.dimensions))
        topics = {
            "world": (f"/world/{group.name}/state", "Rows", columns_metadata(group.model.state)),
            "requested_control": (f"/agents/{group.name}/control", "Rows", inputs),
            "applied_control": (f"/world/{group.name}/control", "Rows", inputs),
            **{
                name: (signal_topic(group.name, name, part), SIGNAL_MESSAGES[part.kind], signal_metadata(part))
                for name, part in awareness.parts.items()
            },
            "awareness": (f"/agents/{group.name}/awareness", "Awareness", motion),
            "knowledge": (f"/agents/{group.name}/knowledge", "Knowledge", {}),
        }
        self._channels = {kind: writer.channel(*topic) for kind, topic in topics.items() if kind not in self._omit}
        self._postures = PostureChannels(writer, environment, group.name) if "world" in self._channels else None
        self._others = (
            OthersChannel(self._channels["awareness"], group, environment.roster)
            if "awareness" in self._channels
            else None
        )
        # There from the beginning, since a captured state can only be restored into objects that exist.
        self._sensors = SensorChannels(writer, group) if "sensors" not in self._omit else None
        #: The columns of the parts of awareness whose channel is open, of control inputs and of signals.
        self._parts = [
            self._source(self._channels[name], awareness.columns[name])
            for name in awareness.parts
            if name in self._channels
        ]
        control = self._channels.get("requested_control")
        self._control = [] if control is None else [self._source(control, group.control_column)]
        self._signals = [
            self._source(
                writer.channel(
                    signal_topic(group.name, field, signal), SIGNAL_MESSAGES[signal.kind], signal_metadata(signal)
                ),
                awareness.columns[field],
            )
            for field, signal in awareness.signals.items()
            if self._omit.isdisjoint((field, "sensors" if signal.name == MEASUREMENT else signal.name))
        ]

    def _source(self, channel: int, column: SignalColumn) -> _Source:
        """Return a column with its channel and the function that encodes its rows, chosen once by its kind."""
        if isinstance(column, Column):
            return channel, column, self._encode_column
        if isinstance(column, TableColumn):
            return channel, column, self._encode_tables
        return channel, column, self._encode_series

    def record(self, now: int, steps: int, messages: list[Message]) -> int:
        """Record the rows that changed and return their number, without those of true states.

        Parts of awareness, such as intents, and signals are recorded alike, by their kind.

        Args:
            now: Simulated time in nanoseconds.
            steps: Number of steps completed.
            messages: The messages of the instant, to which those of the group are added.
        """
        channels, own = self._channels, self._rows.now
        if "world" in channels:
            truth = self._environment.state(self._group)
            if truth is not self._last_truth:
                self._last_truth = truth
                self._record_all(messages, channels["world"], truth)
                if self._postures:
                    self._postures.record(messages, self._there.now)
        if "applied_control" in channels and steps > self._told_steps:
            # The inputs that were applied in the last step; only the world knows them.
            self._told_steps = steps
            self._record_all(messages, channels["applied_control"], self._environment.applied_input(self._group))
        updates = self._record_columns(messages, self._parts, own)
        if self._others:
            updates += self._others.record(now, own, messages)
        updates += self._record_columns(messages, self._control, own)
        if "knowledge" in channels:
            updates += self._record_knowledge(messages, channels["knowledge"], own)
        if self._signals:
            updates += self._record_columns(messages, self._signals, own)
        if self._sensors and self._group.awareness.readings:
            updates += self._sensors.record(own, messages)
        return updates

    def _record_all(self, messages: list[Message], channel: int, values: NDArray[np.float64]) -> None:
        """Record the values of all rows that are present."""
        rows = self._there.now
        if rows is None:
            messages.append((channel, wire.encode_rows(values)))
        elif rows:
            messages.append((channel, wire.encode_rows(values[rows], rows)))

    def _record_columns(self, messages: list[Message], sources: Sequence[_Source], own: Sequence[int] | None) -> int:
        """Record the rows of columns that changed; if only some rows are recorded, those of them."""
        updates = 0
        for channel, column, encode in sources:
            rows = column.take_changes()
            if own is not None:
                rows = own if rows is None else sorted({*rows} & {*own})
            if rows is None:
                updates += self._count
            elif rows:
                updates += len(rows)
            else:
                continue
            messages.append((channel, encode(column, rows)))
        return updates

    def _encode_column(self, column: Column, rows: Sequence[int] | None) -> bytes:
        return wire.encode_rows(column.values) if rows is None else wire.encode_rows(column.values[rows], rows)

    def _encode_series(self, column: SeriesColumn, rows: Sequence[int] | None) -> bytes:
        if rows is None and (shared := column.shared):
            return wire.encode_series(*shared)
        series = [column.row(row) for row in (range(self._count) if rows is None else rows)]
        width = max(each.values.shape[1] for each in series)
        lengths = [len(each) for each in series]
        times = np.concatenate([each.times for each in series])
        parts = [each.values for each in series if len(each)]
        values = np.concatenate(parts) if parts else np.empty((0, width))
        return wire.encode_series(times, values, lengths, rows)

    def _encode_tables(self, column: TableColumn, rows: Sequence[int] | None) -> bytes:
        tables = column.tables if rows is None else [column.row(row) for row in rows]
        lengths = [len(table) for table in tables]
        return wire.encode_tables(np.concatenate(tables), lengths, rows)

    def _record_knowledge(self, messages: list[Message], channel: int, own: Sequence[int] | None) -> int:
        changed = self._group.knowledge_changes.rows
        if not changed:
            return 0
        rows = sorted(changed)
        changed.clear()
        if own is not None:
            rows = [row for row in rows if row in own]
            if not rows:
                return 0
        record = v1.Knowledge(
            rows=[] if len(rows) == self._count else rows, values=[as_json(self._group.knowledge[row]) for row in rows]
        )
        for row in rows:
            self._group.knowledge[row].changed = False
        messages.append((channel, record.SerializeToString(deterministic=True)))
        return len(rows)


def _record_changes(
    messages: list[Message],
    channel: int,
    values: NDArray[np.float64],
    last: NDArray[np.float64] | None,
    own: Sequence[int] | None = None,
) -> None:
    """Record the rows that changed; if only some rows are recorded, all of these."""
    if own is not None:
        if own:
            messages.append((channel, wire.encode_rows(values[list(own)], own)))
        return
    rows = None if last is None else (values != last).any(axis=1).nonzero()[0]
    if rows is None or len(rows) == len(values):
        messages.append((channel, wire.encode_rows(values)))
    elif len(rows):
        messages.append((channel, wire.encode_rows(values[rows], rows)))
