"""Common options, error reports and exit codes of all verbs."""

from __future__ import annotations

import json
import math
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from symaware_cli.cli import result_files
from symaware_cli.cli.folding import folded
from symaware_cli.cli.streams import is_lively, width_of

if TYPE_CHECKING:
    from symaware_cli.plugin_files import FileSet

FAILED, WRONG_INPUT, DATA_LOST, VIOLATED, INTERRUPTED = 1, 2, 3, 3, 130

#: What is said of a command that ends with a status, in files with results.
_RULES = {WRONG_INPUT: "invalid-input", INTERRUPTED: "interrupted"}

ScenarioPath = Annotated[
    Path, typer.Argument(help="A scenario in YAML or TOML, or a log that contains one.", metavar="SCENARIO")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Change a value, such as `agents.robot.count=8`; may be repeated.", metavar="PATH=VALUE"
    ),
]
Over = Annotated[
    list[str] | None,
    typer.Option(
        "--over",
        help="Vary a value: `agents.robot.count=4,8,16` or `run.duration=1..5 by 0.5`; may be repeated: every "
        "combination is one. Where values are drawn, also `PATH={uniform: [0, 1]}`.",
        metavar="PATH=VALUES",
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, max=2**63 - 1, help="A seed that replaces the one of the scenario.")]
Jobs = Annotated[
    int | None,
    typer.Option(
        "--jobs",
        "--workers",
        "-j",
        min=0,
        max=1024,
        help="Number of worker processes, by default one per core; 0 to run in this process.",
        metavar="N",
    ),
]


def _trust(ctx: typer.Context, given: bool) -> bool:
    """Trust the files of plugins of all scenarios until the command ends."""
    if given and not ctx.resilient_parsing:
        from symaware_cli.plugin_files import trusting

        ctx.with_resource(trusting(_trust_aloud))
    return given


def _trust_aloud(files: FileSet) -> bool:
    for name, digest in files.digests.items():
        say(f"symaware: trusted {name}, SHA-256 {digest}", err=True)
    return True


def trust_option(panel: str | None = None) -> Any:
    """The option that trusts the files of plugins of a scenario, in a panel of the help."""
    said = "Execute the scenario's own Python files (`plugins`) and FMUs."
    return typer.Option("--trust", callback=_trust, help=said, rich_help_panel=panel)


def own_plugins_option(panel: str | None = None) -> Any:
    """The option that adds a file of plugins, in a panel of the help."""
    said = "A Python file with plugins, which is executed; may be repeated."
    return typer.Option("--plugin", help=said, metavar="FILE", rich_help_panel=panel)


Trust = Annotated[bool, trust_option()]
OwnPlugins = Annotated[list[Path] | None, own_plugins_option()]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for scripts.")]


