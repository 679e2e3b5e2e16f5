"""Runs of sweeps that never were, for pictures of them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.study.picture.finished_runs import Array, FinishedRuns, MetricColumn, ParameterAxis
from symaware_cli.study.statistics.interval_choice import IntervalChoice


def swept(
    over: Mapping[str, Sequence[Any]], replicates: int = 10, variants: Sequence[str] = (), ended: int | None = None
) -> FinishedRuns:
    """Runs of every combination: `number` is its number plus noise, `satisfied.even` whether it is even."""
    axes = [ParameterAxis(name, values) for name, values in over.items()]
    cells = int(np.prod([len(axis.values) for axis in axes])) * max(1, len(variants))
    planned = replicates * cells
    indices = np.arange(planned if ended is None else ended)
    noise: Array = np.random.default_rng(1).normal(size=len(indices))
    columns = [
        MetricColumn("satisfied.even", "", True, (indices % cells % 2 == 0).astype(float)),
        MetricColumn("number", "m", False, indices % cells + 0.1 * noise),
        MetricColumn("constant", "", False, np.ones(len(indices))),
    ]
    metrics = {column.name: column for column in columns}
    intervals = IntervalChoice(len(indices) == planned, is_independent=True, confidence=0.95)
    return FinishedRuns("swept", 7, axes, variants, planned, intervals, 0, indices, metrics)
