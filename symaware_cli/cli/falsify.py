"""``symaware falsify``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help
from symaware_cli.world import counted

if TYPE_CHECKING:
    from symaware_cli.evidence import Falsification


@in_help("check", 50)
def falsify(
    scenario: terminal.ScenarioPath,
    specification: Annotated[
        str, typer.Option("--specification", help="The specification to violate.", metavar="NAME")
    ],
    over: terminal.Over = None,
    seeds: Annotated[
        int, typer.Option(min=0, help="Also vary the seed, from 0 to N - 1; by default it is that of the scenario.")
    ] = 0,
    overrides: terminal.Overrides = None,
    method: Annotated[
        str, typer.Option(help="How to search: random, differential-evolution, tpe, cma-es, or a method of a plugin.")
    ] = "differential-evolution",
    runs: Annotated[
        int,
        typer.Option(min=1, max=10_000_000, help="Greatest number of runs, without those that simplify."),
    ] = 200,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of the search.")] = 0,
    jobs: terminal.Jobs = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="A new folder for the counterexample and its log.", metavar="DIR"),
    ] = None,
    trust: terminal.Trust = False,
    as_json: terminal.Json = False,
) -> None:
    """Search for a violation of a specification, and simplify it. Exit status 3 if one is found."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import falsify

        with terminal.progress_shown("runs", not as_json) as shown:
            found = falsify(
                scenario,
                specification,
                output,
                over=over or (),
                seeds=seeds,
                changes=overrides,
                method=method,
                runs=runs,
                seed=seed,
                jobs=terminal.job_count(jobs),
                on_progress=shown,
            )
    if as_json:
        terminal.print_json(found.to_json())
    else:
        terminal.say("\n".join(_lines(found)))
    raise typer.Exit(terminal.VIOLATED if found.is_found else 0)


def _lines(found: Falsification) -> Iterator[str]:
    result, outcome = found.result, found.outcome
    failed = f", {result.failed:,} of them failed" if result.failed else ""
    one_by_one = [] if result.one_by_one is None else [f"  {'one by one':<12} {terminal.printable(result.one_by_one)}"]
    looked = f"{counted(result.runs, 'run')} by {found.method}, seed {found.seed}{failed}"
    if not found.is_found:
        yield f"{found.scenario}: no violation of {found.specification} found, which does not prove that there is none"
        yield f"  {'looked':<12} {looked}"
        if result.failure is not None:
            yield f"  {'failed':<12} the first because of: {terminal.printable(result.failure)}"
        for text in found.over:
            yield f"  {'over':<12} {terminal.printable(text)}"
        if outcome is not None:
            yield f"  {'least robust':<12} {terminal.printable(str(outcome))}"
        for path, value in result.values.items():
            yield f"  {'with':<12} {path}={json.dumps(value)}"
        if found.bound is not None:
            yield f"  {'at most':<12} {found.bound:.3g} of such draws violate it, with confidence 0.95"
        yield from one_by_one
        return
    yield f"{found.scenario}: {found.specification} is violated"
    yield f"  {'reason':<12} {terminal.printable(str(outcome))}"
    for path, value in result.values.items():
        yield f"  {'with':<12} {path}={json.dumps(value)}"
    if not result.values:
        yield f"  {'with':<12} nothing changed: the scenario itself violates it"
    values = counted(len(result.found or ()), "value")
    yield f"  {'found after':<12} {looked}; {result.shrinking:,} more to simplify {values}"
    yield from one_by_one
    if found.folder is not None:
        yield f"  {'to repeat':<12} symaware run {found.folder / 'counterexample.yaml'}"
        yield f"  {'log':<12} {found.folder / 'counterexample.mcap'}"
