"""Monitors whether agents keep to the cells that a strategy chose, whichever component steers them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar, NamedTuple

from symaware_cli.core import Level
from symaware_cli.geometry import Array
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel

#: The distance from a cell beyond which an agent is outside [m]; it allows for rounding and for stopping just short.
_OUTSIDE = 2e-6


class CellEvent(NamedTuple):
    """An event about an agent and its cells.

    Attributes:
        name: The name of the event.
        text: One line for people.
        level: Its importance.
        data: Further facts.
    """

    name: str
    text: str
    level: Level
    data: Mapping[str, Any]


class CellWatch:
    """Compares the positions of agents with the present cell of each and the cell that it goes to."""

    uncaptured: ClassVar[Collection[str]] = ("_model",)

    #: The events, with their meanings.
    EVENTS: ClassVar[Mapping[str, str]] = {
        "cells-left": "An agent is neither in the cell that it came from, `cell`, nor in the one that it goes to,"
        " `next_cell`; `distance` is how far outside [m].",
        "cell-skipped": "An agent came from its `cell` to a third one, `reached`, without having been in the next one,"
        " `skipped`.",
        "cells-entered": "An agent that had left both cells is in one of them again.",
    }

    def __init__(self, model: KnowledgeModel, count: int) -> None:
        """Begin with agents that are in their cells.

        Args:
            model: The cells.
            count: The number of agents.
        """
        self._model = model
        self._is_outside = [False] * count
        #: The two cells of each agent, and whether it has reached the second or was reported to have skipped it.
        self._pairs = [(-1, -1)] * count
        self._is_told = [False] * count

    def seen(self, row: int, cell: int, following: int, position: Array) -> CellEvent | None:
        """Return the event of an agent at a position; None for no new event.

        Args:
            row: Its row.
            cell: The cell that it came to last.
            following: The cell that it goes to.
            position: Its position [m]; shape (d,).
        """
        model, states = self._model, self._model.system.states
        if self._pairs[row] != (cell, following):
            self._pairs[row], self._is_told[row] = (cell, following), cell == following
        ahead = model.distance(following, position)
        distance = min(ahead, model.distance(cell, position))
        self._is_told[row] |= ahead <= _OUTSIDE
        was_outside, self._is_outside[row] = self._is_outside[row], distance > _OUTSIDE
        if distance <= _OUTSIDE:
            if not was_outside:
                return None
            return CellEvent("cells-entered", "is in its cell or the next one again", Level.INFO, {})
        reached = int(model.cells(position[None])[0])
        if reached >= 0 and not self._is_told[row]:
            self._is_told[row] = True
            names = {"cell": states[cell], "skipped": states[following], "reached": states[reached]}
            said = f"came from {states[cell]} to {states[reached]} without having been in {states[following]}"
            return CellEvent("cell-skipped", said, Level.WARNING, names)
        if was_outside:
            return None
        data = {"cell": states[cell], "next_cell": states[following], "distance": distance}
        two = f"its cell {states[cell]}" + (f" and the next one, {states[following]}" if cell != following else "")
        return CellEvent("cells-left", f"is {distance:.2g} m outside {two}", Level.WARNING, data)
