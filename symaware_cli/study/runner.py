"""Makes runs of a plan in this process: each cell is read and composed once, its runs are batched where they can be."""

from __future__ import annotations

import gc
import os
import re
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from symaware_cli.recording.digest import digest
from symaware_cli.recording.reader import open_log
from symaware_cli.runtime.failure import describe
from symaware_cli.runtime.run_summary import RunSummary
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.scenario.build import Built, build_composition
from symaware_cli.scenario.catalogue import Catalogue
from symaware_cli.scenario.compose import Composition, compose
from symaware_cli.scenario.execution import prepared
from symaware_cli.scenario.problem import ScenarioError
from symaware_cli.study.agent_verdicts import agent_verdicts
from symaware_cli.study.batch import Batch, batch_size, refusal
from symaware_cli.study.custom_metrics import CustomMetrics, Followers, typed
from symaware_cli.study.measurement import Measurement, RunMeasurement
from symaware_cli.study.metrics import MetricDescription, RunFigures, figures
from symaware_cli.study.row import Row
from symaware_cli.study.sweep_plan import SweepPlan
from symaware_cli.study.sweep_source import texts_of

#: How many cells are kept ready.
_MOST_READY = 256

#: How many runs are made between two garbage collections.
_MOST_UNCOLLECTED = 500

#: Where something lies in memory, which no two processes agree on.
_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")


Value = TypeVar("Value")


class MetricError(Exception):
    """A metric has no value, or one of another type than it declares."""


