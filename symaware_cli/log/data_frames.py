"""Data frames of pandas, Polars or Arrow, and datasets of xarray, made from series.

The four libraries are optional, and imported when the first frame is made.

Reasons: docs/decisions/0076-frames.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.series import Series

if TYPE_CHECKING:
    import pyarrow
    import xarray

FrameLibrary: TypeAlias = Literal["pandas", "polars", "arrow"]
"""A library of data frames."""

DEFAULT_FIELDS = ("world", "state")
"""The fields of a frame if none are named: the true and the believed state."""


@dataclass(frozen=True, slots=True)
class FrameColumn:
    """A column of a frame.

    Attributes:
        name: Its name.
        values: One value per row: numbers, or texts as objects.
        unit: The unit of its values; empty if it has none, or none is known.
    """

    name: str
    values: NDArray[Any]
    unit: str = ""


def library(to: str) -> Any:
    """Import a library of data frames.

    Raises:
        UnknownNameError: It is none of `FrameLibrary`.
        LogError: It is not installed.
    """
    known = get_args(FrameLibrary)
    if to not in known:
        raise UnknownNameError(f"there is no library {to!r} of frames; there are {', '.join(known)}", to, known)
    return imported("pyarrow" if to == "arrow" else to)


def imported(module: str) -> Any:
    """Import an optional module.

    Raises:
        LogError: It is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        message = f"frames need the module `{module}`, which is not installed: pip install 'symaware-cli[frames]'"
        raise LogError(message) from None


def between(series: Series, start: int | None, end: int | None) -> Series:
    """Return the part of a series in an interval of time.

    Args:
        series: The series.
        start: The first simulated time, ns; None for the beginning.
        end: The simulated time at which to stop, exclusive, ns; None for the end.
    """
    first = 0 if start is None else int(np.searchsorted(series.times, start))
    last = len(series.times) if end is None else int(np.searchsorted(series.times, end))
    part = slice(first, max(first, last))
    return replace(series, times=series.times[part], values=series.values[part])


def agent_columns(fields: Mapping[str, Series], agents: Sequence[str]) -> list[FrameColumn]:
    """Join series into columns with one row per instant and agent, in the order of time and then of the agents.

    Args:
        fields: The series by field, each (k, n, columns), or (k, columns) if there is one agent. Their instants may
            differ: a field is NaN at the instants of others. If there is one field, instants may repeat.
        agents: The n ids.

    Returns:
        `time` [s], `agent`, and the columns of each field as ``FIELD.COLUMN``.
    """
    times = _instants(fields)
    found = [
        FrameColumn("time", np.repeat(times / 1e9, len(agents)), "s"),
        FrameColumn("agent", np.tile(np.array(agents, object), len(times))),
    ]
    for field, series in fields.items():
        names, units = _columns(series)
        rows = _on(times, series, len(agents)).reshape(len(times) * len(agents), len(names))
        for place, (name, unit) in enumerate(zip(names, units, strict=True)):
            found.append(FrameColumn(f"{field}.{name}", np.ascontiguousarray(rows[:, place]), unit))
    return found


def frame_of(columns: Sequence[FrameColumn], to: FrameLibrary) -> Any:
    """Make a frame from columns.

    Args:
        columns: The columns.
        to: The library.

    Returns:
        A ``pandas.DataFrame`` whose ``attrs["units"]`` has the units by column, a ``polars.DataFrame``, or a
        ``pyarrow.Table`` whose fields have the metadata ``unit``.

    Raises:
        UnknownNameError: There is no such library.
        LogError: It is not installed.
    """
    module = library(to)
    values = {column.name: column.values for column in columns}
    if to == "polars":
        # Texts as a list: without it, no rows have a column of arbitrary objects.
        text = {name: module.String for name, each in values.items() if each.dtype == object}
        listed = {name: each.tolist() if name in text else each for name, each in values.items()}
        return module.DataFrame(listed, schema_overrides=text)
    if to == "arrow":
        fields = [
            module.field(
                column.name,
                module.string() if column.values.dtype == object else module.from_numpy_dtype(column.values.dtype),
                metadata={"unit": column.unit} if column.unit else None,
            )
            for column in columns
        ]
        return module.table(list(values.values()), schema=module.schema(fields))
    frame = module.DataFrame(values)
    frame.attrs["units"] = {column.name: column.unit for column in columns if column.unit}
    return frame


def frame_of_table(table: pyarrow.Table, to: FrameLibrary) -> Any:
    """Convert a table of Arrow, with the units that its fields have as metadata; see `frame_of`."""
    module = library(to)
    if to == "arrow":
        return table
    if to == "polars":
        return module.from_arrow(table)
    frame = table.to_pandas()
    notes = {field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema}
    frame.attrs["units"] = {name: unit for name, unit in notes.items() if unit}
    return frame


def dataset_of(fields: Mapping[str, Series], agents: Sequence[str]) -> xarray.Dataset:
    """Make a dataset from series.

    Args:
        fields: See `agent_columns`; instants do not repeat.
        agents: The n ids.

    Returns:
        A variable for each field, over `agent`, `time` [s] and `column`; the attribute `units` has the unit of each
        column. Fields whose columns differ from those of the first have the dimension ``column_FIELD``.

    Raises:
        LogError: xarray is not installed.
    """
    module = imported("xarray")
    times = _instants(fields)
    dimensions: dict[tuple[str, ...], str] = {}
    variables, coordinates = {}, {}
    for field, series in fields.items():
        names, units = _columns(series)
        dimension = dimensions.setdefault(names, f"column_{field}" if dimensions else "column")
        coordinates[dimension] = list(names)
        values = _on(times, series, len(agents)).transpose(1, 0, 2)
        variables[field] = module.Variable(("agent", "time", dimension), values, {"units": list(units)})
    coordinates["time"] = module.Variable("time", times / 1e9, {"units": "s"})
    coordinates["agent"] = list(agents)
    return module.Dataset(variables, coordinates)


def _instants(fields: Mapping[str, Series]) -> NDArray[np.int64]:
    """Return the instants of all fields, (k,), ns; those of a single field as they are."""
    found = [series.times for series in fields.values()]
    return found[0] if len(found) == 1 else np.unique(np.concatenate(found))


def _on(times: NDArray[np.int64], series: Series, count: int) -> NDArray[np.float64]:
    """Return the values of a series at given instants, (k, count, columns): NaN where it has none."""
    values = series.values.reshape(len(series.times), count, series.values.shape[-1])
    if np.array_equal(series.times, times):
        return values
    found = np.full((len(times), *values.shape[1:]), np.nan)
    found[np.searchsorted(times, series.times)] = values
    return found


def _columns(series: Series) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return a name and a unit for each column of a series; the number of the column if the log has no name for it."""
    count = series.values.shape[-1]
    named = len(set(series.columns)) == len(series.columns) == count
    names = series.columns if named else tuple(map(str, range(count)))
    return names, series.units if len(series.units) == count else ("",) * count
