"""Shared channels: one message holds the poses of many entities; split into separate channels for reading."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

from symaware_cli.log import wire
from symaware_cli.log.error import LogError
from symaware_cli.log.index import ChannelInfo
from symaware_cli.log.json_text import read_json

if TYPE_CHECKING:
    from symaware_cli.log.log_message import LogMessage

POSE = {"columns": "x,y,z,qx,qy,qz,qw", "units": "m,m,m,1,1,1,1"}
"""The metadata of a channel of poses in space."""

_UNITS = {"x": "m", "y": "m", "z": "m", "heading": "rad"}

SHARED: Mapping[str, Sequence[str]] = {
    "/world/plane": ("x", "y", "heading"),
    "/world/space": ("x", "y", "z", "heading"),
    "/world/bodies": ("x", "y", "z", "heading", "qx", "qy", "qz", "qw"),
}
"""The columns of each shared channel. Their topics have one part less than those of groups and entities."""


def shared_metadata(names: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """Return the metadata of a shared channel: its entities, by row, and columns."""
    units = [_UNITS.get(column, "1") for column in columns]
    return {"columns": ",".join(columns), "units": ",".join(units), "entities": json.dumps(list(names))}


def entities_of(info: ChannelInfo) -> list[str]:
    """Return the entities of a shared channel, by row.

    Raises:
        ValueError: The metadata do not list them.
    """
    names = read_json(info.metadata.get("entities", "[]"))
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError("no list of names")
    return names


class SharedChannel:
    """Splits a shared channel into separate channels of its entities.

    Attributes:
        channels: The separate channels by topic: `/world/<entity>/state`, and `/world/<entity>/pose` if recorded.
    """

    def __init__(self, info: ChannelInfo) -> None:
        """Determine the entities of the channel.

        Args:
            info: The channel.
        """
        self._topic, columns = info.topic, SHARED[info.topic]
        state = [name for name in columns if name in _UNITS]
        metadata = {"state": {"columns": ",".join(state), "units": ",".join(_UNITS[name] for name in state)}}
        #: The columns of each separate channel.
        self._columns: dict[str, slice | list[int]] = {"state": slice(len(state))}
        if len(columns) > len(state):
            metadata["pose"] = POSE
            self._columns["pose"] = [columns.index(name) for name in POSE["columns"].split(",")]
        try:
            self._names = entities_of(info)
        except ValueError:
            self._names = []
        self.channels: dict[str, ChannelInfo] = {}
        #: The separate topics of each row, in the order of kinds.
        self._topics = [[(kind, f"/world/{name}/{kind}") for kind in metadata] for name in self._names]
        for row in self._topics:
            for kind, topic in row:
                self.channels[topic] = replace(info, topic=topic, metadata=metadata[kind])

    def split(self, message: LogMessage, wanted: Collection[str] | None = None) -> Iterator[LogMessage]:
        """Split a message into messages of single entities.

        Args:
            message: A message of this channel.
            wanted: The topics to yield; None for all.

        Raises:
            LogError: It refers to entities that do not exist.
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
    """Return the separate channels of a shared channel; None for any other channel."""
    if info.topic not in SHARED or not info.carries("Rows"):
        return None
    return _shared(info.topic, info.schema, info.encoding, info.count, tuple(sorted(info.metadata.items())))


@lru_cache(maxsize=32)
def _shared(topic: str, schema: str, encoding: str, count: int, metadata: tuple[tuple[str, str], ...]) -> SharedChannel:
    return SharedChannel(ChannelInfo(topic, schema, encoding, dict(metadata), count))


def single(message: LogMessage, wanted: Collection[str] | None = None) -> Iterator[LogMessage]:
    """Split a message of a shared channel into messages of single entities; yield any other unchanged.

    Args:
        message: Any message.
        wanted: The topics of single entities to yield; None for all.
    """
    known = shared(message.channel)
    if known is None:
        yield message
    else:
        yield from known.split(message, wanted)
