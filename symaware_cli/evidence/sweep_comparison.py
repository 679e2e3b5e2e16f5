"""Comparison of two sweeps: their plans, and their runs side by side."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.evidence.comparison import ScenarioChange, differing_values
from symaware_cli.evidence.verification import VersionDifference, version_differences
from symaware_cli.log import LogError
from symaware_cli.studies import SweepFolder, compare, counting, require_pyarrow, table_file
from symaware_cli.views import PlotRequest, check_output, matplotlib_required

if TYPE_CHECKING:
    import pyarrow

Array: TypeAlias = NDArray[np.float64]

#: Keys of a plan that do not affect the runs.
_SILENT = ("scenario", "description")


@dataclass(frozen=True, slots=True)
class ColumnComparison:
    """The comparison of a column of two tables.

    Attributes:
        name: The column; for a verdict ``satisfied.NAME``, which is 1 for runs that satisfy the specification, else 0.
        means: The means over the runs with a value in both tables; if there are none, over those with a value in each.
            NaN without values.
        differing: The number of common runs with different values.
        difference: The mean of the second minus that of the first; paired if each run has the same seed in both. NaN
            without such runs.
        interval: The 95 % confidence interval of the paired t test; None if runs are not paired.
    """

    name: str
    means: tuple[float, float]
    differing: int
    difference: float
    interval: tuple[float, float] | None


#: A column, and its values for the runs that have one in both tables.
PairedColumn: TypeAlias = tuple[ColumnComparison, Array, Array]


@dataclass(frozen=True, slots=True)
class SweepComparison:
    """The differences between two sweeps.

    Attributes:
        paths: Both folders.
        plan: The differing values of the plans.
        scenario: The differing values of the scenarios of the first combination.
        rows: The number of rows of each.
        compared: The number of runs in both tables.
        is_paired: Whether each common run has the same seed in both.
        differing: The number of common runs with any difference.
        first: The number of the first differing run; None if there is none.
        columns: The columns in which runs differ.
        only: The columns that only one of the tables has, for each.
        versions: The differences in versions and machine.
    """

    paths: tuple[Path, Path]
    plan: Sequence[ScenarioChange]
    scenario: Sequence[ScenarioChange]
    rows: tuple[int, int]
    compared: int
    is_paired: bool
    differing: int
    first: int | None
    columns: Sequence[ColumnComparison]
    only: tuple[Sequence[str], Sequence[str]]
    versions: Sequence[VersionDifference]

    @property
    def is_equal(self) -> bool:
        """Whether plan, scenario and all rows are equal, regardless of versions."""
        return not (self.plan or self.scenario or self.differing or any(self.only)) and len(set(self.rows)) == 1

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {"equal": self.is_equal, **asdict(self), "paths": [str(path) for path in self.paths]}


def compare_sweeps(
    one: str | os.PathLike[str], other: str | os.PathLike[str], plot: str | os.PathLike[str] | None = None
) -> SweepComparison:
    """Compare two sweeps that have tables.

    Args:
        one: The folder of a sweep.
        other: The folder of another sweep.
        plot: A file for a figure of the columns that differ, run by run; None for none.

    Raises:
        SweepError: A path is not the folder of a sweep.
        LogError: A sweep has no table yet, there is nothing to draw, or pyarrow is not installed.
        OutputError: The figure cannot be written.
    """
    require_pyarrow()
    if plot is not None:
        check_output(Path(plot), PlotRequest())
    folders = SweepFolder.opened(one), SweepFolder.opened(other)
    tables = _table(folders[0]), _table(folders[1])
    plans = [each.plan.document.model_dump(by_alias=True, exclude=set(_SILENT)) for each in folders]
    resolved = [dict(each.identity.resolved) for each in folders]
    for each in resolved:
        each.pop("seed", None)  # each run has its own seed
    pairs = _pairs(*tables)
    names = [name for name in tables[0].column_names if name in tables[1].column_names]
    differ = np.zeros(len(pairs[0]), bool)
    columns: list[ColumnComparison] = []
    drawn: list[PairedColumn] = []
    is_paired = bool(len(differ)) and not _unequal(tables, "seed", pairs).any()
    for name in names:
        unequal = _unequal(tables, name, pairs)
        if name != "seed":
            differ |= unequal
        if unequal.any() and name not in ("seed", "digest"):
            for column, values in _compared(tables, name, pairs, unequal, is_paired=is_paired):
                columns.append(column)
                drawn.append((column, *values))
    if plot is not None:
        _draw(drawn, (folders[0].path, folders[1].path), plot, is_paired=is_paired)
    index = tables[0]["index"].to_numpy()[pairs[0]]
    return SweepComparison(
        (folders[0].path, folders[1].path),
        _changes(*plans),
        _changes(*resolved),
        (len(tables[0]), len(tables[1])),
        len(differ),
        is_paired,
        int(differ.sum()),
        int(index[differ].min()) if differ.any() else None,
        columns,
        tuple([n for n in each.column_names if n not in names] for each in tables),  # type: ignore[arg-type] # both
        version_differences(*(counting(each.identity.versions) for each in folders)),
    )


def _table(folder: SweepFolder) -> pyarrow.Table:
    found = table_file.read(folder.path)
    if found is None:
        raise LogError(f"{folder.path} has no table yet: symaware resume {folder.path}")
    return found[0]


def _changes(one: Any, other: Any) -> Sequence[ScenarioChange]:
    found = differing_values(one, other, ())
    return [ScenarioChange(".".join(map(str, path)), values, ("", "")) for path, values in found]


def _pairs(one: pyarrow.Table, other: pyarrow.Table) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows of the common runs, matched by number."""
    _, first, second = np.intersect1d(one["index"].to_numpy(), other["index"].to_numpy(), return_indices=True)
    return first, second


