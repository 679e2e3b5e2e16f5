"""``symaware diff``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli.result_files import Results, note
from symaware_cli.cli.terminal import FAILED, WRONG_INPUT, Json, fail, print_json, printable, say, trouble_shown
from symaware_cli.cli.text_table import aligned
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import ComparisonResult, ResultCase, SweepComparison
    from symaware_cli.log import ChannelDifference

#: How many lines of a kind are shown.
_MOST = 20

#: How many characters of a value of a scenario are shown.
_LONG = 120


@in_help("compare", 10)
def diff(
    one: Annotated[Path, typer.Argument(help="A log, a scenario, or the folder of a sweep.", metavar="A")],
    other: Annotated[Path, typer.Argument(help="The one to compare it with.", metavar="B")],
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot",
            help="Write a .png, .svg, .pdf or .pgf: for two logs, both runs on one map and their distance over "
            "time; for two sweeps, each run's values in one against those in the other.",
            metavar="FILE",
        ),
    ] = None,
    tolerance: Annotated[
        Path | None,
        typer.Option(
            help="For two logs, a file that says by how much numbers may differ, by channels and columns.",
            metavar="FILE",
        ),
    ] = None,
    results: Results = None,
    as_json: Json = False,
) -> None:
    """Compare two logs, scenarios or sweeps. Exit status 0 if they are equal, 1 if they differ.

    With ``--tolerance``, two logs are equal if all numbers are as near to each other as it says: a test that a run is
    still the one in a log that was kept.
    """
    result: ComparisonResult | SweepComparison
    if plot and not (one.suffix == other.suffix == ".mcap" or (one.is_dir() and other.is_dir())):
        fail("--plot goes with two logs, or with two sweeps", WRONG_INPUT, as_json)
    if tolerance and not one.suffix == other.suffix == ".mcap":
        fail("--tolerance goes with two logs", WRONG_INPUT, as_json)
    with trouble_shown(as_json):
        if one.is_dir() and other.is_dir():
            result = _compared_sweeps(one, other, plot, as_json=as_json)
            lines = _sweep_lines(result)
        else:
            for path in (one, other):
                if path.is_dir():
                    fail(f"{path} is a folder, which is compared with another folder of a sweep", WRONG_INPUT, as_json)
            from symaware_cli.evidence import compare

            result = compare(one, other, plot, tolerance)
            lines = _lines(result)
        note(lambda: _cases(result))
    if as_json:
        print_json(result.to_json())
    else:
        say("\n".join(lines))
    raise typer.Exit(0 if result.is_equal else FAILED)


def _cases(result: ComparisonResult | SweepComparison) -> Iterable[ResultCase]:
    from symaware_cli.evidence import ComparisonResult, comparison_cases, sweep_comparison_cases

    return comparison_cases(result) if isinstance(result, ComparisonResult) else sweep_comparison_cases(result)


def _compared_sweeps(one: Path, other: Path, plot: Path | None, *, as_json: bool) -> SweepComparison:
    from symaware_cli.evidence import compare_sweeps
    from symaware_cli.studies import SweepError

    try:
        return compare_sweeps(one, other, plot)
    except SweepError as error:
        fail(str(error), WRONG_INPUT, as_json)


def _sweep_lines(result: SweepComparison) -> Iterator[str]:
    """The report on two sweeps."""
    one, other = result.paths
    yield f"{one} and {other}: {'equal' if result.is_equal else 'different'}"
    for title, changes in (("plan", result.plan), ("scenario", result.scenario)):
        for change in changes[:_MOST]:
            first, second = change.values
            yield f"  {title:<12} {printable(change.path)}: {_text(first)} and {_text(second)}"
        yield from _more(len(changes), title)
    rows, others = result.rows
    kind = "with the same seeds" if result.is_paired else "with seeds of their own"
    yield f"  {'rows':<12} {rows:,} and {others:,}; {result.compared:,} in both, {kind}"
    if result.first is not None:
        yield f"  {'different':<12} {result.differing:,} rows, from run {result.first} on"
    if result.columns:
        lines = [["column", "first", "second", "difference", "interval of 95 %"]]
        for each in result.columns[:_MOST]:
            interval = "" if each.interval is None else f"{each.interval[0]:.4g} to {each.interval[1]:.4g}"
            lines.append([printable(each.name), *map(_number, (*each.means, each.difference)), interval])
        yield from aligned(lines, "<>>><")
    yield from _more(len(result.columns), "column")
    for path, names in zip(result.paths, result.only, strict=True):
        if names:
            yield f"  {'columns':<12} only {path} has {printable(', '.join(names))}"
    for version in result.versions[:_MOST]:
        yield f"  {'version':<12} {printable(f'{version.name}: {version.then} and {version.now}')}"


def _number(value: float) -> str:
    """Return a number for a table; a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.4g}"


def _lines(result: ComparisonResult) -> Iterator[str]:
    one, other = result.paths
    yield f"{one} and {other}: {'equal' if result.is_equal else 'different'}"
    for change in result.scenario[:_MOST]:
        (first, second), places = change.values, ", ".join(filter(None, change.places))
        yield f"  {'scenario':<12} {printable(change.path)}: {_text(first)} and {_text(second)} ({places})"
    yield from _more(len(result.scenario), "scenario")
    if result.first is not None:
        yield f"  {'from here on':<12} {printable(str(result.first))}"
    if result.channels:
        lines = [["channel", "since [s]", "messages", "greatest difference"]]
        for each in result.channels[:_MOST]:
            since = "" if each.first.time is None else f"{each.first.time / 1e9:.9g}"
            lines.append([printable(each.topic), since, f"{each.messages:,}", _greatest(each)])
        yield from aligned(lines, "<>><")
    yield from _more(len(result.channels), "channel")
    for name, (first_count, second_count) in (result.events or {}).items():
        yield f"  {'event':<12} {printable(name)}: {first_count} and {second_count} times"
    for each_attached in result.attachments:
        yield f"  {'different':<12} {printable(str(each_attached))}"
    for version in result.versions[:_MOST]:
        yield f"  {'version':<12} {printable(f'{version.name}: {version.then} and {version.now}')}"


def _more(count: int, what: str) -> Iterator[str]:
    if count > _MOST:
        yield f"  {what:<12} {count - _MOST:,} more; --json lists all of them"


def _greatest(channel: ChannelDifference) -> str:
    """The place of the greatest difference between numbers of a channel, or the agents that differ."""
    found = channel.greatest
    if found is None or found.time is None or found.distance is None:
        return printable(", ".join(channel.agents[:3]) + (" ..." if len(channel.agents) > 3 else ""))
    return printable(f"{found.distance:.4g} in {found.agent} {found.element} at {found.time / 1e9:.9g} s")


def _text(value: object) -> str:
    """Return a value of a scenario as YAML has it, without its middle if it is long."""
    text = "nothing" if value is None else printable(_flow(value))
    return text if len(text) <= _LONG else f"{text[: _LONG // 2]} ... {text[-_LONG // 2 :]}"


def _flow(value: object) -> str:
    match value:
        case dict():
            return f"{{{', '.join(f'{key}: {_flow(each)}' for key, each in value.items())}}}"
        case list() | tuple():
            return f"[{', '.join(map(_flow, value))}]"
        case bool():
            return str(value).lower()
        case None:
            return "null"
    return str(value)
