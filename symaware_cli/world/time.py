"""Simulated time: an integer count of nanoseconds since the start of the run."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar

SECOND = 1_000_000_000

#: The longest duration [s].
LONGEST = 1e9


def nanoseconds(seconds: float) -> int:
    """Round a time in seconds to the nearest nanosecond."""
    return round(seconds * SECOND)


def seconds(nanoseconds: int) -> float:
    """Convert a time in nanoseconds to seconds, for formulas and display."""
    return nanoseconds / SECOND


class Clock:
    """The simulated time that all objects of a run share; only the runtime changes it.

    Attributes:
        now: The present time, in nanoseconds since the start of the run.
        end: The declared end of the run; None before it is known.
    """

    __slots__ = ("end", "now")

    uncaptured: ClassVar[Collection[str]] = ("end",)  # another run that continues may end later

    def __init__(self) -> None:
        self.now = 0
        self.end: int | None = None