@contextmanager
def output_kept(for_scripts: bool) -> Iterator[None]:
    """Redirect the output of plugins to stderr, so that stdout contains only JSON.

    This includes native libraries, which write to the file descriptor.

    Args:
        for_scripts: Whether to redirect; otherwise nothing happens.
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
            # Flush the buffer of the C library, which would otherwise follow the JSON.
            ctypes.CDLL(None).fflush(None)
            os.dup2(kept, 1)
            os.close(kept)


@contextmanager
def progress_shown(what: str, wanted: bool = True) -> Iterator[Callable[[int, int], None] | None]:
    """Show a progress bar on a terminal; yields its update, from completed and total counts, or None without a bar."""
    if not wanted or not is_lively(sys.stderr):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def bold(text: str) -> str:
    """Return a text in bold, if colours are allowed."""
    return typer.style(text, bold=True) if is_lively(sys.stdout) else text


def say(text: object, *, err: bool = False) -> None:
    """Print a text for people, folded at the width of the terminal; not for JSON, tables for programs, or tracebacks.

    Args:
        text: The text.
        err: Whether to print it on stderr.
    """
    typer.echo(folded(str(text), width_of(sys.stderr if err else sys.stdout)), err=err)


def print_json(content: Any) -> None:
    """Print a value as JSON."""
    typer.echo(json.dumps(_finite(content), indent=2, allow_nan=False, default=str))


def print_array(entries: Iterable[Any]) -> None:
    """Print a JSON array entry by entry, because there may be many."""
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
    """Replace numbers that JSON does not have, such as an infinite risk, by text."""
    if isinstance(content, float):
        return content if math.isfinite(content) else str(content)
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return content


def fail(message: str, status: int, as_json: bool = False) -> NoReturn:
    """Print an error and exit."""
    result_files.note_error(_RULES.get(status, "failed-command"), message)
    if as_json:
        print_json({"error": message})
    else:
        say(f"symaware: {message}", err=True)
    raise typer.Exit(status)


def fail_for(error: OSError, as_json: bool = False) -> NoReturn:
    """Exit because a path cannot be used; this is wrong input, unless the disk is full or faulty."""
    from symaware_cli.log import is_about_path, reason

    name = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else str(error.filename)
    fail(f"cannot use {printable(name)}: {reason(error)}", WRONG_INPUT if is_about_path(error) else FAILED, as_json)


def refuse(reasons: Iterable[tuple[bool, str]], as_json: bool) -> None:
    """Exit with the first reason whose condition is true."""
    for is_true, reason in reasons:
        if is_true:
            fail(reason, WRONG_INPUT, as_json)


def names(listed: str | None) -> list[str]:
    """Split a list of names at commas."""
    return [name.strip() for name in (listed or "").split(",") if name.strip()]


def job_count(jobs: int | None) -> int:
    """The number of worker processes: by default one per core."""
    if jobs is not None:
        return jobs
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def is_sweep(path: Path) -> bool:
    """Whether a path is the folder of a sweep."""
    if not os.path.isdir(path):
        return False
    from symaware_cli.studies import is_sweep

    return is_sweep(path)


def instant(option: str, time: float | None, as_json: bool = False) -> int | None:
    """Convert the time [s] of an option to nanoseconds; exit if it is invalid."""
    if time is None:
        return None
    if not 0 <= time < 1e9:
        fail(f"{option} takes a time in seconds, not {time:g}", WRONG_INPUT, as_json)
    return round(time * 1e9)


def span(start: float | None, end: float | None, as_json: bool = False) -> tuple[int | None, int | None]:
    """Return --from and --to [s] as instants [ns]; exit if --from is later than --to."""
    first, last = instant("--from", start, as_json), instant("--to", end, as_json)
    if first is not None and last is not None and first > last:
        fail(f"--from {start:g} is later than --to {end:g}", WRONG_INPUT, as_json)
    return first, last


@contextmanager
def trouble_shown(as_json: bool = False) -> Iterator[None]:
    """Report errors that the user can correct without a traceback; after Ctrl-C, name the saved files; exit.

    Args:
        as_json: Whether to report them as JSON.
    """
    from symaware_cli.entry_points import PluginError
    from symaware_cli.language import ScenarioError, nearest, render, to_json
    from symaware_cli.log import UnknownNameError, outputs_noted
    from symaware_cli.world import UserError

    saved: list[Path] = []
    try:
        with _plugins_reported(), outputs_noted() as saved:
            yield
    except ScenarioError as error:
        result_files.note_problems(error.problems)
        if as_json:
            print_json({"valid": False, "problems": to_json(error.problems)})
        else:
            say(render(error.problems, colour=is_lively(sys.stderr), width=width_of(sys.stderr) or 100), err=True)
        raise typer.Exit(WRONG_INPUT) from None
    except UnknownNameError as error:
        near = nearest(error.name, error.known)
        fail(f"{error}; did you mean `{near}`?" if near else str(error), WRONG_INPUT, as_json)
    except UserError as error:
        fail(str(error), error.status, as_json)
    except PluginError as error:
        hint = f"; did you mean `{error.suggestion}`?" if error.suggestion else ""
        fail(
            f"{error}{hint}" if hint else error.sentence,
            FAILED if error.code == "failed-plugin" else WRONG_INPUT,
            as_json,
        )
    except KeyboardInterrupt:
        fail(interruption(saved), INTERRUPTED, as_json)


def interruption(saved: Iterable[Path]) -> str:
    """Return the message of a command after Ctrl-C.

    Args:
        saved: The files that were written; those that no longer exist are left out, such as parts of an unfinished
            folder.
    """
    there = [str(path) for path in saved if path.exists()]
    return f"interrupted; saved: {', '.join(map(printable, there))}" if there else "interrupted; nothing was saved"


@contextmanager
def _plugins_reported() -> Iterator[None]:
    """Print a line about each broken plugin that is left out, once."""
    import warnings

    from symaware_cli.entry_points import PluginWarning

    with warnings.catch_warnings():
        shown, said = warnings.showwarning, set[str]()

        def show(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
            if not issubclass(category, PluginWarning):
                shown(message, category, *rest, **more)
            elif str(message) not in said:
                said.add(str(message))
                say(f"symaware: {message}", err=True)

        warnings.showwarning = show
        warnings.simplefilter("always", PluginWarning)
        yield


def printable(text: str) -> str:
    """Return a text from a log without line breaks and terminal control characters."""
    return text if text.isprintable() else "".join(each if each.isprintable() else ascii(each)[1:-1] for each in text)
