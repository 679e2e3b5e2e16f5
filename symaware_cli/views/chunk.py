"""Chunks: intervals of a log, short enough for memory, with the values of each channel in columns."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import LogError, LogMessage, single, wire

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: Size of the messages at which a chunk ends, after the current instant [bytes].
CHUNK_SIZE = 4 << 20

#: If few of many rows change, frames need more memory than messages; this is the maximum ratio.
_FRAMES_TO_MESSAGES = 8


@dataclass(frozen=True)
class Frames:
    """Values of all rows of a group at some instants; rows that a message omits keep their values.

    Attributes:
        times: (k,) simulated time [ns]; empty if nothing was recorded.
        values: (k, n, columns); NaN before the first value of a row, and for an agent that has left.
        before: (n, columns) the values before the first instant; NaN if unknown.
    """

    times: Times
    values: Array
    before: Array

    def at(self, times: Times) -> Array:
        """Return the values valid at other instants; (len(times), n, columns), NaN where unknown."""
        return self.of(times, slice(None))

    def of(self, times: Times, rows: NDArray[np.intp] | int | slice) -> Array:
        """Return the values of some rows valid at other instants, one instant per row; (len(times), columns)."""
        known = np.concatenate([self.before[None], self.values])
        return known[np.searchsorted(self.times, times, side="right"), rows]


@dataclass(frozen=True)
class SeriesFrames:
    """A series of each row of a group at some instants; rows that a message omits keep their series.

    Attributes:
        times: (k,) simulated time of each message [ns].
        lengths: (k, n) number of points of each row's series.
        values: (sum of lengths, columns), concatenated series.
        before: (n, columns) the first points of the series before the first instant; NaN if unknown.
    """

    times: Times
    lengths: NDArray[np.int64]
    values: Array
    before: Array

    @cached_property
    def firsts(self) -> Frames:
        """The first point of each series; NaN for an empty series."""
        values = _first_points(self.lengths.ravel(), self.values).reshape(*self.lengths.shape, self.values.shape[1])
        return Frames(self.times, values, self.before)


@dataclass(frozen=True)
class Chunk:
    """An interval of a log.

    Attributes:
        frames: States and control inputs, by topic; a topic is missing until its first message.
        strips: Intents, uncertainties and risks, by topic; a topic is missing until its first message.
        entries: All other SymAware messages, by topic: time and decoded content.
        start: The first instant [ns].
        end: The last instant [ns].
    """

    frames: Mapping[str, Frames]
    strips: Mapping[str, SeriesFrames]
    entries: Mapping[str, list[tuple[int, Any]]]
    start: int
    end: int


class ChunkReader:
    """Groups messages into chunks."""

    def __init__(self, counts: Mapping[str, int], places: Mapping[str, tuple[str, int]] | None = None) -> None:
        """Create an empty reader.

        Args:
            counts: Number of rows of each topic, where known.
            places: Group and row of each agent, by id; needed to process agents that leave.
        """
        self._counts = counts
        self._places = places or {}
        self._tables: dict[str, _Table] = {}
        self._series: dict[str, _Series] = {}
        self._entries: defaultdict[str, list[tuple[int, Any]]] = defaultdict(list)
        self._size = 0
        self._start: int | None = None
        #: The instant of the last message [ns].
        self.end = 0

    @property
    def empty(self) -> bool:
        """Whether no message was added since the last chunk."""
        return self._start is None

    @property
    def is_full(self) -> bool:
        """Whether the chunk has reached its maximum size."""
        return self._size >= CHUNK_SIZE

    def chunks(self, messages: Iterable[LogMessage], size: int = CHUNK_SIZE) -> Iterator[Chunk]:
        """Group messages, ordered by time, into chunks; an instant is never split."""
        for message in messages:
            if self._size >= size and message.time > self.end:
                yield self.drain()
            self.take_message(message)
        if self._start is not None:
            yield self.drain()

    def take_message(self, message: LogMessage) -> None:
        """Add a message of a log; messages of shared channels are split by entity."""
        for each in single(message):
            self.take(each.channel.topic, each.time, each.decode(), len(each.data))

    def take(self, topic: str, time: int, content: Any, size: int = 0) -> None:
        """Add a message.

        Args:
            topic: Its topic.
            time: Simulated time [ns].
            content: The decoded message.
            size: Its serialised size [bytes].
        """
        match content:
            case wire.Rows():
                size = max(size, self._take(topic, time, content.rows, content.values) // _FRAMES_TO_MESSAGES)
            case wire.SeriesRows():
                series = self._series.get(topic)
                if series is None:
                    series = self._series[topic] = _Series(self._counts.get(topic, 0))
                self._require_rows(topic, content.rows)
                if len(content.lengths):
                    series.take(time, content)
            case _:
                self._entries[topic].append((time, content))
                self.note(time, content)
        self._size += size
        self._start = time if self._start is None else self._start
        self.end = time

    def note(self, time: int, content: Any) -> None:
        """Discard the values of an agent if the message is the event of its removal."""
        if getattr(content, "name", None) != "removed":
            return
        group, row = self._places.get(content.source.removeprefix("agents."), (None, 0))
        tables: Iterable[tuple[str, _Table | _Series]] = (*self._tables.items(), *self._series.items())
        for topic, known in tables:
            if topic.split("/")[2] == group:
                known.forget(time, row)

    def drain(self) -> Chunk:
        """Return the messages added since the last call as a chunk."""
        chunk = Chunk(
            {topic: table.drain() for topic, table in self._tables.items()},
            {topic: series.drain() for topic, series in self._series.items()},
            dict(self._entries),
            self._start or 0,
            self.end,
        )
        self._entries.clear()
        self._size, self._start = 0, None
        return chunk

    def _take(self, topic: str, time: int, rows: NDArray[np.uint32] | None, values: Array) -> int:
        """Add values of some rows, and return their memory size [bytes]."""
        if not values.size:
            return 0
        self._require_rows(topic, rows)
        table = self._tables.get(topic)
        if table is None:
            count = self._counts.get(topic) or (len(values) if rows is None else int(rows[-1]) + 1)
            table = self._tables[topic] = _Table(count, values.shape[1])
        try:
            table.take(time, rows, values)
        except (ValueError, IndexError) as error:
            raise LogError(f"the messages on {topic} do not fit together: {error}") from error
        return table.frame_size

    def _require_rows(self, topic: str, rows: NDArray[np.uint32] | None) -> None:
        count = self._counts.get(topic)
        if count is not None and rows is not None and rows[-1] >= count:
            raise LogError(f"the messages on {topic} do not fit together: row {rows[-1]} of a group of {count}")


class _Table:
    """Accumulates a value of each row."""

    def __init__(self, count: int, columns: int) -> None:
        self._times: list[int] = []
        self._frames: list[Array] = []
        self._before = np.full((count, columns), np.nan)
        self._last = self._before

    @property
    def frame_size(self) -> int:
        """Memory size of the values of all rows [bytes]."""
        return self._last.nbytes

    def take(self, time: int, rows: NDArray[np.uint32] | None, values: Array) -> None:
        if rows is None and values.shape == self._last.shape:
            frame = values
        else:
            frame = self._last.copy()
            frame[slice(len(values)) if rows is None else rows] = values
        if self._times and self._times[-1] == time:
            self._frames[-1] = frame
        else:
            self._times.append(time)
            self._frames.append(frame)
        self._last = frame

    def forget(self, time: int, row: int) -> None:
        values = self._last.copy()
        values[row] = np.nan
        self.take(time, None, values)

    def drain(self) -> Frames:
        values = np.stack(self._frames) if self._frames else np.empty((0, *self._before.shape))
        frames = Frames(np.array(self._times, np.int64), values, self._before)
        # A copy: the frame may be a view of a message, or of a whole chunk.
        self._before = self._last = self._last.copy()
        self._times, self._frames = [], []
        return frames


class _Series:
    """Accumulates a time series of each row."""

    def __init__(self, count: int) -> None:
        self.times: list[int] = []
        self._count = count
        self._columns = 0
        self._lengths: list[NDArray[np.int64]] = []
        self._values: list[Array] = []
        #: The series at the end of the last chunk.
        self._held: tuple[NDArray[np.int64], Array] | None = None

    def take(self, time: int, message: wire.SeriesRows) -> None:
        columns = message.values.shape[1]
        self._columns = max(self._columns, columns)
        if message.rows is None and len(message.lengths) == 1 and message.lengths[0]:
            # The common case: all rows have series of the same length.
            length = int(message.lengths[0])
            count = len(message.values) // length
            lengths, values = np.full(count, length), message.values[: count * length]
            self._count = max(self._count, count)
        else:
            lengths, values = self._merged(message)
        if self.times and self.times[-1] == time:
            self._lengths[-1], self._values[-1] = lengths, values
        else:
            self.times.append(time)
            self._lengths.append(lengths)
            self._values.append(values)

    def forget(self, time: int, row: int) -> None:
        rows = np.array([row], np.uint32)
        nothing = np.empty((0, self._columns))
        self.take(time, wire.SeriesRows(rows, np.zeros(1, np.uint32), np.empty(0, np.int64), nothing))

    def _merged(self, message: wire.SeriesRows) -> tuple[NDArray[np.int64], Array]:
        """Return the series of all rows; those that the message omits are unchanged."""
        series = [values for _, values in message]
        if message.rows is None and not series:
            # An empty series does not determine how many rows share it: assume all.
            series = [message.values] * self._count
        rows = range(len(series)) if message.rows is None else message.rows.tolist()
        self._count = max([self._count, *(row + 1 for row in rows)])
        held: list[Array] = [np.empty((0, self._columns))] * self._count
        known = (self._lengths[-1], self._values[-1]) if self._lengths else self._held
        if known:
            ends = np.cumsum(known[0])
            for row, (length, end) in enumerate(zip(known[0].tolist(), ends.tolist(), strict=True)):
                held[row] = known[1][end - length : end]
        for row, values in zip(rows, series, strict=True):
            held[row] = values
        held = [_padded(values, self._columns) for values in held]
        lengths = np.array([len(values) for values in held], np.int64)
        return lengths, np.concatenate([np.empty((0, self._columns)), *held])

    def drain(self) -> SeriesFrames:
        before = np.full((self._count, self._columns), np.nan)
        if self._held:
            firsts = _first_points(*self._held)
            before[: len(firsts), : firsts.shape[1]] = firsts
        lengths = np.zeros((len(self.times), self._count), np.int64)
        for place, known in enumerate(self._lengths):
            lengths[place, : len(known)] = known
        values = [np.empty((0, self._columns)), *(_padded(values, self._columns) for values in self._values)]
        series = SeriesFrames(np.array(self.times, np.int64), lengths, np.concatenate(values), before)
        if self.times:
            # A copy: the values may be a view of a message, or of a whole chunk.
            self._held = self._lengths[-1], self._values[-1].copy()
        self.times, self._lengths, self._values = [], [], []
        return series


def _first_points(lengths: NDArray[np.int64], values: Array) -> Array:
    """Return the first point of each series, NaN for an empty one; (len(lengths), columns)."""
    firsts, some = np.full((len(lengths), values.shape[1]), np.nan), lengths > 0
    firsts[some] = values[(np.cumsum(lengths) - lengths)[some]]
    return firsts


def _padded(values: Array, columns: int) -> Array:
    """Extend points to at least the given number of columns, filled with NaN."""
    if values.shape[1] == columns:
        return values
    wider = np.full((len(values), columns), np.nan)
    wider[:, : values.shape[1]] = values
    return wider
