"""Checks and converts the timing of components: periods, conditions, triggers, latencies, and their combinations."""

from __future__ import annotations

import fnmatch
import pickle
import re
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from symaware_cli.core import (
    AgentGroup,
    CommunicationReceiver,
    Component,
    Environment,
    GroupCommunicationReceiver,
    nanoseconds,
)
from symaware_cli.core.component import BaseComponent, may_wait
from symaware_cli.core.event import RECURRING, TURNS
from symaware_cli.engine import NO_TIME, ComponentEntry, NoTime, Timing, Trigger
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ComponentUse, RunSection
from symaware_cli.language.problem import nearest, quoted
from symaware_cli.language.source import Path

if TYPE_CHECKING:
    from symaware_cli.specification import Names
    from symaware_cli.specification.expression import Expression
    from symaware_cli.world import ProbabilityDistribution

#: Events of the targets of faults.
FAULT_EVENTS = frozenset({"fault", "fault-over"})

#: Events that are fired for every component.
COMPONENT_EVENTS = TURNS | FAULT_EVENTS | {"failed", "initialised", "initialising", "overrun", "restarted"}

#: Events with the id of an agent as their source.
AGENT_EVENTS = FAULT_EVENTS | {
    *("added", "adding", "removed", "removing"),
    *("dropped", "received", "restarted", "sending", "sent", "terminated"),
}

#: Events of the environment and of the run.
ENVIRONMENT_EVENTS = frozenset({"contact", "stepped", "stepping", "touching"})
RUN_EVENTS = frozenset({"iterated", "iterating", "started"})

#: Events of specifications, and of those that are offered.
SPECIFICATION_EVENTS = frozenset({"satisfied", "violated", "offered", "accepted", "released", "rejected"})

#: Events of the topology.
TOPOLOGY_EVENTS = frozenset({"links-changed"})


