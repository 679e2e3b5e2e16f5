"""Series of values over simulated time, put together from the messages of one channel."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire

_NOTHING: NDArray[np.float64] = np.empty((0, 0))


@dataclass(frozen=True, slots=True)
class Series:
    """Values over simulated time.

    Attributes:
        times: (k,) simulated time, ns; strictly ascending.
        values: (k, n, columns) for a group of n, (k, columns) for one agent.
        columns: Names of the columns; empty if the log does not tell.
        units: Their units; empty if the log does not tell.
    """

    times: NDArray[np.int64]
    values: NDArray[np.float64]
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()


def present_values(message: Any, *, requested: bool = False) -> tuple[NDArray[np.uint32] | None, NDArray[np.float64]]:
    """Reduce a message to one value a row.

    Args:
        message: A `wire.Rows`; a `wire.Control`, of which the applied input is taken; or a `wire.SeriesRows`, of
            which the first point of each row's series is taken, NaN if it has none.
        requested: Take the requested control input instead of the applied one.

    Returns:
        The rows, (m,) or None for all, and their values, (m, columns).
    """
    match message:
        case wire.Rows():
            return message.rows, message.values
        case wire.Control():
            return message.rows, message.requested if requested else message.applied
        case wire.SeriesRows():
            firsts = [values[0] if len(values) else np.full(values.shape[1], np.nan) for _, values in message]
            return message.rows, np.array(firsts) if firsts else _NOTHING
        case _:
            raise ValueError(f"{type(message).__name__} has no value per row")


def group_series(
    entries: Iterable[tuple[int, NDArray[np.uint32] | None, NDArray[np.float64]]], count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Put the series of a whole group together.

    A row that an entry leaves out keeps its value; before its first value it is NaN. Entries at one instant make
    one frame: the state of affairs after the last of them.

    Args:
        entries: Time in ns, rows, and values (m, columns), in order.
        count: Rows of the group; 0 if that is not known.

    Returns:
        The times (k,) in ns and the values (k, count, columns).

    Raises:
        ValueError: An entry is about a row that the group does not have.
    """
    known = count
    times: list[int] = []
    frames: list[NDArray[np.float64]] = []
    columns = 0
    for time, rows, values in entries:
        if not values.size:
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
        frames[-1][slice(len(values)) if rows is None else rows, : values.shape[1]] = values
    table = np.stack(frames) if frames else np.empty((0, count, columns))
    return np.array(times, np.int64), table


def row_series(
    entries: Iterable[tuple[int, NDArray[np.uint32] | None, NDArray[np.float64]]], row: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Put the series of one row together: the instants at which it was recorded, and no others.

    Args:
        entries: Time in ns, rows, and values (m, columns), in order.
        row: The row.

    Returns:
        The times (k,) in ns and the values (k, columns).
    """
    times: list[int] = []
    frames: list[NDArray[np.float64]] = []
    for time, rows, values in entries:
        place = row if rows is None else int(np.searchsorted(rows, row))
        if place >= len(values) or (rows is not None and rows[place] != row):
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


def _widen(frame: NDArray[np.float64], count: int, columns: int) -> NDArray[np.float64]:
    """The frame with at least that many rows and columns, NaN where it had none."""
    if frame.shape == (count, columns):
        return frame
    wider = np.full((count, columns), np.nan)
    wider[: frame.shape[0], : frame.shape[1]] = frame
    return wider
