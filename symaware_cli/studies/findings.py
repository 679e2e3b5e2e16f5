"""Results of a sweep: the share of runs that satisfy each specification, and the differences between variants."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.studies.statistics.interval_choice import IntervalChoice
from symaware_cli.studies.statistics.interval_estimate import IntervalEstimate
from symaware_cli.studies.statistics.paired import PairedComparison, compare
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_plan import Cell, SweepPlan
from symaware_cli.studies.sweep_query import array_of, column

if TYPE_CHECKING:
    import pyarrow


@dataclass(frozen=True, slots=True)
class VerdictShare:
    """The share of the runs of a cell that satisfy a specification; undecided and failed runs do not.

    Attributes:
        cell: The cell.
        specification: The name of the specification.
        satisfied: The number of runs that satisfy it.
        interval: The share with its confidence interval.
    """

    cell: Cell
    specification: str
    satisfied: int
    interval: IntervalEstimate

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            **_of_cell(self.cell),
            "specification": self.specification,
            "satisfied": self.satisfied,
            **asdict(self.interval),
        }


@dataclass(frozen=True, slots=True)
class VariantDifference:
    """The difference of a variant from the first one, at one combination of parameters.

    Attributes:
        cell: The cell of the variant.
        against: The name of the first variant.
        comparison: The comparison, run by run.
    """

    cell: Cell
    against: str
    comparison: PairedComparison

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {**_of_cell(self.cell), "against": self.against, **asdict(self.comparison)}


def intervals_of(plan: SweepPlan, made: int) -> IntervalChoice:
    """Return the choice of confidence intervals for the runs of a plan.

    Args:
        plan: The plan.
        made: The number of its runs that are executed and not lost.
    """
    document = plan.document
    is_final = not document.may_stop and made == plan.count
    return IntervalChoice(is_final, document.is_independent, document.confidence)


def shares(table: pyarrow.Table, plan: SweepPlan) -> Iterator[VerdictShare]:
    """Yield the share of each specification in each cell.

    Lost runs are left out; so are, in an unfinished sweep, all runs after a gap, because the runs that end first tend
    to be short, which would bias the share.
    """
    names = [name.removeprefix("verdict.") for name in table.column_names if name.startswith("verdict.")]
    index = array_of(table["index"])
    counts = array_of(table["state"]) != "lost"
    intervals = intervals_of(plan, int(counts.sum()))
    for cell in plan.cells:
        rows = np.flatnonzero(index % len(plan.cells) == cell.number)
        rows = rows[index[rows] // len(plan.cells) == np.arange(len(rows))]
        rows = rows[counts[rows]]
        for name in names:
            values = (array_of(table[f"verdict.{name}"])[rows] == "satisfied").astype(float)
            yield VerdictShare(cell, name, int(values.sum()), intervals.share(values))


def differences(table: pyarrow.Table, plan: SweepPlan, name: str) -> Iterator[VariantDifference]:
    """Yield the paired difference of each variant from the first one, in one column.

    Args:
        table: All rows.
        plan: Their plan, with paired variants.
        name: The column; a verdict counts as 1 if satisfied, else 0.

    Raises:
        SweepError: The variants are not paired, or the column is not numeric.
        UnknownNameError: There is no such column.
    """
    if not plan.document.paired:
        raise SweepError("only paired variants are compared run by run: symaware sweep ... --with paired=true")
    values = _numbers(table, column(table, name))
    index = array_of(table["index"])
    by_cell = []
    for cell in plan.cells:
        rows = index % len(plan.cells) == cell.number
        own = np.full(plan.document.runs, np.nan)
        own[index[rows] // len(plan.cells)] = values[rows]
        by_cell.append(own)
    width = len(plan.document.variants)
    for cell in plan.cells:
        first = plan.cells[cell.point * width]
        if cell.number != first.number:
            comparison = compare(by_cell[first.number], by_cell[cell.number], plan.document.confidence)
            if not plan.document.is_independent:
                comparison = comparison.without_intervals()
            yield VariantDifference(cell, first.variant or "", comparison)


def _numbers(table: pyarrow.Table, name: str) -> Any:
    import pyarrow

    found = table[name]
    if name.startswith("verdict."):
        texts = array_of(found)
        return np.where(texts == None, np.nan, (texts == "satisfied").astype(float))  # noqa: E711 (element by element)
    if pyarrow.types.is_string(found.type) or pyarrow.types.is_list(found.type):
        raise SweepError(f"`{name}` is not made of numbers")
    return array_of(found.cast(pyarrow.float64()))


def _of_cell(cell: Cell) -> dict[str, Any]:
    return {**({} if cell.variant is None else {"variant": cell.variant}), **cell.parameters}
