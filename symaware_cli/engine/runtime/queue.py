"""The event queue of simulated time: entries of plain data, ordered by instant, round, place, phase and row.

Reasons: docs/decisions/0022-kernel-of-plain-data.md
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

from symaware_cli.core import Clock

#: Processes an entry, given its row and its payload.
Handler = Callable[[int, Any], object]

#: The place of faults, before the first component; and the place at which an instant begins, before that.
OF_FAULTS, BEFORE_ALL = -1, -2

#: The greatest number of rounds at one instant; more are taken for an endless cycle of triggers.
_MOST_ROUNDS = 1000


class Phase(IntEnum):
    """The order of entries at one instant and place."""

    LANDING = 0
    RESUMING = 1
    TURN = 2


class Entry(NamedTuple):
    """An entry of the queue.

    Attributes:
        time: Its instant in nanoseconds.
        round: The round over all places at that instant.
        place: The index of the component entry whose handlers process it, or `OF_FAULTS`.
        phase: Its order within the place.
        row: The row of the component concerned.
        number: A serial number, so that otherwise equal entries keep the order in which they were made.
        kind: Selects the handler of the place.
        payload: An argument of the handler.
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
    """Simulated time no longer advances, because some components trigger each other or themselves endlessly.

    Attributes:
        places: The places of these components, ascending.
    """

    def __init__(self, places: list[int]) -> None:
        super().__init__(f"{_MOST_ROUNDS} rounds at one instant")
        self.places = places


class Queue:
    """A priority queue of entries, ordered by instant, round, place, phase, row and number.

    A place is the index of a component entry in execution order. An entry for the present instant is processed in the
    present round if its place is still to come, otherwise in a further round after all others of this instant; with a
    grid, at the next instant of the grid.

    An entry is plain data, processed by the handler that was registered for its place and kind. So entries can be
    listed (`pending`), stored, and loaded (`replace`) into another queue with the same handlers.

    Attributes:
        clock: Simulated time, which the queue sets.
        grid: Every instant is rounded up to a multiple of this, in nanoseconds; 0 for none.
        entries: A heap of tuples in the order of `Entry`; the first element of the first one is the next instant.
            Public, as is `place`, because the kernel's loop reads both before each turn.
        place: The present place; `BEFORE_ALL` before the first.
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
        #: The numbers of cancelled entries that are still in the heap; never that of its first entry.
        self._cancelled: set[int] = set()
        self._recent: deque[int] = deque(maxlen=256)

    def __len__(self) -> int:
        return len(self.entries) - len(self._cancelled)

    def register(self, place: int, handlers: Mapping[str, Handler]) -> None:
        """Register the handlers of a place, by kind of entry."""
        for kind, handler in handlers.items():
            self._handlers[place, kind] = handler

    def put(self, time: int, place: int, phase: Phase, row: int, kind: str, payload: Any = None) -> int:
        """Add an entry; see `Entry` for the arguments.

        Args:
            time: Not before now.
            place: A place for which the kind is registered.
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
        """Cancel an entry that was not processed yet.

        Args:
            number: The result of `put`.
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
        """Remove cancelled entries from the top of the heap."""
        entries, cancelled = self.entries, self._cancelled
        while entries and entries[0][5] in cancelled:
            cancelled.remove(heapq.heappop(entries)[5])

    def pending(self) -> list[Entry]:
        """List all entries that are not cancelled, in order."""
        return [Entry(*each) for each in sorted(self.entries) if each[5] not in self._cancelled]

    def replace(self, entries: Sequence[Entry]) -> None:
        """Replace all entries by entries that were listed by `pending`, with their numbers.

        Args:
            entries: The entries, each later than now or at an instant that has not begun.
        """
        self.entries[:] = sorted(tuple(each) for each in entries)
        self._cancelled.clear()
        self._number = max((each.number for each in entries), default=0)

    def begin(self, now: int) -> None:
        """Set the clock to an instant; no place has been processed yet."""
        self.clock.now = now
        self._round = 0
        self.place = BEFORE_ALL

    def run(self, place: int | None = None) -> None:
        """Process all entries of this instant, or those before the turn of a place in the first round.

        Raises:
            LivelockError: There are too many rounds at this instant.
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
