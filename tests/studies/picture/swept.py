"""Fabricated runs of sweeps, for tests of pictures."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.studies.picture.finished_runs import Array, DrawnParameter, FinishedRuns, MetricColumn, ParameterAxis
from symaware_cli.studies.statistics.interval_choice import IntervalChoice


def swept(
    over: Mapping[str, Sequence[Any]],
    replicates: int = 10,
    variants: Sequence[str] = (),
    ended: int | None = None,
    is_drawn: bool = False,
    is_infinite: bool = False,
) -> FinishedRuns:
    """Runs of every combination: `number` is its number plus noise, `satisfied.even` whether it is even.

    The three parameters that may be drawn are the number of the run within its combination, from 1, its magnitude, and
    one of three options in turn. With `is_infinite`, there is `robustness.safe`, which is -inf in some runs.
    """
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
    if is_infinite:
        # Every fourth run has -inf, and the first one inf.
        sign = np.where(np.arange(len(indices)) % 4 == 3, -1, 0).astype(np.int8)
        sign[0] = 1
        values = np.where(sign == 0, columns[1].values, np.nan)
        columns.append(MetricColumn("robustness.safe", "", False, values, None, sign))
    metrics = {column.name: column for column in columns}
    intervals = IntervalChoice(len(indices) == planned, is_independent=True, confidence=0.95)
    numbers: Array = (indices // cells + 1).astype(np.float64)
    drawn = [
        DrawnParameter("linear", numbers),
        DrawnParameter("magnitude", numbers, is_logarithmic=True),
        DrawnParameter("option", (numbers % 3).astype(int).astype(float), ["x", "y", "z"]),
    ]
    shown = drawn if is_drawn else ()
    return FinishedRuns("swept", 7, axes, variants, planned, intervals, 0, indices, metrics, shown)