def _unequal(
    tables: tuple[pyarrow.Table, pyarrow.Table], name: str, pairs: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> NDArray[np.bool_]:
    """Return which of the common runs have different values."""
    one, other = (table[name].take(rows).to_pylist() for table, rows in zip(tables, pairs, strict=True))
    return np.array([a != b and not (a != a and b != b) for a, b in zip(one, other, strict=True)], bool)


def _compared(
    tables: tuple[pyarrow.Table, pyarrow.Table],
    name: str,
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
    unequal: NDArray[np.bool_],
    *,
    is_paired: bool,
) -> Iterator[tuple[ColumnComparison, tuple[Array, Array]]]:
    """Yield the comparison of a numeric or verdict column, and the values of runs that have both; else nothing."""
    import pyarrow

    kind = tables[0].schema.field(name).type
    is_verdict = name.startswith("verdict.")
    is_number = pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_boolean(kind)
    if not (is_verdict or is_number):
        return
    values = [_numbers(table[name].to_pylist(), is_verdict) for table in tables]
    one, other = (each[rows] for each, rows in zip(values, pairs, strict=True))
    both = np.isfinite(one) & np.isfinite(other)
    difference, interval = math.nan, None
    # Runs in only one of the tables would obscure the difference between the common runs.
    means = [float(np.nanmean(each)) if np.isfinite(each).any() else math.nan for each in values]
    if both.any():
        means = [float(np.mean(each[both])) for each in (one, other)]
        difference = float(np.mean(other[both] - one[both]))
        if is_paired and both.sum() > 1:
            estimate = compare(one[both], other[both]).mean
            interval = estimate.lower, estimate.upper
    label = f"satisfied.{name.removeprefix('verdict.')}" if is_verdict else name
    column = ColumnComparison(label, (means[0], means[1]), int(unequal.sum()), difference, interval)
    yield column, (one[both], other[both])


def _draw(
    columns: Sequence[PairedColumn], paths: tuple[Path, Path], plot: str | os.PathLike[str], *, is_paired: bool
) -> None:
    """Draw the columns in which runs differ.

    Raises:
        LogError: There are no such columns, or matplotlib is not installed.
        OutputError: The figure cannot be written.
    """
    with matplotlib_required():
        from symaware_cli.studies import PairedValues, draw_pairs
    panels = [
        PairedValues(column.name, _said(column), bool(np.isin([*first, *second], (0.0, 1.0)).all()), first, second)
        for column, first, second in columns
        if len(first)
    ]
    if not panels:
        raise LogError(f"{paths[0]} and {paths[1]} have no runs whose numbers or verdicts differ: nothing to draw")
    seeds = "with the same seeds" if is_paired else "with different seeds, so that pairs share only their number"
    names = str(paths[0]), str(paths[1])
    if paths[0].resolve().name != paths[1].resolve().name:
        names = paths[0].resolve().name, paths[1].resolve().name
    draw_pairs(panels, names, plot, [f"A point is a run in both sweeps, {seeds}; a larger one stands for several."])


def _said(column: ColumnComparison) -> str:
    interval = "" if column.interval is None else f" ({column.interval[0]:.3g} to {column.interval[1]:.3g})"
    return f"mean difference {column.difference:.3g}{interval}"


def _numbers(values: Sequence[Any], is_verdict: bool) -> NDArray[np.float64]:
    if is_verdict:
        return np.array([math.nan if each is None else float(each == "satisfied") for each in values])
    return np.array([math.nan if each is None else float(each) for each in values])
