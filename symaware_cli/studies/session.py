"""Execution of a sweep: distributes runs, writes their rows to the journal, and builds the table.

Reasons: docs/decisions/0031-sweeps.md
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.studies import sweep_table, table_file
from symaware_cli.studies.cell_stops import CellStops
from symaware_cli.studies.executor import Blocks, Executor, signals_raised
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.row import Row
from symaware_cli.studies.statistics.interval_estimate import IntervalEstimate
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_execution import SweepTask, execution_at
from symaware_cli.studies.sweep_files import JOURNAL, TABLE, TIMES
from symaware_cli.studies.sweep_journal import Counts, SweepJournal

if TYPE_CHECKING:
    import pyarrow


#: The number of runs per cell in a block of runs that can be batched, before their duration is known.
_BATCHED = 16


@dataclass(frozen=True, slots=True)
class SweepProgress:
    """The progress of a sweep.

    Attributes:
        planned: The number of planned runs.
        made: The number of runs with a row.
        failed: The number of failed runs.
        lost: The number of lost runs.
        rate: Runs per second since this process started; 0 before the first.
        estimates: Returns the estimates so far, with anytime-valid intervals.
    """

    planned: int
    made: int
    failed: int
    lost: int
    rate: float
    estimates: Callable[[], Mapping[str, IntervalEstimate]]

    @property
    def time_left(self) -> float:
        """The expected time until the sweep is complete [s]."""
        return (self.planned - self.made) / self.rate if self.rate else math.inf


@dataclass(frozen=True, slots=True)
class SweepOutcome:
    """Counts of finished, failed and lost runs of a sweep, and why it ended.

    Attributes:
        folder: Its folder.
        planned: The number of planned runs.
        counts: The number of runs in each state.
        made: The number of runs executed by this call.
        wall_time: The wall time of this call [s].
        is_interrupted: Whether a signal ended the sweep.
        stopped: Why it ended early, if it did.
        rule: The rule that left out runs, if any were left out.
        one_by_one: Why its runs were executed one by one; None if they were batched.
    """

    folder: Path
    planned: int
    counts: Counts
    made: int
    wall_time: float
    is_interrupted: bool = False
    stopped: str | None = None
    rule: str | None = None
    one_by_one: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the object as plain data."""
        return {
            "folder": str(self.folder),
            "table": str(self.folder / TABLE),
            "runs": self.planned,
            **self.counts._asdict(),
            "made_now": self.made,
            "wall_time": self.wall_time,
            "interrupted": self.is_interrupted,
            "stopped": self.stopped,
            "until": self.rule,
            "one_by_one": self.one_by_one,
        }


def conduct(
    folder: SweepFolder,
    jobs: int,
    *,
    place: str | None = None,
    batch: int | None = None,
    retry_lost: bool = False,
    fail_fast: bool = False,
    on_progress: Callable[[SweepProgress], object] | None = None,
) -> SweepOutcome:
    """Execute all runs of a sweep that have no row yet, and write the table.

    Args:
        folder: The folder of the sweep.
        jobs: The number of worker processes; 0 to execute all runs in this process.
        place: The place of execution; see `execution_at`. On other machines, `jobs` is the number of concurrent runs, 0
            for as many as possible.
        batch: The maximum number of runs per batch; 1 for no batches, None for as many as fit in memory.
        retry_lost: Whether to repeat lost runs.
        fail_fast: Whether to stop at the first failed run.
        on_progress: Called after each run.

    Raises:
        SweepError: The folder is in use, its rows would not be comparable, or there is no such cluster.
        WorkerPoolError: No worker process can be started.
    """
    began = time.monotonic()
    with folder.locked(), SweepJournal(folder.path / JOURNAL) as journal:
        folder = SweepFolder.opened(folder.path)  # another process may have added runs in the meantime
        folder.check()
        (folder.path / TABLE).unlink(missing_ok=True)  # it will be incomplete
        if retry_lost:
            journal.forget("lost")
        session = _Session(folder, journal, jobs, place, batch, on_progress)
        interrupted = False
        try:
            with signals_raised():
                session.make_all(fail_fast)
                session.keep_logs()
        except KeyboardInterrupt:
            interrupted = True
        journal.commit()
        write_table(folder, journal)
        return SweepOutcome(
            folder.path,
            session.stops.planned,
            journal.counts(),
            session.made,
            time.monotonic() - began,
            interrupted,
            session.stopped,
            session.stops.reason,
            folder.one_by_one(batch),
        )


