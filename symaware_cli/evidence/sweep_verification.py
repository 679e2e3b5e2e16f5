"""Verification of the folder of a sweep: table against plan, logs against table, and rows by repetition."""

from __future__ import annotations

import random
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from symaware_cli.engine import RunError
from symaware_cli.evidence.certificate_check import certificate_findings, certificates, opened
from symaware_cli.evidence.checking import check_log
from symaware_cli.evidence.finding import Finding
from symaware_cli.evidence.log_evaluation import EvaluatedSpecification, evaluate_log
from symaware_cli.evidence.tolerances import ColumnTolerance, Tolerances
from symaware_cli.evidence.verification import logged_versions, version_differences
from symaware_cli.language import Catalogue, ScenarioError
from symaware_cli.log import LogError, attachment_differences, first_difference, open_log
from symaware_cli.log.digest import digest
from symaware_cli.specification import SpecificationError
from symaware_cli.studies import (
    IDENTITY,
    JOURNAL,
    MOST_AGENTS,
    PREFIX,
    TABLE,
    Row,
    Runner,
    SweepError,
    SweepFolder,
    SweepIdentity,
    SweepJournal,
    counting,
    differences,
    identity_of,
    listed,
    sweep_table,
    table_file,
)

#: The extent of verification, each level including the previous ones: consistency of table, plan, certificates and
#: digests; specifications evaluated on the kept logs; repetition of randomly chosen rows; repetition of all rows.
Level = Literal["arithmetic", "monitor", "sample", "all"]

LEVELS: tuple[Level, ...] = get_args(Level)

#: Verdicts, the worst first.
_VERDICTS = ("violated", "undecided", "satisfied")


@dataclass(frozen=True, slots=True)
class SweepVerification:
    """The result of verifying the folder of a sweep.

    Attributes:
        folder: The folder.
        level: The extent of verification.
        rows: The number of rows.
        missing: The number of planned runs without a row.
        lost: The number of rows of lost runs, which are not repeated.
        logs: The number of logs read.
        not_evaluated: The number of logs in which a specification was not evaluated independently of the monitors, by
            name and reason.
        repeated: The number of repeated runs.
        findings: The contradictions found.
        versions: The differences in versions or files from when the rows were produced.
    """

    folder: Path
    level: Level
    rows: int
    missing: int
    lost: int
    logs: int
    not_evaluated: Mapping[str, int]
    repeated: int
    findings: Sequence[Finding]
    versions: Sequence[str]

    @property
    def is_sound(self) -> bool:
        """Whether there are no findings."""
        return not self.findings

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return {"sound": self.is_sound, **asdict(self), "folder": str(self.folder)}


def require_sound(folder: SweepFolder) -> None:
    """Raise an error if the table, plan and identity of a sweep contradict one another.

    Raises:
        SweepError: They do, or the folder cannot be read.
    """
    found = verify_folder(folder, "arithmetic", with_certificates=False)
    if not found.is_sound:
        lines = [f"{f'run {each.index}, ' if each.index is not None else ''}{each.column}" for each in found.findings]
        raise SweepError(listed(f"{folder.path} contradicts itself, so nothing is certified", lines))


