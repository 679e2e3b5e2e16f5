"""Replay of a log into a simulation of its scenario, instant by instant, for the evaluation of specifications."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import Column, SeriesColumn, TableColumn, Tracks
from symaware_cli.core import AgentGroup, Contact, Event, Level, TimeSeries, nanoseconds
from symaware_cli.core.event import CHANNELS, RECURRING
from symaware_cli.engine import (
    ContactEpisodes,
    EventRouter,
    Observer,
    RecordedEnvironment,
    Simulation,
    WorldColumns,
    WorldScope,
)
from symaware_cli.geometry import Pose
from symaware_cli.language import Catalogue, Changes, open_scenario
from symaware_cli.log import MEMBERSHIP, SHARED, Log, LogError, LogMessage, open_log, read_json
from symaware_cli.log.logged_events import LoggedEvent, recurring_entries
from symaware_cli.log.logged_events import contact as contact_entry
from symaware_cli.log.logged_events import event as event_entry
from symaware_cli.specification import ExpressionError, Specification, formulate
from symaware_cli.specification.node import Name, walk

Array = NDArray[np.float64]

#: Events of a step that are fired after the evaluation of specifications at that step.
_AFTERWARDS = frozenset({"stepping", "finished", "interrupted"})


class RecordedRun:
    """Reads a log and applies its records to a simulation of the same scenario.

    Attributes:
        log: The log.
        simulation: The simulation, whose environment is a `RecordedEnvironment`.
    """

    def __init__(self, log: Log, simulation: Simulation) -> None:
        self.log = log
        self.simulation = simulation
        assert isinstance(simulation.environment, RecordedEnvironment)
        self._environment = simulation.environment
        self._groups = {group.name: group for group in simulation.groups}
        self._episodes = ContactEpisodes(self._environment.debounce)
        self._states: dict[str, Array] = {}
        self._inputs: dict[str, Array] = {}
        self._poses: dict[str, Pose] = {}
        self._others: dict[str, list[tuple[NDArray[np.intp], Array]]] = {}
        #: The events of the present step that are fired after the evaluation of specifications.
        self._later: list[LoggedEvent] = []
        for group in simulation.groups:
            absent = set(log.manifest["groups"][group.name].get("absent", ()))
            if absent:
                self._set_present(group, np.array([id not in absent for id in group.ids]))

    def instants(self, period: int) -> Iterator[int]:
        """Yield the recorded instants in nanoseconds, at each of which the simulation has its recorded state.

        For a failed or interrupted run, they end with the last evaluation of its specifications.

        Args:
            period: The time between two instants, in nanoseconds.

        Raises:
            LogError: The log is damaged, or contains messages that its scenario cannot produce.
        """
        rooms = ("agents", "world", "events", "contacts")
        # Including the poses of single entities, which are recorded in shared channels.
        topics = [topic for topic in self.log.topics if topic.split("/")[1] in rooms and topic not in SHARED]
        upcoming, last = 0, 0
        for message in self.log.messages(topics):
            while message.time > upcoming:
                yield self._show(upcoming)
                self._fire_later()
                upcoming += period
            self.simulation.clock.now = message.time
            try:
                is_true_state = self._apply(message)
            except (ArithmeticError, LookupError, TypeError, ValueError) as error:
                place = f"{self.log.path}, {message.channel.topic} at {message.time / 1e9:.9g} s"
                raise LogError(f"{place}: a message that its scenario cannot have: {error}") from error
            if is_true_state:
                last = message.time
        outcome = self.log.outcome or {}
        end = outcome.get("evaluated", outcome.get("time", last))
        while end is not None and upcoming <= end:
            yield self._show(upcoming)
            self._fire_later()
            upcoming += period

    def _show(self, now: int) -> int:
        """Set the true states of an instant in the environment, and return the instant."""
        self.simulation.clock.now = now
        for contact in self._episodes.ended(now):
            self._fire_contact(contact)
        self._environment.show(now, self._states, self._inputs, self._poses)
        self._states, self._inputs, self._poses = {}, {}, {}
        return now

    def _apply(self, message: LogMessage) -> bool:
        """Apply a message to the simulation; return whether it contains true states."""
        _, room, *rest = message.channel.topic.split("/")
        if room == "events":
            if message.channel.carries("Event"):
                self._event(event_entry(message.time, message.decode()))
            elif message.channel.carries("Recurring"):
                for each in recurring_entries(message.time, message.decode()):
                    self._event(each)
        elif room == "contacts":
            entry = contact_entry(message.time, message.decode())
            made = Contact(entry.a, entry.b, entry.point, entry.depth, entry.stage != "END", entry.impulse)
            contact, is_announced = self._episodes.follow(made, message.time)
            if is_announced:
                self._fire_contact(contact)
            self._fire_contact(contact, "touching")
        elif room == "world" and rest[0] in self._environment.obstacles:
            if rest[-1] == "state":
                *position, heading = message.decode().values[0].tolist()
                self._poses[rest[0]] = Pose(tuple(position), heading)
        elif rest and rest[0] in self._groups:
            group, kind = self._groups[rest[0]], rest[-1]
            if room == "world":
                return self._truth(group, kind, message)
            if len(rest) == 2:
                self._belief(group, kind, message)
        return False

    def _fire_contact(self, contact: Contact, name: str = "contact") -> None:
        self.simulation.events.fire(Event(name, "environment", self.simulation.clock.now, subject=contact))

    def _event(self, entry: LoggedEvent) -> None:
        simulation = self.simulation
        if entry.name == "contact":
            return  # their own channel records the bodies involved
        if entry.name in ("added", "removed"):
            id = entry.source.removeprefix("agents.")
            group = next((each for each in simulation.groups if id in each.ids), None)
            if group is not None:
                present = group.in_world.copy()
                present[group.ids.index(id)] = entry.name == "added"
                self._set_present(group, present)
        if entry.name in ("violated", "satisfied"):
            return  # the monitors fire them again
        if entry.name in _AFTERWARDS:
            self._later.append(entry)
        else:
            self._announce(entry)

    def _announce(self, entry: LoggedEvent) -> None:
        self.simulation.announce(entry.name, entry.source, entry.text, level=Level[entry.level], **entry.data)

    def _fire_later(self) -> None:
        """Fire the events that followed the evaluation of specifications at a step."""
        later, self._later = self._later, []
        for entry in later:
            self._announce(entry)

    @staticmethod
    def _set_present(group: AgentGroup, present: NDArray[np.bool_]) -> None:
        present.flags.writeable = False
        group.present = present

    def _truth(self, group: AgentGroup, kind: str, message: LogMessage) -> bool:
        if kind == "state":
            before = self._states.get(group.name, self._environment.state(group))
            self._states[group.name] = _changed(before, message.decode())
            return True
        if kind == "control":
            before = self._inputs.get(group.name, self._environment.applied_input(group))
            self._inputs[group.name] = _changed(before, message.decode())
        return False

    def _belief(self, group: AgentGroup, kind: str, message: LogMessage) -> None:
        awareness = group.awareness
        if kind == "control":
            group.control_input = _changed(group.control_input, message.decode())
        elif kind == "knowledge":
            content = message.decode()
            for place, text in enumerate(content.values):
                group.knowledge[content.rows[place] if content.rows else place].replace(read_json(text))
        elif kind == "awareness":
            self._apply_beliefs(group, message)
        elif kind in awareness.parts:
            column, content = awareness.columns[kind], message.decode()
            if isinstance(column, Column):
                column.values = _changed(column.values, content)
            elif isinstance(column, SeriesColumn):
                rows = range(len(group)) if content.rows is None else content.rows.tolist()
                for row, (times, values) in zip(rows, content, strict=False):
                    column.set_row(row, TimeSeries.sampled(times, values) if len(times) else TimeSeries())
            elif isinstance(column, TableColumn):
                rows = range(len(group)) if content.rows is None else content.rows.tolist()
                for place, row in enumerate(rows):
                    column.set_row(row, content.at(place))

    def _apply_beliefs(self, group: AgentGroup, message: LogMessage) -> None:
        """Apply the recorded beliefs about the positions and velocities of others."""
        content: Any = message.decode()
        if not content.has_states:
            return
        roster = self._environment.roster
        if content.world:
            self._show(message.time)
            group.awareness.world = self._environment.snapshot()
            return
        count = len(group)
        width = 2 * roster.dimensions
        others = content.others(count, width)
        known = self._others.setdefault(
            group.name, [(np.empty(0, np.intp), np.empty((0, width))) for _ in range(count)]
        )
        ends = np.cumsum(others.counts).tolist()
        for row, first, last in zip(others.present.tolist(), [0, *ends], ends, strict=False):
            known[row] = others.entities[first:last].astype(np.intp), others.values[first:last]
        pointers = np.cumsum([0, *(len(each) for each, _ in known)])
        positions, velocities = np.split(np.concatenate([each for _, each in known]), 2, axis=1)
        indices = np.concatenate([each for each, _ in known])
        group.awareness.seen = Tracks(message.time, pointers, indices, positions, velocities)


def _changed(before: Array, content: Any) -> Array:
    """Return values with some rows replaced by those of a message."""
    if content.rows is None:
        return np.array(content.values)
    after = np.array(before)
    after[content.rows] = content.values
    return after


class RecordedSpecifications:
    """A log replayed into a simulation of its scenario, with specifications to evaluate.

    Attributes:
        log: The log.
        simulation: The simulation.
        options: The options of the run.
        specifications: The specifications, with windows in steps of `period`.
        router: Connects the events of the log with their effects.
        observer: Observes the simulation, for specifications about the world.
        step: The time step of the world, in nanoseconds.
        period: The time between two instants, in nanoseconds: that of the recorded steps.
    """

    def __init__(
        self,
        path: Path,
        changes: Changes = (),
        statements: Path | None = None,
        catalogue: Catalogue | None = None,
    ) -> None:
        """Open a log.

        Args:
            path: The log.
            changes: Changes to its scenario.
            statements: A file with other specifications.
            catalogue: The installed plugins, if already listed.

        Raises:
            LogError: The log cannot be read.
            ScenarioError: A specification is invalid.
        """
        self.log = open_log(path)
        built = open_scenario(path, changes, None, RecordedEnvironment, statements, catalogue)
        self.simulation, self.options = built.simulation, built.options
        recording = built.document.recording
        omitted = recording.omit
        self._events = recording.events
        self._left_out = {*omitted, *(("requested_control", "applied_control") if "control" in omitted else ())}
        stated: Sequence[Specification] = self.options.specifications
        self.step = self.simulation.environment.time_step
        self.period = max(1, -(-nanoseconds(recording.interval) // self.step)) * self.step
        #: Why specifications cannot be evaluated at the recorded instants, by name.
        self._too_coarse: dict[str, str] = {}
        if self.period != self.step:
            steps = nanoseconds(built.document.run.duration) // self.period + 1
            stated = [self._at_recorded_instants(each, steps) for each in stated]
        self.specifications = stated
        self.router = EventRouter(self.simulation.events)
        self.observer = Observer(self.simulation)
        for each in stated:
            if isinstance(each.scope, WorldColumns):
                each.scope.source = WorldScope(self.simulation, self.observer)

    def instants(self) -> Iterator[int]:
        """Yield the recorded instants in nanoseconds, at each of which names have their recorded values.

        Raises:
            LogError: The log is damaged.
        """
        yield from RecordedRun(self.log, self.simulation).instants(self.period)

    def _at_recorded_instants(self, specification: Specification, steps: int) -> Specification:
        """Return a specification with windows in steps of `period`; unchanged if one contains no recorded instant."""
        try:
            formulation = formulate(specification.formulation.tree, self.period, steps)
        except ExpressionError as error:
            self._too_coarse[specification.name] = f"steps that its windows need ({error})"
            return specification
        return replace(specification, formulation=formulation)

    def missing(self, specification: Specification) -> Sequence[str]:
        """Return the data and events that a specification needs but the scenario leaves out of the log."""
        if specification.name in self._too_coarse:
            return [self._too_coarse[specification.name]]
        names = {node.name for node in walk(specification.formulation.tree) if isinstance(node, Name)}
        moving = {"closing_speed", "control_input", "speed", "velocity"}
        if specification.of == "belief":
            needed = {"state", *({"requested_control"} if names & moving else ())}
            needed |= {"awareness"} & {*map(_kind, names)}
            needed |= names & {"intent", "risk", "uncertainty"}
        elif specification.of == "awareness":
            needed = {"world", "state", "awareness"}
            needed |= {"requested_control"} if "believed_velocity" in names else set()
            needed |= {"applied_control"} if "true_velocity" in names or names & moving else set()
        else:
            needed = {"world", *({"requested_control", "applied_control"} if names & moving else ())}
        return sorted({*(needed & self._left_out), *self._missing_events(specification)})

    def _missing_events(self, specification: Specification) -> Iterator[str]:
        """Yield "events" or the name of the event that triggers a specification, if missing from the log."""
        trigger = self.options.instances.get(specification.name)
        if specification.offer is not None:
            if self._events == "none":
                yield "events"
        elif trigger is not None and trigger.event not in {"contact", *CHANNELS, *MEMBERSHIP}:
            if trigger.event in RECURRING:
                if self._events != "all":
                    yield f"the event `{trigger.event}`"
            elif self._events == "none":
                yield "events"


def _kind(name: str) -> str:
    return "awareness" if name == "nearest" else name
