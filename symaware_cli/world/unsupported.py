"""Errors of plugins that do not support something in a scenario, with its path in the scenario."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class UnsupportedError(ValueError):
    """A plugin does not support something in a scenario.

    Attributes:
        path: Its path, such as ``("agents", "robot", "model")`` in the scenario, or ``("edges", 3)`` in the
            parameters of the plugin.
        name: The unknown name at this path; None for other errors.
        names: The valid names, if they can be listed.
        others: Further errors, if several things were tried.
    """

    def __init__(self, message: str, *path: str | int, name: str | None = None, names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.path = path
        self.name = name
        self.names = names
        self.others: Sequence[UnsupportedError] = ()


class ErrorCollector:
    """Collects errors, so that everything in a scenario that a plugin does not support is reported at once."""

    def __init__(self) -> None:
        self._failed: list[UnsupportedError] = []

    @contextmanager
    def catch(self) -> Iterator[None]:
        """Store an error that is raised within, and continue."""
        try:
            yield
        except UnsupportedError as error:
            self._failed.append(error)

    def raise_first(self) -> None:
        """Raise the first error, if any, with all others in its `others`.

        Raises:
            UnsupportedError: An error was stored.
        """
        if self._failed:
            first, *rest = self._failed
            first.others = rest
            raise first
