"""Every kind of plugin, for the commands that list and describe plugins.

Reasons: docs/decisions/0073-rooms.md
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from symaware_cli.entry_points import PluginError
from symaware_cli.language import KINDS, Catalogue
from symaware_cli.world import InstalledPlugins, PluginKind

Plugins = TypeVar("Plugins", bound=InstalledPlugins)


class _DoorKind(PluginKind):
    """The kind of the plugins that define further kinds of plugins: `PluginKind` objects."""

    def fault(self, loaded: Any) -> str | None:
        """Return why an object is not a kind of plugins."""
        return None if isinstance(loaded, PluginKind) else "is not a PluginKind"


DOOR = _DoorKind("door", "symaware.doors", ())


def every_plugin(files: Sequence[Path] = ()) -> InstalledPlugins:
    """Return the installed plugins of all kinds, and those of some files, which are executed."""
    catalogue = Catalogue((*KINDS, DOOR, *(kind for _, kind in InstalledPlugins([DOOR]).usable(DOOR.name))))
    catalogue.add_sections()
    return with_files(InstalledPlugins(sorted(catalogue.kinds.values(), key=lambda kind: kind.name)), files)


def with_files(catalogue: Plugins, files: Sequence[Path]) -> Plugins:
    """Return a catalogue with the plugins of some files, which are executed.

    Raises:
        PluginError: A file cannot be used.
    """
    for file in files:
        from symaware_cli.plugin_files import PluginFileError, plugins_of, read_files, trusting

        kinds = [kind for kind in catalogue.kinds.values() if kind.name in {each.name for each in KINDS}]
        taken = {listing.name for kind in kinds for listing in catalogue.listings(kind.name)}
        try:
            with trusting():
                catalogue = catalogue.with_plugins(plugins_of(read_files(file.parent, [file.name]), kinds, taken))
        except PluginFileError as error:
            raise PluginError(error.code, str(error), error.expected) from error
    return catalogue
