"""``symaware new``: scenarios and packages of plugins to start from.

Reasons: docs/decisions/0077-scaffolds.md
"""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from symaware_cli.cli.terminal import WRONG_INPUT, fail, say
from symaware_cli.help_place import in_help

#: The panels of the help of ``symaware new plugin``.
_IN_SCENARIOS, _ABOUT_RUNS = "Used in scenarios", "Used with runs and logs"


class _ScenarioByDefault(TyperGroup):
    """A group whose first argument may be the name of a scenario: ``new NAME`` means ``new scenario NAME``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Add the command that was left out."""
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = ["scenario", *args]
        return super().parse_args(ctx, args)


new = typer.Typer(
    cls=_ScenarioByDefault,
    help="Write a commented scenario, or a package with a plugin, to start from.\n\n"
    "`symaware new NAME` is short for `symaware new scenario NAME`.",
)
in_help("author", 10)(new)


class Theme(enum.StrEnum):
    """The themes of new scenarios."""

    crossing = "crossing"
    convoy = "convoy"
    warehouse = "warehouse"
    reach_avoid = "reach-avoid"
    pushing = "pushing"


class Purpose(enum.StrEnum):
    """The purposes of new components."""

    risk = "risk"
    controller = "controller"
    perception = "perception"
    uncertainty = "uncertainty"
    communication = "communication"


@new.command()
def scenario(
    name: Annotated[str, typer.Argument(help="Name of the scenario and of the file.")],
    toml: Annotated[bool, typer.Option("--toml", help="Write TOML instead of YAML.")] = False,
    like: Annotated[
        Theme | None, typer.Option(help="Begin with a scenario of this theme, instead of a plain one.")
    ] = None,
) -> None:
    """Write a commented scenario to start from."""
    from symaware_cli.language.template import TemplateError, template

    try:
        content = template(name, toml=toml, like=like)
    except TemplateError as error:
        fail(str(error), WRONG_INPUT)
    path = Path(f"{name}.toml" if toml else f"{name}.yaml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(content)
    except FileExistsError:
        fail(f"{path} exists already", WRONG_INPUT)
    except OSError as error:
        fail(f"cannot write {path}: {(error.strerror or str(error)).lower()}", WRONG_INPUT)
    say(f"Wrote {path}. Run it with: symaware run {path}")


@new.command()
def plugin(
    name: Annotated[str, typer.Argument(help="Name of the package and of the folder.")],
    component: Annotated[
        Purpose | None, typer.Option(help="A component of agents, for this purpose.", rich_help_panel=_IN_SCENARIOS)
    ] = None,
    model: Annotated[
        bool, typer.Option("--model", help="A model: the dynamics of agents.", rich_help_panel=_IN_SCENARIOS)
    ] = False,
    environment: Annotated[
        bool, typer.Option("--environment", help="An environment: a world.", rich_help_panel=_IN_SCENARIOS)
    ] = False,
    topology: Annotated[
        bool,
        typer.Option("--topology", help="A topology: who reaches whom by messages.", rich_help_panel=_IN_SCENARIOS),
    ] = False,
    transport: Annotated[
        bool,
        typer.Option("--transport", help="A transport between the processes of a run.", rich_help_panel=_IN_SCENARIOS),
    ] = False,
    fault: Annotated[bool, typer.Option("--fault", help="A kind of fault.", rich_help_panel=_IN_SCENARIOS)] = False,
    metric: Annotated[
        bool, typer.Option("--metric", help="A metric: a column of sweeps.", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    drawing: Annotated[bool, typer.Option("--drawing", help="A drawing of logs.", rich_help_panel=_ABOUT_RUNS)] = False,
    command: Annotated[
        bool, typer.Option("--command", help="A verb of the command `symaware`.", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    section: Annotated[
        bool, typer.Option("--section", help="A section of scenarios.", rich_help_panel=_IN_SCENARIOS)
    ] = False,
    export: Annotated[
        bool, typer.Option("--export", help="A format of `symaware export`.", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    report: Annotated[
        bool, typer.Option("--report", help="A section of `symaware report`.", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    result: Annotated[
        bool, typer.Option("--result", help="A format of results (`--results`).", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    search: Annotated[
        bool, typer.Option("--search", help="A method of `symaware falsify`.", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    executor: Annotated[
        bool, typer.Option("--executor", help="An executor of sweeps.", rich_help_panel=_ABOUT_RUNS)
    ] = False,
    abstraction: Annotated[
        bool,
        typer.Option(
            "--abstraction", help="A knowledge model: an abstraction of the workspace.", rich_help_panel=_IN_SCENARIOS
        ),
    ] = False,
) -> None:
    """Write a package with a plugin, a test and a scenario that work; exactly one kind is required."""
    from symaware_cli.cli.plugin_package import ScaffoldError, kind_chosen, write_package

    flags = {
        "model": model,
        "environment": environment,
        "topology": topology,
        "transport": transport,
        "fault": fault,
        "metric": metric,
        "drawing": drawing,
        "command": command,
        "section": section,
        "export": export,
        "report": report,
        "result": result,
        "search": search,
        "executor": executor,
        "abstraction": abstraction,
    }
    try:
        kind = kind_chosen(component, [flag for flag, given in flags.items() if given])
        write_package(Path(), name, kind)
    except ScaffoldError as error:
        fail(str(error), WRONG_INPUT)
    say(f"Wrote {name}. Install and test it with: pip install -e {name} && pytest {name}")
