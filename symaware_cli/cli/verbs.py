"""The verbs of the command: those of this package and those of plugins. Only a plugin makes it import Typer.

Reasons: docs/decisions/0055-doors-for-verbs.md
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

from symaware_cli import entry_points
from symaware_cli.entry_points import Listing, Listings, PluginError
from symaware_cli.help_place import HelpPlace, place_of

DESCRIPTION = "Run multi-agent scenarios with situational awareness: deterministic, recorded, checkable."
"""The help of the command as a whole, in a sentence."""

#: The entry-point group of the verbs.
GROUP = "symaware.commands"

_KIND = "command"

#: The title in the help of verbs that cannot be used.
_UNUSABLE = "Cannot be used"


class Summary(NamedTuple):
    """A verb in the help of the command.

    Attributes:
        name: Its name.
        text: Its help, or the reason that it cannot be used.
        place: Its place in the help; None if it cannot be used.
    """

    name: str
    text: str
    place: HelpPlace | None

    @property
    def title(self) -> str:
        """The title of the group in which it is listed."""
        return _UNUSABLE if self.place is None else self.place.title


class Verbs:
    """The verbs. A verb is imported when it is used; other packages are searched only for verbs not built in."""

    @cached_property
    def _built_in(self) -> Listings:
        if "_installed" not in vars(self):
            return entry_points.built_in(_KIND, GROUP)
        own = {name: [each for each in same if each.built_in] for name, same in self._installed.items()}
        return {name: same for name, same in own.items() if same}

    @cached_property
    def _installed(self) -> Listings:
        return entry_points.listings_of(_KIND, entry_points.installed().get(GROUP, ()))

    @property
    def names(self) -> list[str]:
        """The names of all verbs."""
        return list(self._installed)

    def command(self, name: str) -> Any:
        """The command of a verb; None if there is no such verb, an `UnusableVerb` if it cannot be used."""
        from symaware_cli.cli.verb_command import UnusableVerb, command_of

        try:
            listing = self._find(name)
            return None if listing is None else command_of(name, listing)
        except PluginError as error:
            return UnusableVerb(name, error)

    def summaries(self) -> list[Summary]:
        """All verbs for the help, in its order; those of plugins are imported, and the unusable ones are the last."""
        return sorted(
            self._summaries(),
            key=lambda each: (each.place is None, (each.place or HelpPlace()).rank, each.name),
        )

    def imported_summaries(self) -> dict[str, tuple[str, str, int]]:
        """What `verb_summaries` has to say: of each verb of this package, by its target, its help and its place."""
        found = {}
        for (listing,) in self._built_in.values():
            verb = listing.load()
            found[listing.target] = (_help_of(verb).partition("\n\n")[0], *place_of(verb))
        return found

    def _summaries(self) -> Iterator[Summary]:
        from symaware_cli.cli.verb_summaries import SUMMARIES

        for name in self.names:
            try:
                listing = self._find(name)
                if listing is None:
                    continue
                if listing.built_in and listing.target in SUMMARIES:
                    text, group, order = SUMMARIES[listing.target]
                    yield Summary(name, text, HelpPlace(group, order))
                    continue
                if not listing.built_in:
                    from symaware_cli.cli.verb_command import command_of

                    # To find faults of its signature, too.
                    command_of(name, listing)
                loaded = listing.load()
            except PluginError as error:
                yield Summary(name, error.sentence, None)
                continue
            yield Summary(name, _help_of(loaded), place_of(loaded))
        for name, same in self._installed.items():
            if name in self._built_in:
                for listing in same:
                    if not listing.built_in:
                        yield Summary(name, f"{listing.origin} is ignored: `symaware {name}` is built in", None)

    def _find(self, name: str) -> Listing | None:
        """The registration of a verb, preferably by this package; None if there is none.

        Raises:
            PluginError: Several packages register it.
        """
        same = self._built_in.get(name) or self._installed.get(name)
        return entry_points.chosen(same) if same else None


def _help_of(verb: Any) -> str:
    import typer

    return str((verb.info.help if isinstance(verb, typer.Typer) else inspect.getdoc(verb)) or "")
