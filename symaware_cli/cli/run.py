"""``symaware run``."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli import processor
from symaware_cli.api import RunFailedError, RunInterrupted
from symaware_cli.cli import terminal
from symaware_cli.cli.result_files import note, note_problems, results_option
from symaware_cli.cli.streams import is_lively
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.api import Scenario
    from symaware_cli.core import Event
    from symaware_cli.engine import RunSummary
    from symaware_cli.evidence import ResultCase
    from symaware_cli.language import Problem
    from symaware_cli.processes import Place

_WHAT, _RESULT, _VIEW, _SPREAD = "What to run", "What is written", "Live view", "Several processes"


@in_help("run", 10)
def run(
    scenario: terminal.ScenarioPath,
    seed: terminal.Seed = None,
    overrides: terminal.Overrides = None,
    index: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Of the folder of a sweep, the run to repeat; of a scenario, the run of a sweep, or the episode, with "
            "this --seed.",
            metavar="N",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The log; replaced if it exists. By default NAME.mcap, or NAME-2.mcap, ...",
            rich_help_panel=_RESULT,
        ),
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(
            "--timeout",
            min=0.001,
            help="Wall time after which the run is ended and its log finished, in seconds.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Write no log.", rich_help_panel=_RESULT)] = False,
    live: Annotated[
        bool,
        typer.Option("--live", help="Show the run in the Rerun viewer while it is running.", rich_help_panel=_VIEW),
    ] = False,
    connect: Annotated[
        str | None,
        typer.Option("--connect", help="Like --live, in a running viewer.", metavar="URL", rich_help_panel=_VIEW),
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Do not show progress and summary.", rich_help_panel=_RESULT)
    ] = False,
    results: Annotated[list[str] | None, results_option(_RESULT)] = None,
    trust: Annotated[bool, terminal.trust_option(_WHAT)] = False,
    plugins: Annotated[list[Path] | None, terminal.own_plugins_option(_WHAT)] = None,
    as_json: terminal.Json = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            help="In a run of several processes, the agents that run here.",
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
        typer.Option("--join", help="Join the run of a host.", metavar="HOST:PORT", rich_help_panel=_SPREAD),
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
        typer.Option("--name", help="Name of this process in the run.", metavar="NAME", rich_help_panel=_SPREAD),
    ] = None,
    wait: Annotated[
        float,
        typer.Option("--wait", min=0.1, help="How long to wait for the others, in seconds.", rich_help_panel=_SPREAD),
    ] = 60.0,
) -> None:
    """Run a scenario and record it in a log."""
    terminal.refuse([(no_record and output is not None, "--no-record writes no log, and --output names one")], as_json)
    place = _place(listen, bind, join, terminal.names(",".join(only or ())), key_file, name, wait, as_json=as_json)
    warnings.filterwarnings("ignore", category=processor.ProcessorWarning)
    shows = not quiet and not as_json
    doubtful: list[Problem] = []

    def warn(found: Sequence[Problem]) -> None:
        doubtful.extend(found)
        if shows:
            from symaware_cli.language import render

            terminal.say(render(found, colour=is_lively(sys.stderr), noun="warning"), err=True)

    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.api import Scenario

        if index is not None and seed is not None and not os.path.isdir(scenario):
            from symaware_cli.studies import seed_of

            seed, index = seed_of(seed, index), None
        if index is not None or os.path.isdir(scenario):
            source = _of_sweep(scenario, index, [seed is not None, overrides, plugins], as_json=as_json)
        else:
            source = Scenario(scenario, overrides, seed=seed, plugins=plugins or ())
        try:
            result = source.run(
                output=output,
                record=not no_record,
                timeout=timeout,
                progress=shows and is_lively(sys.stderr),
                on_event=dict.fromkeys(_TOLD, _tell) if place and shows else None,
                live=connect or live,
                place=place,
                may_exit=True,
                # The host's warnings are about the whole run.
                on_warnings=None if (quiet and not results) or join is not None else warn,
            )
        except (RunFailedError, RunInterrupted) as ended:
            result = ended.run
        note_problems(doubtful, is_warning=True)
        note(lambda: _cases(result.summary, source, overrides))
    summary, shortfall = result.summary, processor.shortfall()
    if shortfall and not quiet:
        terminal.say(f"symaware: {shortfall}", err=True)
    if as_json:
        from symaware_cli.language import to_json

        terminal.print_json({**summary.to_json(), "scenario_warnings": to_json(doubtful)})
    elif not quiet:
        terminal.say(result)
    elif result.status == "interrupted":
        terminal.say(f"symaware: {terminal.interruption([Path(summary.log)] if summary.log else [])}", err=True)
    if summary.failure and not as_json:
        terminal.say(f"symaware: {summary.failure}", err=True)
        if summary.log is None:
            typer.echo(summary.traceback or "", err=True, nl=False)
        elif summary.traceback:
            terminal.say(f"The traceback is in the log: symaware log events {summary.log}", err=True)
    sys.stdout.flush()
    if result.viewer:
        # Ctrl-C now closes the view.
        with suppress(KeyboardInterrupt):
            result.viewer.wait()
        result.viewer.close()
    finished = terminal.VIOLATED if summary.falls_short else 0
    raise typer.Exit(
        {"finished": finished, "failed": terminal.FAILED, "interrupted": terminal.INTERRUPTED}[result.status]
    )


def _cases(summary: RunSummary, scenario: Scenario, overrides: Sequence[str] | None) -> Iterable[ResultCase]:
    from symaware_cli.evidence import run_cases, specification_spans

    return run_cases(summary, specification_spans(Path(scenario.path), overrides))


def _of_sweep(folder: Path, index: int | None, others: Sequence[object], *, as_json: bool) -> Scenario:
    """Return the scenario of a run of a sweep; exit if the options are inconsistent."""
    from symaware_cli.api import scenario_of
    from symaware_cli.studies import is_sweep

    if index is None:
        if not is_sweep(folder):
            said = f"{folder} is a folder, and not that of a sweep: give a scenario or a log"
        else:
            said = f"{folder} is a folder: say which run of its sweep to repeat, with --index"
        terminal.fail(said, terminal.WRONG_INPUT, as_json)
    if not folder.is_dir():
        terminal.fail("--index goes with the folder of a sweep, or with --seed", terminal.WRONG_INPUT, as_json)
    if any(others):
        terminal.fail("--seed, --set and --plugin would make another run of it", terminal.WRONG_INPUT, as_json)
    return scenario_of(folder, index)


#: The events of other processes that are printed.
_TOLD = ("waiting", "joined", "rejoined", "lost", "rejected", "restored", "not-restored", "not-stored")


def _tell(event: Event) -> None:
    """Print an event of the other processes."""
    terminal.say(f"symaware: {event.text}", err=True)


def _place(
    listen: int | None,
    bind: str | None,
    join: str | None,
    only: Sequence[str],
    key: Path | None,
    name: str | None,
    wait: float,
    *,
    as_json: bool,
) -> Place | None:
    """Return the role of this process in a run of several; exit if the options are inconsistent."""
    if listen is None and join is None:
        for option, given in (("--only", only), ("--bind", bind), ("--key-file", key), ("--name", name)):
            if given:
                terminal.fail(
                    f"{option} is for a run of several processes: with --listen PORT or --join HOST:PORT",
                    terminal.WRONG_INPUT,
                    as_json,
                )
        return None
    if listen is not None and join is not None:
        terminal.fail(
            "--listen is for the host and --join for all others: give one of them", terminal.WRONG_INPUT, as_json
        )
    if bind and join:
        terminal.fail("--bind says where a host listens: it goes with --listen", terminal.WRONG_INPUT, as_json)
    from symaware_cli.processes import Place

    if join is not None:
        return Place.member(join, only, name=name, key_file=key, wait=wait)
    return Place.host(listen or 0, only, bind=bind or "127.0.0.1", name=name, key_file=key, wait=wait)
