"""The pacer: ties simulated time to wall time. The only one in a run who looks at the clock on the wall."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

#: So late a wake-up counts as late [s]: what an idle machine takes to wake a process up, and some more.
TOLERANCE = 0.002


@dataclass(slots=True)
class Pace:
    """How well a run kept its pace.

    Attributes:
        factor: Simulated seconds for each second of wall time that were asked for.
        instants: How many instants there were to be kept.
        late: How many of them began later than `TOLERANCE`.
        worst: By how much the latest was late, in wall time [s].
    """

    factor: float
    instants: int = 0
    late: int = 0
    worst: float = 0.0

    def figures(self) -> tuple[float, int, int, float]:
        """All four, in this order."""
        return self.factor, self.instants, self.late, self.worst


class Pacer:
    """Sleeps until it is time.

    Attributes:
        kept: How well the pace was kept so far.
        started: When simulated time began, by the monotonic clock [s]; None before it does.
        factor: Simulated seconds for each second of wall time.
    """

    #: It belongs to the clock on the wall.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, factor: float) -> None:
        self.factor = factor
        self.kept = Pace(factor)
        self.started: float | None = None

    def start_at(self, started: float) -> None:
        """Let simulated time begin, or have begun, at an instant of the monotonic clock [s]."""
        self.started = started

    def lead(self, now: int) -> float:
        """Wall time that is left until an instant [s]; negative if it is past. The first call is the start.

        Args:
            now: The instant, in nanoseconds of simulated time.
        """
        monotonic = time.monotonic()
        if self.started is None:
            self.started = monotonic - now / 1e9 / self.factor
        return self.started + now / 1e9 / self.factor - monotonic

    def wait(self, now: int) -> None:
        """Sleep until an instant, and take note of how late it is."""
        lead = self.lead(now)
        while lead > 0.0:
            time.sleep(lead)
            lead = self.lead(now)
        self.note(-lead)

    def note(self, late: float) -> None:
        """Take note of how late an instant begins [s]."""
        kept = self.kept
        kept.instants += 1
        if late > TOLERANCE:
            kept.late += 1
        kept.worst = max(kept.worst, late)

    def simulated(self) -> int:
        """The instant that it is time for, in nanoseconds of simulated time."""
        if self.started is None:
            return 0
        return int((time.monotonic() - self.started) * self.factor * 1e9)
