"""Calibrations: errors of predictions in earlier runs, and the regions that follow from them (conformal prediction).

Runs are exchangeable, errors within a run are not: they overlap in time and concern the same others. So each run counts
with one score, the greatest of its errors, each divided by the size of the region at its look-ahead. Of K runs, the
score of rank ceil((K + 1) c) is exceeded by that of a further run with a probability of at most 1 - c, for any
distribution (V. Vovk, A. Gammerman, G. Shafer, "Algorithmic Learning in a Random World", Springer 2005; for
trajectories L. Lindemann, M. Cleaveland, G. Shim, G. J. Pappas, "Safe planning in dynamic environments using conformal
prediction", IEEE Robotics and Automation Letters 8, 2023; for the weighted maximum over look-aheads M. Cleaveland, I.
Lee, G. J. Pappas, L. Lindemann, "Conformal prediction regions for time series using linear complementarity
programming", AAAI 2024).
"""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array

#: The least size of a region where shaping runs had no error [m].
_LEAST = 1e-9


class ErrorTable(NamedTuple):
    """The errors of predictions in earlier runs.

    Attributes:
        ahead: The look-aheads [s], ascending; shape (H,).
        errors: The greatest error of each run up to each look-ahead from the one before [m]; shape (K, H).
    """

    ahead: Array
    errors: Array


class Calibration:
    """Regions that hold with a probability, and how unusual errors are.

    Attributes:
        coverage: The least probability with which all errors of a run stay below the radii.
        radii: The radius of the region at each look-ahead [m]; shape (H,).
        scores: The score of each run, ascending; shape (K,).
    """

    def __init__(self, table: ErrorTable, coverage: float, shaping_runs: int) -> None:
        """Calibrate.

        Args:
            table: The errors.
            coverage: The least probability.
            shaping_runs: How many runs, the first ones, determine how regions grow with the look-ahead; the others
                calibrate. If 0, regions grow in proportion to it.

        Raises:
            ValueError: There are not enough runs.
        """
        count = len(table.errors) - shaping_runs
        rank = quantile_rank(max(count, 0), coverage)
        if rank > count:
            least = next(number for number in range(1, 1 << 30) if quantile_rank(number, coverage) <= number)
            beside = f" beside {shaping_runs} for the shape" if shaping_runs else ""
            raise ValueError(f"a coverage of {coverage:g} takes at least {least} runs{beside}, not {max(count, 0)}")
        self.coverage = coverage
        self._sizes = _sizes(table, shaping_runs, coverage)
        self.scores: Array = np.sort(self.score(table.errors[shaping_runs:]))
        self.radii: Array = self.scores[rank - 1] * self._sizes

    def score(self, errors: Array) -> Array:
        """Return the scores of errors; shape (n, H) to (n,)."""
        return np.asarray((errors / self._sizes).max(axis=1))

    def p_values(self, errors: Array) -> Array:
        """Return how likely errors as great as these are in a run that is like those before; (n, H) to (n,).

        These are conformal p-values: they are at most p with a probability of at most p, for each p.
        """
        greater = len(self.scores) - np.searchsorted(self.scores, self.score(errors), side="left")
        return np.asarray((greater + 1) / (len(self.scores) + 1))


def quantile_rank(count: int, coverage: float) -> int:
    """Return the rank of the quantile among ascending scores, from 1; greater than their number if there are too few.

    Args:
        count: The number of scores.
        coverage: The least probability; its decimal digits are taken as they are written.
    """
    return math.ceil(Fraction(str(coverage)) * (count + 1))


def read_errors(path: Path, name: str, column: str) -> ErrorTable:
    """Read the table of a sweep.

    Args:
        path: The file.
        name: Its name, for messages.
        column: The column of the metric `prediction.error`.

    Raises:
        ValueError: It is no such table, or some of its runs are not done.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ValueError("tables of sweeps need the extra `sweep`: pip install 'symaware-cli[sweep]'") from error
    try:
        table = parquet.read_table(path)
    except (pyarrow.ArrowException, OSError) as error:
        raise ValueError(f"`{name}` is no table of a sweep") from error
    if column not in table.column_names:
        raise ValueError(f"`{name}` has no column `{column}`: the sweep takes the metric `prediction.error`")
    if "variant" in table.column_names and len(table["variant"].unique()) > 1:
        raise ValueError(f"`{name}` has the runs of several variants, which are not alike")
    rows = table[column].to_pylist()
    missing = sum(row is None for row in rows)
    if missing:
        raise ValueError(f"{missing} of {len(rows)} runs of `{name}` have no errors, as they are not done")
    try:
        profiles = [([each["time"] for each in row], [each["value"] for each in row]) for row in rows]
    except (TypeError, KeyError) as error:
        raise ValueError(f"the column `{column}` of `{name}` is not that of the metric `prediction.error`") from error
    if not profiles or not profiles[0][0]:
        raise ValueError(f"`{name}` has no errors")
    ahead = profiles[0][0]
    if any(times != ahead for times, _ in profiles):
        raise ValueError(f"the runs of `{name}` have different look-aheads")
    return ErrorTable(np.array(ahead), np.array([errors for _, errors in profiles]))


def _sizes(table: ErrorTable, shaping_runs: int, coverage: float) -> Array:
    """Return the relative size of the region at each look-ahead; shape (H,)."""
    if not shaping_runs:
        return table.ahead
    rank = min(quantile_rank(shaping_runs, coverage), shaping_runs)
    quantiles = np.sort(table.errors[:shaping_runs], axis=0)[rank - 1]
    return np.maximum(np.maximum.accumulate(quantiles), _LEAST)
