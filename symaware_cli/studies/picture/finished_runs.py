"""The finished runs of a sweep, in columns, and estimates of metrics for each combination of parameters."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.language import Catalogue
from symaware_cli.studies.custom_metrics import CustomMetrics
from symaware_cli.studies.findings import intervals_of
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.metrics import NUMERIC
from symaware_cli.studies.row import Row
from symaware_cli.studies.statistics.interval_choice import IntervalChoice
from symaware_cli.studies.statistics.interval_estimate import IntervalEstimate
from symaware_cli.studies.sweep_document import SweepDocument
from symaware_cli.studies.sweep_files import JOURNAL
from symaware_cli.studies.sweep_journal import SweepJournal
from symaware_cli.studies.sweep_plan import SweepPlan

Array = NDArray[np.float64]
Scale = Literal["linear", "logarithmic", "options"]


@dataclass(frozen=True, slots=True)
class ParameterAxis:
    """A parameter of a sweep, or several that vary together, and its values in the order of the sweep.

    Attributes:
        name: Its path in the scenario, or several paths.
        values: Its values, in order.
    """

    name: str
    values: Sequence[Any]

    @property
    def positions(self) -> Array | None:
        """The values as positions on a numeric axis; None unless they are ascending numbers."""
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
    """A parameter that is drawn for each run.

    Attributes:
        name: The path in the scenario.
        values: The value drawn for each run: a number, or the index of an option. Shape (n,).
        options: The options of a choice; None for numbers.
        is_logarithmic: Whether the values are shown on a logarithmic axis.
    """

    name: str
    values: Array
    options: Sequence[Any] | None = None
    is_logarithmic: bool = False

    @property
    def scale(self) -> Scale:
        """The scale of its axis."""
        return "options" if self.options is not None else "logarithmic" if self.is_logarithmic else "linear"


@dataclass(frozen=True, slots=True)
class MetricColumn:
    """A metric of all runs.

    Attributes:
        name: Its name: "satisfied.NAME" for a specification.
        unit: Its unit; empty for none.
        is_share: Whether it is 0 or 1 for each run, so that its mean is a share.
        values: The value of each run; NaN where it has none. Shape (n,).
        bounds: The least and the greatest possible value; None if not declared.
        infinite: -1 or 1 for each run whose value is -inf or inf, which has no mean and is NaN in `values`; else 0.
            None if no value is infinite.
    """

    name: str
    unit: str
    is_share: bool
    values: Array
    bounds: tuple[float, float] | None = None
    infinite: NDArray[np.int8] | None = None

    @property
    def label(self) -> str:
        """The name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def varies(self) -> bool:
        """Whether the metric differs between runs."""
        present = self.values[~np.isnan(self.values)]
        infinite = 0 if self.infinite is None else len(np.unique(self.infinite[self.infinite != 0]))
        return infinite + bool(len(present)) > 1 or (len(present) > 0 and bool(present.min() < present.max()))


@dataclass(frozen=True, slots=True)
class FinishedRuns:
    """The finished runs of a sweep: for each combination of parameters, the runs before its first unfinished one.

    Attributes:
        name: The name of the scenario.
        seed: The seed of the sweep.
        axes: The listed parameters; every combination of their values has runs.
        variants: The names of the variants; empty if there are none.
        planned: The maximum number of runs planned.
        intervals: The choice of confidence intervals.
        failed: The number of ended runs without metrics, because they failed or were lost.
        indices: The index of each run, ascending; shape (n,).
        metrics: The metrics by name.
        drawn: The drawn parameters.
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
        """The number of values of each axis, and the number of variants, at least 1."""
        return (*(len(axis.values) for axis in self.axes), max(1, len(self.variants)))

    def cells(self) -> NDArray[np.int64]:
        """Return the number of each run's combination, a flat index into `shape`; shape (n,)."""
        cells: NDArray[np.int64] = self.indices % int(np.prod(self.shape))
        return cells


def _label(value: Any) -> str:
    if isinstance(value, float | int) and not isinstance(value, bool):
        return f"{value:g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


#: The intended number of runs of a combination in each part, and the maximum number of parts.
_RUNS, _MOST = 20, 16


@dataclass(frozen=True, slots=True)
class DrawnParts:
    """A partition of the range of a drawn parameter.

    Attributes:
        parameter: The parameter.
        axis: The axis of the parameter, with the mean of each part or with the options of a choice.
        of: The part of each run; shape (n,).
    """

    parameter: DrawnParameter
    axis: ParameterAxis
    of: NDArray[np.intp]


