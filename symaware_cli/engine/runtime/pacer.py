"""The pacer: ties simulated time to wall time; the only part of a run whose behaviour depends on the wall clock."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

#: The delay above which an instant counts as late [s]: somewhat more than an idle machine takes to wake a process.
TOLERANCE = 0.002


@dataclass(slots=True)
class Pace:
    """How well a run kept its pace.

    Attributes:
        factor: The requested number of simulated seconds per second of wall time.
        instants: The number of paced instants.
        late: The number of instants that began later than `TOLERANCE`.
        worst: The greatest delay, in wall time [s].
    """

    factor: float
    instants: int = 0
    late: int = 0
    worst: float = 0.0

    def figures(self) -> tuple[float, int, int, float]:
        """All four, in this order."""
        return self.factor, self.instants, self.late, self.worst


class Pacer:
    """Sleeps until the wall time of each instant.

    Attributes:
        kept: How well the pace was kept so far.
        started: The start of simulated time on the monotonic clock [s]; None before the start.
        factor: Simulated seconds per second of wall time.
    """

    #: Its times are those of the wall clock.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(self, factor: float) -> None:
        self.factor = factor
        self.kept = Pace(factor)
        self.started: float | None = None

    def start_at(self, started: float) -> None:
        """Set the start of simulated time on the monotonic clock [s]."""
        self.started = started

    def lead(self, now: int) -> float:
        """Return the wall time until an instant [s]; negative if it is past. The first call sets the start.

        Args:
            now: The instant, in nanoseconds of simulated time.
        """
        monotonic = time.monotonic()
        if self.started is None:
            self.started = monotonic - now / 1e9 / self.factor
        return self.started + now / 1e9 / self.factor - monotonic

    def wait(self, now: int) -> None:
        """Sleep until an instant, and record its delay."""
        lead = self.lead(now)
        while lead > 0.0:
            time.sleep(lead)
            lead = self.lead(now)
        self.note(-lead)

    def note(self, late: float) -> None:
        """Record the delay of an instant [s]."""
        kept = self.kept
        kept.instants += 1
        if late > TOLERANCE:
            kept.late += 1
        kept.worst = max(kept.worst, late)

    def simulated(self) -> int:
        """The simulated time that corresponds to the present wall time, in nanoseconds."""
        if self.started is None:
            return 0
        return int((time.monotonic() - self.started) * self.factor * 1e9)
