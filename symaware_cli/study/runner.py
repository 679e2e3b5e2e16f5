"""Makes single runs of a plan, in this process: each cell is read and composed once."""

from __future__ import annotations

import os
import re
import time
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

from symaware_cli.recording.digest import digest
from symaware_cli.recording.reader import open_log
from symaware_cli.scenario.build import build_composition
from symaware_cli.scenario.catalogue import Catalogue
from symaware_cli.scenario.compose import Composition, compose
from symaware_cli.scenario.execution import prepared
from symaware_cli.scenario.problem import ScenarioError
from symaware_cli.study.measurement import Measurement
from symaware_cli.study.metrics import RunFigures, figures
from symaware_cli.study.row import Row
from symaware_cli.study.sweep_plan import SweepPlan
from symaware_cli.study.sweep_source import texts_of

#: How many cells are kept ready.
_MOST_READY = 256

#: Where something lies in memory, which no two processes agree on.
_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")


class Runner:
    """Makes runs of a plan, one at a time."""

    def __init__(self, plan: SweepPlan, scenario: Path) -> None:
        """Prepare.

        Args:
            plan: The plan.
            scenario: The scenario file.
        """
        self._plan = plan
        self._scenario = scenario
        self._catalogue = Catalogue()
        self._ready: OrderedDict[int, Composition] = OrderedDict()

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
        except (ScenarioError, OSError) as error:
            # Such as values that were drawn for this seed and that no world takes.
            row = Row(index, "failed", error=_told(str(error)))
        if log is not None and logs is not None:
            row = replace(row, log=_filed(log, logs))
        return replace(row, wall_time=time.monotonic() - began)

    def _made(self, index: int, log: Path | None) -> Row:
        plan = self._plan
        built = build_composition(
            self._composition(index).copy(), self._scenario.parent, plan.seed(index), self._catalogue
        )
        timeout = plan.document.timeout
        with prepared(built, log, timeout=timeout, may_exit=False) as run:
            measurement = Measurement(built.simulation)
            run.advance()
            trace = measurement.finish() if run.status == "finished" else None
        if run.failure is not None:
            return Row(index, "failed", error=_told(str(run.failure)), trace=_told(run.failure.trace) or None)
        if run.signal is not None:
            raise KeyboardInterrupt
        summary = run.summary
        if summary.status != "finished":
            return Row(index, "lost", error=f"it did not end within {timeout:g} s")
        return Row(
            index,
            "done",
            verdicts={each.name: each.verdict for each in summary.specifications},
            robustness={each.name: each.robustness for each in summary.specifications},
            metrics=figures(RunFigures(summary, measurement, built.simulation)),
            digest=trace,
        )

    def _composition(self, index: int) -> Composition:
        cell = self._plan.cell(index)
        found = self._ready.pop(cell.number, None)
        if found is None:
            found = compose(self._scenario, texts_of(cell.changes))
            if len(self._ready) >= _MOST_READY:
                self._ready.popitem(last=False)
        self._ready[cell.number] = found
        return found


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
