"""Branches of a run: repetitions of the run of a log up to an instant, with changes from that instant on."""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from symaware_cli.core import Event, nanoseconds
from symaware_cli.core.stateful import StateError
from symaware_cli.engine import RunSummary
from symaware_cli.evidence.branch_changes import BranchError, overrides_of
from symaware_cli.evidence.message_comparison import MessageComparison
from symaware_cli.evidence.shared_beginning import STEPS, SharedBeginning
from symaware_cli.language import (
    Assignment,
    Changes,
    FilePath,
    assignments,
    check_output,
    dotted,
    open_scenario,
    prepared,
)
from symaware_cli.language.build import Built
from symaware_cli.log import Log, OutputError, open_log, reason
from symaware_cli.log.logged_events import LoggedEvent

_EVENT = re.compile(r"\s*(?P<name>[\w-]+)\((?P<of>[^()]*)\)\s*(?P<shift>[+-]\s*[\d.]+)?\s*")

Way = Literal["capture", "repetition"]
"""How a branch reaches its instant: from a state captured there, or by repeating the run from its beginning."""

Instant: TypeAlias = float | str | Event | LoggedEvent
"""The instant or event at which a branch begins."""

Progress = Callable[[int, int], object]
"""Called with the number of completed steps and the total."""


@dataclass(frozen=True, slots=True)
class BranchResult:
    """A branch of a run.

    Attributes:
        log: The log that it branches from.
        at: The instant from which it may differ [s].
        equal: The number of messages before the instant, all of which are equal to those of the log.
        changes: The changes, in the form of ``--set``.
        summary: The summary of the branch, with the path of its own log.
        way: How the instant was reached.
        reason: Why the instant was reached by repetition, if a captured state was requested.
    """

    log: Path
    at: float
    equal: int
    changes: Sequence[str]
    summary: RunSummary
    way: Way = "repetition"
    reason: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {
            "log": str(self.log),
            "at": self.at,
            "equal": self.equal,
            "changes": list(self.changes),
            "way": self.way,
            "reason": self.reason,
            "run": self.summary.to_json(),
        }


def branch(
    log: FilePath,
    at: Instant,
    changes: Changes | None = None,
    output: FilePath | None = None,
    on_progress: Progress | None = None,
) -> BranchResult:
    """Repeat the run of a log up to an instant, and continue it with changes.

    Each change becomes a fault of the branch's scenario (docs/time.md, "Faults") that begins at the instant, so the
    branch is a run like any other: its log can be verified, compared and branched again. Without changes it equals the
    original run.

    Args:
        log: The log.
        at: The instant [s]; or an event of ``log.events()`` or of the run; or the description of an event with a shift,
            such as ``violated(safe) - 2.0``.
        changes: The changes at the instant, by path in the scenario: components, their parameters, knowledge, states;
            faults, which begin at the instant unless they specify a time; values under ``run``.
        output: The log of the branch; None to write none.
        on_progress: Called periodically.

    Raises:
        LogError: The log cannot be read or written.
        BranchError: There is no such instant, the change cannot begin at it, or the change affects the run before it.
        ScenarioError: The changed scenario is invalid.
        KeyboardInterrupt: A signal ended the run.
    """
    log = Path(log)
    original = _opened(log)
    target = None if output is None else Path(output)
    made = _Branch(log, original, _instant(original, log, at), assignments(changes), target)
    return made.result(None, on_progress)


def branches(
    log: FilePath,
    at: Instant,
    changes: Iterable[Changes],
    folder: FilePath | None = None,
    way: Way | None = None,
    on_progress: Progress | None = None,
) -> list[BranchResult]:
    """Create several branches of a log at one instant; see `branch`.

    The common beginning is executed once: the run is repeated to the instant, its state is captured, and each branch
    continues from it, with the same log as by repetition. Branches for which this is impossible repeat the run from its
    beginning, and give the reason.

    Args:
        log: The log.
        at: The instant, as for `branch`.
        changes: The changes of each branch.
        folder: The folder for the logs, ``0.mcap`` and so on, which is created; None to write none.
        way: How all branches reach the instant; None to use a captured state where possible and shared.
        on_progress: Called periodically.

    Raises:
        StateError: ``way`` is "capture", and a branch cannot continue from a captured state.
        LogError: As for `branch`, as are all further exceptions.
    """
    log = Path(log)
    original = _opened(log)
    instant = _instant(original, log, at)
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
    # All branches are built before the first one runs, so that mistakes are reported immediately.
    made = [
        _Branch(log, original, instant, assignments(each), None if folder is None else Path(folder, f"{number}.mcap"))
        for number, each in enumerate(changes)
    ]
    beginning = None
    if way == "capture" or (way is None and len(made) > 1):
        beginning = SharedBeginning(log, original, instant, on_progress)
    results = []
    for each in made:
        result = each.result(beginning, on_progress)
        if way == "capture" and result.way != way:
            raise StateError(f"the branch cannot be made from a captured state: {result.reason}")
        results.append(result)
    return results


