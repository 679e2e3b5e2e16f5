"""Turns that have begun and are not finished, by component."""

from __future__ import annotations

from collections.abc import Iterator

from symaware_cli.runtime.turn import Turns


class TurnsInProgress(Turns):
    """The unfinished turns of the components of one entry, by row."""

    def __init__(self) -> None:
        super().__init__()
        self._busy: dict[int, object] = {}

    def __contains__(self, row: int) -> bool:
        return row in self._busy

    def __iter__(self) -> Iterator[object]:
        return iter(self._busy.values())

    @property
    def rows(self) -> list[int]:
        """The rows with an unfinished turn, in the order in which the turns began."""
        return list(self._busy)

    def of(self, row: int) -> object | None:
        """The unfinished turn of a component, if it has one."""
        return self._busy.get(row)

    def add(self, row: int, turn: object) -> None:
        """Register a turn that may take simulated time."""
        self._busy[row] = turn

    def remove(self, row: int, turn: object) -> bool:
        """Remove a finished turn; return False if it was cancelled before."""
        if self._busy.get(row) != turn:
            return False
        del self._busy[row]
        return True

    def pop(self, row: int) -> object | None:
        """Remove and return the unfinished turn of a component, if it has one."""
        return self._busy.pop(row, None)
