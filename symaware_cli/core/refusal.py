"""Refusals: a plugin says that it cannot do what a scenario asks of it, and where in the scenario that is asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class RefusalError(ValueError):
    """A plugin cannot do what a scenario asks of it.

    Attributes:
        path: Where that is asked, such as ``("agents", "robot", "model")`` in the scenario, or ``("edges", 3)`` in the
            parameters of the plugin.
        name: What stands there and is not known; None where something else is wrong.
        names: What would be right in its place, where that can be listed.
        others: What else it cannot do, if several things were tried.
    """

    def __init__(self, message: str, *path: str | int, name: str | None = None, names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.path = path
        self.name = name
        self.names = names
        self.others: Sequence[RefusalError] = ()


class Attempts:
    """Tries all that a scenario asks of a plugin, so that an author learns at once of everything that cannot be."""

    def __init__(self) -> None:
        self._failed: list[RefusalError] = []

    @contextmanager
    def one(self) -> Iterator[None]:
        """Try one of them; where it fails, the next one follows."""
        try:
            yield
        except RefusalError as error:
            self._failed.append(error)

    def conclude(self) -> None:
        """End with the first that failed, which knows of the others.

        Raises:
            RefusalError: One failed.
        """
        if self._failed:
            first, *rest = self._failed
            first.others = rest
            raise first