def verify_folder(
    folder: SweepFolder,
    level: Level = "sample",
    sample: int = 20,
    seed: int = 0,
    on_progress: Callable[[int, int], object] | None = None,
    with_certificates: bool = True,
) -> SweepVerification:
    """Verify the folder of a sweep.

    Runs are repeated one by one, never in batches, so that the check does not rely on batches giving the same rows. If
    a component repeats its results to a tolerance only, numbers are compared to that, and digests are not compared.

    Args:
        folder: The folder.
        level: The extent of verification.
        sample: The number of rows repeated at the level ``sample``.
        seed: The seed of their random choice; use an unpredictable one.
        on_progress: Called with the number of repeated runs and the total to repeat.
        with_certificates: Whether to verify the certificates in the folder as well.

    Raises:
        SweepError: The folder cannot be read.
    """
    depth = LEVELS.index(level)
    found: list[Finding] = []
    if not (folder.path / JOURNAL).exists():
        raise SweepError(f"{folder.path / JOURNAL} is missing: without it there are no rows to verify")
    logs, not_evaluated, chosen = 0, Counter[str](), list[Row]()
    with SweepJournal(folder.path / JOURNAL) as journal:
        found += _in_table(folder, journal)
        rows = list(journal.rows())
    now = identity_of(folder.source, {})[0]
    found += _in_identity(folder.identity, now)
    for path in certificates(folder) if with_certificates else ():
        found += _in_certificate(folder, path)
    runner = folder.runner(1)
    is_monitored = depth >= LEVELS.index("monitor")
    catalogue = Catalogue()
    kept = [row for row in rows if row.log is not None]
    for row in kept:
        found += _in_log(folder, row, runner, catalogue if is_monitored else None, not_evaluated)
    logs = len(kept)
    if depth >= LEVELS.index("sample"):
        chosen = [row for row in rows if row.state != "lost"]
    if level == "sample":
        chosen = sorted(random.Random(seed).sample(chosen, min(sample, len(chosen))), key=lambda row: row.index)
    for number, row in enumerate(chosen):
        found += _repeated(folder, row, runner)
        if on_progress is not None:
            on_progress(number + 1, len(chosen))
    changed = differences(folder.identity, now)
    # A forged table may contain rows that are not in the plan.
    missing = len({*range(folder.plan.count)} - {row.index for row in rows})
    lost = sum(row.state == "lost" for row in rows)
    return SweepVerification(
        folder.path, level, len(rows), missing, lost, logs, dict(not_evaluated), len(chosen), found, changed
    )


def _in_table(folder: SweepFolder, journal: SweepJournal) -> Iterator[Finding]:
    """Yield the contradictions of the table with the plan, the journal or itself."""
    import pyarrow

    plan, names = folder.plan, folder.specifications
    columns = sweep_table.schema(plan, names)
    noted = pyarrow.Table.from_batches(list(sweep_table.batches(journal.records(), plan, names)), columns)
    written = table_file.read(folder.path)
    if written is None and len(noted):
        yield Finding(None, TABLE, "missing", f"the table of {len(noted):,} rows")
    table = noted if written is None else written[0]
    if table.column_names != noted.column_names:
        yield Finding(None, "columns", table.column_names, noted.column_names)
        return
    if len(table) != len(noted):
        yield Finding(None, "rows", len(table), len(noted))
    for name in noted.column_names:
        for index, (found, expected) in enumerate(
            zip(table.column(name).to_pylist(), noted.column(name).to_pylist(), strict=False)
        ):
            if not _equal(found, expected):
                yield Finding(index, name, found, expected)
    for place, row in enumerate(noted.to_pylist()):
        yield from _in_row(folder, place, row)
    for index, identity in journal.identities():
        if identity != folder.identity.of_run(plan, index):
            yield Finding(index, "identity", identity, folder.identity.of_run(plan, index))


