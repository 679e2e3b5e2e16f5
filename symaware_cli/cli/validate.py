"""``symaware validate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli.result_files import Results, note_passed, note_problems
from symaware_cli.cli.streams import is_lively
from symaware_cli.cli.terminal import (
    Json,
    Overrides,
    OwnPlugins,
    Seed,
    Trust,
    output_kept,
    print_json,
    say,
    trouble_shown,
)
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.api import Outline


@in_help("check", 10)
def validate(
    scenarios: Annotated[
        list[Path],
        typer.Argument(help="Scenarios in YAML or TOML, or logs that contain one.", metavar="SCENARIO..."),
    ],
    seed: Seed = None,
    overrides: Overrides = None,
    trust: Trust = False,
    plugins: OwnPlugins = None,
    results: Results = None,
    as_json: Json = False,
) -> None:
    """Check scenarios without running them, and report every problem and warning with its place."""
    outlines: list[tuple[Path, Outline]] = []
    with trouble_shown(as_json), output_kept(as_json):
        from symaware_cli.api import Scenario
        from symaware_cli.language import Problem, ScenarioError, render

        problems: list[Problem] = []
        for path in scenarios:
            try:
                outlines.append((path, Scenario(path, overrides, seed=seed, plugins=plugins or ()).validate()))
            except ScenarioError as error:
                problems += error.problems
        for path, outline in outlines:
            note_problems(outline.warnings, is_warning=True)
            note_passed(str(path), "sound", "scenario", outline.headline)
            if not as_json:
                if outline.warnings:
                    warnings = render(outline.warnings, colour=is_lively(sys.stderr), noun="warning")
                    say(warnings, err=True)
                say(f"{path}: sound; {outline.headline}")
        if problems:
            raise ScenarioError(problems)
    if as_json:
        print_json(_plain(outlines))


def _plain(outlines: list[tuple[Path, Outline]]) -> dict[str, Any]:
    """Return the report on valid scenarios as plain data: of one, its facts beside the verdict; of several, a list."""
    from symaware_cli.language import to_json

    warnings = [each for _, outline in outlines for each in to_json(outline.warnings)]
    facts = [
        {"name": outline.name, "agents": outline.agents, "steps": outline.steps, "digest": outline.digest}
        for _, outline in outlines
    ]
    verdict: dict[str, Any] = {"valid": True, "problems": [], "warnings": warnings}
    if len(outlines) == 1:
        return verdict | facts[0]
    return verdict | {
        "scenarios": [{"file": str(path)} | fact for (path, _), fact in zip(outlines, facts, strict=True)]
    }
