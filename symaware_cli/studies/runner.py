"""Execution of the runs of a plan in this process; common inputs are read once, and runs are batched if possible.

Runs can be batched if they differ in nothing but their seeds, initial states and knowledge.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import re
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

from symaware_cli.engine import RunSummary, Simulation, describe
from symaware_cli.language import Catalogue, ScenarioError, prepared
from symaware_cli.language.build import Built, build_composition
from symaware_cli.language.compose import Composition, compose
from symaware_cli.log import open_log
from symaware_cli.log.digest import digest
from symaware_cli.studies.batch import Batch
from symaware_cli.studies.batch_simulation import Start, batch_size, refusal, starts_of
from symaware_cli.studies.custom_metrics import CustomMetrics, Followers, typed
from symaware_cli.studies.measurement import Measurement, RunMeasurement
from symaware_cli.studies.metrics import MetricDescription, RunFigures, agent_verdicts, figures
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_document import SweepDocument
from symaware_cli.studies.sweep_plan import ParameterChange

#: The number of scenarios kept composed, and the number of runs searched together for runs that can be batched.
_MOST_READY = 256

#: Wall time between two garbage collections [s]; each takes less than a tenth of it.
_UNCOLLECTED = 1.0

#: A memory address, which differs between processes.
_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")


Value = TypeVar("Value")


class MetricError(Exception):
    """A metric has no value, or its value has another type than declared."""


class RunPlan(Protocol):
    """A set of numbered runs: the plan of a sweep, or the candidates of a search."""

    @property
    def document(self) -> SweepDocument:
        """The settings common to all runs, such as the time-out and custom metrics."""

    def changes(self, index: int) -> Sequence[ParameterChange]:
        """Return all changes of a run to the scenario, in order."""

    def seed(self, index: int) -> int | None:
        """Return the seed of a run; None for the scenario's own."""


