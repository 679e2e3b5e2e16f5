"""``symaware diff``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli.terminal import FAILED, WRONG_INPUT, Json, fail, print_json, printable, trouble_shown

if TYPE_CHECKING:
    from symaware_cli.api.comparison import ComparisonResult
    from symaware_cli.recording.log_comparison import ChannelDifference

#: How many lines of a kind are shown.
_MOST = 20


def diff(
    one: Annotated[Path, typer.Argument(help="A log or a scenario.", metavar="A")],
    other: Annotated[Path, typer.Argument(help="Another one.", metavar="B")],
    as_json: Json = False,
) -> None:
    """Tell two logs or two scenarios apart. Exit status 0 if they are equal, 1 if they differ."""
    for path in (one, other):
        if path.is_dir():
            fail(f"{path} is a folder: diff compares logs and scenarios", WRONG_INPUT, as_json)
    with trouble_shown(as_json):
        from symaware_cli.api.comparison import compare

        result = compare(one, other)
    if as_json:
        print_json(result.to_json())
    else:
        typer.echo("\n".join(_lines(result)))
    raise typer.Exit(0 if result.is_equal else FAILED)


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
        yield f"  {'channel':<34} {'since [s]':>10} {'messages':>9}  greatest difference"
    for each in result.channels[:_MOST]:
        since = "" if each.first.time is None else f"{each.first.time / 1e9:.9g}"
        yield f"  {printable(each.topic):<34} {since:>10} {each.messages:>9,}  {_greatest(each)}"
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
    """Where the numbers of a channel differ most, or who differs."""
    found = channel.greatest
    if found is None or found.time is None or found.distance is None:
        return printable(", ".join(channel.agents[:3]) + (" ..." if len(channel.agents) > 3 else ""))
    return printable(f"{found.distance:.4g} in {found.agent} {found.element} at {found.time / 1e9:.9g} s")


def _text(value: object) -> str:
    return "nothing" if value is None else printable(str(value))
