"""Awareness messages: beliefs of rows about others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.wire import (
    BYTES,
    FLOAT,
    INDEX,
    TIME,
    array_of,
    indices_of,
    message_fields,
    packed,
    rows_field,
    text_field,
    varint,
)
from symaware_cli.world import record


@record
class OthersSeries:
    """The series, such as intents, that rows hold of others: for each row in the message, all series of a part.

    Attributes:
        part: The part of awareness.
        rows: (m,) indices, or None for all.
        lengths: (m,) number of series of each row.
        entities: (sum,) roster indices of the others, row after row.
        columns: (sum,) number of columns of each series.
        points: (sum,) number of points of each series.
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
        """Yield for each series: position of its row, roster index of the other, times (k,), values (k, columns)."""
        places = np.repeat(np.arange(len(self.lengths)), self.lengths).tolist()
        columns, points = self.columns.tolist(), self.points.tolist()
        point = number = 0
        for place, other, width, count in zip(places, self.entities.tolist(), columns, points, strict=True):
            values = self.values[number : number + width * count].reshape(count, width)
            yield place, other, self.times[point : point + count], values
            point, number = point + count, number + width * count


@record
class KnownOthers:
    """Beliefs about others in columns, one entry for each row and other.

    Attributes:
        present: (p,) the rows of the group that the message is about, ascending.
        counts: (p,) the number of entries of each.
        rows: (m,) the row of each entry.
        entities: (m,) the roster index of the other.
        ages: (m,) since the other was last perceived [s].
        sizes: (m,) the number of values of the other.
        values: (m, width); NaN where an other has fewer values.
        covariances: (m, width, width) of the values; NaN where they are unknown. None if the message has none.
    """

    present: NDArray[np.int64]
    counts: NDArray[np.int64]
    rows: NDArray[np.int64]
    entities: NDArray[np.int64]
    ages: NDArray[np.float64]
    sizes: NDArray[np.int64]
    values: NDArray[np.float64]
    covariances: NDArray[np.float64] | None


