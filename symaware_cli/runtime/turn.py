"""Turns told apart: which one of its component's is under way, by its instant and how many there were before at it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from symaware_cli.core import Component, GroupComponent
from symaware_cli.core.chance import Turn


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


@contextmanager
def in_turn(component: Component | GroupComponent, turn: Turn) -> Iterator[None]:
    """Let a component draw, meanwhile, what belongs to a turn; without, it takes the only one of the instant."""
    vars(component)["_turn_begun"] = turn
    try:
        yield
    finally:
        vars(component).pop("_turn_begun", None)


@contextmanager
def computed_at(component: Component | GroupComponent, instant: int) -> Iterator[None]:
    """Let a component know when the value was computed that it is given meanwhile.

    Args:
        component: Which one.
        instant: In nanoseconds.
    """
    vars(component)["_computed_at"] = instant
    try:
        yield
    finally:
        vars(component).pop("_computed_at", None)
