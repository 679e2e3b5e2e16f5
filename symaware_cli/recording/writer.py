"""The writer of a log.

It writes MCAP records itself, with the record classes of `mcap`, and not through `mcap.writer.Writer`: the chunks are
ours to cut (a bound on their size, an end on demand, before a large message and not behind it), a message costs 1 us
instead of 4, and every byte reaches the operating system in one place, where a failure can be dealt with.
"""

import contextlib
import os
import struct
import threading
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar

import zstandard
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, MetadataIndex, Schema

from symaware_cli.core.stateful import StateError
from symaware_cli.recording import symaware_v1_pb2 as v1
from symaware_cli.recording.error import LogError, OutputError, reason
from symaware_cli.recording.log_schema import (
    CHUNK_SIZE,
    LARGEST_CHUNK,
    LIBRARY,
    MAGIC,
    MESSAGES,
    OUTCOME,
    PROFILE,
    TIMING,
    descriptor_set,
    json_values,
)
from symaware_cli.recording.log_summary import LogSummary, indexed, serialise

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode 5, length, channel, sequence, log time, publish time
_MESSAGE_HEADER = _MESSAGE.size - 9

PaceFigures = tuple[float, int, int, float]
"""How well a pace was kept; `LogWriter.add_timing` says what the numbers are."""