class _Branch:
    """A branch to be executed."""

    def __init__(
        self, log: Path, original: Log, instant: float, changes: Sequence[Assignment], output: Path | None
    ) -> None:
        self._log = log
        self._original = original
        self._instant = instant
        self._output = output
        self._overrides = overrides_of(log, instant, changes)
        self._built: Built | None = self._build()
        if output is not None:
            check_output(self._built, output, log)

    def _build(self) -> Built:
        return open_scenario(self._log, self._overrides, repeats_until=self._instant)

    def result(self, beginning: SharedBeginning | None, on_progress: Progress | None) -> BranchResult:
        """Execute the branch: from the state of a shared beginning if possible, otherwise by repetition."""
        built, self._built = self._built or self._build(), None
        reason = ""
        if beginning is not None:
            reason = beginning.obstacle_of(built, self._overrides) or ""
            if not reason:
                try:
                    return self._made(built, beginning, "", on_progress)
                except StateError as error:
                    built, reason = self._build(), str(error)
        return self._made(built, None, reason, on_progress)

    def _made(
        self, built: Built, beginning: SharedBeginning | None, reason: str, on_progress: Progress | None
    ) -> BranchResult:
        log, overrides = self._log, self._overrides
        comparison = MessageComparison(self._original, nanoseconds(self._instant) if overrides else None)
        with closing(comparison), tempfile.TemporaryDirectory() as folder:
            written = self._output or Path(folder, "branch.mcap")
            with prepared(built, written, may_exit=False, on_message=comparison.compare) as run:
                if beginning is not None:
                    beginning.continue_in(run)
                while run.status is None and not comparison.differs:
                    run.advance(STEPS)
                    if on_progress is not None:
                        on_progress(run.kernel.done, built.steps)
                if comparison.differs:
                    run.leave("the branch differs before its instant")
            if run.signal is not None:
                raise KeyboardInterrupt
            if comparison.differs or comparison.is_left:
                written.unlink(missing_ok=True)
                where = f"it differs from {log} after {comparison.now / 1e9:g} s already"
                cause = "the change affects the run before the instant" if overrides else "the run is irreproducible"
                raise BranchError(f"there is no such branch: {where}; {cause}. See `symaware verify {log}`")
        way: Way = "repetition" if beginning is None else "capture"
        changes = tuple(map(str, overrides))
        return BranchResult(log, self._instant, comparison.count, changes, run.summary, way, reason)


def _opened(log: Path) -> Log:
    original = open_log(log)
    if "part" in original.manifest:
        raise BranchError(f"{log} is a part of a run in several processes: branch the log that `symaware merge` makes")
    return original


def _instant(original: Log, log: Path, at: Instant) -> float:
    """Return the instant of a branch [s], within the run."""
    end = (original.end_time or 0) / 1e9
    if isinstance(at, Event | LoggedEvent):
        at = at.seconds
    instant = at if isinstance(at, int | float) else _described(original, log, at)
    if not 0.0 <= instant <= end:
        raise BranchError(f"{instant:g} s is not within the run of {log}, which goes from 0 to {end:g} s")
    return instant


def _described(original: Log, log: Path, at: str) -> float:
    try:
        return float(at)
    except ValueError:
        found = _EVENT.fullmatch(at)
    if found is None:
        raise BranchError(f"`{at}` is no instant: write a time [s], or an event as in `violated(safe) - 2.0`")
    name, of = found["name"], found["of"].strip()
    events = [event for event in original.events() if event.name == name]
    for event in events:
        if of in ("", event.source, event.source.removeprefix("specifications.")):
            return event.time / 1e9 + float((found["shift"] or "0").replace(" ", ""))
    sources = sorted({event.source.removeprefix("specifications.") for event in events})
    there = f"{name} was fired only by {', '.join(sources)}" if sources else f"no event is called {name}"
    raise BranchError(f"there is no event {name}({of}) in {log}; {there}")


#: The name of the table in the folder of the branches.
TABLE = "branches.csv"

Cell = str | int | float | None


def branch_rows(results: Sequence[BranchResult], changes: Sequence[Sequence[Assignment]]) -> list[dict[str, Cell]]:
    """Return a row for each branch; all rows have the same keys.

    Args:
        results: The branches of one run at one instant.
        changes: The changes of each branch.
    """
    paths = list(dict.fromkeys(dotted(each.path) for some in changes for each in some))
    names = list(dict.fromkeys(each.name for result in results for each in result.summary.specifications))
    rows = []
    for number, (result, some) in enumerate(zip(results, changes, strict=True)):
        values = {dotted(each.path): _typed(each) for each in some}
        summary = result.summary
        outcomes = {each.name: each for each in summary.specifications}
        closest, risk = summary.minimum_separation, summary.highest_risk
        row: dict[str, Cell] = {"branch": number, **{path: values.get(path) for path in paths}}
        row["status"] = summary.status
        for name in names:
            outcome = outcomes.get(name)
            row[name] = outcome.verdict if outcome else None
            row[f"{name} robustness"] = outcome.robustness if outcome else None
        row |= {
            "contacts": summary.contacts,
            "closest": closest.value if closest else None,
            "highest risk": risk.value if risk else None,
            "goals reached": len(summary.goals_reached),
            "time": summary.simulated_time,
            "way": result.way,
            "log": summary.log and Path(summary.log).name,
        }
        rows.append(row)
    return rows


def write_branch_table(rows: Sequence[dict[str, Cell]], folder: Path) -> Path:
    """Write the rows as CSV, with all digits of numbers, to the folder of the branches, and return the path.

    Raises:
        OutputError: The file cannot be written.
    """
    path = folder / TABLE
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}") from error
    return path


def branch_cells(rows: Sequence[dict[str, Cell]]) -> list[list[str]]:
    """Format the names of columns and the rows as text, without the names of logs and without empty columns."""
    shown = [key for key in rows[0] if key != "log" and any(row[key] is not None for row in rows)]
    return [[_short(key) for key in shown], *([_text(row[key]) for key in shown] for row in rows)]


def _typed(change: Assignment) -> str:
    """Return a string value without its quotes, and other values unchanged."""
    value = change.value.value
    return value if isinstance(value, str) else str(change).partition("=")[2]


def _short(key: str) -> str:
    """Return the last part of a path, which suffices to distinguish columns."""
    return key.rpartition(".")[2]


def _text(cell: Cell) -> str:
    return "-" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)
