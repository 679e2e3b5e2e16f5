"""Export tables of log entries: events, messages, contacts, timing, knowledge and images; one row per entry."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from symaware_cli.log import logged_events, sensor_channels
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.views.exporting.table import ExportColumn, Table, Values, place_cells, place_columns

TIME = ExportColumn("time", "number", "s", "simulated time")
"""The first column of every table that depends on time."""

EVENTS = Table(
    "events",
    (
        TIME,
        ExportColumn("name", "text", "", "name of the event"),
        ExportColumn("source", "text", "", "origin, such as agents.robot.2.steer"),
        ExportColumn("level", "text", "", "DEBUG, INFO, WARNING or ERROR"),
        ExportColumn("text", "text", "", "description"),
        ExportColumn("data", "text", "", "further data, JSON"),
    ),
)
RECURRING = Table(
    "recurring",
    (
        TIME,
        ExportColumn("name", "text", "", "name of an event of every step, turn or message"),
        ExportColumn("source", "text", "", "origin"),
    ),
    optional=True,
)
MESSAGES = Table(
    "messages",
    (
        TIME,
        ExportColumn("id", "integer", "", "identifies the message in all its stages"),
        ExportColumn("sender", "text", "", "the agent that sent it"),
        ExportColumn("receiver", "text", "", "the agent it is addressed to"),
        ExportColumn("kind", "text", "", "kind of message"),
        ExportColumn("stage", "text", "", "SENT, DELIVERED or DROPPED"),
        ExportColumn("sent_time", "number", "s", "when it was sent"),
        ExportColumn("reason", "text", "", "why it was dropped"),
        ExportColumn("payload", "text", "", "content, JSON; empty where a stage does not repeat it"),
        ExportColumn("size", "integer", "byte", "size on the simulated channel"),
    ),
)
CONTACTS = Table(
    "contacts",
    (
        TIME,
        ExportColumn("a", "text", "", "the first agent or entity"),
        ExportColumn("b", "text", "", "the second agent or entity"),
        ExportColumn("stage", "text", "", "BEGIN, END, or RESUME within the debounce after an END"),
        *place_columns("point of contact"),
        ExportColumn("depth", "number", "m", "penetration depth"),
        ExportColumn("impulse", "number", "N*s", "impulse at the beginning; 0 in worlds without forces"),
    ),
)
TIMING = Table(
    "timing",
    (
        TIME,
        ExportColumn("wall_time", "number", "s", "wall time since the start of the run"),
        ExportColumn("cpu_time", "number", "s", "processor time used by the process"),
        ExportColumn("steps", "integer", "1", "steps completed"),
        ExportColumn("pace", "number", "1", "requested simulated time per wall time; 0 for as fast as possible"),
        ExportColumn("instants", "integer", "1", "number of paced instants"),
        ExportColumn("late", "integer", "1", "number of paced instants that began late"),
        ExportColumn("worst_lateness", "number", "s", "greatest lateness"),
    ),
)

#: Pixel encodings of images, as in ROS and Foxglove.
_ENCODINGS = {"COLOUR": "rgb8", "DEPTH": "16UC1", "SEGMENTS": "16UC1"}


@dataclass(frozen=True)
class EntrySource:
    """Converts the messages of a channel to a table of entries.

    Attributes:
        table: The table.
        rows: Converts the time [ns] and the content of a message to rows; none if the message is not selected.
        names: The names that the columns of names refer to.
        growth: Approximate ratio of the size of the table in memory to that of its messages.
    """

    table: Table
    rows: Callable[[int, Any], Iterable[Sequence[Any]]]
    names: Sequence[str] = ()
    growth: int = 1

    def convert(self, entries: Sequence[tuple[int, Any]]) -> list[Values]:
        """Convert messages to rows.

        Args:
            entries: Time [ns] and content of each message, in order.

        Raises:
            ValueError: A message is damaged.
        """
        return self.table.values([row for time, message in entries for row in self.rows(time, message)], self.names)


def event_source(selection: Selection) -> EntrySource:
    """Create the table of events."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        event = logged_events.event(time, message)
        if selection.has_source(event.source):
            yield time / 1e9, event.name, event.source, event.level, event.text, message.data

    return EntrySource(EVENTS, rows)


