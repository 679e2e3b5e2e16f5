"""Makes a scenario that breaks an invariant small: whatever can be left out without it holding is left out."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

Tree = dict[str, Any]
Place = tuple[str | int, ...]


def shrunk(tree: Tree, breaks: Callable[[Tree], bool], attempts: int = 300) -> Tree:
    """Return the smallest scenario that is found.

    Larger parts are tried first: groups and components before options, and those before items of lists.

    Args:
        tree: The scenario.
        breaks: Whether a scenario still breaks the invariant in the same way; False if it is not valid.
        attempts: How many scenarios are tried at most.
    """
    while True:
        for place in sorted(_places(tree), key=len):
            if attempts <= 0:
                return tree
            smaller = _without(tree, place)
            attempts -= 1
            if breaks(smaller):
                tree = smaller
                break
        else:
            return tree


def _places(value: Any, above: Place = ()) -> Iterator[Place]:
    """All keys and items, by their path."""
    keys = value.keys() if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield (*above, key)
        yield from _places(value[key], (*above, key))


def _without(tree: Tree, place: Place) -> Tree:
    smaller = copy.deepcopy(tree)
    holder: Any = smaller
    for key in place[:-1]:
        holder = holder[key]
    del holder[place[-1]]
    return smaller
