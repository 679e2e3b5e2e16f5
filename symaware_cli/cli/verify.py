"""``symaware verify``."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.cli.result_files import Results, note
from symaware_cli.help_place import in_help
from symaware_cli.world import counted

if TYPE_CHECKING:
    from symaware_cli.evidence import Finding, Level, ResultCase, SweepVerification, VerificationResult
    from symaware_cli.log import LogDifference

#: How many findings are shown.
_MOST = 10


@in_help("check", 30)
def verify(
    path: Annotated[Path, typer.Argument(help="A log, the folder of a sweep, or a certificate in it.", metavar="PATH")],
    level: Annotated[
        str | None,
        typer.Option(
            help="How much of a sweep is verified, each level with those before it: arithmetic (what table, plan, "
            "certificates and digests say of each other), monitor (what the logs that were kept say), sample (some "
            "rows, made again; the default), all (all rows, made again)."
        ),
    ] = None,
    rows: Annotated[
        int | None, typer.Option(min=1, help="How many rows the level `sample` makes again; by default 20.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed by which they are chosen; by default one that cannot be predicted.")
    ] = None,
    key: Annotated[
        Path | None,
        typer.Option(help="The key that a certificate has to be signed with, public or private.", metavar="FILE"),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
    trust: terminal.Trust = False,
    results: Results = None,
    as_json: terminal.Json = False,
) -> None:
    """Repeat runs, and report whether they are equal or where they differ. Exit status 1 if they differ."""
    is_of_sweep = path.suffix == ".json" or path.is_dir()
    for option, value in {"--level": level, "--rows": rows, "--seed": seed}.items():
        if value is not None and not is_of_sweep:
            terminal.fail(f"{option} goes with a sweep, and {path} is none", terminal.WRONG_INPUT, as_json)
        if option != "--level" and value is not None and level not in (None, "sample"):
            terminal.fail(f"{option} goes with the level sample, not with {level}", terminal.WRONG_INPUT, as_json)
    level, rows = level or "sample", rows or 20
    if path.suffix == ".json":
        raise typer.Exit(_verify_certificate(path, level, rows, seed, key, quiet=quiet, as_json=as_json))
    if key is not None:
        terminal.fail(f"--key is for certificates, and {path} is none", terminal.WRONG_INPUT, as_json)
    if path.is_dir() and _is_case(path):
        raise typer.Exit(_verify_case(path, level, rows, seed, quiet=quiet, as_json=as_json))
    if path.is_dir():
        raise typer.Exit(_verify_sweep(path, level, rows, seed, quiet=quiet, as_json=as_json))
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import verify_log

        with terminal.progress_shown("repeats", not (quiet or as_json)) as shown:
            result = verify_log(path, shown)
        note(lambda: _log_cases(result))
    if as_json:
        terminal.print_json(result.to_json())
    elif not quiet:
        terminal.say("\n".join(_lines(result)))
    sys.stdout.flush()
    raise typer.Exit(0 if result.is_equal else terminal.FAILED)


def _is_case(path: Path) -> bool:
    from symaware_cli.evidence import is_case

    return is_case(path)


def _verify_case(folder: Path, level: str, rows: int, seed: int | None, *, quiet: bool, as_json: bool) -> int:
    """Check the evidence of an assurance case again, and return the exit status."""
    from symaware_cli.cli.assure import case_lines

    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import verify_case

        with terminal.progress_shown("solutions", not (quiet or as_json)) as shown:
            result = verify_case(folder, _level(level, as_json=as_json), rows=rows, seed=seed, on_progress=shown)
    if as_json:
        terminal.print_json(result.to_json())
    elif not quiet:
        terminal.say("\n".join(case_lines(folder, result)))
    return 0 if result.is_supported else terminal.FAILED


def _verify_sweep(folder: Path, level: str, rows: int, seed: int | None, *, quiet: bool, as_json: bool) -> int:
    """Verify the folder of a sweep, and return the exit status."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.api import verify_sweep

        with terminal.progress_shown("repeats", not (quiet or as_json)) as shown:
            result = verify_sweep(folder, _level(level, as_json=as_json), rows=rows, seed=seed, on_progress=shown)
        note(lambda: _cases(str(folder), result.findings))
    if as_json:
        terminal.print_json(result.to_json())
    elif not quiet:
        terminal.say("\n".join(_report(result)))
    return 0 if result.is_sound else terminal.FAILED