class Runner:
    """Executes the runs of a plan."""

    def __init__(
        self,
        plan: RunPlan,
        scenario: Path,
        batch: int | None = None,
        follow: Callable[[Sequence[int], Simulation], object] | None = None,
    ) -> None:
        """Prepare.

        Args:
            plan: The plan.
            scenario: The scenario file.
            batch: The maximum number of runs per batch; 1 for no batches, None for as many as fit in bounded memory.
            follow: Called before runs begin, with their numbers and the simulation.
        """
        self._follow = follow
        self._batch = batch
        self._collected = time.monotonic()
        self._templates: OrderedDict[str, Built | str] = OrderedDict()
        self._plan = plan
        self._scenario = scenario
        self._catalogue = Catalogue()
        self._ready: OrderedDict[tuple[tuple[str, str], ...], tuple[Composition, str]] = OrderedDict()
        self._custom = CustomMetrics(plan.document, self._catalogue)
        self._described = self._custom.descriptions()

    def rows(self, indices: Sequence[int], logs: Path | None = None) -> Iterator[Row]:
        """Execute runs, and yield their rows in any order.

        Args:
            indices: Their numbers.
            logs: The folder for their logs; None if they are not recorded.

        Raises:
            KeyboardInterrupt: A signal ended a run.
        """
        for begin in range(0, len(indices), _MOST_READY):
            groups: dict[str, list[int]] = {}
            for index in indices[begin : begin + _MOST_READY]:
                groups.setdefault(self._kind(index), []).append(index)
            for kind, own in groups.items():
                template = self._template(kind, own[0]) if logs is None and len(own) > 1 else ""
                if isinstance(template, str):
                    yield from (self.run(index, logs) for index in own)
                    continue
                size = min(self._batch or len(own), batch_size(template))
                for start in range(0, len(own), size):
                    yield from self._batched(own[start : start + size], template)

    def refusal(self, indices: Sequence[int]) -> str | None:
        """Return a one-line reason why runs are executed one by one; None if runs of the same kind are batched."""
        kinds = [self._kind(index) for index in indices]
        template = self._template(kinds[0], indices[0])
        if isinstance(template, str):
            return template
        if len(kinds) > 1 and len({*kinds}) == len(kinds):
            return "runs differ in more than seeds, initial states and knowledge"
        return None

    def prepare(self) -> None:
        """Import everything that is needed to build the first run."""
        with suppress(ScenarioError):  # invalid values drawn for its seed
            self._built(0)

    def _template(self, kind: str, index: int) -> Built | str:
        """Return a built run as the template of a batch of its kind, or the reason why it cannot be batched."""
        if kind not in self._templates:
            if len(self._templates) >= _MOST_READY:
                self._templates.popitem(last=False)
            self._templates[kind] = self._new_template(index)
        return self._templates[kind]

    def _new_template(self, index: int) -> Built | str:
        if self._batch == 1:
            return "batches are switched off"
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
        """Execute runs of one kind as a batch, or one by one if anything fails."""
        self._free_earlier_runs()
        began = time.monotonic()
        seeds = [template.document.seed if (seed := self._plan.seed(index)) is None else seed for index in indices]
        first = self._composition(indices[0])
        starts: list[Mapping[str, Start]] = []
        try:
            if any(self._composition(index) is not first for index in indices):
                # Each run is built, so that scenarios that are invalid alone are rejected here as well.
                starts = [starts_of(self._built(index)) for index in indices]
            batch = Batch(first.copy(), template, seeds, starts)
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
        """Execute a run.

        Args:
            index: Its number.
            logs: The folder for its log; None if it is not recorded.

        Raises:
            KeyboardInterrupt: A signal ended the run; there is no row.
        """
        self._free_earlier_runs()
        began = time.monotonic()
        log = None if logs is None else logs / f".{index}.{os.getpid()}.mcap"
        try:
            row = self._made(index, log)
        except (ScenarioError, MetricError, OSError) as error:
            # Such as values drawn for this seed that are invalid.
            row = Row(index, "failed", error=_told(str(error)))
        if log is not None and logs is not None:
            row = replace(row, log=_filed(log, logs))
        return replace(row, wall_time=time.monotonic() - began)

    def _free_earlier_runs(self) -> None:
        """Collect garbage: runs consist of objects that refer to each other, and may hold solvers of 100 MB."""
        if time.monotonic() - self._collected >= _UNCOLLECTED:
            gc.collect()
            self._collected = time.monotonic()

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

    def resolved(self, index: int) -> bytes:
        """Return the resolved scenario of a run, as written to its log.

        Raises:
            ScenarioError: See `_built`.
        """
        return self._built(index).resolved

    def tolerance(self, index: int) -> float | None:
        """Return the greatest tolerance to which components repeat their results; None if all are equal to the bit.

        Raises:
            ScenarioError: See `_built`.
        """
        return max(self._built(index).simulation.tolerances.values(), default=None)

    def _built(self, index: int) -> Built:
        """Build a run.

        Raises:
            ScenarioError: Values drawn for its seed are invalid.
        """
        composition = self._composition(index).copy()
        return build_composition(composition, self._scenario.parent, self._plan.seed(index), self._catalogue)

    def _composition(self, index: int) -> Composition:
        return self._composed(index)[0]

    def _kind(self, index: int) -> str:
        """Return the kind of a run; runs of the same kind can be batched."""
        try:
            return self._composed(index)[1]
        except (ScenarioError, OSError):
            return f"run {index} cannot be composed"

    def _composed(self, index: int) -> tuple[Composition, str]:
        changes = self._plan.changes(index)
        key = tuple((each.target, json.dumps(each.value)) for each in changes)
        found = self._ready.pop(key, None)
        if found is None:
            composition = compose(self._scenario, [each.assignment() for each in changes])
            found = composition, _kind_of(composition)
            if len(self._ready) >= _MOST_READY:
                self._ready.popitem(last=False)
        self._ready[key] = found
        return found


def _kind_of(composition: Composition) -> str:
    """Return a hash of a scenario without seed, initial states and knowledge values, which may differ in a batch."""
    data = {name: each for name, each in composition.data.items() if name not in ("seed", "parameters")}
    if isinstance(agents := data.get("agents"), dict):
        data["agents"] = {group: _without_start(each) for group, each in agents.items()}
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


def _without_start(group: Any) -> Any:
    """Return an entry of agents without its initial condition."""
    if not isinstance(group, dict):
        return group
    known = group.get("knowledge")
    names = sorted(known) if isinstance(known, dict) else known
    return {**group, "state": None, "knowledge": names}


def _row(
    index: int,
    summary: RunSummary,
    measured: RunMeasurement,
    simulation: Simulation,
    by_agent: Mapping[str, Any],
    wall_time: float = 0.0,
) -> Row:
    """Return the row of a run that reached its end."""
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
    """Call a function of a metric.

    Raises:
        MetricError: The function fails.
    """
    try:
        return call()
    except Exception as error:
        raise MetricError(f"{name}: {describe(error)}") from error


def _told(text: str) -> str:
    """Return an error message in storable text, without memory addresses, which differ between processes."""
    return _ADDRESS.sub("0x...", text.encode("utf-8", "backslashreplace").decode())


def _filed(log: Path, logs: Path) -> str | None:
    """Rename a log by its digest, so that equal logs share one file, and return its name; None without a log."""
    if not log.exists():
        return None
    name = f"{digest(open_log(log)).combined[:32]}.mcap"
    os.replace(log, logs / name)
    return name
