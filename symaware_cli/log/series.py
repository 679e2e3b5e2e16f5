"""Series of values over simulated time, assembled from the messages of a channel."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import wire
from symaware_cli.log.error import UnknownNameError
from symaware_cli.world import record


@record
class Series:
    """Values over simulated time.

    Attributes:
        times: (k,) simulated time, ns; strictly ascending, except that the entries of a table share their time.
        values: (k, n, columns) for a group of n, (k, columns) for one agent.
        columns: Names of the columns; empty if the log does not name them.
        units: Units of the columns; empty if the log does not state them.
    """

    times: NDArray[np.int64]
    values: NDArray[np.float64]
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    @property
    def seconds(self) -> NDArray[np.float64]:
        """The times in s, (k,)."""
        return self.times / 1e9

    def column(self, name: str) -> NDArray[np.float64]:
        """The values of one column, (k, n) or (k,).

        Raises:
            UnknownNameError: The column does not exist.
        """
        if name not in self.columns:
            known = ", ".join(self.columns) or "none with a name"
            raise UnknownNameError(f"there is no column {name!r}; there are {known}", name, self.columns)
        found: NDArray[np.float64] = self.values[..., self.columns.index(name)]
        return found


@record
class Prediction:
    """A prediction that an agent set at one instant: its intent, uncertainty or risk in the future.

    Attributes:
        time: When it was set, simulated ns.
        times: (h,) the predicted instants, ns; empty if the prediction was withdrawn.
        values: (h, columns).
    """

    time: int
    times: NDArray[np.int64]
    values: NDArray[np.float64]


@record
class LoggedTable:
    """A table that a component produced for an agent at one instant.

    Attributes:
        time: Simulated time, ns.
        values: (m, columns).
        columns: Names of the columns.
        units: Units of the columns.
    """

    time: int
    values: NDArray[np.float64]
    columns: tuple[str, ...]
    units: tuple[str, ...]


def present_values(message: Any, count: int) -> tuple[NDArray[np.uint32] | None, NDArray[np.float64]]:
    """Reduce a message to one value per row.

    Args:
        message: A `wire.Rows`; or a `wire.SeriesRows`, of which the first point of each row's series is used, NaN if it
            is empty.
        count: Number of rows of the group; 0 if unknown.

    Returns:
        The rows, (m,) or None for all, and their values, (m, columns).
    """
    match message:
        case wire.Rows():
            return message.rows, message.values
        case wire.SeriesRows():
            nothing = np.full(message.values.shape[1], np.nan)
            firsts = [values[0] if len(values) else nothing for _, values in message]
            if not firsts and len(message.lengths):
                firsts = [nothing] * count  # all series are empty
            return message.rows, np.array(firsts).reshape(len(firsts), len(nothing))
        case _:
            raise ValueError(f"{type(message).__name__} has no value per row")


def group_series(
    entries: Iterable[tuple[int, NDArray[np.uint32] | None, NDArray[np.float64]]], count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Assemble the series of a whole group.

    A row that an entry leaves out keeps its value; before its first value it is NaN. Entries at the same instant are
    merged: the result is the state after the last of them.

    Args:
        entries: Time in ns, rows, and values (m, columns), in order.
        count: Number of rows of the group; 0 if unknown.

    Returns:
        The times (k,) in ns and the values (k, count, columns).

    Raises:
        ValueError: An entry refers to a row that the group does not have.
    """
    known = count
    times: list[int] = []
    frames: list[NDArray[np.float64]] = []
    columns = 0
    for time, rows, values in entries:
        if not len(values):
            continue
        needed = len(values) if rows is None else int(rows.max()) + 1
        if known and needed > known:
            raise ValueError(f"row {needed - 1} of a group of {known}")
        if needed > count or values.shape[1] > columns:
            count, columns = max(count, needed), max(columns, values.shape[1])
            frames = [_widen(frame, count, columns) for frame in frames]
        if not times or time != times[-1]:
            frames.append(frames[-1].copy() if frames else np.full((count, columns), np.nan))
            times.append(time)
        chosen: Any = slice(len(values)) if rows is None else rows
        frames[-1][chosen] = np.nan
        frames[-1][chosen, : values.shape[1]] = values
    table = np.stack(frames) if frames else np.empty((0, count, columns))
    return np.array(times, np.int64), table


def row_series(
    entries: Iterable[tuple[int, NDArray[np.uint32] | None, NDArray[np.float64]]], row: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Assemble the series of one row: only the instants at which it was recorded.

    Args:
        entries: Time in ns, rows, and values (m, columns), in order.
        row: The row.

    Returns:
        The times (k,) in ns and the values (k, columns).
    """
    times: list[int] = []
    frames: list[NDArray[np.float64]] = []
    for time, rows, values in entries:
        place = row_position(row, rows)
        if place is None or place >= len(values):
            continue
        if times and time == times[-1]:
            frames[-1] = values[place]
        else:
            times.append(time)
            # A copy, so that one row does not keep the whole message in memory.
            frames.append(values[place].copy())
    columns = max((len(frame) for frame in frames), default=0)
    frames = [_widen(frame[None], 1, columns)[0] for frame in frames]
    return np.array(times, np.int64), np.array(frames) if frames else np.empty((0, columns))


Spans = Sequence[tuple[int, int | None]]


def gaps(
    times: NDArray[np.int64], values: NDArray[np.float64], spans: Sequence[Spans]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Set the values of rows to NaN while their agents were absent.

    Args:
        times: (k,) ns.
        values: (k, n, columns).
        spans: For each row, the intervals of presence, ns; an end of None is the end of the run.

    Returns:
        The times, including those at which an agent left, and the values, NaN where an agent was absent.
    """
    ends = [end for own in spans for _, end in own if end is not None and end >= times[0]]
    every = np.union1d(times, np.array(ends, np.int64))
    values = values[np.searchsorted(times, every, side="right") - 1]
    for row, own in enumerate(spans):
        here = np.zeros(len(every), bool)
        for start, end in own:
            here |= (every >= start) & (end is None or every < end)
        values[~here, row] = np.nan
    return every, values


def cut(
    times: NDArray[np.int64], values: NDArray[np.float64], spans: Spans
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """End the series of a row, (k,) and (k, columns), with NaN where its agent left the world; see `gaps`."""
    every, cut_off = gaps(times, values[:, None], [spans])
    return every, cut_off[:, 0]


def row_position(row: int, rows: NDArray[np.uint32] | None) -> int | None:
    """Return the position of a row among the ascending rows of a message (None for all rows); None if it is absent."""
    if rows is None:
        return row
    place = int(np.searchsorted(rows, row))
    return place if place < len(rows) and rows[place] == row else None


def _widen(frame: NDArray[np.float64], count: int, columns: int) -> NDArray[np.float64]:
    """Extend a frame to the given number of rows and columns, filled with NaN."""
    if frame.shape == (count, columns):
        return frame
    wider = np.full((count, columns), np.nan)
    wider[: frame.shape[0], : frame.shape[1]] = frame
    return wider
