"""What all verbs share: their common options, and how they show trouble and leave."""

from __future__ import annotations

import json
import math
import os
import sys
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Annotated, Any, NoReturn, TextIO

import typer

FAILED, WRONG_INPUT, DATA_LOST, INTERRUPTED = 1, 2, 3, 130

ScenarioPath = Annotated[
    Path, typer.Argument(help="A scenario in YAML or TOML, or a log that contains one.", metavar="SCENARIO")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Change a value, such as `agents.robot.count=8`; may be repeated.", metavar="PATH=VALUE"
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, max=2**63 - 1, help="A seed that replaces the one of the scenario.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for scripts.")]


@contextmanager
def output_kept(for_scripts: bool) -> Iterator[None]:
    """Let what plugins print go to stderr, so that scripts read nothing but our JSON on stdout.

    That is so for native libraries, too, which write to the file descriptor.

    Args:
        for_scripts: Whether to; otherwise nothing happens.
    """
    if not for_scripts:
        yield
        return
    import ctypes

    sys.stdout.flush()
    with redirect_stdout(sys.stderr):
        try:
            kept = os.dup(1)
        except OSError:  # there is no stdout
            yield
            return
        os.dup2(2, 1)
        try:
            yield
        finally:
            # What is still in the buffer of the C library would come after our JSON.
            ctypes.CDLL(None).fflush(None)
            os.dup2(kept, 1)
            os.close(kept)


def is_plain() -> bool:
    """Whether nothing but text is wanted: `NO_COLOR` (https://no-color.org) or `TERM=dumb` says so."""
    return bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM") == "dumb"


def is_lively(stream: TextIO) -> bool:
    """Whether a stream is a terminal that may be sent colours and moving bars."""
    return stream.isatty() and not is_plain()


def bold(text: str) -> str:
    """A text to be printed in bold, where that is wanted."""
    return typer.style(text, bold=True) if is_lively(sys.stdout) else text


def print_json(content: Any) -> None:
    """Print what a script reads."""
    typer.echo(json.dumps(_finite(content), indent=2, allow_nan=False, default=str))


def print_array(entries: Iterable[Any]) -> None:
    """Print what a script reads, entry by entry, as there may be many."""
    between = "\n"
    typer.echo("[", nl=False)
    try:
        for entry in entries:
            text = json.dumps(_finite(entry), indent=2, allow_nan=False, default=str)
            typer.echo(between + textwrap.indent(text, "  "), nl=False)
            between = ",\n"
    finally:
        typer.echo("]" if between == "\n" else "\n]")


def _finite(content: Any) -> Any:
    """Put into words the numbers that JSON does not have, such as an infinite risk."""
    if isinstance(content, float):
        return content if math.isfinite(content) else str(content)
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content


def fail(message: str, status: int, as_json: bool = False) -> NoReturn:
    """Say what is wrong, and leave."""
    if as_json:
        print_json({"error": message})
    else:
        typer.echo(f"symaware: {message}", err=True)
    raise typer.Exit(status)


def names(listed: str | None) -> list[str]:
    """Take names apart that commas separate."""
    return [name.strip() for name in (listed or "").split(",") if name.strip()]


def instant(option: str, time: float | None, as_json: bool = False) -> int | None:
    """Turn the time [s] that an option was given into nanoseconds; leave where it cannot be one."""
    if time is None:
        return None
    if not 0 <= time < 1e9:
        fail(f"{option} takes a time in seconds, not {time:g}", WRONG_INPUT, as_json)
    return round(time * 1e9)


def span(start: float | None, end: float | None, as_json: bool = False) -> tuple[int | None, int | None]:
    """The first and the last instant [ns] of what --from and --to [s] ask for; leave where there is nothing between."""
    first, last = instant("--from", start, as_json), instant("--to", end, as_json)
    if first is not None and last is not None and first > last:
        fail(f"--from {start:g} is later than --to {end:g}", WRONG_INPUT, as_json)
    return first, last


@contextmanager
def trouble_shown(as_json: bool = False) -> Iterator[None]:
    """Turn problems with scenarios and logs into a report and an exit status."""
    from symaware_cli.recording.error import LogError, OutputError, UnknownNameError
    from symaware_cli.scenario.problem import ScenarioError, nearest, render, to_json

    try:
        yield
    except ScenarioError as error:
        if as_json:
            print_json({"valid": False, "problems": to_json(error.problems)})
        else:
            typer.echo(render(error.problems, colour=is_lively(sys.stderr)), err=True)
        raise typer.Exit(WRONG_INPUT) from None
    except OutputError as error:
        fail(str(error), FAILED, as_json)
    except UnknownNameError as error:
        near = nearest(error.name, error.known)
        fail(f"{error}; did you mean `{near}`?" if near else str(error), WRONG_INPUT, as_json)
    except LogError as error:
        fail(str(error), WRONG_INPUT, as_json)


def printable(text: str) -> str:
    """A text from a log without what would break lines or be taken for commands by a terminal."""
    return text if text.isprintable() else "".join(each if each.isprintable() else ascii(each)[1:-1] for each in text)
