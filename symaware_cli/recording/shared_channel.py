"""Shared channels: those on which one message tells of many entities, and what each of them says of one."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

from symaware_cli.recording import wire
from symaware_cli.recording.error import LogError
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.recording.json_text import read_json
from symaware_cli.recording.log_message import LogMessage

POSE = {"columns": "x,y,z,qx,qy,qz,qw", "units": "m,m,m,1,1,1,1"}
"""The metadata of a channel that tells how bodies are in space."""

_UNITS = {"x": "m", "y": "m", "z": "m", "heading": "rad"}

SHARED: Mapping[str, Sequence[str]] = {
    "/world/plane": ("x", "y", "heading"),
    "/world/space": ("x", "y", "z", "heading"),
    "/world/bodies": ("x", "y", "z", "heading", "qx", "qy", "qz", "qw"),
}
"""The columns of each shared channel. Their topics have a part less than those of single groups and entities."""


def shared_metadata(names: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """The metadata of a shared channel: who it tells of, by row, and what."""
    units = [_UNITS.get(column, "1") for column in columns]
    return {"columns": ",".join(columns), "units": ",".join(units), "entities": json.dumps(list(names))}


def entities_of(info: ChannelInfo) -> list[str]:
    """Who a shared channel tells of, by row.

    Raises:
        ValueError: It does not say so.
    """
    names = read_json(info.metadata.get("entities", "[]"))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError("no list of names")
    return names


class SharedChannel:
    """What a shared channel says of each entity, as channels of their own.

    Attributes:
        channels: These channels, by topic: `/world/<entity>/state`, and `/world/<entity>/pose` if it tells that.
    """

    def __init__(self, info: ChannelInfo) -> None:
        """Find out who is told of.

        Args:
            info: The channel.
        """
        self._topic, columns = info.topic, SHARED[info.topic]
        state = [name for name in columns if name in _UNITS]
        metadata = {"state": {"columns": ",".join(state), "units": ",".join(_UNITS[name] for name in state)}}
        #: Which columns each channel of one entity has.
        self._columns: dict[str, slice | list[int]] = {"state": slice(len(state))}
        if len(columns) > len(state):
            metadata["pose"] = POSE
            self._columns["pose"] = [columns.index(name) for name in POSE["columns"].split(",")]
        try:
            self._names = entities_of(info)
        except ValueError:
            self._names = []
        self.channels: dict[str, ChannelInfo] = {}
        #: The topics of each row, in the order of kinds.
        self._topics = [[(kind, f"/world/{name}/{kind}") for kind in metadata] for name in self._names]
        for row in self._topics:
            for kind, topic in row:
                self.channels[topic] = replace(info, topic=topic, metadata=metadata[kind])

    def split(self, message: LogMessage, wanted: Collection[str] | None = None) -> Iterator[LogMessage]:
        """Make messages of single entities of one that tells of many.

        Args:
            message: One of this channel.
            wanted: The topics that are; None for all.

        Raises:
            LogError: It tells of entities that there are not.
        """
        content: wire.Rows = message.decode()
        rows = range(len(content.values)) if content.rows is None else content.rows.tolist()
        if content.values.shape[1] != len(SHARED[self._topic]) or (len(rows) and max(rows) >= len(self._names)):
            raise LogError(
                f"the message on {self._topic} at {message.time} ns{message.origin} does not fit: {len(self._names)} "
                f"entities have {len(SHARED[self._topic])} columns"
            )
        for place, row in enumerate(rows):
            values = content.values[place : place + 1]
            for kind, topic in self._topics[row]:
                if wanted is None or topic in wanted:
                    own = wire.Rows(None, values[:, self._columns[kind]])
                    yield replace(message, channel=self.channels[topic], data=own.values.tobytes(), content=own)


def shared(info: ChannelInfo) -> SharedChannel | None:
    """What a channel says of each entity, if many share it."""
    if info.topic not in SHARED or not info.carries("Rows"):
        return None
    return _shared(info.topic, info.schema, info.encoding, info.count, tuple(sorted(info.metadata.items())))


@lru_cache(maxsize=32)
def _shared(topic: str, schema: str, encoding: str, count: int, metadata: tuple[tuple[str, str], ...]) -> SharedChannel:
    return SharedChannel(ChannelInfo(topic, schema, encoding, dict(metadata), count))


def single(message: LogMessage, wanted: Collection[str] | None = None) -> Iterator[LogMessage]:
    """Make messages of single entities of one that tells of many; others stay as they are.

    Args:
        message: Any message.
        wanted: The topics of single entities that are; None for all.
    """
    known = shared(message.channel)
    if known is None:
        yield message
    else:
        yield from known.split(message, wanted)
