"""The log writer.

It writes MCAP records itself, with the record classes of `mcap` but without `mcap.writer.Writer`: this gives control
over chunks (maximum size, flush on demand, a new chunk before a large message rather than after it), costs 1 us instead
of 4 us per message, and outputs every byte in one place, where failures are handled.
"""

import contextlib
import io
import os
import stat
import struct
import threading
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar

import zstandard
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, MetadataIndex, Schema

from symaware_cli.core.stateful import StateError
from symaware_cli.engine import PaceFigures
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.error import LogError, OutputError, reason
from symaware_cli.log.log_schema import (
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
from symaware_cli.log.log_summary import LogSummary, indexed, serialise
from symaware_cli.log.output import note_output

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode 5, length, channel, sequence, log time, publish time
_MESSAGE_HEADER = _MESSAGE.size - 9

Message = tuple[int, bytes]
"""The id of the channel and the serialised content of a message."""

MessageWatch = Callable[[str, int, bytes], object]
"""A function that is called with the topic, the time [ns] and the data of each message."""


class LogWriter:
    """Writes a log.

    Messages are collected in a chunk, which is compressed and handed to the operating system when it is full or
    flushed; data that were handed over survive the process. Attachments, metadata and channels are handed over
    immediately.

    As a context manager, it aborts the log on exit, unless the log was finished before.

    Args:
        path: The file, which is replaced.
        flush_interval: Wall time between two flushes by `flush_in_background`, in s.
        on_message: Called with the topic, the time and the data of each message, except those of /timing.
        goes_back: Whether this log itself can be resumed at captured states; other logs always can.

    Raises:
        OutputError: The file cannot be created.

    Attributes:
        path: The file.
        size: Number of bytes handed to the operating system so far.
        timing: The id of the channel /timing, which always exists.
    """

    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        flush_interval: float = 0.5,
        on_message: MessageWatch | None = None,
        goes_back: bool = True,
    ) -> None:
        self.path = Path(path)
        self.size = 0
        self._flush_interval = flush_interval
        self._on_message = on_message
        self._goes_back = goes_back
        self._error: LogError | None = None
        # Level -1 takes half the time of level 1; logs of a thousand agents are 6 % larger, those of a few are not.
        self._compressor = zstandard.ZstdCompressor(level=-1)

        self._chunk = bytearray()
        self._chunk_start = 0
        self._time = 0
        self._sequence = 0
        self._timing_sequence = 0
        # For each channel id a flat list with time and offset of each message in the chunk.
        self._positions: dict[int, list[int]] = {}

        self._summary = LogSummary()
        #: Snapshots of the summary where states were captured, by size and checksum: the log can be resumed there.
        self._marks: dict[tuple[int, int], tuple[LogSummary, int]] = {}
        self._checksum = 0

        try:
            self._file = _opened_alone(self.path)  # closed by finish, abort and _fail
        except BlockingIOError:
            raise OutputError(f"cannot create the log {self.path}: another run is writing it") from None
        except OSError as error:
            raise OutputError(f"cannot create the log {self.path}: {reason(error)}") from error
        self._open = True
        # `flush_in_background` may flush from another thread while a message is being added.
        self._lock = threading.RLock()
        self._closed = threading.Event()
        # Without a version, so that equal runs write equal logs; versions are a separate attachment.
        self._write(MAGIC + serialise(Header(profile=PROFILE, library=LIBRARY)))
        # Opened first, so that its id does not depend on when timing is first recorded.
        self.timing = self.channel(
            TIMING, "Timing", {"columns": "wall_time,cpu_time,steps", "units": "s,s,1", "deterministic": "false"}
        )

    @property
    def sequence(self) -> int:
        """The sequence number of the next message, except for timing messages."""
        return self._sequence

    @property
    def messages(self) -> int:
        """Number of messages added so far."""
        return sum(self._summary.counts.values()) + sum(map(len, self._positions.values())) // 2

    @property
    def channels(self) -> Mapping[str, int]:
        """The ids of the channels that are open, by topic."""
        return {channel.topic: channel.id for channel in self._summary.channels}

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment.

        Args:
            name: Its name in the log, such as `scenario/hello.yaml`.
            media_type: Its media type, such as `application/json`.
            data: Its content.

        Raises:
            LogError: The log cannot be written.
        """
        offset = self.size
        attachment = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        self._summary.add_attachment(attachment, offset, self._write_record(attachment))

    def metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record.

        Args:
            name: Its name.
            data: Its content, in the order in which it is written.

        Raises:
            LogError: The log cannot be written.
        """
        offset = self.size
        length = self._write_record(Metadata(name=name, metadata=dict(data)))
        self._summary.metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def channel(self, topic: str, message_name: str, metadata: Mapping[str, str] | None = None) -> int:
        """Open a channel.

        Args:
            topic: The topic, such as `/agents/robot/state`.
            message_name: Its message type in schemas/symaware/v1/log.proto, such as `Rows`.
            metadata: Metadata for readers, such as the columns and their units.

        Returns:
            The id of the channel, for `add`.

        Raises:
            LogError: The log cannot be written.
            KeyError: The message type does not exist.
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
        # Written outside of chunks, so that a damaged chunk loses only its messages.
        self._write_record(channel)
        self._summary.channels.append(channel)
        self._positions[channel.id] = []
        return channel.id

    def add(self, channel_id: int, time_ns: int, data: bytes) -> None:
        """Add a message.

        Args:
            channel_id: The id that `channel` returned.
            time_ns: Simulated time in ns, not before that of the previous message: logs are read in one pass.
            data: The serialised message.

        Raises:
            LogError: A full chunk could not be written, or the message exceeds the maximum size.
            KeyError: The channel does not exist.
            ValueError: The time is negative or before that of the previous message, or the log has 2^32 messages.
        """
        self.add_all(time_ns, ((channel_id, data),))

    def add_all(self, time_ns: int, messages: Sequence[Message]) -> None:
        """Add messages of one instant, in order; see `add`."""
        with self._lock:
            if not self._open:
                self._refuse()
            if time_ns < self._time:
                raise ValueError(f"a message at {time_ns} ns after one at {self._time} ns")
            chunk, timing, watch = self._chunk, self.timing, self._on_message
            for channel_id, data in messages:
                positions = self._positions[channel_id]
                length = _MESSAGE_HEADER + len(data)
                if len(chunk) + 9 + length > CHUNK_SIZE:
                    self._make_room(channel_id, len(data))
                # Numbered separately, so that they do not shift the sequence numbers of other messages.
                sequence = self._timing_sequence if channel_id == timing else self._sequence
                try:
                    head = _MESSAGE.pack(5, length, channel_id, sequence, time_ns, time_ns)
                except struct.error as error:
                    raise ValueError(f"message {sequence} at {time_ns} ns is out of range") from error
                if not chunk:
                    self._chunk_start = time_ns
                positions += (time_ns, len(chunk))
                chunk += head + data
                self._time = time_ns
                if channel_id == timing:
                    self._timing_sequence += 1
                    continue
                self._sequence += 1
        if watch is not None:
            for channel_id, data in messages:
                if channel_id != timing:
                    watch(self._summary.channels[channel_id - 1].topic, time_ns, data)

    def _make_room(self, channel_id: int, size: int) -> None:
        """End the chunk, as a message of a size [bytes] does not fit into it; a large message has one of its own."""
        if 9 + _MESSAGE_HEADER + size > LARGEST_CHUNK:
            topic = self._summary.channels[channel_id - 1].topic
            raise OutputError(
                f"cannot write the log {self.path}: a message of {size:,} bytes on {topic} is larger than "
                f"{LARGEST_CHUNK:,}, the most that a log holds in one"
            )
        self._end_chunk()

    def add_timing(
        self, time_ns: int, *, wall_time: float, cpu_time: float, steps: int, pace: PaceFigures = (0.0, 0, 0, 0.0)
    ) -> None:
        """Add a message about wall time to /timing.

        Args:
            time_ns: Simulated time in ns.
            wall_time: Wall time since the start of the run, in s.
            cpu_time: Processor time used by the process, in s.
            steps: Number of steps completed.
            pace: The requested simulated seconds per second of wall time, the number of paced instants, the number of
                those that began late, and the greatest lateness, in s of wall time.
        """
        message = v1.Timing(wall_time=wall_time, cpu_time=cpu_time, steps=steps)
        message.pace, message.instants, message.late, message.worst_lateness = pace
        self.add(self.timing, time_ns, message.SerializeToString())

    def flush(self) -> None:
        """End the chunk and hand it to the operating system, so that it survives the process.

        Raises:
            LogError: The log cannot be written.
        """
        with self._lock:
            if not self._open:
                self._refuse()
            self._end_chunk()

    def captured(self) -> dict[str, Any]:
        """Capture the position in the log, after flushing.

        Raises:
            LogError: The log cannot be written.
        """
        with self._lock:
            self.flush()
            summary = self._summary
            if self._goes_back:
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
        """Check that `restored` can resume from a state.

        Raises:
            StateError: The log cannot be resumed from it.
        """
        if tuple(state["position"]) not in self._marks and self._time > state["time"]:
            raise StateError(
                f"the log {self.path} is at {self._time / 1e9:g} s, and cannot go back to {state['time'] / 1e9:g} s: "
                "the state was not taken while it was written"
            )

    def restored(self, state: dict[str, Any]) -> None:
        """Resume from a captured position: in the same log by discarding what follows, in another one by appending.

        Raises:
            LogError: The log cannot be written.
        """
        with self._lock:
            position = tuple(state["position"])
            if position in self._marks:
                self._go_back(*position)
            for topic, name, metadata in state["channels"][len(self._summary.channels) :]:
                self.channel(topic, name, metadata)
            self._sequence = state["sequence"]

    def _go_back(self, size: int, checksum: int) -> None:
        """Discard the messages after a captured position."""
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

        A thread does it, since the main thread may be busy with the turn of a component for many seconds; messages
        added before that turn must not be lost with the process.
        """
        threading.Thread(target=self._keep_flushing, name="symaware-log", daemon=True).start()

    def _keep_flushing(self) -> None:
        while not self._closed.wait(self._flush_interval):
            # An error is stored, and raised when the next message is added.
            with self._lock, contextlib.suppress(LogError):
                if self._open:
                    self._end_chunk()

    def finish(self, outcome: Mapping[str, Any]) -> None:
        """End the run: write its outcome and the summary, and close the file.

        Args:
            outcome: How the run ended; values that JSON can represent.

        Raises:
            LogError: The log cannot be written.
        """
        with self._lock:
            self.flush()
            self.metadata(OUTCOME, json_values(outcome))
            self.close()
        note_output(self.path)

    def close(self) -> None:
        """Close the log without an outcome, or with one that was written by `metadata`.

        Raises:
            LogError: The log cannot be written.
        """
        with self._lock:
            self.flush()
            self._close()

    def abort(self) -> None:
        """Close the log without an outcome, keeping all messages if possible.

        Never raises: it is called while another error is propagating, which must not be hidden.
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
        """Write the chunk, unless it is empty, and its message index."""
        if not self._chunk:
            return
        data = self._chunk
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(data),
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
        """Write the records that follow the messages, and close the file."""
        self._write_record(DataEnd(data_section_crc=0))
        self._write(self._summary.serialise(self.size))
        self._open = False
        self._closed.set()
        try:
            self._file.close()
        except OSError as error:  # a network file system may report a failed write only now
            self._error = OutputError(f"the log {self.path} may be incomplete: {reason(error)}")
            raise self._error from error

    def _write_record(self, record: McapRecord) -> int:
        """Write a record and return its length in bytes."""
        data = serialise(record)
        self._write(data)
        return len(data)

    def _write(self, data: bytes | bytearray) -> None:
        """Hand all data to the operating system; the only place that does."""
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
            # Interrupted half-way: undo the partial write, so that abort() can repeat it.
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise

    def _fail(self, error: OSError) -> None:
        """Handle a failed write: truncate to whole records, close the file, and raise the error once."""
        self._open = False
        self._closed.set()
        self._chunk.clear()
        # If these fail as well, the first error is still the relevant one, and readers handle a partial record.
        with contextlib.suppress(OSError):
            self._file.truncate(self.size)
        with contextlib.suppress(OSError):
            self._file.close()
        self._error = OutputError(
            f"cannot write the log {self.path}: {reason(error)}; the data written before ({self.size:,} bytes) stay "
            "readable"
        )
        raise self._error from error

    def _refuse(self) -> None:
        raise self._error or OutputError(f"the log {self.path} is closed")


def _opened_alone(path: Path) -> io.FileIO:
    """Open a file for writing, emptied, and keep others from doing so until it is closed.

    Raises:
        BlockingIOError: Another writer has it; it stays as it is.
        OSError: It cannot be opened.
    """
    import fcntl

    # Not emptied by opening it: another writer may be at work on it.
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
    file = io.FileIO(descriptor, "wb")
    try:
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise
            except OSError:
                pass  # a file system without locks
            file.truncate(0)
    except BaseException:
        file.close()
        raise
    return file
