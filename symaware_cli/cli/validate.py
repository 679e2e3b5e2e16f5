"""``symaware validate``."""

from __future__ import annotations

import sys

import typer

from symaware_cli.cli.terminal import (
    Json,
    Overrides,
    OwnPlugins,
    ScenarioPath,
    Seed,
    Trust,
    is_lively,
    output_kept,
    print_json,
    trouble_shown,
)
from symaware_cli.help_place import in_help


@in_help("check", 10)
def validate(
    scenario: ScenarioPath,
    seed: Seed = None,
    overrides: Overrides = None,
    trust: Trust = False,
    plugins: OwnPlugins = None,
    as_json: Json = False,
) -> None:
    """Check a scenario without running it, and report every problem and warning with its place."""
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.api import Scenario
        from symaware_cli.language import render, to_json

        outline = Scenario(scenario, overrides, seed=seed, plugins=plugins or ()).validate()
    if as_json:
        print_json(
            {
                "valid": True,
                "problems": [],
                "warnings": to_json(outline.warnings),
                "name": outline.name,
                "agents": outline.agents,
                "steps": outline.steps,
                "digest": outline.digest,
            }
        )
        return
    if outline.warnings:
        typer.echo(render(outline.warnings, colour=is_lively(sys.stderr), noun="warning"), err=True)
    typer.echo(f"{scenario}: sound; {outline.headline}")
