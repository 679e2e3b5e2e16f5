"""``symaware show``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symaware_cli.cli.terminal import WRONG_INPUT, Json, OwnPlugins, Trust, bold, fail, print_json, say, trouble_shown
from symaware_cli.help_place import in_help

if TYPE_CHECKING:
    from symaware_cli.language import Description


def _completed(incomplete: str) -> list[str]:
    """The names of all plugins with this prefix."""
    from symaware_cli.cli.plugin_catalogue import every_plugin

    catalogue = every_plugin()
    known = {listing.name for kind in catalogue.kinds for listing in catalogue.listings(kind)}
    return sorted(name for name in known if name.startswith(incomplete))


@in_help("author", 30)
def show(
    name: Annotated[
        str,
        typer.Argument(
            help="Name of a plugin, such as `control.go-to-goal`; or a scenario, to draw its knowledge models.",
            autocompletion=_completed,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Of a scenario: the figure, .png, .svg or .pdf; by default NAME.svg."),
    ] = None,
    trust: Trust = False,
    plugins: OwnPlugins = None,
    as_json: Json = False,
) -> None:
    """Show the purpose and parameters (units, defaults) of a plugin, or draw the knowledge models of a scenario."""
    if Path(name).suffix in (".yaml", ".yml", ".toml"):
        _draw(Path(name), output, plugins or (), as_json=as_json)
        return
    if output is not None:
        fail("--output goes with a scenario", WRONG_INPUT, as_json)
    from symaware_cli.cli.plugin_catalogue import every_plugin
    from symaware_cli.entry_points import PluginError
    from symaware_cli.language import describe

    try:
        descriptions = describe(name, every_plugin(plugins or ()))
    except PluginError as error:
        hint = f"; did you mean `{error.suggestion}`?" if error.suggestion else ""
        fail(f"{error}{hint}", WRONG_INPUT, as_json)
    if as_json:
        print_json([description.to_json() for description in descriptions])
        return
    say("\n\n".join(_text(description) for description in descriptions))


def _draw(scenario: Path, output: Path | None, plugins: Sequence[Path], *, as_json: bool) -> None:
    """Draw the knowledge models of a scenario."""
    with trouble_shown(as_json):
        from symaware_cli.api import load
        from symaware_cli.language import unused_path
        from symaware_cli.log import whole_file
        from symaware_cli.views import check_format

        if output is not None:
            check_format(output)
        models = load(scenario, plugins=plugins).knowledge_models()
        if not models:
            fail(f"{scenario} has no knowledge models", WRONG_INPUT, as_json)
        from symaware_cli.views import matplotlib_required

        file = output or unused_path(scenario.stem, suffix=".svg")
        with matplotlib_required():
            from symaware_cli.knowledge import draw_models
        with whole_file(file, scenario) as partial:
            draw_models(models, partial)
    facts = {
        name: {"cells": len(model.system.states), "transitions": sum(map(len, model.system.successors))}
        for name, model in models.items()
    }
    if as_json:
        print_json({"file": str(file), "models": facts})
        return
    for name, each in facts.items():
        noun = "cells" if len(models[name].bounds) and not models[name].parts() else "states"
        say(f"{name}: {each['cells']} {noun}, {each['transitions']} transitions")
    say(f"drawn in {file}")


def _text(description: Description) -> str:
    lines = [
        bold(f"{description.name} ({description.kind} of {description.package} {description.version})"),
        "",
        description.text,
    ]
    sections: list[tuple[str, dict[str, Any]]] = [
        ("State", description.state),
        ("Control input", description.control_input),
        ("Requires the knowledge", description.knowledge),
        ("Requires of the world", description.requires),
        ("Writes the parts of awareness", description.parts),
        ("Records the signals", description.signals),
        ("Fires the events", description.events),
    ]
    if description.parameters:
        lines += ["", "Parameters"]
        width = max(len(parameter.name) for parameter in description.parameters)
        for parameter in description.parameters:
            # As written in a scenario.
            default = "required" if parameter.required else f"default {json.dumps(parameter.default)}"
            lines.append(f"  {parameter.name:<{width}}  {parameter.type}, {default}")
            if parameter.description:
                lines.append(f"  {'':<{width}}  {parameter.description}")
    for title, entries in sections:
        if entries:
            width = max(len(entry) for entry in entries)
            lines += ["", title, *(f"  {entry:<{width}}  {meaning}" for entry, meaning in entries.items())]
    return "\n".join(lines)
