"""Decisions of commands as test cases: specifications, claims, rows of sweeps, repetitions, compared channels."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from symaware_cli.engine import RunSummary
from symaware_cli.evidence.certificate_page import decided
from symaware_cli.evidence.certification import Certificate
from symaware_cli.evidence.checking import CheckResult
from symaware_cli.evidence.comparison import ComparisonResult
from symaware_cli.evidence.finding import Finding
from symaware_cli.evidence.results.result_case import CaseStatus, ResultCase
from symaware_cli.evidence.sweep_comparison import SweepComparison
from symaware_cli.evidence.verification import VerificationResult
from symaware_cli.language import Changes, ScenarioError, TextSpan, extracted
from symaware_cli.language.compose import compose
from symaware_cli.log import LogDifference, LogError
from symaware_cli.specification import Outcome
from symaware_cli.studies import JOURNAL, Row, SweepFolder, SweepJournal

_LOG = ".mcap"

Spans = Mapping[str, TextSpan]
"""The place of each specification, by name."""


def specification_spans(path: Path, changes: Changes | None = None, statements: Path | None = None) -> Spans:
    """Return the places of the specifications of a scenario or a log.

    For a log, they are places in the files as the log contains them, which are named as they were. Empty if the files
    cannot be read: the command itself reports their problems.

    Args:
        path: The scenario or the log.
        changes: Values that replace those of the file, as for ``--set``.
        statements: A file of specifications in place of the scenario's.
    """
    try:
        if path.suffix != _LOG:
            return _spans(path, None, changes, statements)
        with tempfile.TemporaryDirectory() as folder:
            file, written = extracted(path, Path(folder))
            # The top file comes first. A scenario written in Python has none, but is in the log as one.
            name = next(iter(written), None)
            file = file if name is None else Path(folder, name)
            return _spans(file, name or f"{path}:{file.name}", changes, statements)
    except (ScenarioError, LogError, OSError):
        return {}


def _spans(path: Path, name: str | None, changes: Changes | None, statements: Path | None) -> Spans:
    found = compose(path, changes, name, statements)
    named = found.data.get("specifications")
    return {each: found.span(("specifications", each), key=True) for each in named} if isinstance(named, dict) else {}


def run_cases(summary: RunSummary, spans: Spans) -> Iterator[ResultCase]:
    """Yield a case for the run, which is an error unless it finished, and one for each specification."""
    suite = f"{summary.name}, seed {summary.seed}"
    if summary.status == "finished":
        yield ResultCase(suite, "run", "run", time=summary.wall_time)
    else:
        rule, said = f"{summary.status}-run", summary.failure or "the run was interrupted"
        yield ResultCase(
            suite, "run", "run", CaseStatus.ERROR, rule, said, summary.traceback or "", time=summary.wall_time
        )
    for name, count in summary.errors.items():
        told = f"agents reported `{name}` {count:,} times"
        yield ResultCase(suite, name, "reported error", CaseStatus.FAILURE, "reported-error", told)
    yield from outcome_cases(suite, summary.specifications, spans)


def check_cases(result: CheckResult, spans: Spans) -> Iterator[ResultCase]:
    """Yield a case for each specification, and an error for a damaged log."""
    suite = str(result.log)
    if result.damage:
        yield ResultCase(suite, "log", "log", CaseStatus.ERROR, "damaged-log", result.damage)
    yield from outcome_cases(suite, result.specifications, spans)


def outcome_cases(suite: str, outcomes: Iterable[Outcome], spans: Spans) -> Iterator[ResultCase]:
    """Yield a case for each specification: a failure if it is violated, skipped if it is undecided or rejected."""
    for each in outcomes:
        status, rule = _judged(each.verdict)
        details = f"{each.verdict}: {each}\n{each.formula}"
        said = each.reason or str(each) if status is not CaseStatus.PASSED else ""
        yield ResultCase(
            suite, each.name, "specification", status, rule, said, details if said else "", spans.get(each.name)
        )


def _judged(verdict: str) -> tuple[CaseStatus, str]:
    if verdict == "violated":
        return CaseStatus.FAILURE, "violated-specification"
    return (CaseStatus.PASSED if verdict == "satisfied" else CaseStatus.SKIPPED), ""


def sweep_cases(folder: SweepFolder, left_out: str | None = None) -> Iterator[ResultCase]:
    """Yield a case for each run of a sweep: an error if it failed or was lost, skipped if it was not made.

    Args:
        folder: The folder of the sweep.
        left_out: The rule that left out the runs that were not made, if one did.
    """
    cells = folder.plan.cells
    spans = specification_spans(folder.source.scenario) if cells else {}
    with SweepJournal(folder.path / JOURNAL) as journal:
        rows = {row.index: row for row in journal.rows()}
    for index in range(folder.plan.count):
        cell = folder.plan.cell(index)
        named = [*filter(None, [cell.variant]), *(f"{key}={value}" for key, value in cell.parameters.items())]
        name = f"run {index}" + (f" ({', '.join(named)})" if named else "")
        row = rows.get(index)
        if row is None:
            said = f"left out: {left_out}" if left_out else "not made yet: `symaware resume` makes it"
            yield ResultCase(str(folder.path), name, "row", CaseStatus.SKIPPED, message=said)
        else:
            yield _row_case(str(folder.path), name, row, spans)


def _row_case(suite: str, name: str, row: Row, spans: Spans) -> ResultCase:
    if row.state != "done":
        return ResultCase(
            suite,
            name,
            "row",
            CaseStatus.ERROR,
            f"{row.state}-run",
            row.error or "",
            row.trace or "",
            time=row.wall_time,
        )
    violated = [each for each, verdict in row.verdicts.items() if verdict == "violated"]
    if not violated:
        return ResultCase(suite, name, "row", time=row.wall_time)
    told = [
        f"{each} is violated" + ("" if (found := row.robustness.get(each)) is None else f", robustness {found:.6g}")
        for each in violated
    ]
    span = next((spans[each] for each in violated if each in spans), None)
    return ResultCase(
        suite, name, "row", CaseStatus.FAILURE, "violated-specification", "; ".join(told), span=span, time=row.wall_time
    )


def certificate_cases(folder: Path, made: Certificate) -> Iterator[ResultCase]:
    """Yield a case for the claim in each combination of parameters: a failure if it is not established."""
    said = made.statement["predicate"]
    for cell in said["combinations"]:
        named = [*filter(None, [cell["variant"]]), *(f"{key}={value}" for key, value in cell["parameters"].items())]
        name = said["claim"]["text"] + (f" ({', '.join(named)})" if named else "")
        told = "; ".join(
            (f"{text}: " if text else "")
            + f"{each['runs']:,} runs; evidence {each['evidence']:.4g} of {each['needed']:.4g}"
            for text, each in decided(cell)
        )
        if cell["established"] and not made.is_post_hoc:
            yield ResultCase(str(folder), name, "claim", message=told)
            continue
        rule = "unestablished-claim"
        if made.is_post_hoc:
            rule, told = "post-hoc-claim", f"not certified: the claim was chosen after the runs; {told}"
        status = CaseStatus.SKIPPED if made.is_established else CaseStatus.FAILURE
        yield ResultCase(str(folder), name, "claim", status, rule, told)


def verification_cases(result: VerificationResult) -> Iterator[ResultCase]:
    """Yield a case for the messages of the log and one for each attachment that differs."""
    suite, details = str(result.log), "\n".join(f"version of {each.name}" for each in result.versions)
    if result.difference is None:
        yield ResultCase(suite, "messages", "repetition", message=f"{result.messages:,} equal messages")
    else:
        writer = f", written by {result.writer}" if result.writer else ""
        yield _different(suite, "messages", "repetition", f"{result.difference}{writer}", details)
    for each in result.attachments:
        yield _different(suite, f"{each.topic} {each.element}".strip(), "attachment", str(each), details)


def finding_cases(suite: str, findings: Iterable[Finding]) -> Iterator[ResultCase]:
    """Yield a failure for each finding of a verification, or a case that passed if there are none."""
    is_sound = True
    for number, each in enumerate(findings):
        is_sound = False
        where = "" if each.index is None else f"run {each.index}, "
        said = f"{where}{each.column}: {each.found}, but should be {each.expected}"
        yield ResultCase(suite, f"{number}: {where}{each.column}", "finding", CaseStatus.FAILURE, "contradiction", said)
    if is_sound:
        yield ResultCase(suite, "sound", "finding")


def comparison_cases(result: ComparisonResult) -> Iterator[ResultCase]:
    """Yield a case for each channel, and a failure for each value of the scenario and each attachment that differs."""
    suite = " and ".join(map(str, result.paths))
    for change in result.scenario:
        said = f"{change.path}: {change.values[0]} and {change.values[1]} ({', '.join(filter(None, change.places))})"
        yield _different(suite, change.path, "scenario", said)
    if not result.scenario:
        yield ResultCase(suite, "scenario", "scenario")
    different = {each.topic: each for each in result.channels}
    for topic in result.compared:
        found = different.get(topic)
        if found is None:
            yield ResultCase(suite, topic, "channel")
            continue
        lines = [f"{found.messages:,} messages differ", f"agents: {', '.join(found.agents)}" if found.agents else ""]
        if found.greatest is not None and found.greatest.distance is not None:
            lines.append(f"greatest difference: {found.greatest.distance:.6g}, {found.greatest}")
        yield _different(suite, topic, "channel", str(found.first), "\n".join(filter(None, lines)))
    for each in result.attachments:
        yield _attached(suite, each)


def _attached(suite: str, difference: LogDifference) -> ResultCase:
    return _different(suite, f"{difference.topic} {difference.element}".strip(), "attachment", str(difference))


def sweep_comparison_cases(result: SweepComparison) -> Iterator[ResultCase]:
    """Yield a case for each part of two sweeps that is compared: plan, scenario, rows and columns."""
    suite = " and ".join(map(str, result.paths))
    for kind, changes in (("plan", result.plan), ("scenario", result.scenario)):
        for change in changes:
            yield _different(suite, change.path, kind, f"{change.path}: {change.values[0]} and {change.values[1]}")
        if not changes:
            yield ResultCase(suite, kind, kind)
    if result.differing or result.rows[0] != result.rows[1]:
        rows = f"{result.rows[0]:,} and {result.rows[1]:,} rows; {result.differing:,} differ"
        since = "" if result.first is None else f", from run {result.first} on"
        yield _different(suite, "rows", "rows", rows + since)
    else:
        yield ResultCase(suite, "rows", "rows")
    for each in result.columns:
        said = f"{each.differing:,} runs differ; means {each.means[0]:.6g} and {each.means[1]:.6g}"
        yield _different(suite, each.name, "column", said)
    for path, names in zip(result.paths, result.only, strict=True):
        for name in names:
            yield _different(suite, f"{name} of {path}", "column", f"only {path} has this column")


def _different(suite: str, name: str, kind: str, message: str, details: str = "") -> ResultCase:
    return ResultCase(suite, name, kind, CaseStatus.FAILURE, "difference", message, details)
