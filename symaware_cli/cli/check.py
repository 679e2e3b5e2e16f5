"""``symaware check``."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli.result_files import Results, note
from symaware_cli.cli.terminal import (
    DATA_LOST,
    FAILED,
    VIOLATED,
    WRONG_INPUT,
    Json,
    Trust,
    fail,
    print_json,
    printable,
    say,
    trouble_shown,
)
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import CheckResult, ResultCase


@in_help("check", 20)
def check(
    paths: Annotated[list[Path], typer.Argument(help="Logs, or folders of logs.", metavar="LOG...")],
    formula: Annotated[
        str | None, typer.Option(help="A formula to check instead of the specifications of the log.")
    ] = None,
    each: Annotated[
        str | None,
        typer.Option(help="The group whose agents the formula is about; by default every group.", metavar="GROUP"),
    ] = None,
    pairs: Annotated[
        str | None, typer.Option(help="The group whose pairs of agents the formula is about.", metavar="GROUP")
    ] = None,
    of: Annotated[str, typer.Option(help="What the formula is about: truth or belief.")] = "truth",
    logic: Annotated[str, typer.Option(help="The logic of the formula: stl or ltl.")] = "stl",
    file: Annotated[
        Path | None,
        typer.Option(help="A file of specifications to check instead, as in a scenario.", metavar="SPECIFICATIONS"),
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Repeat the run instead of reading what was recorded of it.")
    ] = False,
    trust: Trust = False,
    results_to: Results = None,
    as_json: Json = False,
) -> None:
    """Check specifications on logs: those of the run, or new ones."""
    if formula is None:
        for option, given in (
            ("--each", each),
            ("--pairs", pairs),
            ("--of", of != "truth"),
            ("--logic", logic != "stl"),
        ):
            if given:
                fail(f"{option} says what a formula is about: it goes with --formula", WRONG_INPUT, as_json)
    elif file is not None:
        fail("--formula and --file both say what to check: give one of them", WRONG_INPUT, as_json)
    elif each is not None and pairs is not None:
        fail("--each and --pairs both say what the formula is about: give one of them", WRONG_INPUT, as_json)
    if logic not in ("stl", "ltl"):
        fail(f"--logic takes stl or ltl, not {logic}", WRONG_INPUT, as_json)
    if of not in ("truth", "belief"):
        fail(f"--of takes truth or belief, not {of}", WRONG_INPUT, as_json)
    logs = _logs(paths, as_json=as_json)
    results = []
    with trouble_shown(as_json), _located({"--formula": formula, "--each": each, "--pairs": pairs}):
        from symaware_cli.engine import RunError
        from symaware_cli.evidence import check_log

        for log in logs:
            stated: Mapping[str, Any] | Path | None = file
            if formula is not None:
                stated = _stated(log, {"formula": formula, "of": of, "logic": logic}, each, pairs)
            try:
                results.append(check_log(log, stated, again))
            except RunError as error:
                fail(str(error), FAILED, as_json)
            note(partial(_cases, results[-1], file, has_places=formula is None))
    if as_json:
        found = [result.to_json() for result in results]
        print_json(found[0] if len(found) == 1 and paths[0].is_file() else {"logs": found})
    elif len(results) == 1:
        say("\n".join(_lines(results[0])))
    else:
        say("\n".join(_table(results)))
        for result in results:
            if result.damage:
                say(f"symaware: {result.log}: {result.damage}", err=True)
    if any(result.violated for result in results):
        raise typer.Exit(VIOLATED)
    raise typer.Exit(DATA_LOST if any(result.damage for result in results) else 0)


def _cases(result: CheckResult, file: Path | None, *, has_places: bool) -> Iterable[ResultCase]:
    """The specifications as test cases, with their places in the scenario or in the file of specifications."""
    from symaware_cli.evidence import check_cases, specification_spans

    return check_cases(result, specification_spans(result.log, None, file) if has_places else {})


def _logs(paths: Sequence[Path], *, as_json: bool) -> list[Path]:
    """The logs that are named, and those in folders; sorted within each."""
    logs: list[Path] = []
    for path in paths:
        found = sorted(path.rglob("*.mcap")) if path.is_dir() else [path]
        if not found:
            fail(f"there are no logs in {path}", WRONG_INPUT, as_json)
        logs += found
    return logs


@contextmanager
def _located(options: Mapping[str, str | None]) -> Iterator[None]:
    """Locate the problems of a formula in the options in which it was typed, instead of in the scenario's changes."""
    from symaware_cli.language import Problem, ScenarioError, TextSpan

    def typed(problem: Problem) -> Problem:
        span, line = problem.span, problem.source_line
        if span is None or line is None or not span.file.startswith("--set specifications="):
            return problem
        for option, text in options.items():
            if text is not None:
                stated = json.dumps(text, ensure_ascii=False)
                start = line.rfind(stated, 0, span.column - 1 + len(stated))
                if 0 <= start < span.column <= start + len(stated):
                    first, last = (min(max(at - start - 1, 1), len(text) + 1) for at in (span.column, span.end_column))
                    place = TextSpan(option, 1, first, max(last, first))
                    return replace(problem, span=place, source_line=text)
        return problem

    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(map(typed, error.problems)) from None


def _stated(log: Path, stated: Mapping[str, str], each: str | None, pairs: str | None) -> Mapping[str, Any]:
    """The specifications given by a formula and its scope."""
    if pairs is not None:
        return {"formula": {**stated, "pairs": pairs}}
    if each is not None:
        return {"formula": {**stated, "each": each}}
    from symaware_cli.log import open_log

    groups = list(open_log(log).agents)
    return {("formula" if len(groups) == 1 else group): {**stated, "each": group} for group in groups}


def _lines(result: CheckResult) -> list[str]:
    """The report on one log."""
    lines = [f"{result.log}: {result.scenario}, seed {result.seed}"]
    if not result.specifications:
        lines.append("  there are no specifications; give one with --formula or --file")
    lines += [f"  {each.verdict:<10} {printable(str(each))}" for each in result.specifications]
    return lines + [f"  {'note':<10} {note}" for note in _notes(result)]


def _notes(result: CheckResult) -> list[str]:
    notes = []
    if result.sampled is not None:
        notes.append(f"sampled: the log has an instant every {result.sampled:g} s; --again looks at every step")
    if result.damage:
        notes.append(f"the log is damaged, so verdicts are about a part of the run only: {result.damage}")
    if not result.is_whole:
        notes.append("the run did not come to its end, so what was not decided by then stays undecided")
    return notes


def _table(results: Sequence[CheckResult]) -> list[str]:
    """The report on several logs, with a line for each."""
    names = list(dict.fromkeys(each.name for result in results for each in result.specifications))
    lines = [["log", *names]]
    for result in results:
        said = {each.name: _cell(each.verdict, each.robustness) for each in result.specifications}
        lines.append([str(result.log), *(said.get(name, "-") for name in names)])
    counts = {name: sum(name in result.violated for result in results) for name in names}
    violated = ", ".join(f"{name} in {count} of {len(results)}" for name, count in counts.items() if count)
    return [*aligned(lines, "<", indent=""), f"violated: {violated or 'none'}"]


def _cell(verdict: str, robustness: float | None) -> str:
    return verdict if robustness is None else f"{verdict} {robustness:.4g}"
