"""The panels of a picture of a sweep: their metrics, axes and estimates."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import LogError, UnknownNameError
from symaware_cli.studies.picture.finished_runs import (
    Array,
    CellEstimates,
    DrawnParts,
    FinishedRuns,
    MetricColumn,
    ParameterAxis,
    Scale,
    estimated,
    parted,
)

#: The maximum number of panels in a picture, and the maximum unless metrics are requested by name.
_MOST, _USUAL = 48, 6

Kind = Literal["curve", "map", "scatter", "distribution"]


@dataclass(frozen=True, slots=True)
class MetricPanel:
    """A metric for some of the combinations of parameters.

    Attributes:
        kind: "curve" over one listed parameter, "map" over two, "scatter" over one that is drawn, or "distribution" if
            none varies.
        metric: The metric.
        axes: The parameters on the axes of the panel: none, one or two, the horizontal one first.
        series: The names of the series that colours distinguish: the variants, or one empty name.
        caption: The values of the other parameters; empty if there are none.
        value: The mean or share; shape (series, *axes).
        lower: The lower end of its interval, of the same shape; NaN without an interval, as in maps.
        upper: The upper end.
        low: The tenth percentile of the runs; NaN for shares.
        high: The ninetieth.
        samples: The values of each series' runs, only for a distribution or a scatter.
        drawn: The values that these runs drew, only for a scatter.
        scale: The scale of a scatter's axis.
        infinite: The numbers of runs whose value is -inf, and inf; of the same shape as `value`.
    """

    kind: Kind
    metric: MetricColumn
    axes: tuple[ParameterAxis, ...]
    series: tuple[str, ...]
    caption: str
    value: Array
    lower: Array
    upper: Array
    low: Array
    high: Array
    samples: tuple[Array, ...] = ()
    drawn: tuple[Array, ...] = ()
    scale: Scale = "linear"
    infinite: tuple[Array, Array] | None = None


@dataclass(frozen=True, slots=True)
class SweepPicture:
    """The content of a picture of a sweep.

    Attributes:
        runs: The runs.
        panels: Its panels, ordered by metric.
        notes: The lines of text below the panels.
    """

    runs: FinishedRuns
    panels: tuple[MetricPanel, ...]
    notes: tuple[str, ...]

    @property
    def facets(self) -> int:
        """The number of panels per metric."""
        return len(self.panels) // len({panel.metric.name for panel in self.panels})


def composed(runs: FinishedRuns, show: Sequence[str] = ()) -> SweepPicture:
    """Choose the panels of a picture.

    Args:
        runs: The runs of a sweep.
        show: The metrics, in this order; empty for those that differ between runs.

    Raises:
        UnknownNameError: There is no such metric.
        LogError: There are no runs, or too many panels.
    """
    if not len(runs.indices):
        raise LogError("there are no runs to draw: run 0 has not ended")
    varied = [number for number, axis in enumerate(runs.axes) if len(axis.values) > 1]
    # The two parameters with the most values, in the order of the sweep, are the axes of maps.
    shown = tuple(sorted(sorted(varied, key=lambda number: -len(runs.axes[number].values))[:2]))
    if runs.drawn:
        shown = ()  # the drawn parameter is the axis of each panel
    others = [number for number in varied if number not in shown]
    facets = int(np.prod([len(runs.axes[number].values) for number in others]))
    facets *= max(1, len(runs.variants)) if len(shown) == 2 else max(1, len(runs.drawn))
    metrics = _chosen(runs, show, max(1, _USUAL // facets))
    if facets * len(metrics) > _MOST:
        said = f"{len(metrics)} metrics in {facets:,} panels each are too many for one picture (at most {_MOST} panels)"
        raise LogError(f"{said}; show fewer metrics, or sweep over fewer parameters at once")
    panels: list[MetricPanel] = []
    methods: set[str] = set()
    for metric in metrics:
        for parts in [parted(runs, each) for each in runs.drawn] or (None,):
            # Maps show no intervals, which would take seconds for many cells; while runs proceed, the parts keep
            # changing.
            with_intervals = len(shown) < 2 and (parts is None or runs.intervals.is_final)
            estimates = estimated(runs, metric, with_intervals, parts)
            methods.update(estimates.method)
            panels += _panels(runs, metric, estimates, shown, others, parts)
    return SweepPicture(runs, tuple(panels), tuple(_notes(runs, metrics, panels[0].kind, sorted(methods))))


def _chosen(runs: FinishedRuns, show: Sequence[str], usual: int) -> list[MetricColumn]:
    for name in show:
        if name not in runs.metrics:
            known = list(runs.metrics)
            raise UnknownNameError(f"there is no metric {name!r}; there are {', '.join(known)}", name, known)
    if show:
        return [runs.metrics[name] for name in dict.fromkeys(show)]
    shares = [each for each in runs.metrics.values() if each.name.startswith("satisfied.")]
    differing = [each for each in runs.metrics.values() if each.varies and each not in shares]
    found = [*shares, *differing][:usual]
    if not found:
        raise LogError("no metric differs from run to run; say with --show which to draw")
    return found


def _panels(
    runs: FinishedRuns,
    metric: MetricColumn,
    estimates: CellEstimates,
    shown: tuple[int, ...],
    others: list[int],
    parts: DrawnParts | None,
) -> Iterator[MetricPanel]:
    variants = len(runs.axes)
    series = tuple(runs.variants) or ("",)
    is_map = len(shown) == 2
    facets = [*others, variants] if is_map and runs.variants else others
    kind: Kind = "scatter" if parts else "map" if is_map else "curve" if shown else "distribution"
    for place in itertools.product(*(range(runs.shape[number]) for number in facets)):
        fixed = dict(zip(facets, place, strict=True))
        # Axes that are neither free nor fixed have one value.
        free = shown if variants in fixed else (*shown, variants)
        index = tuple(slice(None) if number in free else fixed.get(number, 0) for number in range(variants + 1))

        def part(values: Array, index: tuple[int | slice, ...] = index, fixed: dict[int, int] = fixed) -> Array:
            found = np.asarray(values[index])
            # Series come first; parts are last already.
            return found[None] if variants in fixed else found if parts else np.moveaxis(found, -1, 0)

        names = [
            series[at] if number == variants else f"{runs.axes[number].name} = {runs.axes[number].labels[at]}"
            for number, at in fixed.items()
        ]
        yield MetricPanel(
            kind,
            metric,
            (parts.axis,) if parts else tuple(runs.axes[number] for number in shown),
            (series[fixed[variants]],) if variants in fixed else series,
            ", ".join(names),
            part(estimates.value),
            part(estimates.lower),
            part(estimates.upper),
            part(estimates.low),
            part(estimates.high),
            () if shown else tuple(metric.values[own] for own in _own(runs, metric, fixed)),
            tuple(parts.parameter.values[own] for own in _own(runs, metric, fixed)) if parts else (),
            parts.parameter.scale if parts else "linear",
            None if metric.infinite is None else (part(estimates.infinite[0]), part(estimates.infinite[1])),
        )


def _own(runs: FinishedRuns, metric: MetricColumn, fixed: Mapping[int, int]) -> Iterator[NDArray[np.bool_]]:
    """Yield, for each variant, which runs have a value at fixed values of some axes."""
    places = np.unravel_index(runs.cells(), runs.shape)
    here = ~np.isnan(metric.values)
    for number, at in fixed.items():
        here &= places[number] == at
    for variant in range(runs.shape[-1]):
        yield here & (places[-1] == variant)


def _notes(runs: FinishedRuns, metrics: Sequence[MetricColumn], kind: str, methods: Sequence[str]) -> Iterator[str]:
    ended = len(runs.indices)
    if methods:
        yield f"Intervals hold with {100 * runs.intervals.confidence:g} % each: {', '.join(methods)}."
    if kind == "curve" and not runs.variants and not all(metric.is_share for metric in metrics):
        yield "Paler: the middle 80 % of the runs."
    if kind == "scatter":
        yield "Faint: the runs. Lines: means over as many runs each, or over the runs with the same value."
    if not runs.intervals.is_independent:
        yield "The runs depend on each other by their design: no intervals."
    if not runs.intervals.is_final:
        if ended < runs.planned:
            yield f"{ended:,} of at most {runs.planned:,} runs."
        if (
            kind != "map"
            and runs.intervals.is_independent
            and not all(metric.is_share or metric.bounds for metric in metrics)
        ):
            yield "Means without declared bounds have no interval that holds at every number of runs."
    if runs.failed:
        yield f"{runs.failed:,} of {ended:,} runs failed or were lost, and have no metrics."
    for metric in metrics:
        infinite = metric.infinite if metric.infinite is not None else np.zeros(0, np.int8)
        for sign, word in ((-1, "-inf"), (1, "inf")):
            if count := int((infinite == sign).sum()):
                yield f"{metric.name}: {word} in {count:,} of {ended:,} runs, which no mean includes."
        missing = int(np.isnan(metric.values).sum()) - int(np.count_nonzero(infinite))
        missing -= 0 if metric.is_share else runs.failed
        if missing > 0:
            yield f"{metric.name}: {missing:,} runs have no value."