class TimingCheck:
    """Converts the timing sections of a scenario, and reports problems with them.

    Attributes:
        diagnosis: Takes the problems.
        specifications: The names of the specifications.
    """

    def __init__(
        self,
        diagnosis: Diagnosis,
        environment: Environment,
        regions: Collection[str] = (),
        specifications: Collection[str] = (),
        entities: Collection[str] = (),
    ) -> None:
        self.diagnosis = diagnosis
        self._environment = environment
        self._time_step = environment.time_step
        self._report = diagnosis.report
        self._regions = regions
        self.specifications = specifications
        self._entities = entities

    def expression(self, text: str, path: Path, names: Names) -> Expression | None:
        """Parse an expression; None after a problem."""
        from symaware_cli.specification.expression import Expression, ExpressionError

        try:
            return Expression(text, names)
        except ExpressionError as error:
            example = "highest_risk < 0.2" if path[0] == "run" else "risk > 0.2"
            self.diagnosis.report_expression(text, path, error, f"a comparison such as `{example}`")
            return None

    def until(self, run: RunSection, groups: Sequence[AgentGroup]) -> Expression | None:
        """The condition that ends a run; None without one, or after a problem."""
        return None if run.until is None else self.expression(run.until, ("run", "until"), self.world_names(groups))

    def world_names(self, groups: Sequence[AgentGroup]) -> Names:
        """The names in expressions about the world."""
        from symaware_cli.engine import world_names

        return world_names(groups, self._regions, self._entities, self.specifications)

    def timing(self, use: ComponentUse, group: AgentGroup, component: type[BaseComponent[Any]], path: Path) -> Timing:
        """The timing of a component, converted from its entry."""
        period = None if use.period is None else nanoseconds(use.period)
        offset, jitter = nanoseconds(use.offset), nanoseconds(use.jitter)
        step = self._time_step if period is None else period
        if use.period and not period:
            self._wrong(path, "period", f"a period of {use.period:g} s is less than a nanosecond", "at least 1e-9 [s]")
        if jitter and jitter >= step:
            which = "the period" if period is not None else "the time step of the world, which is its period,"
            self._wrong(
                path, "jitter", f"a jitter of {use.jitter:g} s lets turns overtake each other", f"less than {which} [s]"
            )
        if use.trigger is not None and period is None and (offset or jitter):
            key = "offset" if offset else "jitter"
            self._wrong(path, key, f"{quoted(key)} needs a period, but there is only a trigger", "a period")
        latency = _duration(use.latency)
        if not latency.is_zero and component.async_compute_and_update is not Component.async_compute_and_update:
            self._wrong(
                path,
                "latency",
                f"{quoted(use.use)} overrides `async_compute_and_update`, which does not support a latency",
                "no latency here",
            )
        if use.run_in == "process":
            self._check_run_in(use, component, path)
        if period == 0 and latency.is_zero and use.condition is None and not may_wait(component):
            said = f"{quoted(use.use)} takes no simulated time, so its turns would repeat endlessly at one instant"
            self._wrong(path, "period", said, "a period above 0, or a `latency`")
        condition = None
        if use.condition is not None:
            from symaware_cli.engine import ConditionScope

            names = ConditionScope(group).names(self.specifications)
            condition = self.expression(use.condition, (*path, "condition"), names)
        elif "when_off" in use.model_fields_set:
            self._wrong(path, "when_off", "`when_off` has an effect only with a condition", "a `condition` besides")
        return Timing(
            period=period,
            offset=offset,
            jitter=jitter,
            trigger=None if use.trigger is None else trigger_of(use.trigger.event, use.trigger.of),
            condition=condition,
            when_off=use.when_off,
            latency=latency,
            overrun=use.overrun,
            on_failure=use.on_failure,
            tries=use.tries,
            coast=use.coast,
            in_process=use.run_in == "process",
        )

    def _check_run_in(self, use: ComponentUse, component: type[BaseComponent[Any]], path: Path) -> None:
        """Check that a component can compute in a worker process."""
        problem = None
        if component.sees_world and not self._environment.is_shared:
            world = quoted(self.diagnosis.composition.data["environment"]["use"])
            problem = f"reads the world, and {world} cannot be copied to worker processes"
        elif component.specifications is not None and use.with_.get(component.specifications):
            problem = "continues the monitors of specifications, which worker processes do not have"
        elif issubclass(component, CommunicationReceiver | GroupCommunicationReceiver):
            problem = "reads messages, which worker processes do not receive"
        elif component._async_compute is not Component._async_compute:
            problem = "may wait within its turns, which worker processes do not support"
        elif component.__module__ == "__main__":
            problem = "is a class of the main program, which other processes cannot import"
        else:
            try:
                pickle.dumps(component)
            except KeyboardInterrupt:
                raise
            except BaseException:  # a class may raise anything when it is pickled
                problem = "cannot be imported by its name in another process"
        if problem is not None:
            self._wrong(path, "run_in", f"{quoted(use.use)} {problem}", "`here`")

    def triggers(self, entries: Sequence[ComponentEntry]) -> None:
        """Check that the events that trigger components are fired by their sources."""
        for entry in entries:
            trigger = entry.timing.trigger
            if trigger is not None:
                self.source(trigger, entry.group.name, entries, (*entry.section, "trigger"))

    def source(self, trigger: Trigger, group: str | None, entries: Sequence[ComponentEntry], path: Path) -> None:
        """Check that an event is fired by its source, and report it if not.

        Args:
            trigger: The trigger.
            group: The group of the component with the trigger; None for a trigger without a component.
            entries: All component entries.
            path: The path of the trigger.
        """
        own = {entry.name: entry for entry in entries if entry.group.name == group}
        if trigger.component is not None and trigger.component not in own:
            message = f"there is no component {quoted(trigger.component)} in {quoted(str(group))}"
            others = {*own, "environment"}
            self._unknown(message, (*path, "of"), others, nearest(trigger.component, others))
            return
        fired = self._fired(trigger, own, entries)
        if fired is None:
            message = f"there is no source {quoted(str(trigger.source))}"
            expected = "`environment`, or the path of a component such as `agents.robot.*.steer`"
            self._report("unknown-source", message, (*path, "of"), expected=expected)
        elif trigger.event not in fired and trigger.event != "*":
            who = quoted(trigger.component or trigger.source or str(group))
            message = f"{who} fires no event {quoted(trigger.event)}"
            self._unknown(message, (*path, "event"), fired, nearest(trigger.event, fired))

    def _fired(
        self, trigger: Trigger, own: Mapping[str, ComponentEntry], entries: Sequence[ComponentEntry]
    ) -> set[str] | None:
        """The events fired by the sources of a trigger; None if there are no such sources."""
        if trigger.component is not None:
            return {*COMPONENT_EVENTS, *own[trigger.component].components[0].events}
        if trigger.source is None:
            return {*COMPONENT_EVENTS, *AGENT_EVENTS, *(name for entry in own.values() for name in _events(entry))}
        pattern = re.compile(fnmatch.translate(trigger.source))
        fired: set[str] = set()
        if pattern.match("environment"):
            fired |= ENVIRONMENT_EVENTS
        if pattern.match("run"):
            fired |= RUN_EVENTS
        if pattern.match("topology"):
            fired |= TOPOLOGY_EVENTS
        if any(pattern.match(each) for each in ("exchange", "faults")):
            fired |= FAULT_EVENTS
        if any(pattern.match(f"specifications.{each}") for each in self.specifications):
            fired |= SPECIFICATION_EVENTS
        for entry in entries:
            paths = [entry.path, *(f"agents.{id}.{entry.name}" for id in entry.group.ids)]
            if any(pattern.match(each) for each in paths):
                fired |= {*COMPONENT_EVENTS, *_events(entry)}
            if any(pattern.match(f"agents.{each}") for each in (entry.group.name, *entry.group.ids)):
                fired |= AGENT_EVENTS
        return fired or None

    def _unknown(self, message: str, path: Path, known: Collection[str], suggestion: str | None) -> None:
        listed = sorted(name for name in known if name not in RECURRING) or sorted(known)
        self._report(
            "unknown-event" if path[-1] == "event" else "unknown-source",
            message,
            path,
            expected=f"one of {', '.join(listed)}",
            suggestion=suggestion,
        )

    def _wrong(self, path: Path, key: str, message: str, expected: str) -> None:
        self._report("invalid-value", message, (*path, key), expected=expected)


def _events(entry: ComponentEntry) -> Collection[str]:
    return entry.components[0].events


def trigger_of(event: str, of: str | None) -> Trigger:
    """Create a trigger from an event and its source: a component of the same agent, or a path."""
    if of is None:
        return Trigger(event)
    if of in ("environment", "run", "topology", "exchange", "faults") or any(sign in of for sign in ".*?["):
        return Trigger(event, source=of)
    return Trigger(event, component=of)


def _duration(latency: float | ProbabilityDistribution) -> ProbabilityDistribution | NoTime:
    """Return the duration of a latency [s]."""
    if not latency:
        return NO_TIME
    from symaware_cli.world import duration_of

    duration = duration_of(latency)
    return NO_TIME if duration.is_zero else duration
