"""Identifies the turns of components, by their instant and their count at that instant, and notes unfinished ones."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager

from symaware_cli.core import Component, GroupComponent
from symaware_cli.world import Turn


class Turns:
    """Numbers the turns of several components, such as those of one entry, in the order in which they begin."""

    def __init__(self) -> None:
        self._last: dict[int, Turn] = {}

    def begin(self, row: int, now: int) -> Turn:
        """Begin the next turn of a component.

        Args:
            row: The component's row.
            now: The present time in nanoseconds.
        """
        last = self._last.get(row)
        turn = Turn(now) if last is None or last.instant != now else Turn(now, last.repetition + 1)
        self._last[row] = turn
        return turn


class _TemporaryAttribute:
    """Sets an attribute of a component within a context; a class, as a generator takes three times as long."""

    __slots__ = ("_attributes", "_name", "_value")

    def __init__(self, component: Component | GroupComponent, name: str, value: object) -> None:
        self._attributes = vars(component)
        self._name = name
        self._value = value

    def __enter__(self) -> None:
        self._attributes[self._name] = self._value

    def __exit__(self, *error: object) -> None:
        self._attributes.pop(self._name, None)


def in_turn(component: Component | GroupComponent, turn: Turn) -> AbstractContextManager[None]:
    """Key the random draws of a component by a turn; outside this context they belong to the instant's only turn."""
    return _TemporaryAttribute(component, "_turn_begun", turn)


def computed_at(component: Component | GroupComponent, instant: int) -> AbstractContextManager[None]:
    """Within the context, tell a component when the value that it receives was computed.

    Args:
        component: The component.
        instant: The time of the computation in nanoseconds.
    """
    return _TemporaryAttribute(component, "_computed_at", instant)


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
