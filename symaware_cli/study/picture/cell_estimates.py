"""What a metric comes to in each combination of parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symaware_cli.study.picture.finished_runs import Array, FinishedRuns, MetricColumn
from symaware_cli.study.statistics.bootstrap import bootstrap_mean
from symaware_cli.study.statistics.interval_estimate import IntervalEstimate
from symaware_cli.study.statistics.proportion import clopper_pearson
from symaware_cli.study.statistics.stopping import Mean, Share
from symaware_cli.study.statistics.student import student_mean

#: From this many values on, the interval of a mean is Student's, which is then close to that of the bootstrap.
_MANY = 300


@dataclass(frozen=True, slots=True)
class CellEstimates:
    """A metric in each combination of parameters; each array has the shape `FinishedRuns.shape`.

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


def estimated(runs: FinishedRuns, metric: MetricColumn, with_intervals: bool = True) -> CellEstimates:
    """Estimate a metric in each combination of parameters.

    Intervals for a fixed number of runs are made only of all runs of a planned number. Otherwise shares and means of
    values with declared bounds have confidence sequences, which may be watched, and other means no intervals.
    """
    order = np.argsort(runs.cells(), kind="stable")
    count = int(np.prod(runs.shape))
    ends = np.searchsorted(runs.cells()[order], np.arange(count + 1))
    columns = np.full((6, count), np.nan)
    methods: set[str] = set()
    for cell in range(count):
        values = metric.values[order[ends[cell] : ends[cell + 1]]]
        values = values[~np.isnan(values)]
        if not len(values):
            columns[5, cell] = 0
            continue
        found = _estimate(runs, metric, values, cell) if with_intervals else _mean(runs, values)
        low, high = (np.nan, np.nan) if metric.is_share else np.quantile(values, [0.1, 0.9])
        columns[:, cell] = found.value, found.lower, found.upper, low, high, found.count
        methods.add(found.method)
    value, lower, upper, low, high, counts = (column.reshape(runs.shape) for column in columns)
    return CellEstimates(value, lower, upper, low, high, counts, tuple(sorted(methods - {""})))


def _estimate(runs: FinishedRuns, metric: MetricColumn, values: Array, cell: int) -> IntervalEstimate:
    count, confidence = len(values), runs.confidence
    if not runs.is_final:
        if not metric.is_share and metric.bounds is None:
            return _mean(runs, values)
        estimand = Share() if metric.bounds is None else Mean(*metric.bounds)
        sequence = estimand.sequence(confidence)
        sequence.update(values)
        return sequence.estimate()
    if metric.is_share:
        return clopper_pearson(int(np.sum(values)), count, confidence)
    if count < _MANY:
        return bootstrap_mean(values, runs.seed, f"{metric.name} {cell}", confidence)
    return student_mean(values, confidence)


def _mean(runs: FinishedRuns, values: Array) -> IntervalEstimate:
    """The mean without an interval."""
    return IntervalEstimate(float(np.mean(values)), np.nan, np.nan, len(values), runs.confidence, "")
