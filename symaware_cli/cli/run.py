"""``symaware run``."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli import processor
from symaware_cli.cli.progress import progress
from symaware_cli.cli.terminal import (
    FAILED,
    INTERRUPTED,
    WRONG_INPUT,
    Json,
    Overrides,
    ScenarioPath,
    Seed,
    fail,
    is_lively,
    names,
    output_kept,
    print_json,
    size_in_words,
    trouble_shown,
)

if TYPE_CHECKING:
    from symaware_cli.runtime.pacer import Pace
    from symaware_cli.runtime.summary import Extreme, Summary
    from symaware_cli.scenario.build import Built
    from symaware_cli.scenario.place import Place

_SPREAD = "Several processes"


def run(
    scenario: ScenarioPath,
    seed: Seed = None,
    overrides: Overrides = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="The log; replaced if it exists. By default NAME.mcap, or NAME-2.mcap, ..."
        ),
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(
            "--timeout", min=0.001, help="Wall time after which the run is ended and its log finished, in seconds."
        ),
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Write no log.")] = False,
    live: Annotated[bool, typer.Option("--live", help="Show the run in the Rerun viewer while it goes on.")] = False,
    connect: Annotated[
        str | None, typer.Option("--connect", help="The same in a viewer that runs already.", metavar="URL")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show neither progress nor summary.")] = False,
    as_json: Json = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            help="Of a run of several processes, the agents that run here.",
            metavar="AGENTS",
            rich_help_panel=_SPREAD,
        ),
    ] = None,
    listen: Annotated[
        int | None,
        typer.Option(
            "--listen",
            min=0,
            max=65535,
            help="Be the host of the world, at this port; 0 for any.",
            metavar="PORT",
            rich_help_panel=_SPREAD,
        ),
    ] = None,
    join: Annotated[
        str | None,
        typer.Option("--join", help="Take part in the run of a host.", metavar="HOST:PORT", rich_help_panel=_SPREAD),
    ] = None,
    bind: Annotated[
        str | None,
        typer.Option(
            "--bind",
            help="Listen at this address instead of 127.0.0.1; needs a key.",
            metavar="ADDRESS",
            rich_help_panel=_SPREAD,
        ),
    ] = None,
    key_file: Annotated[
        Path | None,
        typer.Option(
            "--key-file", help="A file with the key that all processes share.", metavar="FILE", rich_help_panel=_SPREAD
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option("--name", help="What the others call this process.", metavar="NAME", rich_help_panel=_SPREAD),
    ] = None,
    wait: Annotated[
        float,
        typer.Option("--wait", min=0.1, help="For how many seconds to wait for the others.", rich_help_panel=_SPREAD),
    ] = 60.0,
) -> None:
    """Run a scenario and record it in a log."""
    place = _place(listen, bind, join, names(",".join(only or ())), key_file, name, wait, as_json)
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.scenario.execution import open_scenario

        built = open_scenario(scenario, overrides or (), seed)
    from symaware_cli.scenario.execution import is_read, unused_path

    if output and is_read(built, output, scenario):
        fail(f"{output} is a file of the scenario; the log needs a file of its own", WRONG_INPUT, as_json)
    log = None if no_record else output or unused_path(built.document.name)
    with ExitStack() as stack:
        path = log
        if live or connect:
            path = stack.enter_context(_live(log, connect, as_json))
        if place and not (quiet or as_json):
            for event in ("waiting", "joined", "rejoined", "lost", "rejected"):
                built.simulation.events.subscribe(event, lambda event: typer.echo(f"symaware: {event.text}", err=True))
        summary = _execute(built, path, timeout, quiet, as_json, place)
        if log is None:
            summary = replace(summary, log=None, log_size=None)
        if as_json:
            print_json(summary.to_json())
        elif not quiet:
            typer.echo(_text(summary))
        if summary.failure and not as_json:
            typer.echo(f"symaware: {summary.failure}", err=True)
            if summary.log is None:
                typer.echo(summary.traceback or "", err=True, nl=False)
            else:
                typer.echo(f"The traceback is in the log: symaware inspect --events {summary.log}", err=True)
        sys.stdout.flush()
    raise typer.Exit({"finished": 0, "failed": FAILED, "interrupted": INTERRUPTED}[summary.status])


def _place(
    listen: int | None,
    bind: str | None,
    join: str | None,
    only: Sequence[str],
    key: Path | None,
    name: str | None,
    wait: float,
    as_json: bool,
) -> Place | None:
    """Where this process stands among those that share the run; leave where that makes no sense."""
    if listen is None and join is None:
        for option, given in (("--only", only), ("--bind", bind), ("--key-file", key), ("--name", name)):
            if given:
                fail(
                    f"{option} is for a run of several processes: with --listen PORT or --join HOST:PORT",
                    WRONG_INPUT,
                    as_json,
                )
        return None
    if listen is not None and join is not None:
        fail("--listen is for the host and --join for all others: give one of them", WRONG_INPUT, as_json)
    if bind and join:
        fail("--bind says where a host listens: it goes with --listen", WRONG_INPUT, as_json)
    from symaware_cli.scenario.place import Place

    if join is not None:
        return Place("member", join, only, name, key, wait)
    address = bind or "127.0.0.1"
    return Place("host", f"[{address}]:{listen}" if ":" in address else f"{address}:{listen}", only, name, key, wait)


def _execute(
    built: Built, log: Path | None, timeout: float | None, quiet: bool, as_json: bool, place: Place | None
) -> Summary:
    from symaware_cli.core import TransportError
    from symaware_cli.recording.error import LogError
    from symaware_cli.scenario.execution import execute
    from symaware_cli.scenario.place import DistributionError

    shortfall = processor.shortfall()
    if shortfall and not quiet:
        typer.echo(f"symaware: {shortfall}", err=True)
    warnings.filterwarnings("ignore", category=processor.ProcessorWarning)
    duration = built.steps * built.simulation.environment.time_step
    shown = is_lively(sys.stderr) and not quiet and not as_json
    try:
        with progress(built.document.name, 0, duration, shown) as on_progress, output_kept(as_json):
            return execute(built, log, on_progress, timeout, place)
    except LogError as error:
        fail(str(error), FAILED, as_json)
    except (DistributionError, TransportError) as error:
        fail(str(error), WRONG_INPUT, as_json)
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None


def _live(log: Path | None, connect: str | None, as_json: bool) -> AbstractContextManager[Path]:
    from symaware_cli.cli.live import live_view

    with trouble_shown(as_json):
        from symaware_cli.viewing.viewer import require

        require()
    return live_view(log, connect)


def _text(summary: Summary) -> str:
    """Lay out the summary for people."""
    agents = f"{summary.agents} agent{'s' if summary.agents != 1 else ''}"
    lines = [
        f"{summary.name}: {summary.status} after {summary.simulated_time:g} s of simulated time",
        _line("agents", f"{agents}, {summary.steps:,} steps, seed {summary.seed}"),
        _line("wall time", f"{summary.wall_time:.2f} s, {_factor(summary.real_time_factor)} real time"),
    ]
    if summary.warnings:
        lines.append(_line("warnings", ", ".join(f"{count:,} {name}" for name, count in summary.warnings.items())))
    if summary.pace:
        lines.append(_line("pace", _pace(summary.pace)))
    if summary.goals_reached:
        lines.append(_line("goals reached", f"{len(summary.goals_reached)} of {agents}"))
    lines.append(_line("contacts", f"{summary.contacts}"))
    if summary.minimum_separation:
        lines.append(_line("closest", _extreme(summary.minimum_separation, "m between the outlines of")))
    if summary.highest_risk:
        lines.append(_line("highest risk", _extreme(summary.highest_risk, "of")))
    if summary.log:
        size = size_in_words(summary.log_size or 0)
        lines.append(_line("recorded", f"{summary.updates:,} updates, {size}"))
        lines.append(_line("log", summary.log))
    return "\n".join(lines)


def _pace(pace: Pace) -> str:
    kept = f"{pace.factor:g} x real time, {pace.late:,} of {pace.instants:,} instants late"
    return f"{kept}, by {1e3 * pace.worst:.3g} ms at most" if pace.late else kept


def _line(label: str, text: str) -> str:
    return f"  {label:<14} {text}"


def _factor(factor: float) -> str:
    return f"{factor:,.0f} x" if factor >= 10 else f"{factor:.2g} x"


def _extreme(extreme: Extreme, relation: str) -> str:
    return f"{extreme.value:.3g} {relation} {' and '.join(extreme.who)} at {extreme.time:g} s"
