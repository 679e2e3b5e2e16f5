"""Messages with a value, a time series or a table for each row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.recording import symaware_v1_pb2 as v1
from symaware_cli.recording.wire.packing import (
    FLOAT,
    INDEX,
    TIME,
    array_of,
    fields_of,
    indices_of,
    number_field,
    packed,
    rows_field,
    table_of,
)


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
        lengths: (m,) number of points of each row, or (1,) for all.
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
            # An empty series does not determine how many rows share it, unless the rows are listed.
            count = len(self.values) // length if length else len(self.rows) if self.rows is not None else 0
            for row in range(count):
                yield self.times, self.values[row * length : (row + 1) * length]
            return
        ends = np.cumsum(self.lengths, dtype=np.int64).tolist()
        for start, end in zip([0, *ends], ends, strict=False):
            yield self.times[start:end], self.values[start:end]

    def at(self, place: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the times (k,) and values (k, columns) of the row at a position in the message."""
        if len(self.lengths) == 1:
            length = int(self.lengths[0])
            return self.times, self.values[place * length : (place + 1) * length]
        start, end = (int(self.lengths[:count].sum(dtype=np.int64)) for count in (place, place + 1))
        return self.times[start:end], self.values[start:end]


@dataclass(frozen=True, slots=True)
class TableRows:
    """A table for each row.

    Attributes:
        rows: (m,) indices, or None for all.
        lengths: (m,) number of entries of each row.
        values: (entries, columns), one row's entries after another.
        values: (entries, columns), one row's entries after another.
    """

    rows: NDArray[np.uint32] | None
    lengths: NDArray[np.uint32]
    values: NDArray[np.float64]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield the entries (k, columns) of each row."""
        ends = np.cumsum(self.lengths, dtype=np.int64).tolist()
        for start, end in zip([0, *ends], ends, strict=False):
            yield self.values[start:end]

    def at(self, place: int) -> NDArray[np.float64]:
        """Return the entries (k, columns) of the row at a position in the message."""
        start, end = (int(self.lengths[:count].sum(dtype=np.int64)) for count in (place, place + 1))
        return self.values[start:end]


def encode_rows(values: ArrayLike, rows: ArrayLike | None = None) -> bytes:
    """Encode a `Rows` message.

    Args:
        values: (m, columns).
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes are inconsistent.
    """
    table = table_of(values)
    return b"".join((number_field(1, table.shape[1]), rows_field(2, rows, len(table)), packed(3, table, FLOAT)))


def encode_series(
    times: ArrayLike, values: ArrayLike, lengths: ArrayLike | None = None, rows: ArrayLike | None = None
) -> bytes:
    """Encode a `SeriesRows` message.

    Args:
        times: ns; (k,) shared by all rows, or (sum of lengths,) one row's after another.
        values: (m, k, columns), or (sum of lengths, columns) if the rows have separate times.
        lengths: (m,) number of points of each row, or None if the rows share the times.
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes are inconsistent.
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
            number_field(1, table.shape[-1]),
            rows_field(2, rows, count),
            packed(3, lengths, INDEX),
            packed(4, times, TIME),
            packed(5, table, FLOAT),
        )
    )


def encode_tables(values: ArrayLike, lengths: ArrayLike, rows: ArrayLike | None = None) -> bytes:
    """Encode a `TableRows` message.

    Args:
        values: (sum of lengths, columns), one row's entries after another.
        lengths: (m,) number of entries of each row.
        rows: (m,) indices, or None for all.

    Raises:
        ValueError: The shapes are inconsistent.
    """
    table = table_of(values)
    if np.sum(lengths) != len(table):
        raise ValueError(f"{np.sum(lengths)} entries are announced, {len(table)} given")
    return b"".join(
        (
            number_field(1, table.shape[1]),
            rows_field(2, rows, np.size(lengths)),
            packed(3, lengths, INDEX),
            packed(4, table, FLOAT),
        )
    )


def decode_rows(data: bytes) -> Rows:
    """Decode a `Rows` message; its arrays are read-only views of the data where possible."""
    fields = fields_of(data)
    if fields is None:
        message = v1.Rows.FromString(data)
        fields = {1: message.columns, 2: message.rows, 3: message.values}
    columns = fields.get(1, 0)
    return Rows(indices_of(fields, 2), array_of(fields, 3, FLOAT, columns))


def decode_series(data: bytes) -> SeriesRows:
    """Decode a `SeriesRows` message."""
    fields = fields_of(data)
    if fields is None:
        message = v1.SeriesRows.FromString(data)
        fields = {1: message.columns, 2: message.rows, 3: message.lengths, 4: message.times, 5: message.values}
    return SeriesRows(
        indices_of(fields, 2),
        array_of(fields, 3, INDEX),
        array_of(fields, 4, TIME),
        array_of(fields, 5, FLOAT, fields.get(1, 0)),
    )


def decode_tables(data: bytes) -> TableRows:
    """Decode a `TableRows` message."""
    fields = fields_of(data)
    if fields is None:
        message = v1.TableRows.FromString(data)
        fields = {1: message.columns, 2: message.rows, 3: message.lengths, 4: message.values}
    return TableRows(indices_of(fields, 2), array_of(fields, 3, INDEX), array_of(fields, 4, FLOAT, fields.get(1, 0)))
