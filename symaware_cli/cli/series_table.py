"""A table of values over time."""

from __future__ import annotations

import numpy as np
import typer
from numpy.typing import NDArray

from symaware_cli.cli.terminal import print_json
from symaware_cli.recording.error import LogError, UnknownNameError
from symaware_cli.recording.reader import Log
from symaware_cli.recording.series import Series

Array = NDArray[np.float64]


def show_series(
    log: Log, spec: str, *, start: int | None, end: int | None, every: float | None, limit: int | None, as_json: bool
) -> None:
    """Print a series: a line for each instant, then the least, mean and greatest value of each column.

    Args:
        log: The log.
        spec: ``NAME:FIELD`` or ``NAME:FIELD:COLUMN``.
        start: The first simulated time [ns].
        end: The last simulated time [ns].
        every: Print only the first line per this many seconds.
        limit: The greatest number of lines.
        as_json: Whether to print JSON.

    Raises:
        LogError: The log has no such series.
    """
    parts = spec.split(":")
    if len(parts) not in (2, 3) or not all(parts):
        raise LogError(f"a series is NAME:FIELD or NAME:FIELD:COLUMN, such as robot.0:state:x, not {spec!r}")
    name, field, *column = parts
    series = log.series(name, field)
    labels, units, values = _columns(log, name, series, column[0] if column else None)
    chosen = np.ones(len(series.times), bool)
    if start is not None:
        chosen &= series.times >= start
    if end is not None:
        chosen &= series.times <= end
    times, values = series.times[chosen], values[chosen]
    extremes = _extremes(values)
    shown = np.arange(len(times)) if every is None else _thinned(times, every)
    shown = shown[:limit]
    if as_json:
        print_json(
            {
                "name": name,
                "field": field,
                "columns": labels,
                "units": units,
                "times": times[shown].tolist(),
                "values": values[shown].tolist(),
                **{word: line.tolist() for word, line in extremes.items()},
                "instants": len(times),
            }
        )
        return
    heads = [f"{label} [{unit}]" if unit else label for label, unit in zip(labels, units, strict=True)]
    widths = [max(len(head), 12) for head in heads]

    def line(first: str, rest: list[str]) -> str:
        return "  ".join([f"{first:>12}", *(f"{text:>{width}}" for text, width in zip(rest, widths, strict=True))])

    typer.echo(line("time [s]", heads))
    for index in shown.tolist():
        typer.echo(line(f"{times[index] / 1e9:.9g}", [_number(value) for value in values[index].tolist()]))
    typer.echo("")
    for word, row in extremes.items():
        typer.echo(line(word, [_number(value) for value in row.tolist()]))
    left_out = f", {len(shown):,} of them shown" if len(shown) < len(times) else ""
    typer.echo(f"of {len(times):,} instants{left_out}")


def _columns(log: Log, name: str, series: Series, column: str | None) -> tuple[list[str], list[str], Array]:
    """Lay out the columns side by side: their labels, their units, and the values (k, m)."""
    width = series.values.shape[-1]
    names = series.columns if len(series.columns) == width else tuple(str(number) for number in range(width))
    units = series.units if len(series.units) == width else ("",) * width
    numbers = list(range(width))
    if column is not None:
        numbers = [_column(log, names, column)]
    if series.values.ndim == 2:
        return [names[number] for number in numbers], [units[number] for number in numbers], series.values[:, numbers]
    count = series.values.shape[1]
    agents = log.agents.get(name, ())
    agents = agents if len(agents) == count else tuple(str(row) for row in range(count))
    labels = [f"{agent} {names[number]}" for agent in agents for number in numbers]
    values = series.values[:, :, numbers].reshape(len(series.times), len(labels))
    return labels, [units[number] for _ in agents for number in numbers], values


def _column(log: Log, names: tuple[str, ...], column: str) -> int:
    """The index of a column, given by its name or number."""
    if column in names:
        return names.index(column)
    if column.isdecimal() and int(column) < len(names):
        return int(column)
    there = ", ".join(names) or "none"
    raise UnknownNameError(f"{log.path} has no column {column!r} there; there are {there}", column, names)


def _thinned(times: NDArray[np.int64], every: float) -> NDArray[np.intp]:
    """The first instant of each interval."""
    _, firsts = np.unique(times // max(round(every * 1e9), 1), return_index=True)
    return firsts


def _extremes(values: Array) -> dict[str, Array]:
    """The minimum, mean and maximum of each column; NaN for an empty one."""
    lines = {word: np.full(values.shape[1], np.nan) for word in ("minimum", "mean", "maximum")}
    some = ~np.isnan(values).all(axis=0)
    if some.any():
        known = values[:, some]
        lines["minimum"][some], lines["maximum"][some] = np.nanmin(known, axis=0), np.nanmax(known, axis=0)
        with np.errstate(invalid="ignore"):  # +inf and -inf have no mean
            lines["mean"][some] = np.nanmean(known, axis=0)
    return lines


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.6g}"
