"""``symaware validate``."""

from __future__ import annotations

import typer

from symaware_cli.cli.terminal import Json, Overrides, ScenarioPath, Seed, output_kept, print_json, trouble_shown


def validate(scenario: ScenarioPath, seed: Seed = None, overrides: Overrides = None, as_json: Json = False) -> None:
    """Check a scenario without running it, and report every problem with its place."""
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.api.scenario import Scenario

        outline = Scenario(scenario, overrides, seed=seed).validate()
    if as_json:
        print_json(
            {
                "valid": True,
                "problems": [],
                "name": outline.name,
                "agents": outline.agents,
                "steps": outline.steps,
                "digest": outline.digest,
            }
        )
        return
    typer.echo(f"{scenario}: sound; {outline.headline}")
