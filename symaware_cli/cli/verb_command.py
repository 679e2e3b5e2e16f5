"""A verb as a command of Typer, or the reason that it cannot be used.

Reasons: docs/decisions/0055-doors-for-verbs.md
"""

from __future__ import annotations

import inspect
from functools import cache
from typing import Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from symaware_cli.cli.streams import is_plain
from symaware_cli.cli.terminal import WRONG_INPUT, fail
from symaware_cli.entry_points import Listing, PluginError


class UnusableVerb(TyperCommand):
    """A verb that cannot be used: it accepts any arguments and exits with the reason."""

    def __init__(self, name: str, error: PluginError) -> None:
        super().__init__(name, help=error.sentence, add_help_option=False, hidden=True)
        self._error = error

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Exit with the reason."""
        if not ctx.resilient_parsing:
            fail(self._error.sentence, WRONG_INPUT, "--json" in args)
        return []


def command_of(name: str, listing: Listing) -> Any:
    """Import a verb, and convert its function or its Typer application to a command.

    Raises:
        PluginError: It cannot be imported, or is not a function whose annotations Typer knows.
    """
    loaded = listing.load()
    if not isinstance(loaded, typer.Typer) and not inspect.isroutine(loaded):
        raise PluginError("broken-plugin", f"{listing.origin} is not a function or a Typer application")
    try:
        return _converted(
            name, loaded, None if listing.built_in else f"Of {listing.package} {listing.version}.", is_plain()
        )
    except Exception as error:
        from symaware_cli.engine import describe

        raise PluginError("broken-plugin", f"{listing.origin} has a faulty signature: {describe(error)}") from error


@cache  # a program that calls the command line again and again would spend a quarter of a short verb's time here
def _converted(name: str, loaded: Any, package: str | None, plain: bool) -> Any:
    """Convert the function or the Typer application of a verb to a command."""
    group = typer.Typer(add_completion=False, rich_markup_mode=None if plain else "rich")
    # With a callback, it is a group of one command, even if that is a group, too.
    group.callback()(lambda: None)
    if isinstance(loaded, typer.Typer):
        group.add_typer(loaded, name=name)
    else:
        group.command(name, epilog=package)(loaded)
    commands: Any = get_command(group)
    return commands.commands[name]
