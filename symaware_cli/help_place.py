"""Where the help of ``symaware`` lists a command."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

Command = TypeVar("Command")

#: The groups of commands in the help, in their order, with their titles.
GROUPS = {
    "run": "Run",
    "look": "Look at results",
    "check": "Check",
    "compare": "Compare",
    "author": "Author",
}

#: The title for commands without a group.
OTHERS = "Other commands"

_ATTRIBUTE = "__symaware_help__"


class HelpPlace(NamedTuple):
    """The place of a command in the help.

    Attributes:
        group: A key of `GROUPS`; another name is a group of its own, after these; empty for none.
        order: Its position in the group; commands at the same position are sorted by name.
    """

    group: str = ""
    order: int = 100

    @property
    def title(self) -> str:
        """The title of its group."""
        return GROUPS.get(self.group, self.group) or OTHERS

    @property
    def rank(self) -> tuple[int, str, int]:
        """The sort key of commands: the groups in their order, others by their names, then commands without one."""
        known = list(GROUPS)
        number = known.index(self.group) if self.group in known else len(known) + (not self.group)
        return number, self.group, self.order


def in_help(group: str, order: int = 100) -> Callable[[Command], Command]:
    """Place a command of ``symaware`` in the help: a decorator for its function.

    Args:
        group: ``run``, ``look``, ``check``, ``compare`` or ``author``; another name is a group of its own, after these.
        order: Its position in the group; commands at the same position are sorted by name. Those of this package have
            less than 100.
    """

    def placed(command: Command) -> Command:
        setattr(command, _ATTRIBUTE, HelpPlace(group, order))
        return command

    return placed


def place_of(command: object) -> HelpPlace:
    """The place of a command in the help."""
    found = getattr(command, _ATTRIBUTE, None)
    return found if isinstance(found, HelpPlace) else HelpPlace()
