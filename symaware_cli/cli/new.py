"""``symaware new``: scenarios and packages of plugins to start from.

Reasons: docs/decisions/0077-scaffolds.md
"""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from symaware_cli.cli.terminal import WRONG_INPUT, fail
from symaware_cli.help_place import in_help


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
    no_args_is_help=True,
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
    typer.echo(f"Wrote {path}. Run it with: symaware run {path}")


@new.command()
def plugin(
    name: Annotated[str, typer.Argument(help="Name of the package and of the folder.")],
    component: Annotated[Purpose | None, typer.Option(help="A component of agents, for this purpose.")] = None,
    model: Annotated[bool, typer.Option("--model", help="A model: the dynamics of agents.")] = False,
    environment: Annotated[bool, typer.Option("--environment", help="An environment: a world.")] = False,
    topology: Annotated[bool, typer.Option("--topology", help="A topology: who reaches whom by messages.")] = False,
    transport: Annotated[
        bool, typer.Option("--transport", help="A transport between the processes of a run.")
    ] = False,
    fault: Annotated[bool, typer.Option("--fault", help="A kind of fault.")] = False,
    metric: Annotated[bool, typer.Option("--metric", help="A metric: a column of sweeps.")] = False,
    drawing: Annotated[bool, typer.Option("--drawing", help="A drawing of logs.")] = False,
    command: Annotated[bool, typer.Option("--command", help="A verb of the command symaware.")] = False,
    section: Annotated[bool, typer.Option("--section", help="A section of scenarios.")] = False,
    export: Annotated[bool, typer.Option("--export", help="A format of symaware export.")] = False,
    report: Annotated[bool, typer.Option("--report", help="A section of symaware report.")] = False,
    search: Annotated[bool, typer.Option("--search", help="A method of symaware falsify.")] = False,
    executor: Annotated[bool, typer.Option("--executor", help="An executor of sweeps.")] = False,
    abstraction: Annotated[
        bool, typer.Option("--abstraction", help="A knowledge model: an abstraction of the workspace.")
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
        "search": search,
        "executor": executor,
        "abstraction": abstraction,
    }
    try:
        kind = kind_chosen(component, [flag for flag, given in flags.items() if given])
        write_package(Path(), name, kind)
    except ScaffoldError as error:
        fail(str(error), WRONG_INPUT)
    typer.echo(f"Wrote {name}. Install and test it with: pip install -e {name} && pytest {name}")
