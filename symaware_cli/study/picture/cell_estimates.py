"""What a metric comes to in each combination of parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symaware_cli.study.picture.drawn_parts import DrawnParts
from symaware_cli.study.picture.finished_runs import Array, FinishedRuns, MetricColumn
from symaware_cli.study.statistics.interval_estimate import IntervalEstimate


@dataclass(frozen=True, slots=True)
class CellEstimates:
    """A metric in each combination of parameters; each array has the shape `FinishedRuns.shape`, and parts after it.

    Attributes:
        value: The mean or the share; NaN where no run has a value.
        lower: The lower end of its interval; NaN where there is none.
        upper: The upper end.
        low: The tenth percentile of the runs' values; NaN for shares.
        high: The ninetieth.
        count: How many runs have a value.
        method: How the intervals are made; several where the numbers of runs differ.
    """

    value: Array
    lower: Array
    upper: Array
    low: Array
    high: Array
    count: Array
    method: tuple[str, ...]


def estimated(
    runs: FinishedRuns, metric: MetricColumn, with_intervals: bool = True, parts: DrawnParts | None = None
) -> CellEstimates:
    """Estimate a metric in each combination of parameters.

    Args:
        runs: The runs.
        metric: The metric.
        with_intervals: Whether to make intervals.
        parts: The parts of a drawn parameter, each of which is estimated by itself.
    """
    cells, shape = runs.cells(), runs.shape
    if parts is not None:
        cells, shape = cells * len(parts.axis.values) + parts.of, (*shape, len(parts.axis.values))
    order = np.argsort(cells, kind="stable")
    count = int(np.prod(shape))
    ends = np.searchsorted(cells[order], np.arange(count + 1))
    columns = np.full((6, count), np.nan)
    methods: set[str] = set()
    for cell in range(count):
        values = metric.values[order[ends[cell] : ends[cell + 1]]]
        values = values[~np.isnan(values)]
        if not len(values):
            columns[5, cell] = 0
            continue
        found = _estimate(runs, metric, values, cell) if with_intervals else runs.intervals.plain(values)
        low, high = (np.nan, np.nan) if metric.is_share else np.quantile(values, [0.1, 0.9])
        columns[:, cell] = found.value, found.lower, found.upper, low, high, found.count
        methods.add(found.method)
    value, lower, upper, low, high, counts = (column.reshape(shape) for column in columns)
    return CellEstimates(value, lower, upper, low, high, counts, tuple(sorted(methods - {""})))


def _estimate(runs: FinishedRuns, metric: MetricColumn, values: Array, cell: int) -> IntervalEstimate:
    if metric.is_share:
        return runs.intervals.share(values)
    return runs.intervals.mean(values, metric.bounds, runs.seed, f"{metric.name} {cell}")
