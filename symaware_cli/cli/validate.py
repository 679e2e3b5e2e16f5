"""``symaware validate``."""

from __future__ import annotations

import typer

from symaware_cli.cli.terminal import Json, Overrides, ScenarioPath, Seed, output_kept, print_json, trouble_shown


def validate(scenario: ScenarioPath, seed: Seed = None, overrides: Overrides = None, as_json: Json = False) -> None:
    """Check a scenario without running it; every problem is shown with its place."""
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.scenario.build import build

        built = build(scenario, overrides or (), seed)
    simulation = built.simulation
    if as_json:
        print_json(
            {
                "valid": True,
                "problems": [],
                "name": simulation.name,
                "agents": simulation.agent_count,
                "steps": built.steps,
                "digest": built.digest.hex(),
            }
        )
        return
    groups = f"{len(simulation.groups)} group{'s' if len(simulation.groups) != 1 else ''}"
    agents = f"{simulation.agent_count} agent{'s' if simulation.agent_count != 1 else ''}"
    typer.echo(f"{scenario}: sound; {agents} in {groups}, {built.steps:,} steps")
