"""The group of all verbs, with the error reports that they share."""

from __future__ import annotations

import difflib
import sys
from typing import Any

import typer
from typer.core import TyperGroup

from symaware_cli.cli.terminal import INTERRUPTED, WRONG_INPUT, fail, fail_for, interruption, trouble_shown
from symaware_cli.cli.verbs import Verbs


class VerbGroup(TyperGroup):
    """The group of all verbs.

    It finds the verbs among the entry points, and reports errors about paths, scenarios and logs for all of them.
    """

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self._verbs = Verbs()

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of all verbs."""
        return self._verbs.names

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a verb; None if there is none with this name."""
        if cmd_name not in self.commands:
            command = self._verbs.command(cmd_name)
            if command is None:
                return None
            self.commands[cmd_name] = command
        return self.commands[cmd_name]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the verb of a command line; suggest others if there is none."""
        name = args[0]
        if not name.startswith("-") and not ctx.resilient_parsing and self.get_command(ctx, name) is None:
            if "run" not in self._verbs.names:
                fail("this installation is incomplete: install symaware-cli again with pip", WRONG_INPUT)
            near = difflib.get_close_matches(name, self._verbs.names)
            hint = f" Did you mean {', '.join(map(repr, near))}?" if near else ""
            ctx.fail(f"No such command {name!r}.{hint}")
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, with the verbs in their groups."""
        from symaware_cli.cli.help import help_text

        formatter.write(help_text(self._verbs))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Show the help if there are no arguments; refuse text that logs, tables and figures could not contain."""
        if not args and not ctx.resilient_parsing:
            from symaware_cli.cli.help import help_text

            typer.echo(help_text(self._verbs), nl=False)
            ctx.exit(WRONG_INPUT)
        for text in args:
            if not _is_utf_8(text):
                shown = text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
                fail(f"`{shown}` is not UTF-8: rename it, or give a link to it", WRONG_INPUT, "--json" in args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run a verb; report errors of scenarios, of logs, and of the operating system about a path."""
        as_json = "--json" in ctx.args
        try:
            return super().invoke(ctx)
        except OSError as error:
            if error.filename is None:
                raise
            fail_for(error, as_json)
        except (typer.Exit, typer.Abort):
            raise
        except KeyboardInterrupt:
            fail(interruption(()), INTERRUPTED, as_json)
        except Exception:
            # Only if one of these modules is imported can the error be one of a scenario or a log.
            if not {"symaware_cli.log.error", "symaware_cli.language.problem"} & sys.modules.keys():
                raise
            with trouble_shown(as_json):
                raise


def _is_utf_8(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
