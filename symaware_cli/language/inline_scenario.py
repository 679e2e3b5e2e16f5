"""Scenarios that a program writes as a mapping, in which `use` may be a class or a function."""

from __future__ import annotations

import linecache
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path as FilePath
from types import FrameType
from typing import Any

from symaware_cli.core import controller
from symaware_cli.language.build import Built, build_composition
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.changes import Changes
from symaware_cli.language.compose import CompositionError, compose_content
from symaware_cli.language.plain_value import placed
from symaware_cli.language.problem import Problem
from symaware_cli.language.resolved import dumped
from symaware_cli.language.source import Source, SourceNode
from symaware_cli.plugin_files import file_of, name_of, register, registered, trusting


class InlineScenario:
    """A scenario that a program wrote as a mapping.

    Attributes:
        content: The document as plain data; classes and functions are replaced by names.
        place: Where it was written, such as ``study.py, line 12``.
    """

    def __init__(self, content: Mapping[str, Any], frame: FrameType | None) -> None:
        """Replace classes and functions by names.

        Args:
            content: The document.
            frame: Where it was written; problems are located there.

        Raises:
            TypeError: A value has a type that scenarios do not support.
        """
        self._folder = FilePath.cwd()
        self._catalogue = Catalogue()
        self._plugins: dict[str, None] = {}
        self._source, self._line = _source(frame)
        self.place = f"{self._source.name}, line {self._line}"
        named = self._named(content, ())
        listed = [*named.get("plugins", ()), *self._plugins]
        if listed:
            named["plugins"] = list(dict.fromkeys(listed))
        plain, _ = placed(named, Source(self._source.name, b""), 0, ())
        self.content: dict[str, Any] = plain.plain()

    def build(self, changes: Changes | None, seed: int | None) -> Built:
        """Build it; see `symaware_cli.language.build.build`.

        Raises:
            ScenarioError: Contains every problem found.
        """
        source = self._source.copy()
        begin = len(source.line_text(self._line) or "") - len((source.line_text(self._line) or "").lstrip()) + 1
        root = SourceNode.of(self.content, source.text_span(self._line, begin, self._line + 1, 0))
        files = {f"{self.content.get('name', 'scenario')}.yaml": self._text}
        found: Sequence[Problem] = ()
        try:
            composition = compose_content(root, source, files, changes)
        except CompositionError as error:
            composition, found = error.partial, error.problems
        # Who names a class has executed its file.
        with trusting(lambda files: set(files.named) <= self._plugins.keys()):
            return build_composition(composition, self._folder, seed, self._catalogue, found)

    @cached_property
    def _text(self) -> bytes:
        """The document as YAML; the same for each run."""
        return dumped(self.content)

    def _named(self, value: Any, path: tuple[str, ...]) -> Any:
        """Return a value in which classes and functions are replaced by names."""
        if isinstance(value, Mapping):
            return {
                key: self._name(each, path) if key == "use" else self._named(each, (*path, str(key)))
                for key, each in value.items()
            }
        return [self._named(each, path) for each in value] if isinstance(value, list | tuple) else value

    def _name(self, plugin: Any, path: tuple[str, ...]) -> Any:
        """Return the name of a plugin, which is added to those of the scenario if it is not installed."""
        given = plugin if isinstance(plugin, str) else None
        if given is not None:
            plugin = registered(given)
        if not callable(plugin):
            return given
        if not hasattr(plugin, "__qualname__"):
            raise TypeError(f"{'.'.join(path)}: a {type(plugin).__name__} has no name: write a function or a class")
        if not isinstance(plugin, type) and path[:1] != ("subscribers",):
            plugin = controller(plugin)
        installed = self._installed(plugin)
        if installed is not None and given is None:
            return installed
        file = file_of(plugin, self._folder)
        if file is not None:
            self._plugins[file] = None
            return given or name_of(plugin) or f"{FilePath(file).stem}.{plugin.__name__}"
        name = given or name_of(plugin) or f"{plugin.__module__}.{plugin.__qualname__}"
        register(name, plugin)
        self._plugins[f"<{name}>"] = None
        return name

    def _installed(self, plugin: Any) -> str | None:
        """Return the entry-point name of a class or function; None if it has none."""
        target = f"{plugin.__module__}:{plugin.__qualname__}"
        for kind in self._catalogue.kinds:
            for listing in self._catalogue.listings(kind):
                if listing.target == target:
                    return listing.name
        return None


def caller(depth: int) -> FrameType | None:
    """Return the frame of a caller; None if Python has no frames."""
    get: Callable[[int], FrameType] | None = getattr(sys, "_getframe", None)
    return None if get is None else get(depth + 1)


def _source(frame: FrameType | None) -> tuple[Source, int]:
    """Return the text of a program with its name, and the line that it executes."""
    if frame is None:
        return Source("program", b""), 1
    file = frame.f_code.co_filename
    text = "".join(linecache.getlines(file, frame.f_globals))
    return Source(FilePath(file).name, text.encode(), text), frame.f_lineno
