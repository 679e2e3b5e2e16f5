"""Quantities over time, one curve for each agent: risk, speed, altitude, control, and any series by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import PARTS, seconds
from symaware_cli.recording.error import LogError, UnknownNameError
from symaware_cli.recording.reader import FIELDS, Log
from symaware_cli.viewing.palette import DISTINCT, SCENERY, hexadecimal
from symaware_cli.viewing.plotting.motion import Chosen, LineStyle, Motion, held, instants, series_of
from symaware_cli.viewing.plotting.request import SeriesName, Window
from symaware_cli.viewing.views import RunView

Array = NDArray[np.float64]

#: [ns] Speed is taken from positions this much before and after, so that noise of each step does not drown it.
_AROUND = 250_000_000

#: What is known by the names of its columns.
_BY_COLUMN = tuple(part.name for part in PARTS)

#: What changes gradually; all else, such as inputs and readings, stands until the next value.
_GRADUAL = ("state", "world", "intent", "uncertainty")


@dataclass(frozen=True)
class PlottedCurves:
    """One quantity over time.

    Attributes:
        name: What it is.
        unit: Its unit; empty if the log does not tell.
        times: (k,) simulated time [ns].
        values: (k, n); NaN where it is not known.
        lines: How each is drawn.
        stepwise: Whether it jumps from one value to the next, as inputs do.
        level: A line to compare with; None for none.
        dots: Whether each value stands by itself, as the entries of a table do; then times may repeat.
        note: How it was obtained, where it is not as it was recorded.
    """

    name: str
    unit: str
    times: NDArray[np.int64]
    values: Array
    lines: tuple[LineStyle, ...]
    stepwise: bool = False
    note: str = ""
    dots: bool = False
    level: float | None = None

    @property
    def many(self) -> bool:
        """Whether the curves are too many to tell one from another."""
        return len(self.lines) > DISTINCT

    def facts(self) -> dict[str, Any]:
        """Return what there is to say in numbers."""
        facts: dict[str, Any] = {"panel": self.name, "unit": self.unit, "curves": len(self.lines)}
        for name, found in (("minimum", self.extreme(-1)), ("maximum", self.extreme())):
            facts[name] = found and {"value": found[0], "time": found[1], "who": [found[2]]}
        return facts

    def extreme(self, sign: int = 1) -> tuple[float, float, str] | None:
        """The greatest value (the least for -1), when it was reached first [s], and by whom; None without values."""
        values = sign * self.values
        if not (np.isfinite(values)).any():
            return None
        row, column = np.unravel_index(int(np.argmax(np.where(np.isfinite(values), values, -np.inf))), values.shape)
        return float(self.values[row, column]), seconds(int(self.times[row])), self.lines[column].name


def recorded(log: Log, chosen: Chosen, field: str, window: Window) -> list[PlottedCurves]:
    """Read a field of `Log.series` of all chosen agents: one for each column, with those that have it.

    Raises:
        LogError: The log cannot be read, or not understood.
    """
    found: dict[tuple[str, str], list[PlottedCurves]] = {}
    for name, rows, lines in chosen.groupwise:
        if field not in (*FIELDS, *log.signals(name)):
            continue  # the components of another group write it
        for curves in _columns(log, name, field, rows, lines, window):
            found.setdefault((curves.name, curves.unit), []).append(curves)
    joined = [_joined(parts) for parts in found.values()]
    if field in _BY_COLUMN:
        return joined
    # A column of a control input may be called as the speed is, and one of a part of awareness as anything.
    return [replace(curves, name=f"{field} {curves.name}".replace(f"{field} {field}", field)) for curves in joined]


def speed(chosen: Chosen, motion: Motion) -> PlottedCurves | None:
    """The speed of each agent, from where it was a little before and a little after; None without two instants."""
    times = motion.times
    if len(times) < 2:
        return None
    before = np.maximum(np.searchsorted(times, times - _AROUND, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(times, times + _AROUND), len(times) - 1)
    travelled = np.linalg.norm(motion.positions[after] - motion.positions[before], axis=2)
    values = travelled / ((times[after] - times[before]) / 1e9)[:, None]
    note = f"mean over {2 * seconds(_AROUND):g} s"
    return PlottedCurves("speed", "m/s", times, values, chosen.lines, note=note)


def altitude(chosen: Chosen, motion: Motion) -> PlottedCurves | None:
    """The third coordinate of agents that move in space; None if nobody does."""
    spatial = np.array([len(group_view.position) == 3 for group_view in chosen.group_view])
    if not spatial.any():
        return None
    lines = tuple(line for line, flies in zip(chosen.lines, spatial, strict=True) if flies)
    return PlottedCurves("altitude", "m", motion.times, motion.positions[:, spatial, 2], lines)


def named(
    log: Log, run_view: RunView, chosen: Chosen, names: Sequence[SeriesName], window: Window
) -> list[PlottedCurves]:
    """Read series by name; those that measure the same, by column and unit, come together.

    Raises:
        LogError: The log has no values of one.
        UnknownNameError: It has no such agent, group, entity, field or column.
    """
    single = [name.owner for name in names if name.owner in run_view.place and name.owner not in run_view.group_views]
    alone = Chosen.of(run_view, single) if single else chosen
    found: dict[tuple[str, str], list[tuple[str, PlottedCurves]]] = {}
    for name in dict.fromkeys(names):
        rows, lines = _owned(run_view, chosen, alone, name)
        for curves in _picked(log, run_view, name, rows, lines, window):
            found.setdefault((curves.name, curves.unit), []).append((name.field, curves))
    return [_joined(_told_apart(parts)) for parts in found.values()]


def _owned(
    run_view: RunView, chosen: Chosen, alone: Chosen, name: SeriesName
) -> tuple[NDArray[np.intp], tuple[LineStyle, ...]]:
    """The rows that a series is about, and how each is drawn."""
    owner = name.owner
    if owner in run_view.obstacle_views:
        return np.array([0]), (LineStyle(owner, hexadecimal(SCENERY)),)
    if owner in run_view.group_views:
        if owner not in chosen.rows:
            raise LogError(f"no agent of {owner!r} is among those that were chosen")
        pairs = zip(chosen.lines, chosen.group_view, strict=True)
        return chosen.rows[owner], tuple(line for line, group_view in pairs if group_view.name == owner)
    if owner in run_view.place:
        # It is shown because it is asked for, whoever else was chosen; in its own colour where it has one.
        known = chosen if owner in chosen.agents and not chosen.many else alone
        return np.array([run_view.place[owner][1]]), (known.lines[known.agents.index(owner)],)
    listed = ", ".join([*run_view.group_views, *run_view.obstacle_views])
    message = f"there is no agent, group or entity {owner!r}; there are {listed}"
    raise UnknownNameError(message, owner, [*run_view.group_views, *run_view.place, *run_view.obstacle_views])


def _picked(
    log: Log, run_view: RunView, name: SeriesName, rows: NDArray[np.intp], lines: tuple[LineStyle, ...], window: Window
) -> list[PlottedCurves]:
    """One for each column that a name stands for."""
    group = run_view.place[name.owner][0] if name.owner in run_view.place else name.owner
    every = _columns(log, group, name.field, rows, lines, window)
    if not every:
        raise LogError(f"{log.path} has no values of {name.owner}:{name.field}")
    if name.column is None:
        return every
    for number, curves in enumerate(every):
        if name.column in (curves.name, str(number)):
            return [curves]
    known = [curves.name for curves in every]
    message = f"{name.owner}:{name.field} has no column {name.column!r}; there are {', '.join(known)}"
    raise UnknownNameError(message, name.column, known)


def _columns(
    log: Log, owner: str, field: str, rows: NDArray[np.intp], lines: tuple[LineStyle, ...], window: Window
) -> list[PlottedCurves]:
    """One for each column of a field that has values in the window; none where it was not recorded.

    Raises:
        UnknownNameError: There is no such field.
    """
    signal = log.signals(owner).get(field)
    if signal is not None and signal.kind == "table":
        return _entries(log, owner, field, rows, lines, window)
    series = series_of(log, owner, field, log.series_topic(owner, field))
    if series is None or series.times[0] > window.end:
        return []
    # A value holds until the next, so the window begins with the last one before it, and ends with the last one in it.
    edges = np.array([max(window.start, int(series.times[0])), window.end], np.int64)
    times = instants([series.times, edges], window)
    values = held(series.times, series.values, times)[:, rows]
    count = values.shape[2]
    names = series.columns or ((field,) if count == 1 else tuple(f"{field} {number}" for number in range(count)))
    units = series.units or ("",) * count
    stepwise = field not in _GRADUAL
    return [
        PlottedCurves(name, unit, times, values[:, :, number], lines, stepwise)
        for number, (name, unit) in enumerate(zip(names, units, strict=False))
        if number < count
    ]


def _entries(
    log: Log, group: str, field: str, rows: NDArray[np.intp], lines: tuple[LineStyle, ...], window: Window
) -> list[PlottedCurves]:
    """The entries of tables, one for each column; none where there are none in the window."""
    found = [log.series(log.agents[group][row], field) for row in rows.tolist()]
    times = np.concatenate([series.times for series in found])
    owner = np.repeat(np.arange(len(found)), [len(series.times) for series in found])
    entries = np.concatenate([series.values for series in found])
    order = np.argsort(times, kind="stable")
    order = order[(times[order] >= window.start) & (times[order] <= window.end)]
    if not len(order):
        return []
    values = np.full((len(order), len(lines), entries.shape[1]), np.nan)
    values[np.arange(len(order)), owner[order]] = entries[order]
    return [
        PlottedCurves(name, unit, times[order], values[:, :, number], lines, dots=True)
        for number, (name, unit) in enumerate(zip(found[0].columns, found[0].units, strict=True))
    ]


def _joined(parts: Sequence[PlottedCurves]) -> PlottedCurves:
    """Curves of several owners in one table."""
    if len(parts) == 1:
        return parts[0]
    if all(curves.dots for curves in parts):
        return _joined_dots(parts)
    times = np.unique(np.concatenate([curves.times for curves in parts]))
    values = [held(curves.times, curves.values, times) for curves in parts]
    lines = tuple(line for curves in parts for line in curves.lines)
    return replace(parts[0], times=times, values=np.concatenate(values, axis=1), lines=lines)


def _joined_dots(parts: Sequence[PlottedCurves]) -> PlottedCurves:
    """Entries of several owners in one table, each of which stays by itself."""
    times = np.concatenate([curves.times for curves in parts])
    lines = tuple(line for curves in parts for line in curves.lines)
    values, row, column = np.full((len(times), len(lines)), np.nan), 0, 0
    for curves in parts:
        rows, columns = curves.values.shape
        values[row : row + rows, column : column + columns] = curves.values
        row, column = row + rows, column + columns
    order = np.argsort(times, kind="stable")
    return replace(parts[0], times=times[order], values=values[order], lines=lines)


def _told_apart(parts: Sequence[tuple[str, PlottedCurves]]) -> list[PlottedCurves]:
    """Curves of several fields, with the field in the name and every other one dashed."""
    fields = list(dict.fromkeys(field for field, _ in parts))
    if len(fields) == 1:
        return [curves for _, curves in parts]
    told = []
    for field, curves in parts:
        dashed = fields.index(field) % 2 == 1
        lines = tuple(LineStyle(f"{line.name} {field}", line.colour, dashed) for line in curves.lines)
        told.append(replace(curves, lines=lines))
    return told
