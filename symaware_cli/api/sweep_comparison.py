"""Compares two sweeps: what was planned, and the runs of both side by side."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from numpy.typing import NDArray

from symaware_cli.api.comparison import ScenarioChange, differing_values
from symaware_cli.api.verification import VersionDifference, version_differences
from symaware_cli.recording.error import LogError
from symaware_cli.study import table_file
from symaware_cli.study.folder import SweepFolder
from symaware_cli.study.identity import counting
from symaware_cli.study.statistics.paired import compare

if TYPE_CHECKING:
    import pyarrow

#: Keys of a plan that say nothing about the runs.
_SILENT = ("scenario", "description")


@dataclass(frozen=True, slots=True)
class ColumnComparison:
    """A column of two tables.

    Attributes:
        name: The column; for a verdict ``satisfied.NAME``, which is 1 for runs that satisfy the specification, else 0.
        means: The mean of the runs of each that have a value; NaN where none has.
        differing: How many of the runs of both have different values.
        difference: The mean difference of the second from the first; paired if each run has the same seed in both. NaN
            without such runs.
        interval: Its interval of the paired t test, at 95 %; None where runs are not paired.
    """

    name: str
    means: tuple[float, float]
    differing: int
    difference: float
    interval: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class SweepComparison:
    """How two sweeps differ.

    Attributes:
        paths: Both folders.
        plan: The values of the plan that differ.
        scenario: The values of the scenario of the first combination that differ.
        rows: How many rows each has.
        compared: How many runs are in both tables.
        is_paired: Whether each of these has the same seed in both.
        differing: How many of these differ in something.
        first: The number of the first of these; None if there is none.
        columns: The columns in which runs differ.
        only: Columns that only one of them has.
        versions: What differs in versions and machine.
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
        """Whether plan, scenario and all rows are equal, whatever the versions."""
        return not (self.plan or self.scenario or self.differing or any(self.only)) and len(set(self.rows)) == 1

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {"equal": self.is_equal, **asdict(self), "paths": [str(path) for path in self.paths]}


def compare_sweeps(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> SweepComparison:
    """Compare two sweeps whose tables are there.

    Args:
        one: The folder of a sweep.
        other: Another one.

    Raises:
        SweepError: One of them is not the folder of a sweep.
        LogError: One of them has no table yet.
    """
    folders = SweepFolder.opened(one), SweepFolder.opened(other)
    tables = _table(folders[0]), _table(folders[1])
    plans = [each.plan.document.model_dump(by_alias=True, exclude=set(_SILENT)) for each in folders]
    resolved = [yaml.safe_load(each.identity.resolved) for each in folders]
    for each in resolved:
        each.pop("seed", None)  # each run has its own
    pairs = _pairs(*tables)
    names = [name for name in tables[0].column_names if name in tables[1].column_names]
    differ = np.zeros(len(pairs[0]), bool)
    columns: list[ColumnComparison] = []
    is_paired = bool(len(differ)) and not _unequal(tables, "seed", pairs).any()
    for name in names:
        unequal = _unequal(tables, name, pairs)
        if name != "seed":
            differ |= unequal
        if unequal.any() and name not in ("seed", "digest"):
            columns += _compared(tables, name, pairs, unequal, is_paired)
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
        raise LogError(f"{folder.path} has no table yet: symaware sweep {folder.path}")
    return found[0]


def _changes(one: Any, other: Any) -> Sequence[ScenarioChange]:
    found = differing_values(one, other, ())
    return [ScenarioChange(".".join(map(str, path)), values, ("", "")) for path, values in found]


def _pairs(one: pyarrow.Table, other: pyarrow.Table) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The rows of the runs that both have, by their numbers."""
    _, first, second = np.intersect1d(one["index"].to_numpy(), other["index"].to_numpy(), return_indices=True)
    return first, second


def _unequal(
    tables: tuple[pyarrow.Table, pyarrow.Table], name: str, pairs: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> NDArray[np.bool_]:
    """Which of the runs of both have different values."""
    one, other = (table[name].take(rows).to_pylist() for table, rows in zip(tables, pairs, strict=True))
    return np.array([a != b and not (a != a and b != b) for a, b in zip(one, other, strict=True)], bool)


def _compared(
    tables: tuple[pyarrow.Table, pyarrow.Table],
    name: str,
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
    unequal: NDArray[np.bool_],
    is_paired: bool,
) -> Iterator[ColumnComparison]:
    """Compare a column of numbers or verdicts; nothing for others."""
    import pyarrow

    kind = tables[0].schema.field(name).type
    is_verdict = name.startswith("verdict.")
    is_number = pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_boolean(kind)
    if not (is_verdict or is_number):
        return
    values = [_numbers(table[name].to_pylist(), is_verdict) for table in tables]
    means = tuple(float(np.nanmean(each)) if np.isfinite(each).any() else math.nan for each in values)
    one, other = (each[rows] for each, rows in zip(values, pairs, strict=True))
    both = np.isfinite(one) & np.isfinite(other)
    difference, interval = math.nan, None
    if both.any():
        difference = float(np.mean(other[both] - one[both]))
        if is_paired and both.sum() > 1:
            estimate = compare(one[both], other[both]).mean
            interval = estimate.lower, estimate.upper
    label = f"satisfied.{name.removeprefix('verdict.')}" if is_verdict else name
    yield ColumnComparison(label, (means[0], means[1]), int(unequal.sum()), difference, interval)


def _numbers(values: Sequence[Any], is_verdict: bool) -> NDArray[np.float64]:
    if is_verdict:
        return np.array([math.nan if each is None else float(each == "satisfied") for each in values])
    return np.array([math.nan if each is None else float(each) for each in values])
