"""Simulated time: an integer count of nanoseconds since the start of the run."""

from __future__ import annotations

SECOND = 1_000_000_000


def nanoseconds(seconds: float) -> int:
    """Round a time in seconds to the nearest nanosecond."""
    return round(seconds * SECOND)


def seconds(nanoseconds: int) -> float:
    """Express a time in nanoseconds as seconds, for formulas and for people."""
    return nanoseconds / SECOND


class Clock:
    """The simulated time that everything in a run shares; only the runtime moves it.

    Attributes:
        now: The present, in nanoseconds since the start of the run.
    """

    __slots__ = ("now",)

    def __init__(self) -> None:
        self.now = 0