def recurring_source(selection: Selection) -> EntrySource:
    """Create the table of recurring events."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        wanted = [selection.has_source(source) for source in message.sources]
        for name, source in zip(message.name, message.source, strict=True):
            if wanted[source]:
                yield time / 1e9, message.names[name], message.sources[source]

    return EntrySource(RECURRING, rows)


def message_source(selection: Selection, roster: Sequence[str]) -> EntrySource:
    """Create the table of messages between agents, whose indices refer to a roster."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        for entry in logged_events.communications(time, message, roster):
            if selection.has_agent(entry.sender, entry.receiver):
                about = (entry.sender, entry.receiver, entry.kind, entry.stage)
                says = "" if entry.payload is None else json.dumps(entry.payload, sort_keys=True)
                yield time / 1e9, entry.id, *about, entry.sent_time / 1e9, entry.reason, says, entry.size

    return EntrySource(MESSAGES, rows)


def contact_source(selection: Selection) -> EntrySource:
    """Create the table of contacts."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        contact = logged_events.contact(time, message)
        if selection.has_agent(contact.a, contact.b):
            about = (contact.a, contact.b, contact.stage, *place_cells(contact.point))
            yield time / 1e9, *about, contact.depth, contact.impulse

    return EntrySource(CONTACTS, rows)


def timing_source() -> EntrySource:
    """Create the table of timing figures."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        pace = (message.pace, message.instants, message.late, message.worst_lateness)
        yield time / 1e9, message.wall_time, message.cpu_time, message.steps, *pace

    return EntrySource(TIMING, rows)


def knowledge_source(path: str, ids: Sequence[str], selection: Selection) -> EntrySource:
    """Create the table of the knowledge of the agents of a group, at a path."""
    table = Table(
        path,
        (
            TIME,
            ExportColumn("agent", "name", "", "the agent that knows it"),
            ExportColumn("key", "text", "", "name of the entry"),
            ExportColumn("value", "text", "", "JSON"),
        ),
        optional=True,
    )

    place = {id: row for row, id in enumerate(ids)}

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        for entry in logged_events.knowledge(time, message, ids):
            if selection.has_agent(entry.agent):
                for key, value in entry.values.items():
                    yield time / 1e9, place[entry.agent], key, json.dumps(value, sort_keys=True)

    return EntrySource(table, rows, ids)


def image_source(path: str, sensor: str, ids: Sequence[str], selection: Selection) -> EntrySource:
    """Create the table of the images of a camera of the agents of a group, at a path."""
    table = Table(
        path,
        (
            TIME,
            ExportColumn("agent", "name", "", "the agent with the camera"),
            ExportColumn("measured", "number", "s", "simulated time of the image"),
            ExportColumn("kind", "text", "", "COLOUR, DEPTH or SEGMENTS"),
            ExportColumn("width", "integer", "1", "width in pixels"),
            ExportColumn("height", "integer", "1", "height in pixels"),
            ExportColumn(
                "encoding", "text", "", "rgb8: red, green, blue; 16UC1: depth in mm, 65535 for none, or segments"
            ),
            ExportColumn("field_of_view", "number", "rad", "vertical field of view"),
            *place_columns("position of the camera"),
            *place_columns("a point at the centre of the image", "target_"),
            ExportColumn("image", "image", "", "PNG"),
        ),
        optional=True,
    )
    place = {id: row for row, id in enumerate(ids)}

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        for seen in sensor_channels.images(time, message, sensor, ids):
            if selection.has_agent(seen.agent):
                where = (*place_cells(seen.position), *place_cells(seen.target))
                about = (place[seen.agent], seen.measured / 1e9, seen.kind, *seen.size, _ENCODINGS.get(seen.kind, ""))
                yield time / 1e9, *about, seen.field_of_view, *where, seen.data

    return EntrySource(table, rows, ids)
