"""The specifications of a run: monitored at each step, told by events, read by agents and conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from symaware_cli.core import AgentGroup, Event, Level
from symaware_cli.runtime.event_router import EventRouter
from symaware_cli.runtime.failure import RunError
from symaware_cli.runtime.offers import Offers
from symaware_cli.runtime.scope import WorldColumns, WorldScope
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.runtime.timing import Trigger, concerned
from symaware_cli.specification.monitor_statuses import MonitorStatuses
from symaware_cli.specification.outcome import Decision, Outcome
from symaware_cli.specification.specification import Specification, SpecificationError
from symaware_cli.specification.specification_monitor import SpecificationMonitor

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder
    from symaware_cli.runtime.run_summary import Observer

_LEVELS = {"continue": Level.INFO, "event": Level.WARNING, "end": Level.WARNING}


class Specifications:
    """Monitors the specifications of a run.

    Attributes:
        monitors: The monitor of each, by name.
        offers: Those that are offered, and what becomes of them.
    """

    def __init__(
        self,
        simulation: Simulation,
        specifications: Sequence[Specification],
        triggers: Mapping[str, Trigger],
        router: EventRouter,
        observer: Observer,
        recorder: Recorder | None = None,
        period: int | None = None,
        decides: bool = True,
        takes_part: Callable[[AgentGroup, int], bool] | None = None,
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation to monitor.
            specifications: What is to hold.
            triggers: The events with which instances of some begin, by name.
            router: Connects events with what they bring about.
            observer: Watches the run, for what is said of the world.
            recorder: Writes the run down; None where nobody does.
            decides: Whether this process decides the verdicts. Another process of the same run monitors only what its
                agents read, and only specifications that can be evaluated on a copy of the world.
            takes_part: Tells whether an agent takes part in the run; None where a log is evaluated.
            period: The time between two looks, in nanoseconds; by default the time step of the world.
        """
        self._simulation = simulation
        self._decides = decides
        if not decides:
            specifications = [each for each in specifications if not isinstance(each.scope, WorldColumns)]
            recorder = None
        time_step = period or simulation.environment.time_step
        self.monitors = {
            each.name: SpecificationMonitor(each, time_step, begins=each.name not in triggers)
            for each in specifications
        }
        #: Those whose first state is in the log.
        self._recorded: set[str] = set()
        self._recorder = recorder.specifications(self.monitors.values()) if recorder and self.monitors else None
        for each in specifications:
            if isinstance(each.scope, WorldColumns):
                each.scope.source = WorldScope(simulation, observer)
        for name, trigger in triggers.items():
            if name not in self.monitors or self.monitors[name].specification.offer is not None:
                continue
            router.connect(trigger.event, trigger.source, partial(self._begin, self.monitors[name], trigger))
        self.offers = Offers(simulation, self.monitors, triggers, router, takes_part)
        statuses = {name: MonitorStatuses(monitor, simulation.clock) for name, monitor in self.monitors.items()}
        for group in simulation.groups:
            group.specifications = statuses

    def look(self, now: int) -> str | None:
        """Take the values of a step, tell what they decided, and say why the run is over if it is.

        Raises:
            RunError: A specification has no value.
        """
        ending = None
        for name, monitor in self.monitors.items():
            if name in self._recorded and (monitor.is_over or now < monitor.specification.start):
                continue
            try:
                decisions = monitor.look(now)
            except SpecificationError as error:
                raise RunError(f"specifications.{name}", "symaware", now, str(error), error) from error
            for decision in decisions if self._decides else ():
                self._tell(decision, monitor.specification)
                if not decision.satisfied and monitor.specification.on_violation == "end":
                    ending = ending or f"`{name}` is violated"
            if self._recorder:
                self._recorder.record(monitor, now)
            self._recorded.add(name)
        return ending

    def finish(self, now: int) -> None:
        """Take note that the run has come to its declared end."""
        if self._decides:
            self.offers.finish()
        for monitor in self.monitors.values():
            decisions = monitor.finish()
            for decision in decisions if self._decides else ():
                self._tell(decision, monitor.specification)
            if self._recorder:
                self._recorder.record(monitor, now)

    def outcomes(self) -> tuple[Outcome, ...]:
        """What has become of each, in the scenario's order."""
        return tuple(monitor.outcome for monitor in self.monitors.values())

    def _begin(self, monitor: SpecificationMonitor, trigger: Trigger, event: Event) -> None:
        """An event has fired with which an instance begins."""
        specification = monitor.specification
        if specification.each is None:
            monitor.begin(range(specification.scope.rows))
            return
        group = next(each for each in self._simulation.groups if each.name == specification.each)
        rows = {id: row for row, id in enumerate(group.ids)}
        monitor.begin(sorted(concerned(event, trigger, group.name, rows)))

    def _tell(self, decision: Decision, specification: Specification) -> None:
        """Tell of a verdict."""
        name = "satisfied" if decision.satisfied else "violated"
        level = Level.INFO if decision.satisfied else _LEVELS[specification.on_violation]
        about = f" by {' and '.join(decision.agents)}" if decision.agents else ""
        text = f"`{decision.specification}` is {name}{about}: {decision.reason}"
        source = f"specifications.{decision.specification}"
        self._simulation.announce(name, source, text, level=level, **decision.to_json())
