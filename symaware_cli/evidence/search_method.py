"""Search methods that minimise a function of points between 0 and 1, evaluated one batch at a time.

The points of a batch depend only on the seed and on the values of earlier batches, not on where they were computed.

Reasons: docs/decisions/0048-methods-of-search.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import ClassVar

import numpy as np

from symaware_cli.entry_points import PluginError
from symaware_cli.studies import Array, SweepError
from symaware_cli.world import InstalledPlugins, PluginKind

#: Returns the values (n,) of points (n, d); raises an exception to end the search.
Look = Callable[[Array], Array]


class SearchMethod(ABC):
    """Chooses the points that a search evaluates; registered in the group `symaware.searches`.

    Attributes:
        module: An optional module that it needs.
        install: The command to install that module.
        is_independent: Whether the points are independent draws, so that a search without a violation bounds the
            violation probability.
    """

    module: ClassVar[str | None] = None
    install: ClassVar[str] = ""
    is_independent: ClassVar[bool] = False

    @abstractmethod
    def minimise(self, look: Look, names: Sequence[str], most: int, seed: int) -> None:
        """Evaluate points until `look` ends the search with an exception, or at least `most` of them.

        Args:
            look: Returns the values of a batch of points; shapes (n, d) and (n,).
            names: The names of the coordinates, d of them.
            most: The number of points to evaluate at least, if `look` does not end the search.
            seed: The seed of the points; the same seed and values give the same points.
        """


SEARCH = PluginKind("search", "symaware.searches", (SearchMethod,))


def method_names() -> Sequence[str]:
    """Return the names of all installed methods."""
    return list(dict.fromkeys(listing.name for listing in InstalledPlugins([SEARCH]).listings(SEARCH.name)))


def method_named(name: str) -> SearchMethod:
    """Return the search method with a name.

    Raises:
        SweepError: There is no such method, or the module that it needs is not installed.
    """
    try:
        method: SearchMethod = InstalledPlugins([SEARCH]).load(SEARCH.name, name)()
    except PluginError as error:
        if error.code != "unknown-plugin":
            raise SweepError(str(error)) from error
        raise SweepError(f"there is no search method `{name}`; there are {', '.join(method_names())}") from None
    if method.module is not None and find_spec(method.module) is None:
        raise SweepError(
            f"the method {name} needs the module `{method.module}`, which is not installed: {method.install}"
        )
    return method


def number_of(*key: int) -> int:
    """Return a 32-bit seed derived from a key, for generators that need one."""
    return int(np.random.SeedSequence(key).generate_state(1)[0])