class LogWriter:
    """Writes one log.

    Messages gather in a chunk, which is compressed and handed to the operating system when it is full or flushed;
    whatever has been handed over outlives the process. Attachments, metadata and channels are handed over at once.

    As a context manager it aborts the log on leaving, unless it was finished before.

    Args:
        path: The file, which is replaced.
        flush_interval: Wall time between two flushes by `flush_in_background`, in s.

    Raises:
        OutputError: The file cannot be created.

    Attributes:
        path: The file.
        size: Bytes handed to the operating system so far.
        timing: The number of the channel /timing, which is there from the beginning.
    """

    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, path: str | os.PathLike[str], *, flush_interval: float = 0.5):
        self.path = Path(path)
        self.size = 0
        self._flush_interval = flush_interval
        self._error: LogError | None = None
        self._compressor = zstandard.ZstdCompressor(level=1)

        self._chunk = bytearray()
        self._chunk_start = 0
        self._time = 0
        self._sequence = 0
        self._timing_sequence = 0
        # By number of the channel: time and offset of each message in the chunk, one after the other.
        self._positions: dict[int, list[int]] = {}

        self._summary = LogSummary()
        #: What the log was where a state was taken, by its size and what it held: there it can go on again.
        self._marks: dict[tuple[int, int], tuple[LogSummary, int]] = {}
        self._checksum = 0

        try:
            self._file = open(self.path, "wb", buffering=0)  # noqa: SIM115 (closed by finish, abort and _fail)
        except OSError as error:
            raise OutputError(f"cannot create the log {self.path}: {reason(error)}") from error
        self._open = True
        # A flush may come from another thread (see `flush_in_background`) while a message is being added.
        self._lock = threading.RLock()
        self._closed = threading.Event()
        # Without a version, so that equal runs make equal logs; versions have an attachment of their own.
        self._write(MAGIC + serialise(Header(profile=PROFILE, library=LIBRARY)))
        # First of all, so that its number does not depend on when somebody looked at the clock.
        self.timing = self.channel(
            TIMING, "Timing", {"columns": "wall_time,cpu_time,steps", "units": "s,s,1", "deterministic": "false"}
        )

    @property
    def sequence(self) -> int:
        """The sequence number that the next message gets, unless it is one of wall time."""
        return self._sequence

    @property
    def messages(self) -> int:
        """Messages added so far."""
        return sum(self._summary.counts.values()) + sum(map(len, self._positions.values())) // 2

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment.

        Args:
            name: Its name in the log, such as `scenario/hello.yaml`.
            media_type: What it is, such as `application/json`.
            data: Its content.

        Raises:
            LogError: It cannot be written.
        """
        offset = self.size
        attachment = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        self._summary.add_attachment(attachment, offset, self._write_record(attachment))

    def metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record.

        Args:
            name: Its name.
            data: Its content, in the order in which it is to stand.

        Raises:
            LogError: It cannot be written.
        """
        offset = self.size
        length = self._write_record(Metadata(name=name, metadata=dict(data)))
        self._summary.metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def channel(self, topic: str, message_name: str, metadata: Mapping[str, str] | None = None) -> int:
        """Open a channel.

        Args:
            topic: Where it is found, such as `/agents/robot/state`.
            message_name: Its message in schemas/symaware/v1/log.proto, such as `Rows`.
            metadata: What a reader should know of it, such as the columns and their units.

        Returns:
            Its number, for `add`.

        Raises:
            LogError: It cannot be written.
            KeyError: There is no such message.
        """
        schema = self._summary.schemas.get(message_name)
        if schema is None:
            name = MESSAGES[message_name].DESCRIPTOR.full_name
            schema = Schema(id=len(self._summary.schemas) + 1, name=name, encoding="protobuf", data=descriptor_set())
            self._write_record(schema)
            self._summary.schemas[message_name] = schema
        channel = Channel(
            id=len(self._summary.channels) + 1,
            topic=topic,
            message_encoding="protobuf",
            metadata=dict(metadata or {}),
            schema_id=schema.id,
        )
        # Beside the chunks and not in one, so that a damaged chunk costs its messages only.
        self._write_record(channel)
        self._summary.channels.append(channel)
        self._positions[channel.id] = []
        return channel.id

    def add(self, channel_id: int, time_ns: int, data: bytes) -> None:
        """Add a message.

        Args:
            channel_id: What `channel` returned.
            time_ns: Simulated time in ns, never before that of the last message: logs are read in one pass.
            data: The serialised message.

        Raises:
            LogError: A chunk was full and could not be written, or the message is larger than any may be.
            KeyError: There is no such channel.
            ValueError: The time went back, is negative, or the log has its 2^32 messages.
        """
        if channel_id == self.timing:
            # They have a sequence of their own, so that they do not shift the others'.
            self._add(channel_id, time_ns, data, self._timing_sequence)
            self._timing_sequence += 1
        else:
            self._add(channel_id, time_ns, data, self._sequence)
            self._sequence += 1

    def add_timing(
        self, time_ns: int, *, wall_time: float, cpu_time: float, steps: int, pace: PaceFigures = (0.0, 0, 0, 0.0)
    ) -> None:
        """Add to /timing how fast the machine was.

        Args:
            time_ns: Simulated time in ns.
            wall_time: Since the run started, in s.
            cpu_time: Used by the process, in s.
            steps: Steps done.
            pace: Simulated seconds for each second of wall time that were asked for, how many instants had to be kept,
                how many of them began late, and by how much the latest, in s of wall time.
        """
        message = v1.Timing(wall_time=wall_time, cpu_time=cpu_time, steps=steps)
        message.pace, message.instants, message.late, message.worst_lateness = pace
        self.add(self.timing, time_ns, message.SerializeToString())

    def _add(self, channel_id: int, time_ns: int, data: bytes, sequence: int) -> None:
        with self._lock:
            if not self._open:
                self._refuse()
            if time_ns < self._time:
                raise ValueError(f"a message at {time_ns} ns after one at {self._time} ns")
            positions = self._positions[channel_id]
            chunk = self._chunk
            length = _MESSAGE_HEADER + len(data)
            if 9 + length > LARGEST_CHUNK:
                topic = self._summary.channels[channel_id - 1].topic
                raise OutputError(
                    f"cannot write the log {self.path}: a message of {len(data):,} bytes on {topic} is larger than "
                    f"{LARGEST_CHUNK:,}, the most that a log holds in one"
                )
            if chunk and len(chunk) + 9 + length > CHUNK_SIZE:
                self._end_chunk()
            try:
                record = _MESSAGE.pack(5, length, channel_id, sequence, time_ns, time_ns) + data
            except struct.error as error:
                raise ValueError(f"message {sequence} at {time_ns} ns is out of range") from error
            if not chunk:
                self._chunk_start = time_ns
            positions += (time_ns, len(chunk))
            chunk += record
            self._time = time_ns

    def flush(self) -> None:
        """End the chunk and hand it to the operating system, from where it survives the death of this process.

        Raises:
            LogError: It cannot be written.
        """
        with self._lock:
            if not self._open:
                self._refuse()
            self._end_chunk()

    def captured(self) -> dict[str, Any]:
        """Where the log stands: what was written before goes to the operating system.

        Raises:
            LogError: It cannot be written.
        """
        with self._lock:
            self.flush()
            summary = self._summary
            self._marks[self.size, self._checksum] = summary.copied(), self._time
            names = {schema.id: name for name, schema in summary.schemas.items()}
            channels = [[each.topic, names[each.schema_id], each.metadata] for each in summary.channels]
            return {
                "position": [self.size, self._checksum],
                "time": self._time,
                "sequence": self._sequence,
                "channels": channels,
            }

    def check_state(self, state: dict[str, Any]) -> None:
        """See `restored`.

        Raises:
            StateError: The log cannot go on from there.
        """
        if tuple(state["position"]) not in self._marks and self._time > state["time"]:
            raise StateError(
                f"the log {self.path} is at {self._time / 1e9:g} s, and cannot go back to {state['time'] / 1e9:g} s: "
                "the state was not taken while it was written"
            )

    def restored(self, state: dict[str, Any]) -> None:
        """Go on where a log stood: in this one by forgetting what came after it, in another one behind what it has.

        Raises:
            LogError: It cannot be written.
        """
        with self._lock:
            position = tuple(state["position"])
            if position in self._marks:
                self._go_back(*position)
            for topic, name, metadata in state["channels"][len(self._summary.channels) :]:
                self.channel(topic, name, metadata)
            self._sequence = state["sequence"]

    def _go_back(self, size: int, checksum: int) -> None:
        """Forget what was added after a mark."""
        if not self._open:
            self._refuse()
        summary, self._time = self._marks[size, checksum]
        self._marks = {mark: each for mark, each in self._marks.items() if mark[0] <= size}
        self._summary = summary.copied()
        self._chunk.clear()
        self._positions = {channel.id: [] for channel in summary.channels}
        self.size, self._checksum = size, checksum
        try:
            self._file.truncate(size)
            self._file.seek(size)
        except OSError as error:
            self._fail(error)

    def flush_in_background(self) -> None:
        """Flush every `flush_interval` from now on, until the log is closed.

        A thread does it, because nothing else comes by while a component takes a turn of many seconds; what was
        added before such a turn must not die with it.
        """
        threading.Thread(target=self._keep_flushing, name="symaware-log", daemon=True).start()

    def _keep_flushing(self) -> None:
        while not self._closed.wait(self._flush_interval):
            # An error is kept: the next message that is added tells it.
            with self._lock, contextlib.suppress(LogError):
                if self._open:
                    self._end_chunk()

    def finish(self, outcome: Mapping[str, Any]) -> None:
        """End the run: write its outcome and the summary, and close the file.

        Args:
            outcome: How the run ended; values that JSON can hold.

        Raises:
            LogError: It cannot be written.
        """
        with self._lock:
            self.flush()
            self.metadata(OUTCOME, json_values(outcome))
            self.close()

    def close(self) -> None:
        """Close the log without an outcome, or with one that `metadata` was given.

        Raises:
            LogError: It cannot be written.
        """
        with self._lock:
            self.flush()
            self._close()

    def abort(self) -> None:
        """Close the log without an outcome, keeping all that was added if it can be kept.

        Never raises: there is an error on its way already that must not be hidden.
        """
        with self._lock:
            if self._open:
                with contextlib.suppress(LogError):
                    self._end_chunk()
                    self._close()

    def __enter__(self) -> "LogWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.abort()

    def _end_chunk(self) -> None:
        """Write the chunk, if there is one, and the index of its messages."""
        if not self._chunk:
            return
        data = bytes(self._chunk)
        compressed = self._compressor.compress(data)
        chunk = Chunk(
            compression="zstd",
            data=compressed,
            message_start_time=self._chunk_start,
            message_end_time=self._time,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        records, index = indexed(chunk, self.size, self._positions)
        self._write(records)
        self._summary.add_chunk(
            index, {number: len(positions) // 2 for number, positions in self._positions.items() if positions}
        )
        for positions in self._positions.values():
            positions.clear()
        self._chunk.clear()

    def _close(self) -> None:
        """Write what stands behind the messages and close the file."""
        self._write_record(DataEnd(data_section_crc=0))
        self._write(self._summary.serialise(self.size))
        self._open = False
        self._closed.set()
        try:
            self._file.close()
        except OSError as error:  # a network file system may say only now that it kept nothing
            self._error = OutputError(f"the log {self.path} may be incomplete: {reason(error)}")
            raise self._error from error

    def _write_record(self, record: McapRecord) -> int:
        """Write a record and return its length in bytes."""
        data = serialise(record)
        self._write(data)
        return len(data)

    def _write(self, data: bytes | bytearray) -> None:
        """Hand all of it to the operating system: the only place that does."""
        if not self._open:
            self._refuse()
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) or 0 :]
            self.size += len(data)
            self._checksum = zlib.crc32(data, self._checksum)
        except OSError as error:
            self._fail(error)
        except BaseException:
            # Interrupted half-way: as if it had not begun, so that abort() can do it again.
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise

    def _fail(self, error: OSError) -> None:
        """Give up after a failed write: leave whole records only, close the file, and say so once."""
        self._open = False
        self._closed.set()
        self._chunk.clear()
        # If these fail as well, the first error is still the one to tell, and a reader copes with half a record.
        with contextlib.suppress(OSError):
            self._file.truncate(self.size)
        with contextlib.suppress(OSError):
            self._file.close()
        self._error = OutputError(
            f"cannot write the log {self.path}: {reason(error)}; what was written before ({self.size:,} bytes) stays "
            "readable"
        )
        raise self._error from error

    def _refuse(self) -> None:
        raise self._error or OutputError(f"the log {self.path} is closed")
