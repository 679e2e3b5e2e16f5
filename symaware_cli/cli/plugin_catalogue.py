"""Every kind of plugin, for the commands that list and describe plugins.

Reasons: docs/decisions/0073-rooms.md
"""

from __future__ import annotations

from typing import Any

from symaware_cli.language import KINDS, Catalogue
from symaware_cli.world import InstalledPlugins, PluginKind


class _DoorKind(PluginKind):
    """The kind of the plugins that define further kinds of plugins: `PluginKind` objects."""

    def fault(self, loaded: Any) -> str | None:
        """Return why an object is not a kind of plugins."""
        return None if isinstance(loaded, PluginKind) else "is not a PluginKind"


DOOR = _DoorKind("door", "symaware.doors", ())


def every_plugin() -> InstalledPlugins:
    """Return the installed plugins of all kinds."""
    catalogue = Catalogue((*KINDS, DOOR, *(kind for _, kind in InstalledPlugins([DOOR]).usable(DOOR.name))))
    catalogue.add_sections()
    return InstalledPlugins(sorted(catalogue.kinds.values(), key=lambda kind: kind.name))
