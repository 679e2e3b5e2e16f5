"""The big messages of a log, encoded and decoded without a Python object per number.

A packed `repeated double` is the array's little-endian bytes behind a tag and a length, so an array is written with
one copy and read with none. What is written here is, byte for byte, what the generated classes write; a message that
somebody else laid out differently is read with the generated class.

Rows are indices in a group, ascending; `None` stands for every row in order.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.recording import symaware_v1_pb2 as v1

_FLOAT = np.dtype("<f8")
_INDEX = np.dtype("<u4")
_TIME = np.dtype("<i8")
_VARINT = 0
_BYTES = 2


@dataclass(frozen=True, slots=True)
class Rows:
    """A value for each row.

    Attributes:
        rows: (m,) indices, or None for all.
        values: (m, columns).
    """

    rows: NDArray[np.uint32] | None
    values: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SeriesRows:
    """A time series for each row.

    Attributes:
        rows: (m,) indices, or None for all.
        lengths: (m,) points per row, or (1,) for all.
        times: ns; (lengths[0],) if the rows share them, otherwise (sum of lengths,).
        values: (points, columns), one row's series after another.
    """

    rows: NDArray[np.uint32] | None
    lengths: NDArray[np.uint32]
    times: NDArray[np.int64]
    values: NDArray[np.float64]

    def __iter__(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield the times (k,) and values (k, columns) of each row."""
        if len(self.lengths) == 1:
            length = int(self.lengths[0])
            # A series without points says nothing of how many rows share it, unless they are listed.
            count = len(self.values) // length if length else len(self.rows) if self.rows is not None else 0
            for row in range(count):
                yield self.times, self.values[row * length : (row + 1) * length]
            return
        ends = np.cumsum(self.lengths, dtype=np.int64).tolist()
        for start, end in zip([0, *ends], ends, strict=False):
            yield self.times[start:end], self.values[start:end]

    def at(self, place: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The times (k,) and values (k, columns) of one row, by its place among those in the message."""
        if len(self.lengths) == 1:
            length = int(self.lengths[0])
            return self.times, self.values[place * length : (place + 1) * length]
        start, end = (int(self.lengths[:count].sum(dtype=np.int64)) for count in (place, place + 1))
        return self.times[start:end], self.values[start:end]


@dataclass(frozen=True, slots=True)
class OthersSeries:
    """The intents, uncertainties or risks that rows hold of others: all of them, for each row that is there.

    Attributes:
        part: Which part of awareness.
        rows: (m,) indices, or None for all.
        lengths: (m,) others of whom each row holds a series.
        entities: (sum,) indices in the roster, one row's after another.
        columns: (sum,) numbers per point of each series.
        points: (sum,) points of each series.
        times: ns; series after series.
        values: flat, series after series.
    """

    part: str
    rows: NDArray[np.uint32] | None
    lengths: NDArray[np.uint32]
    entities: NDArray[np.uint32]
    columns: NDArray[np.uint32]
    points: NDArray[np.uint32]
    times: NDArray[np.int64]
    values: NDArray[np.float64]

    def __iter__(self) -> Iterator[tuple[int, int, NDArray[np.int64], NDArray[np.float64]]]:
        """Yield for each series the place of its row, whom it is about, its times (k,) and values (k, columns)."""
        places = np.repeat(np.arange(len(self.lengths)), self.lengths).tolist()
        columns, points = self.columns.tolist(), self.points.tolist()
        point = number = 0
        for place, other, width, count in zip(places, self.entities.tolist(), columns, points, strict=True):
            values = self.values[number : number + width * count].reshape(count, width)
            yield place, other, self.times[point : point + count], values
            point, number = point + count, number + width * count


@dataclass(frozen=True, slots=True)
class Awareness:
    """What each row knows of others.

    Attributes:
        world: Everyone knows the whole world; the rest is empty then.
        rows: (m,) indices, or None for all.
        lengths: (m,) others known per row, or (1,) for all.
        entities: (sum,) indices in the roster, one row's after another.
        columns: (sum,) numbers per entity, or (1,) for all.
        values: flat, entity after entity.
        covariances: flat, a matrix of columns x columns for each entity, or empty.
        ages: (sum,) s since each was last seen, or empty.
        series: What they know of other parts of awareness than the state.
    """

    world: bool
    rows: NDArray[np.uint32] | None
    lengths: NDArray[np.uint32]
    entities: NDArray[np.uint32]
    columns: NDArray[np.uint32]
    values: NDArray[np.float64]
    covariances: NDArray[np.float64]
    ages: NDArray[np.float64]
    series: tuple[OthersSeries, ...] = ()

    @property
    def tells_states(self) -> bool:
        """Whether it says anything of where others are."""
        return self.world or len(self.lengths) > 0


def encode_rows(values: ArrayLike, rows: ArrayLike | None = None) -> bytes:
    """Encode a `Rows` message.

    Args:
        values: (m, columns).
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes do not fit.
    """
    table = _table(values)
    return b"".join((_count(1, table.shape[1]), _rows(2, rows, len(table)), _packed(3, table, _FLOAT)))


def encode_series(
    times: ArrayLike, values: ArrayLike, lengths: ArrayLike | None = None, rows: ArrayLike | None = None
) -> bytes:
    """Encode a `SeriesRows` message.

    Args:
        times: ns; (k,) shared by all rows, or (sum of lengths,) one row's after another.
        values: (m, k, columns), or (sum of lengths, columns) if the rows have times of their own.
        lengths: (m,) points of each row, or None if the rows share the times.
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes do not fit.
    """
    table = np.asarray(values)
    points = np.shape(times)
    if lengths is None:
        if table.ndim != 3 or points != (table.shape[1],):
            raise ValueError(f"values must be (rows, points, columns); got {table.shape} with times {points}")
        count = len(table)
        lengths = points
    else:
        count = len(np.asarray(lengths))
        if table.ndim != 2 or points != (len(table),) or np.sum(lengths) != len(table):
            raise ValueError(f"values must be (points, columns); got {table.shape} with times {points}")
    return b"".join(
        (
            _count(1, table.shape[-1]),
            _rows(2, rows, count),
            _packed(3, lengths, _INDEX),
            _packed(4, times, _TIME),
            _packed(5, table, _FLOAT),
        )
    )


WHOLE_WORLD = b"\x08\x01"
"""The `Awareness` message of a group whose agents know the whole world as it is."""


def encode_awareness(
    lengths: ArrayLike,
    entities: ArrayLike,
    columns: ArrayLike,
    values: ArrayLike,
    rows: ArrayLike | None = None,
    *,
    covariances: ArrayLike = (),
    ages: ArrayLike = (),
) -> bytes:
    """Encode an `Awareness` message; see also `WHOLE_WORLD`.

    Args:
        lengths: (m,) how many others each row knows.
        entities: (sum of lengths,) who, as indices in the roster, one row's after another.
        columns: Numbers per known entity: one for all of them, or (sum of lengths,).
        values: Their believed states, entity after entity; any shape.
        rows: (m,) indices, or None for all.
        covariances: Of those states, entity after entity; any shape, or empty.
        ages: (sum of lengths,) s since each was last seen, or empty.

    Raises:
        ValueError: The shapes do not fit.
    """
    lengths, sizes, table = np.atleast_1d(lengths), np.atleast_1d(columns), np.asarray(values)
    known = len(np.atleast_1d(entities))
    if lengths.sum() != known or len(sizes) not in (1, known):
        raise ValueError(f"{lengths.sum()} others are known, {known} are named, {len(sizes)} sizes are given")
    sizes_each = sizes if len(sizes) == known else np.repeat(sizes, known)
    numbers, squares = int(sizes_each.sum()), int((sizes_each.astype(np.int64) ** 2).sum())
    if table.size != numbers:
        raise ValueError(f"{numbers} numbers were announced, {table.size} given")
    spread, since = np.asarray(covariances), np.asarray(ages)
    if spread.size not in (0, squares) or since.size not in (0, known):
        raise ValueError(f"{squares} covariances and {known} ages were announced, {spread.size} and {since.size} given")
    return b"".join(
        (
            _rows(2, rows, len(lengths)),
            _packed(3, lengths, _INDEX),
            _packed(4, entities, _INDEX),
            _packed(5, sizes, _INDEX),
            _packed(6, table, _FLOAT),
            _packed(7, spread, _FLOAT),
            _packed(8, since, _FLOAT),
        )
    )


def encode_others_series(
    part: str,
    lengths: ArrayLike,
    entities: ArrayLike,
    columns: ArrayLike,
    points: ArrayLike,
    times: ArrayLike,
    values: ArrayLike,
    rows: ArrayLike | None = None,
) -> bytes:
    """Encode what an `Awareness` message says of a part that is a series, behind the rest of it; see `OthersSeries`.

    Raises:
        ValueError: The shapes do not fit.
    """
    known, sizes, counts = np.size(entities), np.asarray(columns, np.int64), np.asarray(points, np.int64)
    if np.sum(lengths) != known or len(sizes) != known or len(counts) != known:
        raise ValueError(f"{np.sum(lengths)} series are announced, {known} named, {len(counts)} of a length")
    if np.size(times) != counts.sum() or np.size(values) != (sizes * counts).sum():
        raise ValueError(f"{(sizes * counts).sum()} numbers were announced, {np.size(values)} given")
    content = b"".join(
        (
            _text(1, part),
            _rows(2, rows, np.size(lengths)),
            _packed(3, lengths, _INDEX),
            _packed(4, entities, _INDEX),
            _packed(5, sizes, _INDEX),
            _packed(6, counts, _INDEX),
            _packed(7, times, _TIME),
            _packed(8, values, _FLOAT),
        )
    )
    return bytes((9 << 3 | _BYTES,)) + _varint(len(content)) + content


def encode_message_columns(
    senders: ArrayLike,
    receivers: ArrayLike,
    sequences: ArrayLike,
    reason: ArrayLike | None = None,
    says: ArrayLike | None = None,
    sizes: ArrayLike | None = None,
    rows: ArrayLike | None = None,
) -> bytes:
    """Encode the long columns of a `MessageColumns` message; the rest of it may stand before or behind them.

    Args:
        senders: (m,) indices in the roster.
        receivers: (m,) indices in the roster.
        sequences: (m,) the number of each among those of its sender.
        reason: (m,) indices in the message's `reasons`; None if nothing was dropped.
        says: (s,) who says something, as indices in the roster; None if that is not repeated.
        sizes: (m,) bytes; None if all are the same.
        rows: (m,) places in `says`; None if nobody says several things.
    """
    return b"".join(
        (
            _packed(5, senders, _INDEX),
            _packed(6, receivers, _INDEX),
            _packed(7, sequences, _INDEX),
            b"" if reason is None else _packed(9, reason, _INDEX),
            b"" if says is None else _packed(10, says, _INDEX),
            b"" if sizes is None else _packed(12, sizes, _INDEX),
            b"" if rows is None else _packed(13, rows, _INDEX),
        )
    )


def decode_rows(data: bytes) -> Rows:
    """Decode a `Rows` message; its arrays are read-only views of the data where that is possible."""
    fields = _fields(data)
    if fields is None:
        message = v1.Rows.FromString(data)
        fields = {1: message.columns, 2: message.rows, 3: message.values}
    columns = fields.get(1, 0)
    return Rows(_indices(fields, 2), _array(fields, 3, _FLOAT, columns))


def decode_series(data: bytes) -> SeriesRows:
    """Decode a `SeriesRows` message."""
    fields = _fields(data)
    if fields is None:
        message = v1.SeriesRows.FromString(data)
        fields = {1: message.columns, 2: message.rows, 3: message.lengths, 4: message.times, 5: message.values}
    return SeriesRows(
        _indices(fields, 2),
        _array(fields, 3, _INDEX),
        _array(fields, 4, _TIME),
        _array(fields, 5, _FLOAT, fields.get(1, 0)),
    )


def decode_awareness(data: bytes) -> Awareness:
    """Decode an `Awareness` message."""
    fields = _fields(data, several=9)
    if fields is None:
        message = v1.Awareness.FromString(data)
        fields = {1: message.world, 2: message.rows, 3: message.lengths}
        fields |= {4: message.entities, 5: message.columns, 6: message.values}
        fields |= {7: message.covariances, 8: message.ages}
        fields[9] = [each.SerializeToString() for each in message.series]
    lengths, entities, columns = (_array(fields, number, _INDEX) for number in (3, 4, 5))
    values, covariances, ages = (_array(fields, number, _FLOAT) for number in (6, 7, 8))
    series = tuple(_others_series(each) for each in fields.get(9, ()))
    world = bool(fields.get(1, 0))
    return Awareness(world, _indices(fields, 2), lengths, entities, columns, values, covariances, ages, series)


def _others_series(data: bytes | memoryview) -> OthersSeries:
    fields = _fields(data, first=_BYTES)
    if fields is None:
        message = v1.OthersSeries.FromString(bytes(data))
        fields = {1: message.part.encode(), 2: message.rows, 3: message.lengths, 4: message.entities}
        fields |= {5: message.columns, 6: message.points, 7: message.times, 8: message.values}
    lengths, entities, columns, points = (_array(fields, number, _INDEX) for number in (3, 4, 5, 6))
    part = bytes(fields.get(1, b"")).decode()
    times, values = _array(fields, 7, _TIME), _array(fields, 8, _FLOAT)
    return OthersSeries(part, _indices(fields, 2), lengths, entities, columns, points, times, values)


def _table(values: ArrayLike) -> NDArray[Any]:
    table = np.asarray(values)
    if table.ndim != 2:
        raise ValueError(f"values must be (rows, columns); got {table.shape}")
    return table


def _varint(number: int) -> bytes:
    if number < 0x80:
        return bytes((number,))
    out = bytearray()
    while number >= 0x80:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


def _count(field: int, number: int) -> bytes:
    """A varint field; absent if it is 0, as proto3 wants it."""
    return bytes((field << 3 | _VARINT,)) + _varint(number) if number else b""


def _text(field: int, text: str) -> bytes:
    data = text.encode()
    return bytes((field << 3 | _BYTES,)) + _varint(len(data)) + data


def _packed(field: int, values: ArrayLike, dtype: np.dtype[Any]) -> bytes:
    """A packed field of fixed width; absent if it is empty."""
    data = np.asarray(values, dtype).tobytes()
    return bytes((field << 3 | _BYTES,)) + _varint(len(data)) + data if data else b""


def _rows(field: int, rows: ArrayLike | None, count: int) -> bytes:
    if rows is None:
        return b""
    if np.shape(rows) != (count,):
        raise ValueError(f"{count} rows of values for the rows {rows}")
    return _packed(field, rows, _INDEX)


def _fields(data: bytes | memoryview, first: int = _VARINT, several: int = 0) -> dict[int, Any] | None:
    """Split a message: field number -> integer, or a view of the bytes of a packed field.

    Args:
        data: The message.
        first: How the first field is laid out; every other one is packed.
        several: A field that may come several times, whose value is a list; 0 for none.

    None if it is not laid out as above (a field comes twice, is not packed, or has a type unknown here).
    """
    fields: dict[int, Any] = {}
    view = memoryview(data)
    position, end = 0, len(data)
    try:
        while position < end:
            tag = data[position]
            number, shift, position = 0, 0, position + 1
            while True:
                byte = data[position]
                position += 1
                number |= (byte & 0x7F) << shift
                if byte < 0x80:
                    break
                shift += 7
            field, kind = tag >> 3, tag & 7
            if tag >= 0x80 or (field in fields and field != several) or kind != (first if field == 1 else _BYTES):
                return None
            if kind == _VARINT:
                fields[field] = number
            elif position + number > end:
                return None
            else:
                content = view[position : position + number]
                if field == several:
                    fields.setdefault(field, []).append(content)
                else:
                    fields[field] = content
                position += number
    except IndexError:
        return None
    return fields


def _array(fields: dict[int, Any], field: int, dtype: np.dtype[Any], columns: int | None = None) -> NDArray[Any]:
    """The array in a field, flat, or (rows, columns) if it has columns."""
    content = fields.get(field, b"")
    flat = np.frombuffer(content, dtype) if isinstance(content, bytes | memoryview) else np.array(content, dtype)
    if columns is None:
        return flat
    if not columns:
        return flat.reshape(0, 0)
    return flat.reshape(-1, columns)


def _indices(fields: dict[int, Any], field: int) -> NDArray[np.uint32] | None:
    rows = _array(fields, field, _INDEX)
    return rows if len(rows) else None