def _verify_certificate(
    path: Path, level: str, rows: int, seed: int | None, key: Path | None, *, quiet: bool, as_json: bool
) -> int:
    """Verify a certificate and the folder of its sweep, and return the exit status."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import verify_certificate

        with terminal.progress_shown("repeats", not (quiet or as_json)) as shown:
            result = verify_certificate(
                path, _level(level, as_json=as_json), key=key, rows=rows, seed=seed, on_progress=shown
            )
        note(lambda: _cases(str(path), result.findings))
        note(lambda: _cases(str(result.sweep.folder), result.sweep.findings))
    if as_json:
        terminal.print_json(result.to_json())
    elif not quiet:
        findings = result.findings
        terminal.say(f"{path}: {_outcome(findings)}")
        if result.public_key is not None:
            whose = "the key that was asked for" if result.is_known_signer else "nobody says whose: --key does"
            if any(each.column == "signature" for each in findings):
                whose = "which is not accepted"
            terminal.say(f"  {'signed by':<12} {result.public_key}, {whose}")
        else:
            terminal.say(f"  {'signed by':<12} nobody")
        terminal.say("\n".join([*_findings(findings), *_report(result.sweep)]))
    return 0 if result.is_sound else terminal.FAILED


def _cases(suite: str, findings: Sequence[Finding]) -> Iterable[ResultCase]:
    from symaware_cli.evidence import finding_cases

    return finding_cases(suite, findings)


def _log_cases(result: VerificationResult) -> Iterable[ResultCase]:
    from symaware_cli.evidence import verification_cases

    return verification_cases(result)


def _level(level: str, *, as_json: bool) -> Level:
    from symaware_cli.evidence import LEVELS

    chosen = next((each for each in LEVELS if each == level), None)
    if chosen is None:
        terminal.fail(f"--level takes {', '.join(LEVELS)}, not {level}", terminal.WRONG_INPUT, as_json)
    return chosen


def _report(result: SweepVerification) -> Iterator[str]:
    """The report on the folder of a sweep."""
    findings = result.findings
    yield f"{result.folder}: {_outcome(findings)}, level {result.level}"
    yield f"  {'rows':<12} {result.rows:,}, {result.repeated:,} of them made again, {result.logs:,} logs read"
    yield from _findings(findings)
    for line in result.versions[:_MOST]:
        yield f"  {'version':<12} {terminal.printable(line)}"
    for name, logs in list(result.not_evaluated.items())[:_MOST]:
        yield f"  {'note':<12} of {logs:,} logs not evaluated independently: {terminal.printable(name)}"
    if result.missing:
        yield f"  {'note':<12} runs of the plan without a row: {result.missing:,}"
    if result.lost:
        yield f"  {'note':<12} lost runs, which are not made again: {result.lost:,}"
    if result.level == "arithmetic":
        yield f"  {'note':<12} a table that was forged consistently is found by repetition only"


def _outcome(findings: Sequence[Finding]) -> str:
    return counted(len(findings), "finding") if findings else "sound"


def _findings(findings: Sequence[Finding]) -> Iterator[str]:
    for each in findings[:_MOST]:
        where = "" if each.index is None else f"run {each.index}, "
        there, expected = _text(each.found), _text(each.expected)
        yield f"  {'different':<12} {where}{terminal.printable(each.column)}: {there}, where {expected} has to be"
    if len(findings) > _MOST:
        yield f"  {'different':<12} {len(findings) - _MOST:,} more; --json lists all of them"


def _lines(result: VerificationResult) -> Iterator[str]:
    """The report on a log."""
    difference = result.difference
    found = "equal"
    if difference is not None and difference.time is not None:
        found = f"different from {difference.time / 1e9:g} s on"
    elif not result.is_equal:
        found = "different"
    elif result.tolerated:
        found = f"equal within {max(result.tolerances.values()):g}"
    yield f"{result.log}: {found}"
    yield f"  {'repeated':<12} {terminal.printable(result.scenario)}, seed {result.seed}, until {result.until:g} s"
    yield f"  {'equal':<12} {result.messages:,} messages{'' if result.is_equal else ' before the difference'}"
    if result.tolerances:
        yield f"  {'tolerance':<12} {_tolerance(result)}"
    if difference is not None:
        by = f", written by {result.writer}" if result.writer else ""
        yield f"  {'channel':<12} {terminal.printable(difference.topic)}{by}"
        yield from _values(difference)
    for each in result.attachments:
        yield f"  {'different':<12} {terminal.printable(f'{each.topic} {each.element}'.strip())}: {_pair(each)}"
    for version in result.versions:
        there = f"{version.then or 'not installed'} in the log, {version.now or 'not installed'} here"
        yield f"  {'version':<12} {terminal.printable(f'{version.name}: {there}')}"
    if result.damage:
        yield f"  {'damage':<12} {terminal.printable(result.damage)}"
    if not result.is_whole:
        yield f"  {'note':<12} the log ends before its run did; it was compared as far as it goes"


def _tolerance(result: VerificationResult) -> str:
    by = terminal.printable(", ".join(result.tolerances))
    said = f"{max(result.tolerances.values()):g}, stated by {by}; {result.tolerated:,} messages differ within it"
    if result.greatest is None:
        return said
    return f"{said}, by at most {result.greatest.distance:.3g} on {terminal.printable(result.greatest.topic)}"


def _values(difference: LogDifference) -> Iterator[str]:
    if difference.agent:
        yield f"  {'agent':<12} {terminal.printable(difference.agent)}"
    if difference.element:
        yield f"  {'element':<12} {terminal.printable(difference.element)}"
    first, second = difference.values
    yield f"  {'in the log':<12} {_text(first)}"
    apart = difference.distance
    yield f"  {'repeated':<12} {_text(second)}" + ("" if apart is None else f", {apart:.3g} apart")


def _pair(difference: LogDifference) -> str:
    first, second = difference.values
    return f"{_text(first)} in the log, {_text(second)} when repeated"


def _text(value: object) -> str:
    return "nothing" if value is None else terminal.printable(str(value))
