"""Turns told apart: which one of its component's is under way, by its instant and how many there were before at it."""

from __future__ import annotations

from contextlib import AbstractContextManager

from symaware_cli.core import Component, GroupComponent
from symaware_cli.world.chance import Turn


class Turns:
    """Names the turns of a number of components, such as those of one entry, in the order in which they begin."""

    def __init__(self) -> None:
        self._last: dict[int, Turn] = {}

    def begin(self, row: int, now: int) -> Turn:
        """The next turn of a component.

        Args:
            row: The component's row.
            now: In nanoseconds.
        """
        last = self._last.get(row)
        turn = Turn(now) if last is None or last.instant != now else Turn(now, last.repetition + 1)
        self._last[row] = turn
        return turn


class _TemporaryAttribute:
    """An attribute that a component has meanwhile; a class, because a generator takes three times as long."""

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
    """Let a component draw, meanwhile, what belongs to a turn; without, it takes the only one of the instant."""
    return _TemporaryAttribute(component, "_turn_begun", turn)


def computed_at(component: Component | GroupComponent, instant: int) -> AbstractContextManager[None]:
    """Let a component know when the value was computed that it is given meanwhile.

    Args:
        component: Which one.
        instant: In nanoseconds.
    """
    return _TemporaryAttribute(component, "_computed_at", instant)
