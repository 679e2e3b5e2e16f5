"""Turns under way: which of them take time, and whose they are."""

from __future__ import annotations

from collections.abc import Iterator

from symaware_cli.runtime.turn import Turns


class TurnsInProgress(Turns):
    """What the components of one entry are busy with, by row."""

    def __init__(self) -> None:
        super().__init__()
        self._busy: dict[int, object] = {}

    def __contains__(self, row: int) -> bool:
        return row in self._busy

    def __iter__(self) -> Iterator[object]:
        return iter(self._busy.values())

    @property
    def rows(self) -> list[int]:
        """Who is busy, in the order in which they began."""
        return list(self._busy)

    def of(self, row: int) -> object | None:
        """What a component is busy with."""
        return self._busy.get(row)

    def occupy(self, row: int, turn: object) -> None:
        """A component is busy with a turn that may take time."""
        self._busy[row] = turn

    def vacate(self, row: int, turn: object) -> bool:
        """A component is done with a turn; False if it was made to give it up before."""
        if self._busy.get(row) != turn:
            return False
        del self._busy[row]
        return True

    def give_up(self, row: int) -> object | None:
        """A component is to do nothing any more; return what it was busy with."""
        return self._busy.pop(row, None)
