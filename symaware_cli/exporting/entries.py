"""Tables of entries: events, messages, contacts, images, and the like, each a row by itself."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from symaware_cli.exporting.log_selection import Selection
from symaware_cli.exporting.table import ExportColumn, Table, Values, place_cells, place_columns
from symaware_cli.recording import logged_events, sensor_channels

TIME = ExportColumn("time", "number", "s", "simulated time")
"""The first column of every table but those that do not depend on time."""

EVENTS = Table(
    "events",
    (
        TIME,
        ExportColumn("name", "text", "", "what happened"),
        ExportColumn("source", "text", "", "where, such as agents.robot.2.steer"),
        ExportColumn("level", "text", "", "DEBUG, INFO, WARNING or ERROR"),
        ExportColumn("text", "text", "", "in words"),
        ExportColumn("data", "text", "", "more about it, JSON"),
    ),
)
RECURRING = Table(
    "recurring",
    (
        TIME,
        ExportColumn("name", "text", "", "what happens with every step, turn or message"),
        ExportColumn("source", "text", "", "where"),
    ),
    optional=True,
)
MESSAGES = Table(
    "messages",
    (
        TIME,
        ExportColumn("id", "integer", "", "the same in all stages of one message"),
        ExportColumn("sender", "text", "", "who sent it"),
        ExportColumn("receiver", "text", "", "who it is for"),
        ExportColumn("kind", "text", "", "what it is about"),
        ExportColumn("stage", "text", "", "SENT, DELIVERED or DROPPED"),
        ExportColumn("sent_time", "number", "s", "when it was sent"),
        ExportColumn("reason", "text", "", "why it was dropped"),
        ExportColumn("payload", "text", "", "what it says, JSON; empty where a stage does not repeat it"),
        ExportColumn("size", "integer", "byte", "size on the simulated channel"),
    ),
)
CONTACTS = Table(
    "contacts",
    (
        TIME,
        ExportColumn("a", "text", "", "the one"),
        ExportColumn("b", "text", "", "the other"),
        ExportColumn("stage", "text", "", "BEGIN or END"),
        *place_columns("where"),
        ExportColumn("depth", "number", "m", "how deep they overlap"),
        ExportColumn("impulse", "number", "N*s", "how hard they hit each other; 0 in worlds without forces"),
    ),
)
TIMING = Table(
    "timing",
    (
        TIME,
        ExportColumn("wall_time", "number", "s", "since the run started"),
        ExportColumn("cpu_time", "number", "s", "used by the process"),
        ExportColumn("steps", "integer", "1", "steps done"),
        ExportColumn(
            "pace", "number", "1", "simulated time per wall time that was asked for; 0 for as fast as possible"
        ),
        ExportColumn("instants", "integer", "1", "instants that had to be kept"),
        ExportColumn("late", "integer", "1", "how many of them began late"),
        ExportColumn("worst_lateness", "number", "s", "by how much the latest"),
    ),
)

#: What the pixels of each kind of image are, as ROS and Foxglove say it.
_ENCODINGS = {"COLOUR": "rgb8", "DEPTH": "16UC1", "SEGMENTS": "16UC1"}


@dataclass(frozen=True)
class EntrySource:
    """Makes a table of the messages of a channel.

    Attributes:
        table: The table.
        rows: Makes rows of the time [ns] and the content of a message; none if it is not wanted.
        names: What the columns of names stand for.
        growth: How many times as large as its messages the table is in memory, roughly.
    """

    table: Table
    rows: Callable[[int, Any], Iterable[Sequence[Any]]]
    names: Sequence[str] = ()
    growth: int = 1

    def convert(self, entries: Sequence[tuple[int, Any]]) -> list[Values]:
        """Make rows of messages.

        Args:
            entries: Time [ns] and content of each message, in order.

        Raises:
            ValueError: A message is damaged.
        """
        return self.table.values([row for time, message in entries for row in self.rows(time, message)], self.names)


def event_source(selection: Selection) -> EntrySource:
    """Make the table of events."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        event = logged_events.event(time, message)
        if selection.has_source(event.source):
            yield time / 1e9, event.name, event.source, event.level, event.text, message.data

    return EntrySource(EVENTS, rows)


def recurring_source(selection: Selection) -> EntrySource:
    """Make the table of events that recur."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        wanted = [selection.has_source(source) for source in message.sources]
        for name, source in zip(message.name, message.source, strict=True):
            if wanted[source]:
                yield time / 1e9, message.names[name], message.sources[source]

    return EntrySource(RECURRING, rows)


def message_source(selection: Selection, roster: Sequence[str]) -> EntrySource:
    """Make the table of messages between agents, of which a roster tells who they are."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        for entry in logged_events.communications(time, message, roster):
            if selection.has_agent(entry.sender, entry.receiver):
                about = (entry.sender, entry.receiver, entry.kind, entry.stage)
                says = "" if entry.payload is None else json.dumps(entry.payload, sort_keys=True)
                yield time / 1e9, entry.id, *about, entry.sent_time / 1e9, entry.reason, says, entry.size

    return EntrySource(MESSAGES, rows)


def contact_source(selection: Selection) -> EntrySource:
    """Make the table of contacts."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        contact = logged_events.contact(time, message)
        if selection.has_agent(contact.a, contact.b):
            about = (contact.a, contact.b, contact.stage, *place_cells(contact.point))
            yield time / 1e9, *about, contact.depth, contact.impulse

    return EntrySource(CONTACTS, rows)


def timing_source() -> EntrySource:
    """Make the table of how fast the machine was."""

    def rows(time: int, message: Any) -> Iterable[Sequence[Any]]:
        pace = (message.pace, message.instants, message.late, message.worst_lateness)
        yield time / 1e9, message.wall_time, message.cpu_time, message.steps, *pace

    return EntrySource(TIMING, rows)


def knowledge_source(path: str, ids: Sequence[str], selection: Selection) -> EntrySource:
    """Make the table of what the agents of a group know, at a path."""
    table = Table(
        path,
        (
            TIME,
            ExportColumn("agent", "name", "", "whose knowledge it is"),
            ExportColumn("key", "text", "", "what is known"),
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
    """Make the table of what the cameras of a group saw, at a path."""
    table = Table(
        path,
        (
            TIME,
            ExportColumn("agent", "name", "", "whose camera"),
            ExportColumn("measured", "number", "s", "simulated time that is seen"),
            ExportColumn("kind", "text", "", "COLOUR, DEPTH or SEGMENTS"),
            ExportColumn("width", "integer", "1", "pixels from left to right"),
            ExportColumn("height", "integer", "1", "pixels from top to bottom"),
            ExportColumn(
                "encoding", "text", "", "rgb8: red, green, blue; 16UC1: mm, 65535 for nothing, or who is seen"
            ),
            ExportColumn("field_of_view", "number", "rad", "from the lower to the upper edge"),
            *place_columns("where the camera was"),
            *place_columns("a point in the middle of the image", "target_"),
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
