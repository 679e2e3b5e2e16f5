"""The agenda: what is to happen at which instant of simulated time, and in which order."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable
from enum import IntEnum

Call = Callable[[], object]

#: The place of faults, before the first component; and where an instant begins, before that.
OF_FAULTS, BEFORE_ALL = -1, -2

#: So many rounds at one instant are a circle: nothing that is right wakes itself a thousand times in no time.
_MOST_ROUNDS = 1000


class Phase(IntEnum):
    """What comes first within the place of a component, at one instant."""

    LANDING = 0
    RESUMING = 1
    TURN = 2


class LivelockError(Exception):
    """No time passes any more, because some components wake each other, or themselves, without end.

    Attributes:
        places: Who they are, ascending.
    """

    def __init__(self, places: list[int]) -> None:
        super().__init__(f"{_MOST_ROUNDS} rounds at one instant")
        self.places = places


class Agenda:
    """Calls in the order of their instants; at one instant by round, place, phase, row and time of entry.

    A place is the position of a component in the order of the scenario. What is entered for the present instant comes
    in its place if that is still to come, else in another round after all others of this instant; with a grid, at the
    next instant of the grid.

    Attributes:
        now: The present instant, in nanoseconds.
        grid: Every instant is rounded up to a multiple of this, in nanoseconds; 0 for none.
        entries: What is entered, as a heap; the first element of the first one is the next instant. Public, as is
            `place`, because a run looks at both before each turn.
        place: Whose place it is at present; before the first, `BEFORE_ALL`.
    """

    __slots__ = ("_number", "_recent", "_round", "entries", "grid", "now", "place")

    def __init__(self, grid: int = 0) -> None:
        self.grid = grid
        self.now = 0
        self.entries: list[tuple[int, int, int, int, int, int, Call]] = []
        self._number = 0
        self._round = 0
        self.place = BEFORE_ALL
        self._recent: deque[int] = deque(maxlen=256)

    def put(self, time: int, place: int, phase: Phase, row: int, call: Call) -> None:
        """Enter what is to happen.

        Args:
            time: When; not before now.
            place: Whose place it is.
            phase: Of which kind it is.
            row: Which agent of the group it is about.
            call: What to call.
        """
        if self.grid:
            time = -(-time // self.grid) * self.grid
        number = 0
        if time == self.now:
            if place > self.place:
                number = self._round
            elif self.grid:
                time += self.grid
            else:
                number = self._round + 1
        self._number += 1
        heapq.heappush(self.entries, (time, number, place, phase, row, self._number, call))

    def begin(self, now: int) -> None:
        """Come to an instant; all places are still to come."""
        self.now = now
        self._round = 0
        self.place = BEFORE_ALL

    def run(self, place: int | None = None) -> None:
        """Call all that is entered for this instant, or what comes before the turn of a place in the first round.

        Raises:
            LivelockError: There is no end to it.
        """
        entries, now, pop = self.entries, self.now, heapq.heappop
        while entries and entries[0][0] == now:
            if place is not None and entries[0][:4] >= (now, 0, place, Phase.TURN):
                break
            _, number, own, _, _, _, call = pop(entries)
            if number > _MOST_ROUNDS - 10:
                self._recent.append(own)
                if number > _MOST_ROUNDS:
                    raise LivelockError(sorted(set(self._recent)))
            self._round, self.place = number, own
            call()
        self._round = 0 if place is not None else self._round