def _in_row(folder: SweepFolder, place: int, row: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield the contradictions of a row with the plan or itself."""
    plan, index = folder.plan, row["index"]
    if not folder.plan.document.may_stop and index != place:
        yield Finding(index, "index", index, place)
    if not 0 <= index < plan.count:
        yield Finding(index, "index", index, f"less than {plan.count}")
        return
    planned = {"seed": plan.seed(index), "replicate": plan.replicate(index), **plan.parameters(index)}
    if plan.document.variants:
        planned["variant"] = plan.cell(index).variant
    for name, expected in planned.items():
        if not _equal(row[name], expected):
            yield Finding(index, name, row[name], expected)
    for name in folder.specifications:
        verdict, robustness = row[f"verdict.{name}"], row[f"robustness.{name}"]
        if robustness and verdict in ("satisfied", "violated") and (robustness > 0.0) != (verdict == "satisfied"):
            yield Finding(index, f"verdict.{name}", verdict, f"the verdict for a robustness of {robustness:g}")
        by_agent = row[f"{PREFIX}{name}"]
        if by_agent and len(by_agent) < MOST_AGENTS:
            worst = min((each["verdict"] for each in by_agent), key=_VERDICTS.index)
            if worst != verdict:
                yield Finding(index, f"verdict.{name}", verdict, f"{worst}, the worst of `{PREFIX}{name}`")


def _in_identity(then: SweepIdentity, now: SweepIdentity) -> Iterator[Finding]:
    """Yield the differences of the scenario in the folder from that at the start of the sweep."""
    if len(then.cells) != len(now.cells):
        yield Finding(None, "scenario", f"{len(now.cells):,} combinations", f"{len(then.cells):,}, as it was run")
    for number, (was, found) in enumerate(zip(then.cells, now.cells, strict=False)):
        if was != found:
            yield Finding(None, f"scenario of combination {number}", f"SHA-256 {found}", f"{was}, as it was run")
    for name in dict.fromkeys([*then.resolved, *now.resolved]):
        values = then.resolved.get(name), now.resolved.get(name)
        if values[0] != values[1] and name != "seed":
            yield Finding(None, f"{IDENTITY}, resolved.{name}", values[0], f"{values[1]}, as in the scenario")
    if list(then.specifications) != list(now.specifications):
        said = f"{list(now.specifications)}, as in the scenario"
        yield Finding(None, f"{IDENTITY}, specifications", then.specifications, said)


def _in_certificate(folder: SweepFolder, path: Path) -> Iterator[Finding]:
    """Yield the contradictions of a certificate with the folder that contains it."""
    try:
        for each in certificate_findings(folder, path, opened(path)):
            yield replace(each, column=f"{path.name}, {each.column}")
    except LogError as error:
        yield Finding(None, path.name, str(error), "a certificate")


def _in_log(
    folder: SweepFolder, row: Row, runner: Runner, catalogue: Catalogue | None, not_evaluated: Counter[str]
) -> Iterator[Finding]:
    """Yield the contradictions of a kept log with its name, the plan or its row.

    Args:
        folder: The folder.
        row: The row.
        runner: Builds the scenario of the run.
        catalogue: The installed plugins, for evaluating its specifications; None to skip them.
        not_evaluated: Counts the reasons why specifications were not evaluated.
    """
    assert row.log is not None
    try:
        log = open_log(folder.logs / row.log)
        name = f"{digest(log).combined[:32]}.mcap"
        if row.log != name:
            yield Finding(row.index, "log", row.log, name)
        if log.manifest.get("seed") != folder.plan.seed(row.index):
            yield Finding(row.index, "log", f"seed {log.manifest.get('seed')}", f"seed {folder.plan.seed(row.index)}")
        if log.attachments.get("resolved.yaml") != runner.resolved(row.index):
            yield Finding(row.index, "log", "another scenario", "that of this run, as the folder has it")
        if row.state == "done" and (log.outcome or {}).get("status") != "finished":
            yield Finding(row.index, "log", "a part of a run", "the log of a run that reached its end")
        elif row.state == "done" and catalogue is not None:
            yield from _in_specifications(log.path, row, catalogue, not_evaluated)
    except (LogError, ScenarioError, SpecificationError, RunError) as error:
        yield Finding(row.index, "log", str(error), "a log of this run")


def _in_specifications(log: Path, row: Row, catalogue: Catalogue, not_evaluated: Counter[str]) -> Iterator[Finding]:
    """Yield the differences of a row from its log's specifications, evaluated independently."""
    evaluation = evaluate_log(log, catalogue)
    for each in evaluation.specifications:
        yield from _verdict(row, each.name, each.verdict, each.robustness, is_exact=each.is_exact)
        yield from _by_agent(row, each)
    not_evaluated.update(f"{name}: {reason}" for name, reason in evaluation.left_out.items())
    if evaluation.left_out and evaluation.is_complete:
        for outcome in check_log(log).specifications:
            if outcome.name in evaluation.left_out:
                yield from _verdict(row, outcome.name, outcome.verdict, outcome.robustness, is_exact=True)


def _verdict(row: Row, name: str, verdict: str, robustness: float | None, *, is_exact: bool) -> Iterator[Finding]:
    """Yield the difference of a row's verdict or robustness from that of its log."""
    said, known = row.verdicts.get(name), row.robustness.get(name)
    if said != verdict:
        yield Finding(row.index, f"verdict.{name}", said, f"{verdict}, as in the log")
    elif not (_equal(known, robustness) if is_exact else _at_least(known, robustness)):
        yield Finding(row.index, f"robustness.{name}", known, f"{robustness}, as in the log")


def _by_agent(row: Row, evaluated: EvaluatedSpecification) -> Iterator[Finding]:
    """Yield the differences of a row's outcomes for each agent or pair from those of its log."""
    column = f"{PREFIX}{evaluated.name}"
    said = {each["agent"]: each for each in row.metrics.get(column) or ()}
    if not said:
        return
    here = {" and ".join(each.agents): each for each in evaluated.rows}
    if len(said) < MOST_AGENTS and said.keys() != here.keys():
        yield Finding(row.index, column, sorted(said), sorted(here))
    for agent, each in said.items():
        if agent not in here:
            continue
        verdict = here[agent].verdict
        robustness = here[agent].robustness if np.isfinite(here[agent].robustness) else None
        known = each["robustness"]
        if each["verdict"] != verdict:
            yield Finding(row.index, f"{column} {agent}", each["verdict"], f"{verdict}, as in the log")
        elif not (_equal(known, robustness) if evaluated.is_exact else _at_least(known, robustness)):
            yield Finding(row.index, f"{column} {agent}", known, f"{robustness}, as in the log")


def _at_least(bound: float | None, robustness: float | None) -> bool:
    """Return whether an upper bound of the robustness holds; None is infinity."""
    return bound is None or (robustness is not None and bound >= robustness)


def _repeated(folder: SweepFolder, row: Row, runner: Runner) -> Iterator[Finding]:
    """Yield the differences of a row, and of its log if kept, from a repetition of the run."""
    tolerance = None
    with suppress(ScenarioError):  # invalid values drawn for its seed: the row says so
        tolerance = runner.tolerance(row.index)
    if row.log is None:
        yield from _differing(row, runner.run(row.index), tolerance)
        return
    allowed = None if tolerance is None else Tolerances.everywhere(tolerance).allow
    with tempfile.TemporaryDirectory() as scratch:
        repeated = runner.run(row.index, Path(scratch))
        yield from _differing(row, repeated, tolerance)
        try:
            logs = open_log(folder.logs / row.log), open_log(Path(scratch, repeated.log or ""))
            first = first_difference(*logs, allowed)
            beside = list(attachment_differences(*logs, allowed))
        except LogError as error:
            yield Finding(row.index, "log", str(error), "a log")
            return
        if first is not None:
            place = f"log, {first.topic}" if first.time is None else f"log, {first.topic} at {first.time / 1e9:.9g} s"
            yield Finding(row.index, " ".join(filter(None, (place, first.agent, first.element))), *first.values)
        for each in beside:
            yield Finding(row.index, f"log, {each.topic} {each.element}".strip(), *each.values)
        # The name of a log is its digest.
        if first is None and not beside and tolerance is None and repeated.log != row.log:
            yield Finding(row.index, "log", row.log, repeated.log)
        made = version_differences(counting(folder.identity.versions), logged_versions(logs[0]))
        for version in made:
            yield Finding(row.index, f"log, version of {version.name}", version.now, version.then)


def _differing(row: Row, repeated: Row, tolerance: float | None) -> Iterator[Finding]:
    """Yield the differences of a row from a repetition of the run, of numbers beyond a tolerance if there is one."""
    is_same = _equal if tolerance is None else ColumnTolerance(absolute=tolerance, relative=tolerance).allows
    for name in ("state", "digest", "error") if tolerance is None else ("state", "error"):
        found, expected = getattr(row, name), getattr(repeated, name)
        if found != expected:
            yield Finding(row.index, name, found, expected)
    for prefix, there, here in (
        ("verdict.", row.verdicts, repeated.verdicts),
        ("robustness.", row.robustness, repeated.robustness),
        ("", row.metrics, repeated.metrics),
    ):
        for name in dict.fromkeys([*there, *here]):
            if not is_same(there.get(name), here.get(name)):
                yield Finding(row.index, prefix + name, there.get(name), here.get(name))


def _equal(one: Any, other: Any) -> bool:
    """Return whether two values are equal, where NaN equals NaN and a tuple equals a list of the same values."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_equal(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_equal, one, other))
    return bool(one == other) or (one != one and other != other)
