"""Kinds of plugins: the group of entry points that each is registered in, and the requirements on plugins."""

from __future__ import annotations

import inspect
from typing import Any

from pydantic import BaseModel

from symaware_cli.world.plugin import Plugin
from symaware_cli.world.records import record


@record
class PluginKind:
    """A kind of plugin. It is declared beside the base class of its plugins.

    Attributes:
        name: Its name, such as ``component``.
        group: The group of entry points, such as ``symaware.components``; its last part is the plural of the name.
        bases: The base classes, one of which a plugin derives from.
    """

    name: str
    group: str
    bases: tuple[type, ...]

    @property
    def plural(self) -> str:
        """The plural of the name."""
        return self.group.rpartition(".")[2]

    @property
    def article(self) -> str:
        """The indefinite article of the name."""
        return "an" if self.name[0] in "aeiou" else "a"

    def is_name(self, name: str) -> bool:
        """Whether plugins of this kind may have a name."""
        return True

    def fault(self, loaded: Any) -> str | None:
        """Return why an imported object is not a plugin of this kind, as a predicate; None if it is one."""
        if not inspect.isclass(loaded) or not issubclass(loaded, self.bases):
            return f"is not a subclass of {' or '.join(base.__name__ for base in self.bases)}"
        if inspect.isabstract(loaded):
            missing = ", ".join(sorted(getattr(loaded, "__abstractmethods__", ())))
            return f"does not implement {missing}"
        if issubclass(loaded, Plugin):
            parameters = getattr(loaded, "Parameters", None)
            if not inspect.isclass(parameters) or not issubclass(parameters, BaseModel):
                return "has Parameters that are not a subclass of symaware_cli.Parameters"
        return None
