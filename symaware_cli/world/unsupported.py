"""What a plugin raises if it does not support what a scenario asks of it, and where in the scenario that is asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class UnsupportedError(ValueError):
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
        self.others: Sequence[UnsupportedError] = ()


class ErrorCollector:
    """Collects errors, so that an author learns at once of everything in a scenario that a plugin does not support."""

    def __init__(self) -> None:
        self._failed: list[UnsupportedError] = []

    @contextmanager
    def catch(self) -> Iterator[None]:
        """Keep an error that is raised within, and go on."""
        try:
            yield
        except UnsupportedError as error:
            self._failed.append(error)

    def raise_first(self) -> None:
        """Raise the first error, if there is one; it knows of the others.

        Raises:
            UnsupportedError: There was an error.
        """
        if self._failed:
            first, *rest = self._failed
            first.others = rest
            raise first
