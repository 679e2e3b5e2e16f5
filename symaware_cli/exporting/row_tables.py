"""Tables of arrays: what each agent of a group had at each instant, laid out without a loop over agents."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.exporting.table import Names, Table, Values
from symaware_cli.recording import symaware_v1_pb2 as v1
from symaware_cli.recording import wire

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Piece:
    """The rows of a table that a message amounts to.

    Attributes:
        present: (k,) of whom the message speaks, as rows of the group.
        who: (m,) whose each row of the table is, ascending.
        numbers: (m, columns) numbers.
        index: (m,) a whole number for each row of the table, such as that of a point; None if the table has none.
    """

    present: Indices
    who: Indices
    numbers: Array
    index: Indices | None = None

    def only(self, kept: NDArray[np.bool_]) -> Piece:
        """Leave out rows of the table."""
        index = None if self.index is None else self.index[kept]
        return Piece(self.present, self.who[kept], self.numbers[kept], index)


@dataclass(frozen=True)
class RowSource:
    """Makes a table of the messages of a channel.

    Attributes:
        table: Its columns are the time, who, the index if there is one, and numbers.
        ids: The agents, by row.
        lay_out: Makes a piece of a message and the number of agents.
        index_names: What the index stands for, if it stands for names.
        chosen: (n,) which agents are wanted; None for all.
        growth: How many times as large as its messages the table is in memory, roughly.
    """

    table: Table
    ids: Sequence[str]
    lay_out: Callable[[Any, int], Piece]
    index_names: Sequence[str] | None = None
    chosen: NDArray[np.bool_] | None = None
    growth: int = 1

    def convert(self, entries: Sequence[tuple[int, Any]]) -> list[Values]:
        """Make rows of messages.

        Args:
            entries: Time [ns] and content of each message, in order; no instant may continue in a later call.

        Raises:
            ValueError: A message does not fit the group, or itself.
        """
        instants = np.array([time for time, _ in entries], np.int64)
        pieces = [self._piece(message) for _, message in entries]
        repeated = bool((np.diff(instants) == 0).any())
        if repeated:
            _leave_out_revised(instants, pieces)
        times = np.repeat(instants, [len(piece.who) for piece in pieces])
        who = np.concatenate([piece.who for piece in pieces])
        numbers = np.concatenate([piece.numbers for piece in pieces])
        indices = [piece.index for piece in pieces if piece.index is not None]
        index = np.concatenate(indices) if indices else None
        if repeated:
            order = np.lexsort((who, times))
            times, who, numbers = times[order], who[order], numbers[order]
            index = None if index is None else index[order]
        values: list[Values] = [times / 1e9, Names(who.astype(np.int32), self.ids)]
        if index is not None:
            names = self.index_names
            values.append(index if names is None else Names(index.astype(np.int32), names))
        return [*values, *np.ascontiguousarray(numbers.T)]

    def _piece(self, message: Any) -> Piece:
        piece = self.lay_out(message, len(self.ids))
        if piece.present.max(initial=-1) >= len(self.ids):
            raise ValueError(f"row {piece.present.max()} of a group of {len(self.ids)}")
        known = self.index_names
        if known is not None and piece.index is not None and piece.index.max(initial=-1) >= len(known):
            raise ValueError(f"entity {piece.index.max()} of {len(known)}")
        return piece if self.chosen is None else piece.only(self.chosen[piece.who])


def _leave_out_revised(instants: Indices, pieces: list[Piece]) -> None:
    """Of what is said of one agent at one instant more than once, leave the last."""
    said = np.empty(0, np.int64)
    for place in range(len(pieces) - 2, -1, -1):
        if instants[place] != instants[place + 1]:
            said = said[:0]
            continue
        said = np.union1d(said, pieces[place + 1].present)
        pieces[place] = pieces[place].only(~np.isin(pieces[place].who, said))


def lay_out_rows(message: wire.Rows, count: int, *, width: int) -> Piece:
    """Lay out states: a row for each agent."""
    who = _present(message.rows, len(message.values))
    return Piece(who, who, _widened(message.values, width))


def lay_out_series(message: wire.SeriesRows, count: int, *, width: int) -> Piece:
    """Lay out time series: a row for each point; one without a value for a series without points.

    The numbers are the time of the point and its values.
    """
    lengths, times = message.lengths.astype(np.int64), message.times
    if len(lengths) == 1:
        each = int(lengths[0])
        agents = len(message.values) // each if each else count if message.rows is None else len(message.rows)
        lengths, times = np.full(agents, each), np.tile(times, agents) if len(times) == each else times
    present = _present(message.rows, len(lengths))
    who, point, filled = _spread(present, lengths, len(message.values))
    numbers = np.full((len(who), 1 + width), np.nan)
    numbers[filled, 0] = times / 1e9
    numbers[filled, 1:] = _widened(message.values, width)
    return Piece(present, who, numbers, point)


def lay_out_tables(message: wire.TableRows, count: int, *, width: int) -> Piece:
    """Lay out tables: a row for each entry; one without a value for a table without entries."""
    present = _present(message.rows, len(message.lengths))
    who, entry, filled = _spread(present, message.lengths.astype(np.int64), len(message.values))
    numbers = np.full((len(who), width), np.nan)
    numbers[filled] = _widened(message.values, width)
    return Piece(present, who, numbers, entry)


def lay_out_awareness(message: wire.Awareness, count: int, *, width: int, covariances: bool) -> Piece:
    """Lay out beliefs about others: a row for each other; one without a name for who knows nobody.

    The numbers are the age, the values, and the covariance row by row. Who knows the whole world has no row.
    """
    columns = 1 + width + (width * width if covariances else 0)
    nobody = np.empty(0, np.int64)
    if not message.has_states:
        return Piece(nobody, nobody, np.empty((0, columns)), nobody)
    if message.world:
        return Piece(_present(message.rows, count), nobody, np.empty((0, columns)), nobody)
    lengths = message.lengths.astype(np.int64)
    if len(lengths) == 1:
        lengths = np.full(count if message.rows is None else len(message.rows), lengths[0])
    present = _present(message.rows, len(lengths))
    who, _, filled = _spread(present, lengths, len(message.entities))
    others = np.full(len(who), -1, np.int64)
    others[filled] = message.entities
    numbers = np.full((len(who), columns), np.nan)
    numbers[filled, 0] = message.ages if len(message.ages) else 0.0
    # Others may be known by more or fewer numbers each.
    sizes = np.broadcast_to(message.columns.astype(np.int64), len(message.entities))
    inside = np.arange(width) < sizes[:, None]
    values = np.full(inside.shape, np.nan)
    values[inside] = message.values
    numbers[filled, 1 : 1 + width] = values
    if covariances and len(message.covariances):
        squares = inside[:, :, None] & inside[:, None, :]
        spread = np.full(squares.shape, np.nan)
        spread[squares] = message.covariances
        # Zeros stand for nothing where the message says something of others.
        spread[~np.nan_to_num(spread).any(axis=(1, 2))] = np.nan
        numbers[filled, 1 + width :] = spread.reshape(len(spread), -1)
    return Piece(present, who, numbers, others)


def lay_out_scan(message: v1.Scan, count: int) -> Piece:
    """Lay out scans: a row for each ray.

    The numbers are the time that was measured, the angle and the distance of the ray, and the pose of the sensor.
    """
    rays = len(message.angles)
    rows = np.array(message.rows, np.uint32) if len(message.rows) else None
    poses = np.array(message.poses).reshape(-1, 4)
    present = _present(rows, len(poses))
    distances = np.array(message.distances, float).reshape(len(poses), rays)
    measured = np.full(distances.size, message.measured / 1e9)
    angles = np.tile(np.array(message.angles), len(poses))
    numbers = np.column_stack([measured, angles, distances.ravel(), np.repeat(poses, rays, axis=0)])
    return Piece(present, np.repeat(present, rays), numbers, np.tile(np.arange(rays), len(poses)))


def _present(rows: NDArray[np.uint32] | None, count: int) -> Indices:
    """The rows that a message speaks of."""
    if rows is None or not count:
        return np.arange(count)
    if len(rows) != count:
        raise ValueError(f"values for {count} of the rows {rows}")
    return rows.astype(np.int64)


def _spread(present: Indices, lengths: Indices, total: int) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """Give each agent as many rows of a table as it has entries, and one if it has none.

    Returns:
        For each row of the table whose it is, its number among that one's, and whether there is an entry.
    """
    if lengths.sum() != total:
        raise ValueError(f"{total} entries, where {lengths.sum()} were announced")
    rows = np.maximum(lengths, 1)
    starts = np.cumsum(rows) - rows
    number = np.arange(rows.sum()) - np.repeat(starts, rows)
    return np.repeat(present, rows), number, np.repeat(lengths > 0, rows)


def _widened(values: Array, width: int) -> Array:
    """The values with that many columns, NaN where they had none."""
    if values.shape[1] == width:
        return values
    if values.shape[1] > width:
        raise ValueError(f"{values.shape[1]} columns, where {width} were announced")
    wider = np.full((len(values), width), np.nan)
    wider[:, : values.shape[1]] = values
    return wider
