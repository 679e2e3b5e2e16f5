"""The specifications of a run: monitored at each step, told by events, read by agents and conditions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from symaware_cli.core import AgentGroup, Event, Level, SubscriberError
from symaware_cli.engine.runtime.event_router import EventRouter
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.offers import Offers
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import Trigger, concerned

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.recording import RunRecording
    from symaware_cli.engine.runtime.run_summary import Observer
    from symaware_cli.specification import (
        Decision,
        MonitorStatuses,
        Outcome,
        Specification,
        SpecificationError,
        SpecificationMonitor,
    )

_LEVELS = {"continue": Level.INFO, "event": Level.WARNING, "end": Level.WARNING}


def _specification_error() -> type[SpecificationError]:
    """Return the class; imported here, because runs without specifications do not need the package."""
    from symaware_cli.specification import SpecificationError

    return SpecificationError


def rows_begun(
    event: Event, trigger: Trigger, specification: Specification, groups: Sequence[AgentGroup]
) -> Sequence[int]:
    """Return the rows whose instances begin with an event, ascending.

    Of a group they are the agents that the event concerns; pairs and the world begin with every event.

    Args:
        event: The event.
        trigger: The event with which instances of the specification begin.
        specification: The specification.
        groups: All groups.
    """
    if specification.each is None:
        return range(specification.scope.rows)
    group = next(each for each in groups if each.name == specification.each)
    return sorted(concerned(event, trigger, group.name, {id: row for row, id in enumerate(group.ids)}))


class Specifications:
    """Monitors the specifications of a run.

    Attributes:
        monitors: The monitor of each, by name.
        offers: The offers of specifications, and their states.
        decides: Whether this process decides the verdicts.
        is_finished: Whether the run has come to its declared end.
        looked: The last instant at which they were evaluated, in nanoseconds; None before the first.
        recorder: Writes them to the log; None without a log or without specifications.
    """

    #: Captured with the log: a run without one can be restored as well.
    uncaptured: ClassVar[Collection[str]] = ("recorder",)

    def __init__(
        self,
        simulation: Simulation,
        specifications: Sequence[Specification],
        triggers: Mapping[str, Trigger],
        router: EventRouter,
        observer: Observer,
        recorder: RunRecording | None = None,
        period: int | None = None,
        decides: bool = True,
        takes_part: Callable[[AgentGroup, int], bool] | None = None,
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation to monitor.
            specifications: The specifications.
            triggers: The events with which instances of some begin, by name.
            router: Connects events with their effects.
            observer: Watches the run, for formulas about the world.
            recorder: Records the run; None without a recording.
            decides: Whether this process decides the verdicts. Another process of the same run monitors only the
                specifications that its agents read and that can be evaluated on a copy of the world.
            takes_part: Tells whether an agent takes part in the run; None where a log is evaluated.
            period: The time between two looks, in nanoseconds; by default the time step of the world.
        """
        self._simulation = simulation
        self.decides = decides
        self.looked: int | None = None
        self.is_finished = False
        if not decides:
            recorder = None
        self.monitors: dict[str, SpecificationMonitor] = {}
        statuses: dict[str, MonitorStatuses] = {}
        if specifications:
            from symaware_cli.engine.runtime.scope import WorldColumns, WorldScope
            from symaware_cli.specification import MonitorStatuses, SpecificationMonitor

            time_step = period or simulation.environment.time_step
            for each in specifications:
                if isinstance(each.scope, WorldColumns):
                    if not decides:
                        continue
                    each.scope.source = WorldScope(simulation, observer)
                monitor = SpecificationMonitor(each, time_step, begins=each.name not in triggers)
                self.monitors[each.name] = monitor
                statuses[each.name] = MonitorStatuses(monitor, simulation.clock)
        #: Those whose first state is in the log.
        self._recorded: set[str] = set()
        self.recorder = recorder.specifications(self.monitors.values()) if recorder and self.monitors else None
        for name, trigger in triggers.items():
            if name not in self.monitors or self.monitors[name].specification.offer is not None:
                continue
            router.connect(trigger.event, trigger.source, partial(self._begin, self.monitors[name], trigger))
        self.offers = Offers(simulation, self.monitors, triggers, router, takes_part)
        for group in simulation.groups:
            group.specifications = statuses

    def look(self, now: int) -> str | None:
        """Evaluate a step, publish the decisions, and return why the run is over; None if it goes on.

        Raises:
            RunError: A specification has no value; all others were evaluated.
            SubscriberError: A subscriber to a decision failed; all specifications were evaluated.
        """
        ending: str | None = None
        failure: Exception | None = None
        self.looked = now
        if not self.monitors:
            return None
        for name, monitor in self.monitors.items():
            if name in self._recorded and (monitor.is_over or now < monitor.specification.start):
                continue
            try:
                decisions = monitor.look(now)
            except _specification_error() as error:
                failure = failure or RunError(f"specifications.{name}", "symaware", now, str(error), error)
                continue
            for decision in decisions if self.decides else ():
                refused = self._tell(decision, monitor.specification)
                failure = failure or refused
                if not decision.satisfied and monitor.specification.on_violation == "end":
                    ending = ending or f"`{name}` is violated"
            if self.recorder:
                self.recorder.record(monitor, now)
            self._recorded.add(name)
        if failure is not None:
            raise failure
        return ending

    def finish(self, now: int) -> None:
        """Take note that the run has come to its declared end.

        Raises:
            SubscriberError: A subscriber to a decision failed; all specifications were finished.
        """
        failure: SubscriberError | None = None
        if self.decides:
            self.offers.finish()
        self.is_finished = True
        for monitor in self.monitors.values():
            decisions = monitor.finish()
            for decision in decisions if self.decides else ():
                refused = self._tell(decision, monitor.specification)
                failure = failure or refused
            if self.recorder:
                self.recorder.record(monitor, now)
        if failure is not None:
            raise failure

    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcome of each, in the scenario's order."""
        return tuple(monitor.outcome for monitor in self.monitors.values())

    def _begin(self, monitor: SpecificationMonitor, trigger: Trigger, event: Event) -> None:
        """An event has fired with which an instance begins."""
        monitor.begin(rows_begun(event, trigger, monitor.specification, self._simulation.groups))

    def _tell(self, decision: Decision, specification: Specification) -> SubscriberError | None:
        """Tell of a verdict; return the failure of a subscriber, if there is one."""
        name = "satisfied" if decision.satisfied else "violated"
        level = Level.INFO if decision.satisfied else _LEVELS[specification.on_violation]
        about = f" by {' and '.join(decision.agents)}" if decision.agents else ""
        text = f"`{decision.specification}` is {name}{about}: {decision.reason}"
        source = f"specifications.{decision.specification}"
        try:
            self._simulation.announce(name, source, text, level=level, **decision.to_json())
        except SubscriberError as error:
            return error
        return None
