"""When something happens: the timing of a component's turns, the agents that an event triggers, and their presence."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

import numpy as np

from symaware_cli.core import Contact, Event
from symaware_cli.world import record, uniform

if TYPE_CHECKING:
    from symaware_cli.specification.expression import Expression
    from symaware_cli.world import ProbabilityDistribution

Overrun = Literal["skip", "queue", "fail"]
OnFailure = Literal["stop", "isolate", "restart"]
Coast = Literal["last", "safe"]
WhenOff = Literal["hold", "clear"]


#: The number of delays that are drawn at once.
_BLOCK = 64


@record
class NoTime:
    """The duration of what takes no time, for which no model of distributions is imported."""

    is_zero: ClassVar[bool] = True
    is_drawn: ClassVar[bool] = False

    def quantile(self, point: float) -> float:
        """Return 0 for any probability."""
        return 0.0


NO_TIME = NoTime()


@record
class Trigger:
    """An event that triggers a turn of a component.

    Attributes:
        event: The event's name.
        component: Only events of this component of the same agent trigger; None for any of its components.
        source: Only events from this path trigger, in which ``*`` matches anything, whichever agent it belongs to; None
            for events of the same agent.
    """

    event: str
    component: str | None = None
    source: str | None = None


@record
class Timing:
    """The timing of a component's turns, and the handling of overruns and failures.

    Attributes:
        period: Time between two turns, in nanoseconds; 0 to begin each turn when the previous one is finished; None for
            a turn at each step of the world, or with a trigger, for triggered turns only.
        offset: The time of the first turn, in nanoseconds.
        jitter: The greatest random delay of each turn, in nanoseconds.
        trigger: An event that triggers turns.
        condition: A condition on the agent; turns are skipped while it does not hold.
        when_off: The values of the parts of awareness and the signals that the component writes, while its condition
            does not hold: the last ones, or none.
        latency: The duration of a computation, after which its update is applied.
        overrun: What happens to a turn that is due while the previous one still computes.
        on_failure: What happens to the agent if the component fails.
        tries: The greatest number of restarts.
        coast: The control input of an agent whose component failed: the last one, or a safe one.
        in_process: Whether the component computes in a worker process.
    """

    period: int | None = None
    offset: int = 0
    jitter: int = 0
    trigger: Trigger | None = None
    condition: Expression | None = None
    when_off: WhenOff = "hold"
    latency: ProbabilityDistribution | NoTime = NO_TIME
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


#: A turn at each step without latency; a failure ends the run.
STEADY = Timing()


class Timetable:
    """The instants of the turns of a component with a period, as a function of their numbers alone."""

    __slots__ = ("_delays", "_first", "_grid", "_jitter", "_key", "_offset", "_period")

    def __init__(self, timing: Timing, time_step: int, grid: int, key: int = 0) -> None:
        """Prepare.

        Args:
            timing: Period, offset and jitter.
            time_step: The world's time step, in nanoseconds.
            grid: Instants are rounded up to a multiple of this, each at most once; 0 for none.
            key: Keys the random jitter, together with the nominal instant of each turn.
        """
        self._period = time_step if timing.period is None else timing.period
        self._offset, self._jitter = timing.offset, timing.jitter
        self._grid, self._key = grid, key
        #: The delays of some consecutive turns, in nanoseconds, and the number of the first of these turns.
        self._delays: list[int] = []
        self._first = 0

    def rekey(self, key: int) -> None:
        """Draw the jitter with another key from now on."""
        self._key, self._delays = key, []

    def turn(self, number: int, earliest: int) -> tuple[int, int] | None:
        """Find the first turn at or after an instant.

        Args:
            number: The least number of the turn.
            earliest: The instant in nanoseconds.

        Returns:
            The turn's time in nanoseconds, and its number; None if there is no such turn.
        """
        period, grid = self._period, self._grid
        # Turns nominally after this instant are rounded up to `earliest` or a later instant.
        before = (earliest - 1) // grid * grid if grid else earliest - 1
        if not period:
            return (self._offset, 0) if number == 0 and self._offset >= earliest else None
        while True:
            nominal = time = self._offset + number * period
            if self._jitter:
                place = number - self._first
                time += self._delays[place] if 0 <= place < len(self._delays) else self._late(number)
            if grid:
                time = -(-time // grid) * grid
            if time >= earliest:
                return time, number
            number += 1 if self._jitter else (before - nominal) // period + 1

    def _late(self, number: int) -> int:
        """Draw the delays of a turn and of those that follow it; return that of the turn, in nanoseconds."""
        # Drawn in blocks, which is much faster and gives the same numbers.
        self._first = number
        start = np.uint64(self._offset + number * self._period)
        instants = np.arange(_BLOCK, dtype=np.uint64) * np.uint64(self._period) + start
        drawn = uniform(instants, np.zeros_like(instants), self._key, 1)[:, 0]
        self._delays = np.rint(drawn * self._jitter).astype(np.int64).tolist()
        return self._delays[0]


def concerned(event: Event, trigger: Trigger, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The rows of the agents of a group that an event concerns.

    Args:
        event: The event.
        trigger: The trigger of the agents' components.
        group: The group's name.
        rows: The row of each of its agents, by id.
    """
    if trigger.source is not None:
        contact = event.subject
        if isinstance(contact, Contact):
            return [rows[id] for id in (contact.first, contact.second) if id in rows]
        return rows.values()
    path = event.source.removeprefix("agents.")
    owner, _, component = path.rpartition(".")
    if path in rows and trigger.component is None:
        return [rows[path]]
    if event.name in ("fault", "fault-over"):
        return _fault_targets(path, trigger, group, rows)
    if trigger.component not in (None, component):
        return []
    if owner in rows:
        return [rows[owner]]
    return rows.values() if owner == group else []


def _fault_targets(path: str, trigger: Trigger, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that a fault affects: it names agents or their components by patterns."""
    owner, _, component = path.rpartition(".")
    if trigger.component is None:
        return _matching(path, group, rows) or _matching(owner, group, rows)
    return _matching(owner, group, rows) if fnmatch.fnmatchcase(trigger.component, component) else []


def _matching(pattern: str, group: str, rows: Mapping[str, int]) -> Collection[int]:
    """The agents of a group that match a pattern: all if the group's name matches, otherwise by their ids."""
    if fnmatch.fnmatchcase(group, pattern):
        return rows.values()
    return [row for id, row in rows.items() if fnmatch.fnmatchcase(id, pattern)]


#: An instant in nanoseconds, a condition, or an event.
Moment: TypeAlias = "int | Expression | Trigger"


@record
class PresenceInterval:
    """The interval in which an agent is in the world.

    Attributes:
        begin: When it enters; a condition is evaluated in the scope of the world. None for the start of the run.
        end: When it leaves; a condition is evaluated in the scope of the agent. None for never.
        apart: How far from it the positions of others have to be when it enters [m]; it waits until they are. None for
            an agent that does not wait.
        then: The next interval, if it returns after it has left.
    """

    begin: Moment | None = None
    end: Moment | None = None
    apart: float | None = None
    then: PresenceInterval | None = None

    @property
    def is_late(self) -> bool:
        """Whether the agent is absent when the run begins."""
        return self.begin is not None and self.begin != 0
