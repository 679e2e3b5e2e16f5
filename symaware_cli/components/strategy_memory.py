"""What an agent that follows a strategy remembers from turn to turn, and what it reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Level


class Revision(NamedTuple):
    """What an agent knows beyond the formulas and the model: a strategy is made again for each revision.

    Attributes:
        blocked: The cells that cannot be entered, ascending.
        dropped: The numbers of the assumptions that are made no longer, ascending.
    """

    blocked: tuple[int, ...] = ()
    dropped: tuple[int, ...] = ()


#: Why an agent stays where it is: an assumption was broken; what is assumed is overdue; a strategy is being made; or
#: there is none from there.
Halt = Literal["", "violation", "overdue", "revision", "unrealisable"]


class StrategyMemory(NamedTuple):
    """What an agent remembers from turn to turn. States are those of the game with all assumptions and all cells.

    Attributes:
        values: The last known values of the environment's variables, in their order; -1 for none.
        met: When each goal of the environment was last met [ns].
        overdue: Whether each of these was reported to be overdue.
        state: The state at the last decision; -1 before the first one.
        goal: The goal that it pursues.
        following: The cell that it decided to go to.
        halt: Why it follows no strategy; empty if it does.
        opposing: The goal that the environment pursues, if it plays a counterstrategy.
        path: The cells through which it came, without loops; the present one is the last.
        dropped: The numbers of the assumptions that it has given up, ascending.
        distrusted: The numbers of the assumptions of which something is overdue, so that it stays, ascending.
        revision: The revision whose strategy it follows.
        pending: The revision for which a strategy is being made; None for none.
        due: When that strategy takes effect [ns].
    """

    values: tuple[int, ...]
    met: tuple[int, ...]
    overdue: tuple[bool, ...]
    state: int = -1
    goal: int = 0
    following: int = -1
    halt: Halt = ""
    opposing: int = 0
    path: tuple[int, ...] = ()
    dropped: tuple[int, ...] = ()
    distrusted: tuple[int, ...] = ()
    revision: Revision = Revision()
    pending: Revision | None = None
    due: int = 0

    def walked(self, cell: int) -> tuple[int, ...]:
        """Return the path with a further cell; of a loop only its beginning is kept."""
        if cell in self.path:
            return self.path[: self.path.index(cell) + 1]
        return (*self.path, cell)


class TurnReport(NamedTuple):
    """An event that a turn leads to.

    Attributes:
        row: The row of the agent.
        name: The name of the event.
        text: One line for people.
        level: Its importance.
        data: Further facts.
    """

    row: int
    name: str
    text: str
    level: Level
    data: Mapping[str, Any]


@dataclass(frozen=True)
class StrategyTurn:
    """A turn of an agent.

    Attributes:
        row: The row of the agent.
        now: The instant [ns].
        blocked: The cells that it knows to be blocked, ascending.
        position: Where it believes to be [m]; shape (2,).
        reports: What the turns of the group have led to so far.
    """

    row: int
    now: int
    blocked: tuple[int, ...]
    position: NDArray[np.float64]
    reports: list[TurnReport]

    def report(self, name: str, text: str, level: Level = Level.INFO, **data: object) -> None:
        """Add an event to the reports."""
        self.reports.append(TurnReport(self.row, name, text, level, data))