class _Session:
    """The work of one process on a sweep.

    Attributes:
        made: The number of executed runs.
        stopped: Why it ended early, if it did.
    """

    def __init__(
        self,
        folder: SweepFolder,
        journal: SweepJournal,
        jobs: int,
        place: str | None,
        batch: int | None,
        on_progress: Callable[[SweepProgress], object] | None,
    ) -> None:
        self._batch = batch
        self.made = 0
        self.stopped: str | None = None
        self._folder = folder
        self._journal = journal
        self._jobs = jobs
        self._place = place
        self._on_progress = on_progress
        self._counts = journal.counts()
        self.stops = CellStops(folder.plan, folder.specifications)
        for row in journal.rows():
            self.stops.add(row)
        self._began = time.monotonic()

    def make_all(self, fail_fast: bool) -> None:
        """Execute all runs that have no row."""
        plan = self._folder.plan
        known = self._journal.indices()
        missing = plan.count - len(known)
        if not missing:
            return
        blocks = Blocks(
            (index for index in range(plan.count) if index not in known and self.stops.wants(index)),
            missing,
            is_recorded=plan.document.keep == "all",
            least=self._least(),
        )
        with self._executor(missing) as executor:
            for row in executor.results(blocks):
                self._note(row)
                if fail_fast and row.state == "failed":
                    self.stopped = f"run {row.index} failed: {row.error}"
                    return
        self._journal.drop(index for index in range(plan.count) if not self.stops.wants(index))

    def _least(self) -> int:
        """Return the minimum number of runs per block: enough for a batch of each cell, if runs can be batched.

        Otherwise runs that take long individually would never be batched, although that is many times as fast.
        """
        plan = self._folder.plan
        if plan.document.keep == "all" or self._folder.one_by_one(self._batch) is not None:
            return 1
        return min(self._batch or _BATCHED, _BATCHED) * len(plan.cells)

    def keep_logs(self) -> None:
        """Repeat the runs whose logs are kept to record them, and remove the references to all other logs."""
        wanted = set(_kept(self._folder.plan.document.keep, self._journal))
        have = {row.index: row for row in self._journal.rows() if row.log}
        missing = sorted(wanted - have.keys())
        if missing:
            with self._executor(len(missing)) as executor:
                for row in executor.results(Blocks(missing, len(missing), is_recorded=True)):
                    former = self._journal.row(row.index)
                    if former is not None and row.state != "lost" and row.digest != former.digest:
                        raise SweepError(f"run {row.index} had another result when it was repeated for its log")
                    self._journal.keep_logs([(row.index, row.log)])
        self._journal.keep_logs([(index, None) for index in have if index not in wanted])
        used = {row.log for row in self._journal.rows() if row.log}
        for file in self._folder.logs.iterdir():
            if file.name not in used:
                file.unlink()

    def _note(self, row: Row) -> None:
        folder = self._folder
        self._journal.add(row, folder.plan, folder.identity.of_run(folder.plan, row.index))
        self.stops.add(row)
        self.made += 1
        counts = self._counts._asdict()
        counts[row.state] += 1
        self._counts = Counts(**counts)
        if self._on_progress is not None:
            rate = self.made / (time.monotonic() - self._began)
            self._on_progress(
                SweepProgress(
                    *(self.stops.planned, self._counts.all, self._counts.failed, self._counts.lost, rate),
                    self.stops.estimates,
                )
            )

    def _executor(self, count: int) -> AbstractContextManager[Executor[Row]]:
        execution, address = execution_at(self._place)
        return execution.executor(SweepTask(self._folder, address, self._jobs, count, self._batch))


def rows_so_far(folder: SweepFolder) -> pyarrow.Table:
    """Return the table of all existing rows: as written, or from the journal of an unfinished sweep."""
    import pyarrow

    written = table_file.read(folder.path)
    if written is not None:
        return written[0]
    plan, names = folder.plan, folder.specifications
    with SweepJournal(folder.path / JOURNAL) as journal:
        found = list(sweep_table.batches(journal.records(), plan, names))
    return pyarrow.Table.from_batches(found, sweep_table.schema(plan, names))


def write_table(folder: SweepFolder, journal: SweepJournal) -> None:
    """Write the table of all existing rows."""
    plan, names = folder.plan, folder.specifications
    table_file.write(
        folder.path / TABLE, sweep_table.batches(journal.records(), plan, names), sweep_table.schema(plan, names)
    )
    sweep_table.write_times(folder.path / TIMES, journal.times())


def _kept(policy: str, journal: SweepJournal) -> Iterator[int]:
    """Yield the numbers of the runs whose logs are kept."""
    if policy == "failed":
        yield from (row.index for row in journal.rows("failed"))
    elif policy == "all":
        yield from (row.index for row in journal.rows() if row.state != "lost")
    elif policy.startswith("worst:"):
        ranked = sorted((_merit(row), row.index) for row in journal.rows("done"))
        yield from (index for _, index in ranked[: int(policy.partition(":")[2])])


def _merit(row: Row) -> float:
    """Return the merit of a run: its least robustness or, without specifications, its least separation."""
    values = [value for value in row.robustness.values() if value is not None]
    if row.robustness:
        return min(values, default=math.inf)
    closest = row.metrics["closest"]
    return math.inf if closest is None else float(closest)
