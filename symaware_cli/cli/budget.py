"""``symaware budget``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from symaware_cli.cli import terminal
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.evidence import Budget, BudgetLevel


@in_help("check", 45)
def budget(
    scenario: terminal.ScenarioPath,
    claim: Annotated[
        str,
        typer.Option(help="What is to hold at each level, such as `P(safe) > 0.99`.", metavar="CLAIM"),
    ],
    over: Annotated[
        str,
        typer.Option(
            help="What is degraded, from mild to severe: noise, delay, loss or range, also with levels as in "
            "`noise=0..1 by 0.1`; or a value of the scenario, PATH=VALUES.",
            metavar="WHAT",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="The folder for a sweep of each level; continued if it exists.", metavar="DIR"
        ),
    ],
    runs: Annotated[
        int | None,
        typer.Option(
            min=1, help="Runs of each level; by default as many as establish the claim with two failures.", metavar="N"
        ),
    ] = None,
    overrides: terminal.Overrides = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of the sweeps.")] = 0,
    jobs: terminal.Jobs = None,
    as_json: terminal.Json = False,
) -> None:
    """Find up to which degradation a claim is certified. Exit status 3 if it is at no level."""
    with terminal.trouble_shown(as_json), terminal.output_kept(as_json):
        from symaware_cli.evidence import budget

        try:
            with terminal.progress_shown("runs of this level", not as_json) as shown:
                found = budget(
                    scenario,
                    output,
                    claim=claim,
                    over=over,
                    runs=runs,
                    changes=overrides,
                    seed=seed,
                    jobs=terminal.job_count(jobs),
                    on_progress=shown,
                )
        except ValueError as error:
            terminal.fail(f"--claim {claim}: {error}", terminal.WRONG_INPUT, as_json)
    if as_json:
        terminal.print_json(found.to_json())
    else:
        terminal.say("\n".join(_lines(scenario, found)))
    raise typer.Exit(0 if found.certified else terminal.VIOLATED)


def _lines(scenario: Path, found: Budget) -> Iterator[str]:
    if found.certified:
        yield f"{scenario}: certified up to {found.grid.name} {json.dumps(found.certified_up_to)}"
    else:
        yield f"{scenario}: not certified at any level"
    yield f"  {'claim':<12} {found.claim}"
    for path in found.grid.paths:
        yield f"  {'over':<12} {path}"
    width = max(len(json.dumps(each)) for each in found.grid.values)
    for each in found.tested:
        yield f"  {json.dumps(each.value):>{max(width, 12)}} {_outcome(each)}"
    rest = found.grid.values[len(found.tested) :]
    if rest:
        yield f"  {'not tested':<12} {', '.join(map(json.dumps, rest))}: the first level that is not certified ends it"


def _outcome(level: BudgetLevel) -> str:
    return f"{'certified' if level.is_certified else 'not certified'}: {level.figures}"
