"""The names of the plugins that files define: given by decorators, or FILE.CLASS."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import PurePosixPath
from types import ModuleType
from typing import Any, TypeVar

from symaware_cli.entry_points import Listing
from symaware_cli.plugin_files.file_set import FileSet, PluginFileError
from symaware_cli.plugin_files.inline import kind_of, register
from symaware_cli.plugin_files.loading import load_files
from symaware_cli.world import PluginKind, describe

Object = TypeVar("Object", bound=Callable[..., Any])

#: The attribute of a class or function that has its name in scenarios.
_NAME = "__plugin_name__"


def component(name: str) -> Callable[[Object], Object]:
    """Give a class, or a function of an event, a name for scenarios: a decorator.

    The class is a component, or another plugin that a scenario names under ``use``. It is in a file that a scenario
    lists as one of its `plugins`, or in the program (or notebook) that builds a scenario with `scenario`.

    Args:
        name: The name, such as ``mine.steer``.

    Raises:
        ValueError: It is not a name.
    """
    if not isinstance(name, str) or not all(part.replace("-", "_").isidentifier() for part in name.split(".")):
        raise ValueError(f"{name!r} is not a name of a plugin, such as 'mine.steer'")

    def decorated(plugin: Object) -> Object:
        setattr(plugin, _NAME, name)
        if not plugin.__module__.startswith(f"{__package__}."):
            register(name, plugin)
        return plugin

    return decorated


def name_of(plugin: Any) -> str | None:
    """Return the name that `component` gave to a class or function itself; None if it has none."""
    found: str | None = vars(plugin).get(_NAME)
    return found


def plugins_of(files: FileSet, kinds: Iterable[PluginKind], taken: Collection[str]) -> list[Listing]:
    """Import files of plugins, and return the plugins that they define.

    Args:
        files: The files.
        kinds: The kinds of plugins that a scenario can name.
        taken: The names of the plugins that are installed.

    Raises:
        PluginFileError: Nobody trusts the files, one cannot be imported, or a name is taken.
    """
    kept = tuple(kinds)
    families = {name.partition(".")[0] for name in taken}
    for name in files.named:
        stem = PurePosixPath(name).stem
        if stem in families:
            raise PluginFileError(
                name, "shadowing", f"`{stem}` is the family of installed plugins", "a file of another name"
            )
    found: list[Listing] = []
    for name, module_name in load_files(files).items():
        module = _imported(name, module_name, files)
        for plugin, attribute, kind in _defined(module, kept):
            use = name_of(plugin) or f"{PurePosixPath(name).stem}.{attribute}"
            if not kind.is_name(use):
                continue
            if use in taken or any(each.name == use for each in found):
                raise PluginFileError(name, "shadowing", f"the name `{use}` is taken", "another name")
            target = f"{module_name}:{plugin.__qualname__}"
            digest = files.digests[name][:12]
            found.append(Listing(kind.name, use, target, name, digest))
    return found


def _imported(name: str, module: str, files: FileSet) -> ModuleType:
    try:
        return import_module(module)
    except KeyboardInterrupt:
        raise
    except SyntaxError as error:
        place = f"line {error.lineno}" if error.lineno else "it"
        raise PluginFileError(name, "broken-plugin", f"`{name}` is no valid Python: {error.msg} ({place})") from error
    except BaseException as error:
        own = [
            each for each in traceback.extract_tb(error.__traceback__) if each.filename.startswith(str(files.folder))
        ]
        place = f" ({PurePosixPath(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
        raise PluginFileError(
            name, "broken-plugin", f"`{name}` cannot be imported: {describe(error)}{place}"
        ) from error


def _defined(module: ModuleType, kinds: Collection[PluginKind]) -> Iterator[tuple[Any, str, PluginKind]]:
    """Yield the public classes and functions that a module defines and a scenario can name, each with its kind."""
    public: Mapping[str, Any] = {name: each for name, each in vars(module).items() if name[0] != "_"}
    for name, each in public.items():
        if getattr(each, "__module__", None) != module.__name__ or getattr(each, "__name__", None) != name:
            continue
        kind = kind_of(each, kinds) if inspect.isclass(each) or inspect.isfunction(each) else None
        if kind is not None:
            yield each, name, kind
