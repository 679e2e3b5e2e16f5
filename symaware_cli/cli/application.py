"""The command ``symaware`` and its verbs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from symaware_cli.cli.streams import is_plain
from symaware_cli.cli.verb_command import UnusableVerb
from symaware_cli.cli.verb_group import VerbGroup
from symaware_cli.cli.verbs import DESCRIPTION

application = typer.Typer(
    name="symaware",
    cls=VerbGroup,
    help=DESCRIPTION,
    pretty_exceptions_enable=False,
    # Usage errors, too: Rich would leave out the colours and keep the rest.
    rich_markup_mode=None if is_plain() else "rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from symaware_cli.version import __version__

        typer.echo(f"symaware {__version__}")
        raise typer.Exit


@application.callback()
def _symaware(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options of the command without a verb."""


def all_commands() -> Mapping[str, TyperCommand]:
    """Every command of every verb that can be used, such as ``run`` or ``log events``; each is imported."""
    root: Any = get_command(application)
    found: dict[str, TyperCommand] = {}
    context = root.make_context("symaware", ["run"], resilient_parsing=True)
    for name in root.list_commands(context):
        verb = root.get_command(context, name)
        if isinstance(verb, TyperGroup):
            commands: dict[str, Any] = dict(verb.commands)
            found |= {f"{name} {part}": command for part, command in commands.items()}
        elif not isinstance(verb, UnusableVerb):
            found[name] = verb
    return found