@record
class Awareness:
    """The beliefs of each row about others.

    Attributes:
        world: Whether all rows know the whole world; the other fields are then empty.
        rows: (m,) indices, or None for all.
        lengths: (m,) number of others known to each row, or (1,) for all.
        entities: (sum,) roster indices of the others, row after row.
        columns: (sum,) number of values of each entity, or (1,) for all.
        values: flat, entity after entity.
        covariances: flat, a matrix of columns x columns for each entity, or empty.
        ages: (sum,) s since each was last perceived, or empty.
        series: Beliefs about parts of awareness other than the state.
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
    def has_states(self) -> bool:
        """Whether it holds beliefs about the states of others."""
        return self.world or len(self.lengths) > 0

    def others(self, count: int, width: int | None = None, wanted: ArrayLike | None = None) -> KnownOthers:
        """Return the beliefs in columns; there are no entries for rows that know the whole world.

        Args:
            count: Number of rows of the group.
            width: Number of values of each other, further ones are left out; None for the greatest number.
            wanted: The rows whose entries are returned; None for all.

        Raises:
            ValueError: The message is inconsistent.
        """
        lengths = self.lengths.astype(np.int64)
        if self.world or len(lengths) == 1:
            number = count if self.rows is None else len(self.rows)
            lengths = np.full(number, 0 if self.world else lengths[0])
        present = np.arange(len(lengths)) if self.rows is None or not len(lengths) else self.rows.astype(np.int64)
        known = len(self.entities)
        if len(present) != len(lengths) or lengths.sum() != known:
            raise ValueError(f"{known} others of {len(present)} rows, where {lengths.sum()} were announced")
        sizes = np.broadcast_to(self.columns.astype(np.int64), known) if known else np.empty(0, np.int64)
        if sizes.sum() != len(self.values):
            raise ValueError(f"{len(self.values)} numbers, where {sizes.sum()} were announced")
        if len(self.covariances) not in (0, (sizes**2).sum()):
            raise ValueError(f"{len(self.covariances)} covariances, where {(sizes**2).sum()} were announced")
        rows = np.repeat(present, lengths)
        some = np.arange(known) if wanted is None else np.flatnonzero(np.isin(rows, wanted))
        width = int(sizes.max(initial=0)) if width is None else width
        column = np.arange(width)
        inside = column < sizes[some, None]
        values = np.full((len(some), width), np.nan)
        values[inside] = self.values[((np.cumsum(sizes) - sizes)[some, None] + column)[inside]]
        covariances = None
        if len(self.covariances):
            covariances = np.full((len(some), width, width), np.nan)
            both = inside[:, :, None] & inside[:, None, :]
            inner = sizes[some, None, None] * column[:, None] + column
            covariances[both] = self.covariances[((np.cumsum(sizes**2) - sizes**2)[some, None, None] + inner)[both]]
            # All zeros mean that the covariance is unknown, if the message has covariances of others.
            covariances[~np.nan_to_num(covariances).any(axis=(1, 2))] = np.nan
        ages = self.ages[some] if len(self.ages) else np.zeros(len(some))
        return KnownOthers(
            present=present,
            counts=lengths,
            rows=rows[some],
            entities=self.entities[some].astype(np.int64),
            ages=ages,
            sizes=sizes[some],
            values=values,
            covariances=covariances,
        )


WHOLE_WORLD = b"\x08\x01"
"""The `Awareness` message of a group whose agents know the whole world exactly."""


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
        lengths: (m,) number of others known to each row.
        entities: (sum of lengths,) roster indices of the others, row after row.
        columns: Number of values of an entity: one for all, or (sum of lengths,).
        values: The believed states, entity after entity; any shape.
        rows: (m,) indices, or None for all.
        covariances: Of those states, entity after entity; any shape, or empty.
        ages: (sum of lengths,) s since each was last perceived, or empty.

    Raises:
        ValueError: The shapes are inconsistent.
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
            rows_field(2, rows, len(lengths)),
            packed(3, lengths, INDEX),
            packed(4, entities, INDEX),
            packed(5, sizes, INDEX),
            packed(6, table, FLOAT),
            packed(7, spread, FLOAT),
            packed(8, since, FLOAT),
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
    """Encode the series part of an `Awareness` message, to be appended to its other fields; see `OthersSeries`.

    Raises:
        ValueError: The shapes are inconsistent.
    """
    known, sizes, counts = np.size(entities), np.asarray(columns, np.int64), np.asarray(points, np.int64)
    if np.sum(lengths) != known or len(sizes) != known or len(counts) != known:
        raise ValueError(f"{np.sum(lengths)} series are announced, {known} named, {len(counts)} of a length")
    if np.size(times) != counts.sum() or np.size(values) != (sizes * counts).sum():
        raise ValueError(f"{(sizes * counts).sum()} numbers were announced, {np.size(values)} given")
    content = b"".join(
        (
            text_field(1, part),
            rows_field(2, rows, np.size(lengths)),
            packed(3, lengths, INDEX),
            packed(4, entities, INDEX),
            packed(5, sizes, INDEX),
            packed(6, counts, INDEX),
            packed(7, times, TIME),
            packed(8, values, FLOAT),
        )
    )
    return bytes((9 << 3 | BYTES,)) + varint(len(content)) + content


def decode_awareness(data: bytes) -> Awareness:
    """Decode an `Awareness` message."""
    fields = message_fields(data, v1.Awareness, several=9)
    lengths, entities, columns = (array_of(fields, number, INDEX) for number in (3, 4, 5))
    values, covariances, ages = (array_of(fields, number, FLOAT) for number in (6, 7, 8))
    series = tuple(_others_series(each) for each in fields.get(9, ()))
    world = bool(fields.get(1, 0))
    return Awareness(world, indices_of(fields, 2), lengths, entities, columns, values, covariances, ages, series)


def _others_series(data: bytes | memoryview | v1.OthersSeries) -> OthersSeries:
    content = data.SerializeToString() if isinstance(data, v1.OthersSeries) else data
    fields = message_fields(content, v1.OthersSeries, first=BYTES)
    lengths, entities, columns, points = (array_of(fields, number, INDEX) for number in (3, 4, 5, 6))
    part = fields.get(1, "")
    part = part if isinstance(part, str) else bytes(part).decode()
    times, values = array_of(fields, 7, TIME), array_of(fields, 8, FLOAT)
    return OthersSeries(part, indices_of(fields, 2), lengths, entities, columns, points, times, values)
