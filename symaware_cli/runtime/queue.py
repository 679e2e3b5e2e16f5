"""The queue: what is to happen at which instant of simulated time, in which order, as plain data."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

from symaware_cli.core import Clock

#: Does what an entry says, given its row and its payload.
Handler = Callable[[int, Any], object]

#: The place of faults, before the first component; and where an instant begins, before that.
OF_FAULTS, BEFORE_ALL = -1, -2

#: So many rounds at one instant are a circle: nothing that is right wakes itself a thousand times in no time.
_MOST_ROUNDS = 1000


class Phase(IntEnum):
    """What comes first within the place of a component, at one instant."""

    LANDING = 0
    RESUMING = 1
    TURN = 2


class Entry(NamedTuple):
    """What is to happen.

    Attributes:
        time: When, in nanoseconds.
        round: In which round over all places, at its instant.
        place: Whose place it is; whoever has it registered what to do.
        phase: What comes first within the place.
        row: Which component of those at its place it is about.
        number: Counts the entries, so that those that are alike in all else come in the order in which they were made.
        kind: What is to be done, as the handlers of the place have it.
        payload: What it is done with.
    """

    time: int
    round: int
    place: int
    phase: int
    row: int
    number: int
    kind: str
    payload: Any


class LivelockError(Exception):
    """No time passes any more, because some components wake each other, or themselves, without end.

    Attributes:
        places: Who they are, ascending.
    """

    def __init__(self, places: list[int]) -> None:
        super().__init__(f"{_MOST_ROUNDS} rounds at one instant")
        self.places = places


class Queue:
    """Entries in the order of their instants; at one instant by round, place, phase, row and number.

    A place is the position of a component in the order of the scenario. What is entered for the present instant comes
    in its place if that is still to come, else in another round after all others of this instant; with a grid, at the
    next instant of the grid.

    An entry is plain data. What it means is said by the handlers that were registered for its place, so that entries
    can be listed (`pending`), put away, and taken up (`replace`) by another queue whose places have the same handlers.

    Attributes:
        clock: Simulated time, which this moves.
        grid: Every instant is rounded up to a multiple of this, in nanoseconds; 0 for none.
        entries: What is entered, as a heap of tuples in the order of `Entry`. The first element of the first one is the
            next instant. Public, as is `place`, because the loop looks at both before each turn.
        place: Whose place it is at present; before the first, `BEFORE_ALL`.
    """

    __slots__ = ("_cancelled", "_handlers", "_number", "_recent", "_round", "clock", "entries", "grid", "place")

    def __init__(self, clock: Clock, grid: int = 0) -> None:
        self.clock = clock
        self.grid = grid
        self.entries: list[tuple[int, int, int, int, int, int, str, Any]] = []
        self._number = 0
        self._round = 0
        self.place = BEFORE_ALL
        self._handlers: dict[tuple[int, str], Handler] = {}
        #: The numbers of entries that count no more; never of the first in the heap, so that it is the next to come.
        self._cancelled: set[int] = set()
        self._recent: deque[int] = deque(maxlen=256)

    def __len__(self) -> int:
        return len(self.entries) - len(self._cancelled)

    def register(self, place: int, handlers: Mapping[str, Handler]) -> None:
        """Say what the entries of a place mean, by their kind."""
        for kind, handler in handlers.items():
            self._handlers[place, kind] = handler

    def put(self, time: int, place: int, phase: Phase, row: int, kind: str, payload: Any = None) -> int:
        """Enter what is to happen; see `Entry` for what the arguments are.

        Args:
            time: Not before now.
            place: One for which the kind is registered.
            phase: See `Entry`.
            row: See `Entry`.
            kind: See `Entry`.
            payload: Plain data.

        Returns:
            The entry's number, for `cancel`.
        """
        if self.grid:
            time = -(-time // self.grid) * self.grid
        number = 0
        if time == self.clock.now:
            if place > self.place:
                number = self._round
            elif self.grid:
                time += self.grid
            else:
                number = self._round + 1
        self._number += 1
        heapq.heappush(self.entries, (time, number, place, phase, row, self._number, kind, payload))
        return self._number

    def cancel(self, number: int) -> None:
        """Take out an entry that is still to come.

        Args:
            number: What `put` returned.
        """
        entries, cancelled = self.entries, self._cancelled
        cancelled.add(number)
        if len(cancelled) * 2 > len(entries):
            entries[:] = [each for each in entries if each[5] not in cancelled]
            heapq.heapify(entries)
            cancelled.clear()
        else:
            self._drop_cancelled()

    def _drop_cancelled(self) -> None:
        """Take out what is cancelled and would come next."""
        entries, cancelled = self.entries, self._cancelled
        while entries and entries[0][5] in cancelled:
            cancelled.remove(heapq.heappop(entries)[5])

    def pending(self) -> list[Entry]:
        """All that is to come, in its order."""
        return [Entry(*each) for each in sorted(self.entries) if each[5] not in self._cancelled]

    def replace(self, entries: Sequence[Entry]) -> None:
        """Forget what is entered, and take up entries that were listed by `pending`, with their numbers.

        Args:
            entries: All of them later than now, or at an instant that has not begun.
        """
        self.entries[:] = sorted(tuple(each) for each in entries)
        self._cancelled.clear()
        self._number = max((each.number for each in entries), default=0)

    def begin(self, now: int) -> None:
        """Come to an instant; all places are still to come."""
        self.clock.now = now
        self._round = 0
        self.place = BEFORE_ALL

    def run(self, place: int | None = None) -> None:
        """Do all that is entered for this instant, or what comes before the turn of a place in the first round.

        Raises:
            LivelockError: There is no end to it.
        """
        entries, handlers, now, pop = self.entries, self._handlers, self.clock.now, heapq.heappop
        while entries and entries[0][0] == now:
            if place is not None and entries[0][:4] >= (now, 0, place, Phase.TURN):
                break
            _, number, own, _, row, _, kind, payload = pop(entries)
            if self._cancelled:
                self._drop_cancelled()
            if number > _MOST_ROUNDS - 10:
                self._recent.append(own)
                if number > _MOST_ROUNDS:
                    raise LivelockError(sorted(set(self._recent)))
            self._round, self.place = number, own
            handlers[own, kind](row, payload)
        self._round = 0 if place is not None else self._round
