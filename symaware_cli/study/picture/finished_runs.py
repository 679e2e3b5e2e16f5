"""The finished runs of a sweep, in columns, and where they stand among the parameters."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.study.statistics.interval_choice import IntervalChoice

Array = NDArray[np.float64]
Scale = Literal["linear", "logarithmic", "options"]


@dataclass(frozen=True, slots=True)
class ParameterAxis:
    """A parameter of a sweep, or several that vary together, and its values in the order of the sweep.

    Attributes:
        name: The path in the scenario, or several.
        values: What it takes, one after the other.
    """

    name: str
    values: Sequence[Any]

    @property
    def positions(self) -> Array | None:
        """Where the values stand on an axis of numbers, ascending; None for what has no such place."""
        if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in self.values):
            return None
        positions = np.array(self.values, float)
        return positions if (np.diff(positions) > 0).all() else None

    @property
    def labels(self) -> list[str]:
        """The values as text."""
        return [_label(each) for each in self.values]


@dataclass(frozen=True, slots=True)
class DrawnParameter:
    """A parameter that each run draws.

    Attributes:
        name: The path in the scenario.
        values: What each run drew: a number, or which of the options. Shape (n,).
        options: What there is to choose from; None for numbers.
        is_logarithmic: Whether their magnitudes are what varies.
    """

    name: str
    values: Array
    options: Sequence[Any] | None = None
    is_logarithmic: bool = False

    @property
    def scale(self) -> Scale:
        """How an axis of it is laid out."""
        return "options" if self.options is not None else "logarithmic" if self.is_logarithmic else "linear"


@dataclass(frozen=True, slots=True)
class MetricColumn:
    """A metric of all runs.

    Attributes:
        name: Its name: "satisfied.NAME" for a specification.
        unit: Its unit; empty for none.
        is_share: Whether it is 0 or 1 for each run, so that its mean is a share.
        values: The value of each run; NaN where it has none. Shape (n,).
        bounds: The least and the greatest possible value; None where they are not declared.
    """

    name: str
    unit: str
    is_share: bool
    values: Array
    bounds: tuple[float, float] | None = None

    @property
    def label(self) -> str:
        """The name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def varies(self) -> bool:
        """Whether two runs have different values."""
        present = self.values[~np.isnan(self.values)]
        return len(present) > 0 and bool(present.min() < present.max())


@dataclass(frozen=True, slots=True)
class FinishedRuns:
    """The runs of a sweep that have ended: of each combination of parameters, those before the first that has not.

    Attributes:
        name: The name of the scenario.
        seed: The seed of the sweep.
        axes: What varies over lists; every combination of their values has runs.
        variants: The names of the variants; empty where there are none.
        planned: How many runs there are to be, at most.
        intervals: How intervals are chosen.
        failed: How many of those that have ended have no metrics, since they failed or were lost.
        indices: The index of each run, ascending; shape (n,).
        metrics: What was measured.
        drawn: What each run drew.
    """

    name: str
    seed: int
    axes: Sequence[ParameterAxis]
    variants: Sequence[str]
    planned: int
    intervals: IntervalChoice
    failed: int
    indices: NDArray[np.int64]
    metrics: Mapping[str, MetricColumn]
    drawn: Sequence[DrawnParameter] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """How many values each axis has, and how many variants there are, at least 1."""
        return (*(len(axis.values) for axis in self.axes), max(1, len(self.variants)))

    def cells(self) -> NDArray[np.int64]:
        """The number of each run's combination; `shape` says how these count. Shape (n,)."""
        cells: NDArray[np.int64] = self.indices % int(np.prod(self.shape))
        return cells


def _label(value: Any) -> str:
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f"{value:g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
