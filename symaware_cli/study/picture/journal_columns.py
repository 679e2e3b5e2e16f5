"""From the journal of a sweep to its finished runs in columns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import Any

import numpy as np

from symaware_cli.study.folder import JOURNAL, SweepFolder
from symaware_cli.study.metrics import BUILT_IN
from symaware_cli.study.picture.finished_runs import FinishedRuns, MetricColumn, ParameterAxis
from symaware_cli.study.row import Row
from symaware_cli.study.sweep_document import SweepDocument
from symaware_cli.study.sweep_journal import SweepJournal


def finished_runs(folder: SweepFolder) -> FinishedRuns:
    """Read the runs of a sweep that have ended, up to the first that has not.

    A run that is not done has no values. Of a run that is, a specification counts as satisfied only if its verdict says
    so: undecided ones count against it.
    """
    with SweepJournal(folder.path / JOURNAL) as journal:
        numbered = takewhile(lambda each: each[0] == each[1].index, enumerate(journal.rows()))
        rows = [row for _, row in numbered]
    plan = folder.plan
    return FinishedRuns(
        name=folder.path.resolve().name,
        seed=plan.document.seed,
        axes=tuple(_axes(plan.document)),
        variants=tuple(plan.document.variants),
        planned=plan.count,
        failed=sum(row.state != "done" for row in rows),
        indices=np.arange(len(rows)),
        metrics={each.name: each for each in _metrics(rows, folder.specifications)},
    )


def _axes(document: SweepDocument) -> Iterator[ParameterAxis]:
    """The parameters in the order in which a plan combines them; see `sweep_plan`."""
    for path, values in document.over.items():
        yield ParameterAxis(path, values)
    for lists in document.together:
        if len(lists) == 1:
            yield from (ParameterAxis(path, values) for path, values in lists.items())
        elif lists:
            yield ParameterAxis(", ".join(lists), [list(each) for each in zip(*lists.values(), strict=True)])


def _metrics(rows: Sequence[Row], specifications: Sequence[str]) -> Iterator[MetricColumn]:
    for name in specifications:
        verdicts = [row.verdicts.get(name) if row.state == "done" else None for row in rows]
        yield _column(f"satisfied.{name}", "", True, [each and each == "satisfied" for each in verdicts])
        yield _column(f"robustness.{name}", "", False, [row.robustness.get(name) for row in rows])
    for each in BUILT_IN:
        if each.kind != "text":
            yield _column(each.name, each.unit, each.kind == "truth", [row.metrics.get(each.name) for row in rows])


def _column(name: str, unit: str, is_share: bool, values: Sequence[Any]) -> MetricColumn:
    numbers = np.array([math.nan if each is None else float(each) for each in values], float)
    # What is infinite, such as the robustness of what cannot fail, has no mean.
    return MetricColumn(name, unit, is_share, np.where(np.isfinite(numbers), numbers, np.nan))
