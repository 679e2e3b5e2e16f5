"""Formats of ``symaware export``, to which a log is converted."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

from symaware_cli.entry_points import PluginError
from symaware_cli.log import Log, LogError, whole_file, whole_folder
from symaware_cli.views.exporting.log_selection import Selection
from symaware_cli.world import InstalledPlugins, PluginKind, code_position, describe

Progress: TypeAlias = Callable[[int], None] | None
"""Called at intervals with the simulated time reached [ns]."""


@dataclass(frozen=True)
class Exported:
    """A description of the written files.

    Attributes:
        parts: Name, number of entries, and size [bytes] of each part; None for a size that is unknown.
        nouns: The words for a part and for its entries, such as ``table`` and ``rows``.
        size: The size of everything [bytes].
        facts: Further facts, as plain data.
    """

    parts: Sequence[tuple[str, int, int | None]]
    nouns: tuple[str, str]
    size: int
    facts: Mapping[str, Any] = field(default_factory=dict)


class ExportFormat(ABC):
    """A format of ``symaware export``.

    Most formats are `TableFormat`, whose tables are the same for all.

    Attributes:
        suffix: The suffix of the file that it writes; empty if it writes a folder.
        requires: The optional modules that it needs, with the commands that install them.
        selects: Whether a part of a log can be exported: some fields, agents, or an interval of time.
    """

    suffix: ClassVar[str] = ""
    requires: ClassVar[Mapping[str, str]] = {}
    selects: ClassVar[bool] = True

    @abstractmethod
    def write(self, log: Log, place: Path, selection: Selection, on_progress: Progress) -> Exported:
        """Write a log.

        Args:
            log: The log, with a manifest.
            place: A temporary path of the file, or an empty folder; it replaces the target when this method returns.
            selection: The part of the log to export.
            on_progress: Called at intervals with the simulated time reached [ns].

        Raises:
            LogError: The log cannot be exported.
            OSError: The file or the folder cannot be written.
        """

    def export(
        self,
        log: Log,
        output: str | os.PathLike[str],
        selection: Selection | None = None,
        on_progress: Progress = None,
    ) -> Exported:
        """Export a log.

        Args:
            log: The log. Damaged parts are skipped and reported by `Log.damage`.
            output: The target: a file, which is replaced, or a folder, which must be missing or empty. It appears when
                it is complete.
            selection: The part of the log to export; None for everything.
            on_progress: Called at intervals with the simulated time reached [ns].

        Raises:
            LogError: The log is foreign, or a required module is not installed.
            OutputError: The target cannot be written; nothing is left behind then.
        """
        for module, command in self.requires.items():
            if find_spec(module) is None:
                raise LogError(f"this format needs the module `{module}`, which is not installed: {command}")
        log.require_manifest()
        with whole_file(output, log.path) if self.suffix else whole_folder(output) as place:
            return self.write(log, place, selection or Selection(), on_progress)


class _ExportKind(PluginKind):
    """The kind of plugin `export`; formats declare their files and the modules that they need."""

    def fault(self, loaded: Any) -> str | None:
        """Return why an object is not a format, or declares something invalid."""
        fault = super().fault(loaded)
        if fault is not None:
            return fault
        if not isinstance(loaded.suffix, str) or loaded.suffix[:1] not in ("", ".") or "/" in loaded.suffix:
            return "has a suffix that is neither empty nor begins with a full stop"
        if not isinstance(loaded.requires, Mapping):
            return "requires something else than a mapping of modules to the commands that install them"
        return None


EXPORT = _ExportKind("export", "symaware.exports", (ExportFormat,))


def installed_format(name: str) -> ExportFormat:
    """Return an installed format, whose failures are raised as `PluginError`.

    Raises:
        PluginError: There is no such format, or it cannot be used.
    """
    installed = InstalledPlugins([EXPORT])
    form: ExportFormat = installed.load(EXPORT.name, name)()
    (listing, *_) = sorted(installed.find(name), key=lambda each: not each.built_in)
    return form if listing.built_in else _Guarded(form, listing.origin)


class _Guarded(ExportFormat):
    """A format of another package, whose failures are attributed to it."""

    def __init__(self, form: ExportFormat, origin: str) -> None:
        self._form, self._origin = form, origin
        self.suffix = form.suffix  # type: ignore[misc] # of the class in formats, of the instance here
        self.requires = form.requires  # type: ignore[misc]
        self.selects = form.selects  # type: ignore[misc]

    def write(self, log: Log, place: Path, selection: Selection, on_progress: Progress) -> Exported:
        """Write a log."""
        try:
            return self._form.write(log, place, selection, on_progress)
        except (LogError, OSError, KeyboardInterrupt):
            raise
        except BaseException as error:
            text = describe(error) + code_position(error, beyond=__file__)
            raise PluginError("failed-plugin", f"{self._origin} fails: {text}") from error