class Runner:
    """Makes runs of a plan."""

    def __init__(
        self,
        plan: SweepPlan,
        scenario: Path,
        batch: int | None = None,
        follow: Callable[[Sequence[int], Simulation], object] | None = None,
    ) -> None:
        """Prepare.

        Args:
            plan: The plan.
            scenario: The scenario file.
            batch: How many runs are batched at most; 1 for none, None for as many as fit in a bounded memory.
            follow: Called before runs begin, with their numbers and what runs.
        """
        self._follow = follow
        self._batch = batch
        self._since_collection = 0
        self._templates: OrderedDict[int, Built | str] = OrderedDict()
        self._plan = plan
        self._scenario = scenario
        self._catalogue = Catalogue()
        self._ready: OrderedDict[int, Composition] = OrderedDict()
        self._custom = CustomMetrics(plan.document, self._catalogue)
        self._described = self._custom.descriptions()

    def rows(self, indices: Sequence[int], logs: Path | None = None) -> Iterator[Row]:
        """Make some runs, and yield their rows in any order.

        Args:
            indices: Their numbers.
            logs: The folder for their logs; None if they are not recorded.

        Raises:
            KeyboardInterrupt: A signal ended one.
        """
        of_cells: dict[int, list[int]] = {}
        for index in indices:
            of_cells.setdefault(self._plan.cell(index).number, []).append(index)
        for own in of_cells.values():
            template = self._template(own[0]) if logs is None and len(own) > 1 else ""
            if isinstance(template, str):
                yield from (self.run(index, logs) for index in own)
                continue
            size = min(self._batch or len(own), batch_size(template))
            for start in range(0, len(own), size):
                yield from self._batched(own[start : start + size], template)
        self._since_collection += len(indices)
        if self._since_collection >= _MOST_UNCOLLECTED:
            # Runs consist of objects that refer to each other, and full collections are rare.
            gc.collect()
            self._since_collection = 0

    def refusal(self, index: int) -> str | None:
        """Say in one line why the runs of a run's cell are made one by one; None if they are batched."""
        template = self._template(index)
        return template if isinstance(template, str) else None

    def prepare(self) -> None:
        """Import all that it takes to build the first run."""
        with suppress(ScenarioError):  # values that were drawn for its seed
            self._built(0)

    def _template(self, index: int) -> Built | str:
        """The cell of a run, built for any seed, or why its runs cannot be batched."""
        number = self._plan.cell(index).number
        if number not in self._templates:
            if len(self._templates) >= _MOST_READY:
                self._templates.popitem(last=False)
            self._templates[number] = self._new_template(index)
        return self._templates[number]

    def _new_template(self, index: int) -> Built | str:
        if self._batch == 1:
            return "batches are switched off"
        if self._plan.document.drawn:
            return "each run draws parameters of its own"
        if self._plan.document.timeout is not None:
            return "each run has a time-out of its own"
        if self._plan.document.metrics:
            return "further metrics follow each run by itself"
        try:
            built = self._built(index)
        except (ScenarioError, OSError):
            return "the scenario has problems"
        if self._follow is not None and built.options.until is not None:
            return "what is followed is to end with its run"
        return refusal(built) or built

    def _batched(self, indices: Sequence[int], template: Built) -> Iterator[Row]:
        """Make runs of one cell together; one by one if anything goes wrong."""
        began = time.monotonic()
        seeds = [self._plan.seed(index) for index in indices]
        try:
            batch = Batch(self._composition(indices[0]).copy(), template, seeds)
        except ScenarioError:
            yield from map(self.run, indices)
            return
        if self._follow is not None:
            self._follow(indices, batch.simulation)
        with batch.simulation.environment:
            batch.advance()
        if batch.run.signal is not None:
            raise KeyboardInterrupt
        if batch.run.status != "finished":
            yield from map(self.run, indices)
            return
        found = zip(indices, batch.summaries(), batch.measurement.finish(), strict=True)
        monitors, runs = batch.run.specification_monitors, len(indices)
        share = (time.monotonic() - began) / runs
        yield from [
            _row(index, summary, measured, batch.simulation, agent_verdicts(monitors, run, runs), share)
            for run, (index, summary, measured) in enumerate(found)
        ]

    def run(self, index: int, logs: Path | None = None) -> Row:
        """Make a run.

        Args:
            index: Its number.
            logs: The folder for its log; None if it is not recorded.

        Raises:
            KeyboardInterrupt: A signal ended it; there is no row.
        """
        began = time.monotonic()
        log = None if logs is None else logs / f".{index}.{os.getpid()}.mcap"
        try:
            row = self._made(index, log)
        except (ScenarioError, MetricError, OSError) as error:
            # Such as values that were drawn for this seed and that no world takes.
            row = Row(index, "failed", error=_told(str(error)))
        if log is not None and logs is not None:
            row = replace(row, log=_filed(log, logs))
        return replace(row, wall_time=time.monotonic() - began)

    def _made(self, index: int, log: Path | None) -> Row:
        plan = self._plan
        built = self._built(index)
        timeout = plan.document.timeout
        with prepared(built, log, timeout=timeout, may_exit=False) as run:
            followers = _called("metrics", partial(self._custom.followers, built.simulation))
            measurement = Measurement(built.simulation)
            if self._follow is not None:
                self._follow([index], built.simulation)
            run.advance()
            measured, custom = None, {}
            if run.status == "finished":
                measured = measurement.finish()[0]
                _called("metrics", followers.look)
                custom = {each.name: _called(each.name, partial(_value, each, followers)) for each in self._described}
        if run.failure is not None:
            return Row(index, "failed", error=_told(str(run.failure)), trace=_told(run.failure.trace) or None)
        if run.signal is not None:
            raise KeyboardInterrupt
        summary = run.summary
        if measured is None:
            return Row(index, "lost", error=f"it did not end within {timeout:g} s")
        row = _row(index, summary, measured, built.simulation, agent_verdicts(run.specification_monitors))
        return replace(row, metrics={**row.metrics, **custom}) if custom else row

    def _built(self, index: int) -> Built:
        """Build a run.

        Raises:
            ScenarioError: Values that were drawn for its seed are not valid.
        """
        composition = self._composition(index).copy()
        return build_composition(composition, self._scenario.parent, self._plan.seed(index), self._catalogue)

    def _composition(self, index: int) -> Composition:
        if self._plan.document.drawn:  # each run is another scenario
            return compose(self._scenario, texts_of(self._plan.changes(index)))
        cell = self._plan.cell(index)
        found = self._ready.pop(cell.number, None)
        if found is None:
            found = compose(self._scenario, texts_of(self._plan.changes(index)))
            if len(self._ready) >= _MOST_READY:
                self._ready.popitem(last=False)
        self._ready[cell.number] = found
        return found


def _row(
    index: int,
    summary: RunSummary,
    measured: RunMeasurement,
    simulation: Simulation,
    by_agent: Mapping[str, Any],
    wall_time: float = 0.0,
) -> Row:
    """The row of a run that came to its end."""
    return Row(
        index,
        "done",
        verdicts={each.name: each.verdict for each in summary.specifications},
        robustness={each.name: each.robustness for each in summary.specifications},
        metrics={**figures(RunFigures(summary, measured, simulation)), **by_agent},
        digest=measured.digest,
        wall_time=wall_time,
    )


def _value(description: MetricDescription, followers: Followers) -> Any:
    return typed(followers.by_name[description.name].value(), description.kind)


def _called(name: str, call: Callable[[], Value]) -> Value:
    """Call what belongs to a metric.

    Raises:
        MetricError: It fails.
    """
    try:
        return call()
    except Exception as error:
        raise MetricError(f"{name}: {describe(error)}") from error


def _told(text: str) -> str:
    """Return what went wrong, in text that can be stored, without what differs from process to process."""
    return _ADDRESS.sub("0x...", text.encode("utf-8", "backslashreplace").decode())


def _filed(log: Path, logs: Path) -> str | None:
    """Call a log by what it says, so that equal logs are one file; None where there is none."""
    if not log.exists():
        return None
    name = f"{digest(open_log(log)).combined[:32]}.mcap"
    os.replace(log, logs / name)
    return name
