"""From the journal of a sweep to its finished runs in columns."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from symaware_cli.scenario.catalogue import Catalogue
from symaware_cli.study.custom_metrics import CustomMetrics
from symaware_cli.study.findings import intervals_of
from symaware_cli.study.folder import SweepFolder
from symaware_cli.study.metrics import NUMERIC
from symaware_cli.study.picture.finished_runs import (
    Array,
    DrawnParameter,
    FinishedRuns,
    MetricColumn,
    ParameterAxis,
)
from symaware_cli.study.row import Row
from symaware_cli.study.sweep_document import SweepDocument
from symaware_cli.study.sweep_files import JOURNAL
from symaware_cli.study.sweep_journal import SweepJournal
from symaware_cli.study.sweep_plan import SweepPlan


def finished_runs(folder: SweepFolder) -> FinishedRuns:
    """Read the runs of a sweep that have ended, those of each combination up to its first that has not.

    A specification counts as satisfied only if its verdict says so: a run that failed or was undecided counts against
    it. One that was lost has no values at all.
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
    """The parameters in the order in which a plan combines them; see `sweep_plan`."""
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
            yield DrawnParameter(path, np.array(values, float), None, drawn.log_uniform is not None)
        else:
            places = {json.dumps(option): place for place, option in enumerate(drawn.choice)}
            numbers = [places[json.dumps(value)] for value in values]
            yield DrawnParameter(path, np.array(numbers, float), drawn.choice)


def _metrics(rows: Sequence[Row], specifications: Sequence[str], document: SweepDocument) -> Iterator[MetricColumn]:
    for name in specifications:
        verdicts = [None if row.state == "lost" else row.verdicts.get(name) == "satisfied" for row in rows]
        yield MetricColumn(f"satisfied.{name}", "", True, _numbers(verdicts))
        yield MetricColumn(f"robustness.{name}", "", False, _numbers([row.robustness.get(name) for row in rows]))
    further = [each for each in CustomMetrics(document, Catalogue()).descriptions() if each.kind != "text"]
    for each in [*NUMERIC, *further]:
        values = _numbers([row.metrics.get(each.name) for row in rows])
        low, high = document.bounds.get(each.name, (math.inf, -math.inf))
        is_within = bool(((values >= low) & (values <= high) | np.isnan(values)).all())
        declared = (low, high) if is_within and low < high else None
        yield MetricColumn(each.name, each.unit, each.kind == "truth", values, declared)


def _numbers(values: Sequence[Any]) -> Array:
    numbers = np.array([math.nan if each is None else float(each) for each in values], float)
    # What is infinite, such as the robustness of what cannot fail, has no mean.
    return np.where(np.isfinite(numbers), numbers, np.nan)
