"""Follows a log while it is being written: reads messages as soon as they are in the file."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

from symaware_cli.log import ChannelInfo, Log, LogError, LogMessage, open_log
from symaware_cli.views.chunk import Chunk, ChunkReader

#: Interval between two checks for new data [s]; logs are flushed twice a second.
_INTERVAL = 0.1


class FollowingAbandoned(Exception):  # noqa: N818 (nothing went wrong)
    """Following was cancelled."""


class _Tail(io.RawIOBase):
    """A file that another process writes: reading waits until there are data."""

    def __init__(self, path: Path, wanted: Callable[[], bool], on_rest: Callable[[], None]) -> None:
        """Open the file.

        Args:
            path: The file.
            wanted: Returns whether to continue waiting.
            on_rest: Called before waiting, when all available data have been read.
        """
        self._file = open(path, "rb")  # noqa: SIM115 (closed with this)
        self._wanted = wanted
        self._on_rest = on_rest

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        while not (count := self._file.readinto(buffer)):
            self._on_rest()
            if not self._wanted():
                raise FollowingAbandoned
            time.sleep(_INTERVAL)
        return count

    def close(self) -> None:
        self._file.close()
        super().close()


def await_beginning(path: Path, wanted: Callable[[], bool]) -> Log:
    """Wait until a log has a manifest and its first messages.

    Args:
        path: The file, which need not exist yet.
        wanted: Returns whether to continue waiting.

    Raises:
        FollowingAbandoned: Waiting was cancelled.
        LogError: The file is not a SymAware log.
    """
    while wanted():
        if path.exists() and path.stat().st_size:
            try:
                log = open_log(path)
            except LogError:
                # The writer has not finished the first records.
                time.sleep(_INTERVAL)
                continue
            if log.foreign and log.header.profile:
                raise LogError(f"{path} was not written by SymAware")
            if log.manifest and log.message_count:
                return log
        time.sleep(_INTERVAL)
    raise FollowingAbandoned


def follow(
    path: Path, chunk_reader: ChunkReader, draw_chunk: Callable[[Chunk], None], wanted: Callable[[], bool]
) -> None:
    """Draw a log from its beginning to its end while it grows.

    Args:
        path: The file.
        chunk_reader: Groups the messages into chunks.
        draw_chunk: Draws a chunk.
        wanted: Returns whether to continue; called whenever there are no new data.

    Raises:
        FollowingAbandoned: Following was cancelled.
        LogError: The log is damaged.
    """

    def draw() -> None:
        if not chunk_reader.empty:
            draw_chunk(chunk_reader.drain())

    with _Tail(path, wanted, draw) as tail:
        try:
            for message in _messages(tail):
                _take(chunk_reader, message, draw)
        except McapError as error:
            raise LogError(f"{path} is damaged: {error}") from error
    draw()


def _take(chunk_reader: ChunkReader, message: LogMessage, draw: Callable[[], None]) -> None:
    if chunk_reader.is_full and message.time > chunk_reader.end:
        draw()
    chunk_reader.take_message(message)


def _messages(tail: _Tail) -> Iterator[LogMessage]:
    """Read messages in file order, which in SymAware logs is the order of time."""
    schemas: dict[int, str] = {}
    channels: dict[int, ChannelInfo] = {}
    for record in StreamReader(io.BufferedReader(tail)).records:
        match record:
            case Schema():
                schemas[record.id] = record.name
            case Channel():
                schema = schemas.get(record.schema_id, "")
                channels[record.id] = ChannelInfo(record.topic, schema, record.message_encoding, record.metadata, 0)
            case Message():
                yield LogMessage(channels[record.channel_id], record.log_time, record.sequence, record.data)
