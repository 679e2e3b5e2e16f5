"""Parts of what runs draw, in which metrics are estimated: a curve over a parameter that has no two equal values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.study.picture.finished_runs import Array, DrawnParameter, FinishedRuns, ParameterAxis

#: Runs of a combination in each part, if there are so many, and the most parts.
_RUNS, _MOST = 20, 16


@dataclass(frozen=True, slots=True)
class DrawnParts:
    """The range of a drawn parameter, taken apart.

    Attributes:
        parameter: The parameter.
        axis: The parameter's axis, with the mean of each part, or with the options of a choice.
        of: The part of each run; shape (n,).
    """

    parameter: DrawnParameter
    axis: ParameterAxis
    of: NDArray[np.intp]


def parted(runs: FinishedRuns, parameter: DrawnParameter) -> DrawnParts:
    """Take the range of a parameter apart: into its options, or such that each part has about as many runs."""
    values = parameter.values
    if parameter.options is not None:
        return DrawnParts(parameter, ParameterAxis(parameter.name, parameter.options), values.astype(np.intp))
    cells = int(np.prod(runs.shape))
    count = min(_MOST, max(1, len(values) // cells // _RUNS))
    inner: Array = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    of = np.searchsorted(inner, values, side="right")
    # Without the parts that have no runs, since many drew the same.
    _, of = np.unique(of, return_inverse=True)
    means = np.bincount(of, values) / np.bincount(of)
    return DrawnParts(parameter, ParameterAxis(parameter.name, means.tolist()), of)
