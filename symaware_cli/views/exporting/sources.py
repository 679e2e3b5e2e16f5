"""Determines the tables of a log, with the names and units of their columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Part, Signal
from symaware_cli.log import ChannelInfo, Log, column_quantities, logged_events, others_message, signal_of, signal_topic
from symaware_cli.log.sensor_channels import IMAGE, SCAN, sensors
from symaware_cli.views.exporting import entries, row_tables
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.views.exporting.table import ExportColumn, Table, Values

Quantities = Sequence[tuple[str, str]]
"""Name and unit of each column."""

#: Topics of true quantities, and their tables.
_TRUTH = {"state": "world", "pose": "pose", "joints": "joints"}

#: A ray takes 4 bytes in the log and ten numbers in a table.
_SCAN_GROWTH = 16


class TableSource(Protocol):
    """Converts the messages of a channel to a table."""

    @property
    def table(self) -> Table:
        """The table."""

    @property
    def growth(self) -> int:
        """Approximate ratio of the size of the table in memory to that of its messages."""

    def convert(self, entries: Sequence[tuple[int, Any]]) -> list[Values]:
        """Convert messages to rows.

        Args:
            entries: Time [ns] and content of each message, in order; all messages of an instant are in the same call.

        Raises:
            ValueError: A message is inconsistent.
        """


@dataclass
class Extent:
    """The sizes of the messages of a channel.

    Attributes:
        widths: Numbers of columns that occur: of a row, a point or a belief.
        covariances: Whether there are covariances.
    """

    widths: set[int] = field(default_factory=set)
    covariances: bool = False

    @property
    def width(self) -> int:
        """The greatest number of columns."""
        return max(self.widths, default=0)


def sources_of(log: Log, selection: Selection) -> dict[str, TableSource]:
    """Determine the tables of a log.

    Args:
        log: The log, with a manifest.
        selection: The part of the log to export.

    Returns:
        The sources by topic.

    Raises:
        LogError: The log can no longer be read.
    """
    extents = _extents(log, selection)
    sources: dict[str, TableSource] = {}
    for name, group in log.manifest.get("groups", {}).items():
        ids = tuple(group["agents"])
        chosen = np.array([selection.has_agent(id) for id in ids], bool)
        if chosen.any():
            sources |= _Group(log, name, ids, group.get("model", {}), chosen, extents).sources(selection)
    for name in log.manifest.get("entities", {}):
        if selection.has_agent(name):
            sources |= _Group(log, name, (name,), {}, np.ones(1, bool), extents).sources(selection)
    singles: Mapping[str, tuple[str, TableSource]] = {
        "events": ("/events", entries.event_source(selection)),
        "recurring": ("/events/recurring", entries.recurring_source(selection)),
        "contacts": ("/contacts", entries.contact_source(selection)),
        "timing": ("/timing", entries.timing_source()),
    }
    if selection.has_field("messages"):
        told = entries.message_source(selection, log.manifest.get("roster", ()))
        sources |= dict.fromkeys(logged_events.MESSAGES, told)
    return sources | dict(each for kind, each in singles.items() if selection.has_field(kind))


def _extents(log: Log, selection: Selection) -> dict[str, Extent]:
    """Read the channels whose metadata do not determine the sizes of their messages."""
    extents = {
        topic: Extent()
        for topic, info in log.topics.items()
        if selection.has_field(_kind(info))
        and (
            info.schema in ("symaware.v1.SeriesRows", "symaware.v1.Awareness")
            or (info.schema in ("symaware.v1.Rows", "symaware.v1.TableRows") and "columns" not in info.metadata)
        )
    }
    for message in log.messages(extents, selection.start, selection.end):
        extent, content = extents[message.channel.topic], message.decode()
        match content:
            case others_message.Awareness():
                extent.widths.update(content.columns.tolist() if len(content.entities) else ())
                extent.covariances |= len(content.covariances) > 0
            case _:
                extent.widths.add(content.values.shape[1])
    return extents


@dataclass(frozen=True)
class _Group:
    """A group of agents, or a moving entity."""

    log: Log
    name: str
    ids: tuple[str, ...]
    model: Mapping[str, Any]
    chosen: NDArray[np.bool_]
    extents: Mapping[str, Extent]

    def sources(self, selection: Selection) -> dict[str, TableSource]:
        """Return the tables of the group, by topic."""
        prefix = f"/agents/{self.name}"
        makers: dict[str, tuple[str, Callable[[str], TableSource]]] = {
            **{f"/world/{self.name}/{kind}": ("world", partial(self.world, table)) for kind, table in _TRUTH.items()},
            f"{prefix}/control": ("control", partial(self.control, "control_requested", "as the controller requested")),
            f"/world/{self.name}/control": ("control", partial(self.control, "control", "as applied up to this time")),
            f"{prefix}/awareness": ("awareness", self.awareness),
            f"{prefix}/knowledge": ("knowledge", partial(self.knowledge, selection)),
        }
        for name, signal in self.log.signals(self.name).items():
            makers[signal_topic(self.name, name, signal)] = (signal.name, partial(self.signal, signal))
        sensing: dict[str, Callable[[str, str], TableSource]] = {
            SCAN: self.scan,
            IMAGE: partial(self.image, selection),
        }
        for kind, maker in sensing.items():
            for sensor, topic in sensors(self.log.topics, self.name, kind).items():
                makers[topic] = (kind, partial(maker, sensor))
        return {
            topic: make(topic)
            for topic, (kind, make) in makers.items()
            if topic in self.log.topics and selection.has_field(kind)
        }

    def world(self, table: str, topic: str) -> TableSource:
        """True states, poses or joint positions."""
        quantities = self._quantities(topic)
        lay_out = partial(row_tables.lay_out_rows, width=len(quantities))
        return self._source(table, _numbers(quantities, "true value"), lay_out)

    def control(self, table: str, description: str, topic: str) -> TableSource:
        """Control inputs."""
        quantities = self._quantities(topic)
        lay_out = partial(row_tables.lay_out_rows, width=len(quantities))
        return self._source(table, _numbers(quantities, description), lay_out)

    def signal(self, signal: Signal, topic: str) -> TableSource:
        """A part of the agents' awareness of themselves, or a signal of a component."""
        quantities = self._quantities(topic)
        columns = _numbers(quantities, signal.description or "as measured")
        lay_out: Callable[..., row_tables.Piece] = row_tables.lay_out_rows
        if signal.kind == "series":
            lay_out = row_tables.lay_out_series
            columns = [
                ExportColumn("point", "integer", "1", "number of the point in its series"),
                ExportColumn("point_time", "number", "s", "simulated time of the point; NaN if there is none"),
                *columns,
            ]
        elif signal.kind == "table":
            lay_out = row_tables.lay_out_tables
            columns = [ExportColumn("entry", "integer", "1", "number of the entry in its table"), *columns]
        component = None if isinstance(signal, Part) else topic.split("/")[-1]
        return self._source(signal.name, columns, partial(lay_out, width=len(quantities)), sensor=component)

    def awareness(self, topic: str) -> TableSource:
        """Beliefs of the agents about others."""
        extent = self.extents[topic]
        quantities = self._quantities(topic)
        columns = [
            ExportColumn("other", "name", "", "the other agent; none if the agent knows no other"),
            ExportColumn("age", "number", "s", "time since the other was last perceived"),
            *_numbers(quantities, "of the other, as believed"),
        ]
        if extent.covariances:
            pairs = [(one, other) for one in quantities for other in quantities]
            spread = [(f"cov_{one[0]}_{other[0]}", f"{one[1]}*{other[1]}".strip("*")) for one, other in pairs]
            columns += _numbers(spread, "covariance")
        lay_out = partial(row_tables.lay_out_awareness, width=len(quantities), covariances=extent.covariances)
        return self._source("awareness", columns, lay_out, self.log.manifest.get("roster", ()))

    def scan(self, sensor: str, topic: str) -> TableSource:
        """Scans of a lidar."""
        columns = [
            ExportColumn("ray", "integer", "1", "number of the ray in its scan"),
            ExportColumn("measured", "number", "s", "simulated time of the measurement"),
            ExportColumn("angle", "number", "rad", "direction of the ray, counter-clockwise from the heading"),
            ExportColumn(
                "distance", "number", "m", "length of the ray; infinite if nothing is in range, NaN if it was missed"
            ),
            *_numbers([("x", "m"), ("y", "m"), ("z", "m"), ("heading", "rad")], "true pose of the sensor"),
        ]
        return self._source(SCAN, columns, row_tables.lay_out_scan, sensor=sensor, growth=_SCAN_GROWTH)

    def image(self, selection: Selection, sensor: str, topic: str) -> TableSource:
        """Images of a camera."""
        return entries.image_source(_path(IMAGE, self.name, sensor), sensor, self.ids, selection)

    def knowledge(self, selection: Selection, topic: str) -> TableSource:
        """Knowledge of the agents."""
        return entries.knowledge_source(_path("knowledge", self.name), self.ids, selection)

    def _source(
        self,
        kind: str,
        columns: Sequence[ExportColumn],
        lay_out: Callable[[Any, int], row_tables.Piece],
        index_names: Sequence[str] | None = None,
        sensor: str | None = None,
        growth: int = 1,
    ) -> TableSource:
        keys = (entries.TIME, ExportColumn("agent", "name", "", "the agent"))
        path = _path(kind, self.name) if sensor is None else _path(kind, self.name, sensor)
        table = Table(path, _distinct([*keys, *columns]), optional=True)
        chosen = None if self.chosen.all() else self.chosen
        return row_tables.RowSource(table, self.ids, lay_out, index_names, chosen, growth)

    def _quantities(self, topic: str) -> Quantities:
        """Return the names and units in the metadata of a channel, unless its messages have a different width."""
        announced = [(each.name, each.unit) for each in column_quantities(self.log.topics[topic].metadata)]
        extent = self.extents.get(topic)
        return announced if extent is None or extent.width in (0, len(announced)) else _numbered(extent.width)


def _path(kind: str, *names: str) -> str:
    """Return the path of a table; names are quoted, so that they cannot lead out of the folder."""
    return "/".join([kind, *(quote(name, safe="") for name in names)])


def _kind(info: ChannelInfo) -> str:
    """Return the selectable field that a channel belongs to."""
    if info.topic.startswith("/world/") and not info.topic.endswith("/control"):
        return "world"
    signal = signal_of(info)
    return signal[1].name if signal else info.topic.split("/")[-1]


def _numbers(quantities: Quantities, description: str) -> list[ExportColumn]:
    return [ExportColumn(name, "number", unit, description) for name, unit in quantities]


def _numbered(width: int) -> Quantities:
    return [(f"value_{place}", "") for place in range(width)]


def _distinct(columns: Sequence[ExportColumn]) -> tuple[ExportColumn, ...]:
    """Number columns of the same name: a state may well have an element called `time`."""
    taken: set[str] = set()
    distinct = []
    for column in columns:
        name, number = column.name, 2
        while name in taken:
            name, number = f"{column.name}_{number}", number + 1
        taken.add(name)
        distinct.append(ExportColumn(name, column.kind, column.unit, column.description))
    return tuple(distinct)
