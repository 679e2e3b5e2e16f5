"""Makes runs of a plan in this process: what they share is read and composed once, and they are batched if they can be.

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
from symaware_cli.studies.batch import Batch, Start, batch_size, refusal, starts_of
from symaware_cli.studies.custom_metrics import CustomMetrics, Followers, typed
from symaware_cli.studies.measurement import Measurement, RunMeasurement
from symaware_cli.studies.metrics import MetricDescription, RunFigures, agent_verdicts, figures
from symaware_cli.studies.row import Row
from symaware_cli.studies.sweep_document import SweepDocument
from symaware_cli.studies.sweep_plan import ParameterChange

#: How many scenarios are kept ready, and how many runs are looked at together to find those that can be batched.
_MOST_READY = 256

#: Wall time between two garbage collections [s]; each takes less than a tenth of it.
_UNCOLLECTED = 1.0

#: Where something lies in memory, which no two processes agree on.
_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")


Value = TypeVar("Value")


class MetricError(Exception):
    """A metric has no value, or one of another type than it declares."""


class RunPlan(Protocol):
    """Which runs there are, by their numbers: the plan of a sweep, or the candidates of a search."""

    @property
    def document(self) -> SweepDocument:
        """What is said of all of them: time-outs and further metrics."""

    def changes(self, index: int) -> Sequence[ParameterChange]:
        """Return all that a run changes in the scenario, in this order."""

    def seed(self, index: int) -> int | None:
        """Return the seed of a run; None for that of the scenario."""


class Runner:
    """Makes runs of a plan."""

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
            batch: How many runs are batched at most; 1 for none, None for as many as fit in a bounded memory.
            follow: Called before runs begin, with their numbers and what runs.
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
        """Make some runs, and yield their rows in any order.

        Args:
            indices: Their numbers.
            logs: The folder for their logs; None if they are not recorded.

        Raises:
            KeyboardInterrupt: A signal ended one.
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
        """Say in one line why some runs are made one by one; None if those that are alike are batched."""
        kinds = [self._kind(index) for index in indices]
        template = self._template(kinds[0], indices[0])
        if isinstance(template, str):
            return template
        if len(kinds) > 1 and len({*kinds}) == len(kinds):
            return "runs differ in more than seeds, initial states and knowledge"
        return None

    def prepare(self) -> None:
        """Import all that it takes to build the first run."""
        with suppress(ScenarioError):  # values that were drawn for its seed
            self._built(0)

    def _template(self, kind: str, index: int) -> Built | str:
        """A run, built to make others of its kind together with it, or why they cannot be batched."""
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
        """Make runs of one kind together; one by one if anything goes wrong."""
        self._free_earlier_runs()
        began = time.monotonic()
        seeds = [template.document.seed if (seed := self._plan.seed(index)) is None else seed for index in indices]
        first = self._composition(indices[0])
        starts: list[Mapping[str, Start]] = []
        try:
            if any(self._composition(index) is not first for index in indices):
                # Each is built, so that what is refused alone is refused here.
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
        """Make a run.

        Args:
            index: Its number.
            logs: The folder for its log; None if it is not recorded.

        Raises:
            KeyboardInterrupt: A signal ended it; there is no row.
        """
        self._free_earlier_runs()
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
        """Return the resolved scenario of a run, as its log has it.

        Raises:
            ScenarioError: See `_built`.
        """
        return self._built(index).resolved

    def _built(self, index: int) -> Built:
        """Build a run.

        Raises:
            ScenarioError: Values that were drawn for its seed are not valid.
        """
        composition = self._composition(index).copy()
        return build_composition(composition, self._scenario.parent, self._plan.seed(index), self._catalogue)

    def _composition(self, index: int) -> Composition:
        return self._composed(index)[0]

    def _kind(self, index: int) -> str:
        """What runs have in common that can be batched."""
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
    """A hash of a scenario but for what runs of a batch differ in: seed, initial states, and values of knowledge."""
    data = {name: each for name, each in composition.data.items() if name not in ("seed", "parameters")}
    if isinstance(agents := data.get("agents"), dict):
        data["agents"] = {group: _without_start(each) for group, each in agents.items()}
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


def _without_start(group: Any) -> Any:
    """An entry of agents without how they begin."""
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
