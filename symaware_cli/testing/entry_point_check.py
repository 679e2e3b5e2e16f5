"""Checks of entry points: each of a distribution can be imported, and is of the kind of its group."""

from __future__ import annotations

import difflib
from typing import Any

from symaware_cli.entry_points import Listing, PluginError, built_in, listings_of, points_of
from symaware_cli.language import KINDS, Catalogue
from symaware_cli.testing.conformance import ConformanceError
from symaware_cli.world import PluginKind

#: Groups whose entry points are not classes of plugins: verbs, and kinds of plugins.
_OTHERS = {"symaware.commands": "command", "symaware.doors": "door"}


def check_entry_points(package_name: str) -> None:
    """Check the entry points of an installed distribution in the groups of SymAware.

    Each entry point must be in a group that exists, be importable, be of the kind of its group, and have a name that no
    built-in plugin has. A module that cannot be imported is reported once.

    Args:
        package_name: The name of the distribution, as in ``pip install``.

    Raises:
        ConformanceError: A line for each deviation.
    """
    points = points_of(package_name)
    if points is None:
        raise ConformanceError([f"{package_name} is not installed here; install it, such as with `pip install -e .`"])
    problems = [] if points else [f"{package_name} has no entry points in groups like symaware.components; add them"]
    kinds = _kinds()
    unusable: set[str] = set()
    for point in points:
        if point.group not in kinds and point.group not in _OTHERS:
            near = difflib.get_close_matches(point.group, [*kinds, *_OTHERS], 1)
            how = f"did you mean `{near[0]}`?" if near else f"the groups are {', '.join(sorted(kinds))}"
            problems.append(
                f"{package_name}: `{point.name}` is in the group `{point.group}`, which does not exist; {how}"
            )
            continue
        kind = kinds.get(point.group)
        name = _OTHERS.get(point.group) or kind.name  # type: ignore[union-attr]
        listing = listings_of(name, [point])[point.name][0]
        problem = _problem(listing, kind, unusable)
        if problem:
            problems.append(problem)
    if problems:
        raise ConformanceError(list(dict.fromkeys(problems)))


def _kinds() -> dict[str, PluginKind]:
    """Return all kinds of plugins by the groups of their entry points."""
    catalogue = Catalogue()
    catalogue.add_sections()
    found = {each.group: each for each in (*KINDS, *catalogue.kinds.values())}
    for (listing,) in built_in("door", "symaware.doors").values():
        door = listing.load()
        found[door.group] = door
    return found


def _problem(listing: Listing, kind: PluginKind | None, unusable: set[str]) -> str | None:
    """Return the problem with an entry point; None if there is none, or if it was reported for its module already."""
    where, module = f"{listing.origin} ({listing.target})", listing.target.partition(":")[0]
    if module in unusable:
        return None
    try:
        loaded: Any = listing.load()
    except PluginError as error:
        if not isinstance(error.__cause__, AttributeError):
            unusable.add(module)
        how = error.expected or f"let `python -c 'import {module}'` succeed, and the target be MODULE:NAME"
        return f"{error}; {how}"
    if kind is None:
        return None if callable(loaded) or isinstance(loaded, PluginKind) else f"{where} is not callable"
    fault = kind.fault(loaded)
    if fault is not None:
        return f"{where} {fault}; register it in the group of its kind"
    if not kind.is_name(listing.name):
        return f"{where} has a name that cannot be a key of {kind.plural}; choose another one"
    taken = {each.name for each in Catalogue([kind]).listings(kind.name) if each.built_in}
    if not listing.built_in and listing.name in taken:
        return f"{where} has the name of a built-in one and is never used; name it after your package, family.name"
    return None
