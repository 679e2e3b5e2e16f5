"""Protects rows of a group from its group components: those of agents that are stopped or whose component is frozen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import Column, SeriesColumn, TableColumn, joined_covariances
from symaware_cli.core import AgentGroup, Tracks
from symaware_cli.world import SECOND


class ProtectedRows:
    """A context that restores, on exit, all parts of awareness and the control inputs of some agents.

    A group component works on arrays with a row for each agent, whether or not the agent still takes part. Arrays are
    never written in place, so the earlier values need no copy. Nothing is restored after an exception. The context can
    be used many times, but not within itself.
    """

    def __init__(self, group: AgentGroup, rows: Sequence[int]) -> None:
        """Prepare.

        Args:
            group: The group.
            rows: The rows to restore, ascending.
        """
        self._awareness, self._chosen = group.awareness, list(rows)
        first, count = self._chosen[0], len(self._chosen)
        is_run = self._chosen[-1] - first + 1 == count
        # NumPy copies a slice in a fraction of the time that a list of indices takes.
        self._index = slice(first, first + count) if is_run else self._chosen
        self._held = np.zeros(len(group), bool)
        self._held[self._chosen] = True
        written = [group.control_column, *group.awareness.columns.values()]
        self._columns = [column for column in written if isinstance(column, Column)]
        self._series = [column for column in written if isinstance(column, SeriesColumn)]
        self._tables = [column for column in written if isinstance(column, TableColumn)]
        self._before: tuple[Any, ...] = ()

    def __enter__(self) -> None:
        awareness = self._awareness
        self._before = (
            [column.values for column in self._columns],
            [column.held() for column in self._series],
            [column.tables for column in self._tables],
            awareness.seen,
            awareness.received,
        )

    def __exit__(self, kind: object, *error: object) -> None:
        (columns, series, tables, seen, received), self._before = self._before, ()
        if kind is not None:
            return
        chosen, awareness = self._chosen, self._awareness
        for column, values in zip(self._columns, columns, strict=True):
            if column.values is not values:
                column.restore(self._index, values)
        for series_column, before in zip(self._series, series, strict=True):
            series_column.put_back(chosen, before)
        for table_column, entries in zip(self._tables, tables, strict=True):
            for row in chosen:
                if table_column.row(row) is not entries[row]:
                    table_column.set_row(row, entries[row])
        if awareness.seen is not None and awareness.seen is not seen:
            awareness.seen = merged(awareness.seen, seen, self._held)
        if awareness.received is not None and awareness.received is not received:
            awareness.received = merged(awareness.received, received, self._held)


def merged(tracks: Tracks, before: Tracks | None, held: NDArray[np.bool_]) -> Tracks:
    """The earlier tracks of some observers, and the present tracks of all others."""
    then = tracks.select(np.zeros(len(tracks), bool)) if before is None else before.select(held[before.observers])
    now = tracks.select(~held[tracks.observers])
    since = (tracks.time - then.time) / SECOND
    observers = np.concatenate([now.observers, then.observers])
    order = np.argsort(observers, kind="stable")
    covariances = joined_covariances([each for each in (now, then) if len(each)])
    return Tracks.of(
        tracks.time,
        len(held),
        observers[order],
        np.concatenate([now.others, then.others])[order],
        np.concatenate([now.positions, then.positions])[order],
        np.concatenate([now.velocities, then.velocities])[order],
        covariances=None if covariances is None else covariances[order],
        ages=np.concatenate([now.ages, then.ages + since])[order],
    )
