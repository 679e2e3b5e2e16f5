"""Protects rows of a group from its group components: those of agents that are stopped or whose component is frozen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.column import Column, SeriesColumn
from symaware_cli.awareness.table_column import TableColumn
from symaware_cli.awareness.time_series import TimeSeries
from symaware_cli.core import AgentGroup, Tracks
from symaware_cli.world.time import SECOND


@contextmanager
def protected(group: AgentGroup, rows: Sequence[int]) -> Iterator[None]:
    """Restore, on exit, all parts of awareness and the control inputs of some agents.

    A group component works on arrays with a row for each agent, whether or not the agent still takes part. Arrays are
    never written in place, so the earlier values need no copy.

    Args:
        group: The group.
        rows: The rows to restore, ascending.
    """
    if not rows:
        yield
        return
    awareness, chosen = group.awareness, list(rows)
    written = [group.control_column, *awareness.columns.values()]
    columns = [(column, column.values) for column in written if isinstance(column, Column)]
    series = [
        (column, None if column.is_unwritten else {row: column.row(row) for row in chosen})
        for column in written
        if isinstance(column, SeriesColumn)
    ]
    tables = [(column, column.tables) for column in written if isinstance(column, TableColumn)]
    seen, received = awareness.seen, awareness.received
    yield
    for column, before in columns:
        if column.values is not before and column.values[chosen].tobytes() != before[chosen].tobytes():
            column.restore(chosen, before)
    for series_column, own in series:
        if not series_column.is_unwritten:
            series_column.put_back(dict.fromkeys(chosen, TimeSeries()) if own is None else own)
    for table_column, tables_before in tables:
        for row in chosen:
            if table_column.row(row) is not tables_before[row]:
                table_column.set_row(row, tables_before[row])
    held = np.zeros(len(group), bool)
    held[chosen] = True
    if awareness.seen is not None and awareness.seen is not seen:
        awareness.seen = _merged(awareness.seen, seen, held)
    if awareness.received is not None and awareness.received is not received:
        awareness.received = _merged(awareness.received, received, held)


def _merged(tracks: Tracks, before: Tracks | None, held: NDArray[np.bool_]) -> Tracks:
    """The earlier tracks of some observers, and the present tracks of all others."""
    then = tracks.select(np.zeros(len(tracks), bool)) if before is None else before.select(held[before.observers])
    now = tracks.select(~held[tracks.observers])
    since = (tracks.time - then.time) / SECOND
    observers = np.concatenate([now.observers, then.observers])
    order = np.argsort(observers, kind="stable")
    covariances = None
    if any(len(each) and each.covariances is not None for each in (now, then)):
        # If only one of the two has covariances, the other is filled with zeros.
        size = 2 * tracks.positions.shape[1]
        parts = [
            np.zeros((len(each), size, size)) if each.covariances is None else each.covariances for each in (now, then)
        ]
        covariances = np.concatenate(parts)[order]
    return Tracks.of(
        tracks.time,
        len(held),
        observers[order],
        np.concatenate([now.others, then.others])[order],
        np.concatenate([now.positions, then.positions])[order],
        np.concatenate([now.velocities, then.velocities])[order],
        covariances=covariances,
        ages=np.concatenate([now.ages, then.ages + since])[order],
    )
