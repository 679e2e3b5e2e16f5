"""The installed plugins of some kinds, found through entry points and imported only when they are used."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, Self

from symaware_cli import entry_points
from symaware_cli.entry_points import EntryPoints, Listing, Listings, PluginError, PluginWarning, chosen, listings_of
from symaware_cli.world.naming import nearest, quoted
from symaware_cli.world.plugin_kind import PluginKind


class InstalledPlugins:
    """The installed plugins of some kinds.

    A name that is built in belongs to this package alone: another package that registers it does not replace it.

    Attributes:
        kinds: The kinds by name.
    """

    def __init__(self, kinds: Iterable[PluginKind]) -> None:
        self.kinds: dict[str, PluginKind] = {kind.name: kind for kind in kinds}
        self._found: dict[str, Listings] = {}

    def add(self, kinds: Iterable[PluginKind]) -> None:
        """Find plugins of further kinds as well."""
        self.kinds.update((kind.name, kind) for kind in kinds)

    def with_plugins(self, listings: Iterable[Listing]) -> Self:
        """Return these plugins and further ones, whose names are not among these."""
        both = type(self)(tuple(self.kinds.values()))
        both._points, both._found = self._points, {kind: dict(self._entries(kind)) for kind in self.kinds}
        for listing in listings:
            both._found[listing.kind] = {**both._found[listing.kind], listing.name: [listing]}
        return both

    @cached_property
    def _points(self) -> EntryPoints:
        return entry_points.installed()

    def _entries(self, kind: str) -> Listings:
        """The plugins of a kind, by name."""
        if kind not in self._found:
            self._found[kind] = listings_of(kind, self._points.get(self.kinds[kind].group, ()))
        return self._found[kind]

    def listings(self, kind: str) -> list[Listing]:
        """All plugins of a kind, sorted by name; none is imported."""
        return sorted(
            (listing for same in self._entries(kind).values() for listing in same),
            key=lambda listing: (listing.name, listing.package),
        )

    def find(self, name: str) -> list[Listing]:
        """All plugins with a name, of any kind."""
        return [listing for kind in self.kinds for listing in self.listings(kind) if listing.name == name]

    def is_shadowed(self, listing: Listing) -> bool:
        """Return whether a plugin is never used, because its name is that of a built-in one."""
        return not listing.built_in and any(each.built_in for each in self._entries(listing.kind)[listing.name])

    def has(self, kind: str, name: str) -> bool:
        """Whether there is a plugin of a kind with a name, usable or not; none is imported."""
        return name in self._entries(kind)

    def load(self, kind: str, name: str) -> Any:
        """Import the class of a plugin, or the function of a subscriber.

        Raises:
            PluginError: There is no such plugin, more than one, or it cannot be used.
        """
        same = self._entries(kind).get(name)
        if not same:
            raise self._unknown(kind, name)
        listing = chosen([each for each in same if each.built_in] or same)
        loaded = listing.load()
        fault = self.kinds[kind].fault(loaded)
        if not fault and not self.kinds[kind].is_name(name):
            fault = f"has a name that cannot be a key of {self.kinds[kind].plural}"
        if fault:
            raise PluginError("broken-plugin", f"{listing.origin} {fault}")
        return loaded

    def usable(self, kind: str) -> Iterator[tuple[Listing, Any]]:
        """Import all plugins of a kind. Each that cannot be used is left out, and reported by a `PluginWarning`."""
        for name in sorted(self._entries(kind)):
            *others, listing = sorted(self._entries(kind)[name], key=lambda each: each.built_in)
            for other in others:
                if listing.built_in:
                    other.warn("has the name of a built-in one")
            try:
                yield listing, self.load(kind, name)
            except PluginError as error:
                if listing.built_in:
                    raise
                warnings.warn(f"{error}; it is left out", PluginWarning, stacklevel=2)

    def _unknown(self, kind: str, name: str) -> PluginError:
        everything = f"a name that `symaware list {self.kinds[kind].plural}` shows"
        for other in self.kinds.values():
            if other.name != kind and name in self._entries(other.name):
                text = f"`{name}` is {other.article} {other.name}, not {self.kinds[kind].article} {kind}"
                return PluginError("unknown-plugin", text, everything)
        known = sorted(self._entries(kind))
        suggestion = nearest(name, known)
        # Only names of the same family, the part before the dot, are listed.
        family = [each for each in known if each.rpartition(".")[0] == name.rpartition(".")[0]]
        listed = f"one of {', '.join(family)}" if family and len(family) <= 12 and not suggestion else everything
        return PluginError("unknown-plugin", f"no {kind} called {quoted(name)} is installed", listed, suggestion)
