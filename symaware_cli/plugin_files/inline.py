"""Plugins that a program or a notebook defines, for the scenarios that it builds itself.

A scenario names each in its list of `plugins`, as `<NAME>`, so that its log shows that the run cannot be repeated
without the program.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from symaware_cli.entry_points import Listing
from symaware_cli.plugin_files.file_set import PluginFileError
from symaware_cli.world import PluginKind

#: The plugins, by an identifier made of their names: an entry point refers to an attribute.
OBJECTS = SimpleNamespace()


def register(name: str, plugin: Callable[..., Any]) -> None:
    """Let scenarios of this program find a plugin by its name; a former plugin with this name is replaced."""
    setattr(OBJECTS, _key(name), plugin)


def registered(name: str) -> Callable[..., Any] | None:
    """Return the plugin with a name; None if this program defines none."""
    found: Callable[..., Any] | None = getattr(OBJECTS, _key(name), None)
    return found


def _key(name: str) -> str:
    return f"plugin_{name.encode().hex()}"


def inline_plugins(names: Iterable[str], kinds: Iterable[PluginKind]) -> list[Listing]:
    """Return the plugins of this program with some names.

    Raises:
        PluginFileError: This program does not define one, or a scenario cannot name it.
    """
    found, known = [], tuple(kinds)
    for name in names:
        plugin = registered(name)
        if plugin is None:
            raise PluginFileError(
                f"<{name}>",
                "unrepeatable",
                f"`{name}` was defined by the program that made this scenario, and no file in the log defines it",
                "a run in that program; a class in a file beside the scenario can be repeated from the log alone",
            )
        kind = kind_of(plugin, known)
        if kind is None:
            raise PluginFileError(f"<{name}>", "wrong-type", f"`{name}` is not a plugin: {_expected(known)}")
        target = f"{__name__}:OBJECTS.{_key(name)}"
        found.append(Listing(kind.name, name, target, place_of_definition(plugin), ""))
    return found


def _expected(kinds: Iterable[PluginKind]) -> str:
    bases = [base.__name__ for kind in kinds for base in kind.bases]
    return f"it derives from none of {', '.join(bases)}"


def kind_of(plugin: Any, kinds: Iterable[PluginKind]) -> PluginKind | None:
    """Return the kind of a class or function; None if scenarios cannot name it."""
    is_class = inspect.isclass(plugin)
    for kind in kinds:
        if is_class == bool(kind.bases) and (issubclass(plugin, kind.bases) if is_class else callable(plugin)):
            return kind
    return None


def place_of_definition(plugin: Any) -> str:
    """Return where a class or function is defined, for messages: its file and line, or its module."""
    try:
        file, (_, line) = inspect.getsourcefile(plugin), inspect.getsourcelines(plugin)
        return f"{Path(file or '').name}, line {line}"
    except (OSError, TypeError):
        return str(getattr(plugin, "__module__", "this program"))


def file_of(plugin: Any, folder: Path) -> str | None:
    """Return the file that defines a class or function, relative to a folder; None if a log could not have it.

    This applies to the main module, whose import would run the program again, and to nested classes and functions.
    """
    module = sys.modules.get(getattr(plugin, "__module__", ""))
    path = getattr(module, "__file__", None)
    if module is None or module.__name__ == "__main__" or not path or not path.endswith(".py"):
        return None
    if vars(module).get(getattr(plugin, "__name__", "")) is not plugin:
        return None
    file = Path(path).resolve()
    return file.relative_to(folder.resolve()).as_posix() if file.is_relative_to(folder.resolve()) else None
