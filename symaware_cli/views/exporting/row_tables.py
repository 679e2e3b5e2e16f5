"""Export tables of arrays: values of each agent of a group at each instant, converted without a loop over agents."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.views.exporting.table import Names, Table, Values

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Piece:
    """The rows of a table that result from a message.

    Attributes:
        present: (k,) rows of the group in the message.
        who: (m,) row of the group for each row of the table, ascending.
        numbers: (m, columns) numbers.
        index: (m,) an integer for each row of the table, such as the number of a point; None if the table has none.
    """

    present: Indices
    who: Indices
    numbers: Array
    index: Indices | None = None

    def only(self, kept: NDArray[np.bool_]) -> Piece:
        """Return the rows of the table where `kept` is true."""
        index = None if self.index is None else self.index[kept]
        return Piece(self.present, self.who[kept], self.numbers[kept], index)


@dataclass(frozen=True)
class RowSource:
    """Converts the messages of a channel to a table of arrays.

    Attributes:
        table: The table; its columns are time, agent, optional index, and numbers.
        ids: The agents, by row.
        lay_out: Converts a message to a piece, given the number of agents.
        index_names: The names that the index refers to, if any.
        chosen: (n,) the selected agents; None for all.
        growth: Approximate ratio of the size of the table in memory to that of its messages.
    """

    table: Table
    ids: Sequence[str]
    lay_out: Callable[[Any, int], Piece]
    index_names: Sequence[str] | None = None
    chosen: NDArray[np.bool_] | None = None
    growth: int = 1

    def convert(self, entries: Sequence[tuple[int, Any]]) -> list[Values]:
        """Convert messages to rows.

        Args:
            entries: Time [ns] and content of each message, in order; all messages of an instant are in the same call.

        Raises:
            ValueError: A message is inconsistent, or does not fit the group.
        """
        instants = np.array([time for time, _ in entries], np.int64)
        pieces = [self._piece(message) for _, message in entries]
        repeated = bool((np.diff(instants) == 0).any())
        if repeated:
            _keep_latest(instants, pieces)
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


def _keep_latest(instants: Indices, pieces: list[Piece]) -> None:
    """If an agent has several messages at the same instant, keep only the rows of the last."""
    said = np.empty(0, np.int64)
    for place in range(len(pieces) - 2, -1, -1):
        if instants[place] != instants[place + 1]:
            said = said[:0]
            continue
        said = np.union1d(said, pieces[place + 1].present)
        pieces[place] = pieces[place].only(~np.isin(pieces[place].who, said))


def lay_out_rows(message: wire.Rows, count: int, *, width: int) -> Piece:
    """Convert values: a row for each agent."""
    who = _present(message.rows, len(message.values))
    return Piece(who, who, _widened(message.values, width))


def lay_out_series(message: wire.SeriesRows, count: int, *, width: int) -> Piece:
    """Convert time series: a row for each point; an empty series has one row without a value.

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
    """Convert tables: a row for each entry; an empty table has one row without a value."""
    present = _present(message.rows, len(message.lengths))
    who, entry, filled = _spread(present, message.lengths.astype(np.int64), len(message.values))
    numbers = np.full((len(who), width), np.nan)
    numbers[filled] = _widened(message.values, width)
    return Piece(present, who, numbers, entry)


def lay_out_awareness(message: others_message.Awareness, count: int, *, width: int, covariances: bool) -> Piece:
    """Convert beliefs about others: a row for each other agent; one without a name for an agent that knows no other.

    The numbers are the age, the values, and the covariance by rows. An agent that knows the whole world has no row.
    """
    columns = 1 + width + (width * width if covariances else 0)
    if not message.has_states or message.world:
        nobody = np.empty(0, np.int64)
        present = _present(message.rows, count) if message.world else nobody
        return Piece(present, nobody, np.empty((0, columns)), nobody)
    known = message.others(count, width)
    who, _, filled = _spread(known.present, known.counts, len(known.entities))
    others = np.full(len(who), -1, np.int64)
    others[filled] = known.entities
    numbers = np.full((len(who), columns), np.nan)
    numbers[filled, 0] = known.ages
    numbers[filled, 1 : 1 + width] = known.values
    if known.covariances is not None and covariances:
        numbers[filled, 1 + width :] = known.covariances.reshape(-1, width * width)
    return Piece(known.present, who, numbers, others)


def lay_out_scan(message: v1.Scan, count: int) -> Piece:
    """Convert scans: a row for each ray.

    The numbers are the time of measurement, the angle and the distance of the ray, and the pose of the sensor.
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
    """Return the rows of the group in a message."""
    if rows is None or not count:
        return np.arange(count)
    if len(rows) != count:
        raise ValueError(f"values for {count} of the rows {rows}")
    return rows.astype(np.int64)


def _spread(present: Indices, lengths: Indices, total: int) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """Give each agent as many rows of a table as it has entries, and one if it has none.

    Returns:
        For each row of the table: the row of the group, the number of the entry, and whether there is an entry.
    """
    if lengths.sum() != total:
        raise ValueError(f"{total} entries, where {lengths.sum()} were announced")
    rows = np.maximum(lengths, 1)
    starts = np.cumsum(rows) - rows
    number = np.arange(rows.sum()) - np.repeat(starts, rows)
    return np.repeat(present, rows), number, np.repeat(lengths > 0, rows)


def _widened(values: Array, width: int) -> Array:
    """Extend values to the given number of columns, filled with NaN."""
    if values.shape[1] == width:
        return values
    if values.shape[1] > width:
        raise ValueError(f"{values.shape[1]} columns, where {width} were announced")
    wider = np.full((len(values), width), np.nan)
    wider[:, : values.shape[1]] = values
    return wider