def parted(runs: FinishedRuns, parameter: DrawnParameter) -> DrawnParts:
    """Partition the range of a parameter into its options, or into parts with about equally many runs."""
    values = parameter.values
    if parameter.options is not None:
        return DrawnParts(parameter, ParameterAxis(parameter.name, parameter.options), values.astype(np.intp))
    cells = int(np.prod(runs.shape))
    count = min(_MOST, max(1, len(values) // cells // _RUNS))
    inner: Array = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    of = np.searchsorted(inner, values, side="right")
    # Parts without runs are left out; they occur if many runs drew the same value.
    _, of = np.unique(of, return_inverse=True)
    means = np.bincount(of, values) / np.bincount(of)
    return DrawnParts(parameter, ParameterAxis(parameter.name, means.tolist()), of)


@dataclass(frozen=True, slots=True)
class CellEstimates:
    """Estimates of a metric for each combination of parameters; arrays have the shape `FinishedRuns.shape`, then parts.

    Attributes:
        value: The mean or the share; NaN if no run has a value.
        lower: The lower end of its interval; NaN without an interval.
        upper: The upper end.
        low: The tenth percentile of the runs' values; NaN for shares.
        high: The ninetieth.
        count: The number of runs with a value.
        method: The methods of the intervals; several if the numbers of runs differ.
        infinite: The numbers of runs whose value is -inf, and inf.
    """

    value: Array
    lower: Array
    upper: Array
    low: Array
    high: Array
    count: Array
    method: tuple[str, ...]
    infinite: tuple[Array, Array]


def estimated(
    runs: FinishedRuns, metric: MetricColumn, with_intervals: bool = True, parts: DrawnParts | None = None
) -> CellEstimates:
    """Estimate a metric for each combination of parameters.

    Args:
        runs: The runs.
        metric: The metric.
        with_intervals: Whether to compute intervals.
        parts: The parts of a drawn parameter, which are estimated separately.
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
    signs = np.zeros(len(cells), np.int8) if metric.infinite is None else metric.infinite
    below, above = (np.bincount(cells[signs == sign], minlength=count).reshape(shape).astype(float) for sign in (-1, 1))
    return CellEstimates(value, lower, upper, low, high, counts, tuple(sorted(methods - {""})), (below, above))


def _estimate(runs: FinishedRuns, metric: MetricColumn, values: Array, cell: int) -> IntervalEstimate:
    if metric.is_share:
        return runs.intervals.share(values)
    return runs.intervals.mean(values, metric.bounds, runs.seed, f"{metric.name} {cell}")


def finished_runs(folder: SweepFolder) -> FinishedRuns:
    """Read the finished runs of a sweep, those of each combination before its first unfinished one.

    A specification counts as satisfied only if its verdict is "satisfied": failed and undecided runs count against it.
    A lost run has no values at all.
    """
    plan = folder.plan
    with SweepJournal(folder.path / JOURNAL) as journal:
        rows = list(_without_gaps(journal.rows(), len(plan.cells)))
    document = plan.document
    return FinishedRuns(
        name=folder.path.resolve().name,
        seed=plan.document.seed,
        axes=tuple(_axes(plan.document)),
        variants=tuple(plan.document.variants),
        planned=plan.count,
        intervals=intervals_of(plan, len(rows) - sum(row.state == "lost" for row in rows)),
        failed=sum(row.state != "done" for row in rows),
        indices=np.array([row.index for row in rows], np.int64),
        metrics={each.name: each for each in _metrics(rows, folder.specifications, document)},
        drawn=tuple(_drawn(plan, rows)),
    )


def _without_gaps(rows: Iterator[Row], cells: int) -> Iterator[Row]:
    ended = [0] * cells
    for row in rows:
        replicate, cell = divmod(row.index, cells)
        if replicate == ended[cell]:
            ended[cell] += 1
            yield row


def _axes(document: SweepDocument) -> Iterator[ParameterAxis]:
    """Yield the parameters in the order in which a plan combines them; see `sweep_plan`."""
    for path, values in document.listed.items():
        yield ParameterAxis(path, values)
    for lists in document.together:
        if len(lists) == 1:
            yield from (ParameterAxis(path, values) for path, values in lists.items())
        elif lists:
            yield ParameterAxis(", ".join(lists), [list(each) for each in zip(*lists.values(), strict=True)])


def _drawn(plan: SweepPlan, rows: Sequence[Row]) -> Iterator[DrawnParameter]:
    samples = [plan.samples.of(plan.replicate(row.index)) for row in rows]
    for path, drawn in plan.document.drawn.items():
        values = [sample[path] for sample in samples]
        if drawn.choice is None:
            yield DrawnParameter(path, np.array(values, float), None, drawn.loguniform is not None)
        else:
            places = {json.dumps(option): place for place, option in enumerate(drawn.choice)}
            numbers = [places[json.dumps(value)] for value in values]
            yield DrawnParameter(path, np.array(numbers, float), drawn.choice)


def _metrics(rows: Sequence[Row], specifications: Sequence[str], document: SweepDocument) -> Iterator[MetricColumn]:
    for name in specifications:
        verdicts = [None if row.state == "lost" else row.verdicts.get(name) == "satisfied" for row in rows]
        yield MetricColumn(f"satisfied.{name}", "", True, _numbers(verdicts))
        robustness = [row.robustness.get(name) for row in rows]
        yield MetricColumn(f"robustness.{name}", "", False, _numbers(robustness), None, _infinite(robustness))
    further = [each for each in CustomMetrics(document, Catalogue()).descriptions() if each.kind != "text"]
    for each in [*NUMERIC, *further]:
        values = _numbers([row.metrics.get(each.name) for row in rows])
        low, high = document.bounds.get(each.name, (math.inf, -math.inf))
        is_within = bool(((values >= low) & (values <= high) | np.isnan(values)).all())
        declared = (low, high) if is_within and low < high else None
        infinite = _infinite([row.metrics.get(each.name) for row in rows])
        yield MetricColumn(each.name, each.unit, each.kind == "truth", values, declared, infinite)


def _numbers(values: Sequence[Any]) -> Array:
    numbers = np.array([math.nan if each is None else float(each) for each in values], float)
    # Infinite values, such as the robustness of a specification that cannot be violated, have no mean.
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _infinite(values: Sequence[Any]) -> NDArray[np.int8] | None:
    numbers = np.array([0.0 if each is None else float(each) for each in values], float)
    found = np.where(np.isinf(numbers), np.sign(numbers), 0.0).astype(np.int8)
    return found if found.any() else None
