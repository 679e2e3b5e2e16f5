"""When a component takes its turns, how long they take, and what becomes of one that fails: what a scenario says."""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Literal

import numpy as np

from symaware_cli.core import nanoseconds
from symaware_cli.specification.expression import Expression
from symaware_cli.world.chance import uniform

Overrun = Literal["skip", "queue", "fail"]
OnFailure = Literal["stop", "isolate", "restart"]
Coast = Literal["last", "safe"]


#: How many numbers are drawn ahead.
_BLOCK = 64

_NORMAL = NormalDist()


@dataclass(frozen=True, slots=True)
class Trigger:
    """An event on which a component takes a turn.

    Attributes:
        event: The event's name.
        component: Only where it comes from this component of the same agent; None for any of its components.
        source: Only where it comes from this path, in which ``*`` matches anything, and from whomever; None for the
            same agent.
    """

    event: str
    component: str | None = None
    source: str | None = None


@dataclass(frozen=True, slots=True)
class Duration:
    """How long something takes: a constant, or drawn anew each time.

    Attributes:
        kind: ``constant``, ``uniform`` or ``normal``.
        first: The constant, the least, or the mean [s].
        second: The greatest, or the standard deviation [s].
    """

    kind: Literal["constant", "uniform", "normal"] = "constant"
    first: float = 0.0
    second: float = 0.0

    @property
    def is_zero(self) -> bool:
        """Whether it never takes any time."""
        return self.kind == "constant" and nanoseconds(self.first) == 0

    @property
    def is_drawn(self) -> bool:
        """Whether it differs from time to time."""
        return self.kind != "constant"

    def at(self, fraction: float) -> int:
        """How long it takes, in nanoseconds, where it takes no longer in a fraction (0, 1) of all cases.

        It is never less than nothing.
        """
        if self.kind == "constant":
            return nanoseconds(self.first)
        if self.kind == "uniform":
            return nanoseconds(self.first + (self.second - self.first) * fraction)
        return max(0, nanoseconds(self.first + self.second * _NORMAL.inv_cdf(fraction)))


@dataclass(frozen=True, slots=True)
class Timing:
    """When the turns of a component are, and what becomes of them.

    Attributes:
        period: Time between two turns, in nanoseconds; 0 for as soon as the last one is over; None for each step of the
            world, or where there is a trigger for nothing but that.
        offset: When the first turn is, in nanoseconds.
        jitter: How much later than that each turn may be, in nanoseconds.
        trigger: An event on which it takes a turn, too.
        condition: What must hold for the agent, or else the turn is left out.
        latency: How long a computation takes: its update lands that much later.
        overrun: What becomes of a turn that is due while the one before still computes.
        on_failure: What becomes of the agent if the component fails.
        tries: How often it is restarted, at most.
        coast: The control input of an agent whose component failed: the last one, or a safe one.
        in_process: Whether it computes in a process of its own.
    """

    period: int | None = None
    offset: int = 0
    jitter: int = 0
    trigger: Trigger | None = None
    condition: Expression | None = None
    latency: Duration = field(default_factory=Duration)
    overrun: Overrun = "skip"
    on_failure: OnFailure = "stop"
    tries: int = 3
    coast: Coast = "safe"
    in_process: bool = False

    def is_steady(self, time_step: int) -> bool:
        """Whether there is exactly one turn at each step of the world."""
        if self.period is None:
            return self.trigger is None and not self.offset and not self.jitter
        return self.period == time_step and not self.offset and not self.jitter


#: One turn at each step, at once, and the end of the run if it fails.
STEADY = Timing()


class Timetable:
    """The instants of the turns of a component with a period; they depend on nothing but their numbers."""

    __slots__ = ("_delays", "_first", "_grid", "_jitter", "_key", "_offset", "_period")

    def __init__(self, timing: Timing, time_step: int, grid: int, key: int = 0) -> None:
        """Prepare.

        Args:
            timing: Period, offset and jitter.
            time_step: That of the world, in nanoseconds.
            grid: Instants are rounded up to a multiple of this, each at most once; 0 for none.
            key: What the jitter is keyed by, beside the nominal instant of each turn.
        """
        self._period = time_step if timing.period is None else timing.period
        self._offset, self._jitter = timing.offset, timing.jitter
        self._grid, self._key = grid, key
        #: How late some turns are, in nanoseconds, and from which turn on.
        self._delays: list[int] = []
        self._first = 0

    def turn(self, number: int, earliest: int) -> tuple[int, int] | None:
        """Find the first of some turns that is not before an instant.

        Args:
            number: Those with this number and greater ones.
            earliest: In nanoseconds.

        Returns:
            When it is, in nanoseconds, and its number; None if there is none.
        """
        period, grid = self._period, self._grid
        # Those that are nominally after this are rounded up to `earliest` or a later instant.
        before = (earliest - 1) // grid * grid if grid else earliest - 1
        if not period:
            return (self._offset, 0) if number == 0 and self._offset >= earliest else None
        while True:
            nominal = time = self._offset + number * period
            if self._jitter:
                time += self._late(number)
            if grid:
                time = -(-time // grid) * grid
            if time >= earliest:
                return time, number
            number += 1 if self._jitter else (before - nominal) // period + 1

    def _late(self, number: int) -> int:
        """How late a turn is, in nanoseconds."""
        place = number - self._first
        if not 0 <= place < len(self._delays):
            # Drawn in blocks, which is a fraction of the price and gives the same numbers.
            self._first, place = number, 0
            start = np.uint64(self._offset + number * self._period)
            instants = np.arange(_BLOCK, dtype=np.uint64) * np.uint64(self._period) + start
            drawn = uniform(instants, np.zeros_like(instants), self._key, 1)[:, 0]
            self._delays = np.rint(drawn * self._jitter).astype(np.int64).tolist()
        return self._delays[place]
