"""Membership: which agents take part in a run, as they enter, leave, return, fail, stop and restart.

Reasons: docs/decisions/0111-agents-that-return.md
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from symaware_cli.awareness import Array, Column, SeriesColumn, TableColumn
from symaware_cli.core import AgentGroup, Event, Level, Model, TimeSeries
from symaware_cli.engine.runtime.event_router import EventRouter
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.run_summary import Observer
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import Coast, Moment, PresenceInterval, Trigger, concerned
from symaware_cli.world import is_finite

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.scheduler import TurnScheduler
    from symaware_cli.engine.runtime.scope import ConditionScope
    from symaware_cli.specification.expression import Lookup


class Membership:
    """Retires and revives agents, and lets them enter and leave the world.

    A retired agent (failed or stopped) stays in the world as a body that coasts. An absent agent takes no part and has
    no position.

    Attributes:
        is_open: Whether the scenario lets agents enter or leave.
        waiting: The agents that are absent, and enter or return later, by group and row.
        leaving: The agents in the world that may leave.
    """

    #: The intervals are part of the scenario.
    uncaptured: ClassVar[Collection[str]] = ("_intervals",)

    def __init__(
        self,
        simulation: Simulation,
        schedulers: Sequence[TurnScheduler],
        presence: Mapping[str, Sequence[PresenceInterval]],
        observer: Observer,
        router: EventRouter,
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation.
            schedulers: The turn scheduler of each entry.
            presence: The presence of the agents of some groups, by row; agents of other groups are always present.
            observer: Supplies contacts, goals and risks to conditions on which agents enter.
            router: Connects agents with the events on which they enter or leave.
        """
        self._simulation = simulation
        self._schedulers = schedulers
        self._groups = {group.name: group for group in simulation.groups}
        self._scopes: dict[str, ConditionScope] = {}
        if presence:
            from symaware_cli.engine.runtime.scope import ConditionScope, WorldScope

            self._look_up = WorldScope(simulation, observer).look_up
            self._scopes = {name: ConditionScope(self._groups[name]) for name in presence}
        #: The number of reasons for which each agent takes no part: absence, faults, and failures, which are permanent.
        self._reasons: Counter[tuple[str, int]] = Counter()
        #: The agents whose event to enter or leave has fired since the last step.
        self._triggered: set[tuple[str, int]] = set()
        self.is_open = bool(presence)
        self._observer = observer
        #: The intervals of each agent, in order.
        self._intervals = {
            (name, row): _in_order(interval) for name in sorted(presence) for row, interval in enumerate(presence[name])
        }
        #: How often agents that return have left.
        self._times_left: Counter[tuple[str, int]] = Counter()
        self.waiting = {agent for agent, (interval, *_) in self._intervals.items() if interval.is_late}
        self.leaving = self._intervals.keys() - self.waiting
        for name in sorted(presence):
            self._listen(self._groups[name], presence[name], router)

    def _listen(self, group: AgentGroup, intervals: Sequence[PresenceInterval], router: EventRouter) -> None:
        """Subscribe to the events on which agents of a group enter or leave."""
        rows = {id: row for row, id in enumerate(group.ids)}
        every = [each for interval in intervals for each in _in_order(interval)]
        for way, moments in (("begin", [each.begin for each in every]), ("end", [each.end for each in every])):
            for trigger in dict.fromkeys(each for each in moments if isinstance(each, Trigger)):
                call = partial(self._on_event, trigger, group.name, rows, way)
                router.connect(trigger.event, trigger.source, call)

    def _on_event(self, trigger: Trigger, group: str, rows: Mapping[str, int], way: str, event: Event) -> None:
        concerns = self.waiting if way == "begin" else self.leaving
        for row in concerned(event, trigger, group, rows):
            agent = group, row
            if agent in concerns and getattr(self._interval(agent), way) == trigger:
                self._triggered.add(agent)

    def _interval(self, agent: tuple[str, int]) -> PresenceInterval:
        """Return the interval in which an agent is, or that it waits for."""
        return self._intervals[agent][self._times_left[agent]]

    @property
    def never_present(self) -> int:
        """The number of agents that have not entered yet."""
        return sum(not self._times_left[agent] for agent in self.waiting)

    def begin(self) -> None:
        """Suspend the agents that have not entered yet."""
        for name, row in sorted(self.waiting):
            self._hold(self._groups[name], row)

    def update(self, now: int) -> None:
        """Let agents leave and enter at a step of the world.

        Raises:
            RunError: A condition has no value, or the environment raised an exception.
        """
        gone = [
            each
            for each in sorted(self.leaving)
            if self._is_time(
                each, self._interval(each).end, "until", partial(self._scopes[each[0]].look_up, each[1]), now
            )
        ]
        come = [
            each
            for each in sorted(self.waiting)
            if self._is_time(each, self._interval(each).begin, "from", self._look_up, now)
        ]
        # An event is not forgotten while its agent waits for room.
        entering_now = self._with_room(come, gone)
        self._triggered = {each for each in come if each not in entering_now} & self._triggered
        come = entering_now
        for name, group in self._groups.items():
            leaving, entering = ([row for own, row in each if own == name] for each in (gone, come))
            if leaving:
                self._leave(group, leaving)
            if entering:
                self._enter(group, entering)

    def _with_room(self, come: Sequence[tuple[str, int]], gone: Collection[tuple[str, int]]) -> list[tuple[str, int]]:
        """Return the agents that enter: those that need no room, or have it, also beside those before them.

        Args:
            come: The agents whose time to enter has come.
            gone: The agents that leave at this instant.
        """
        needs = {each: self._interval(each).apart for each in come}
        if not any(needs.values()):
            return list(come)
        environment, entering = self._simulation.environment, []
        roster = environment.roster
        positions = environment.snapshot().positions.copy()
        positions[[roster.start(name) + row for name, row in gone]] = np.nan
        for name, row in come:
            group, apart = self._groups[name], needs[name, row]
            states = environment.state(group) if self._times_left[name, row] else group.initial_state
            place = group.model.positions(states[row : row + 1])[0]
            away = positions[:, : len(place)] - place
            if apart is not None and (np.sqrt((away * away).sum(axis=1)) < apart).any():
                continue
            entering.append((name, row))
            positions[roster.start(name) + row, : len(place)] = place
        return entering

    def _is_time(self, agent: tuple[str, int], moment: Moment | None, key: str, look_up: Lookup, now: int) -> bool:
        """Whether the time, event or condition at which an agent enters or leaves has come."""
        if moment is None:
            return False
        if isinstance(moment, Trigger):
            return agent in self._triggered
        if isinstance(moment, int):
            return now >= moment
        from symaware_cli.specification.expression import EvaluationError

        try:
            return moment.holds(look_up)
        except EvaluationError as error:
            id = self._groups[agent[0]].ids[agent[1]]
            raise RunError(f"agents.{id}.present.{key}", "symaware", now, str(error), error) from error

    def _enter(self, group: AgentGroup, rows: Sequence[int]) -> None:
        """Let agents into the world."""
        for row in rows:
            self._simulation.announce("adding", f"agents.{group.ids[row]}")
            self.waiting.remove((group.name, row))
            self.leaving.add((group.name, row))
            if group.returning is not None and group.returning[row]:
                group.returning = np.where(np.arange(len(group)) == row, False, group.returning)
        self._set_present(group, rows, present=True)
        # Their awareness, control inputs and knowledge are recorded as new.
        for column in (*group.awareness.columns.values(), group.control_column):
            if isinstance(column, Column):
                column.mark(rows)
        group.knowledge_changes.rows.update(rows)
        for row in rows:
            if self._release(group, row):
                self._simulation.exchange.inboxes.reopen(group.ids[row])
                for scheduler in self._schedulers_of(group):
                    scheduler.release(row)
                    scheduler.enter(row)
        for row in rows:
            overlapped = self._simulation.environment.overlaps(group.ids[row])
            said = f"; its body overlaps {', '.join(overlapped)}" if overlapped else ""
            level = Level.WARNING if overlapped else Level.INFO
            self._simulation.announce("added", f"agents.{group.ids[row]}", f"enters{said}", level=level)

    def _leave(self, group: AgentGroup, rows: Sequence[int]) -> None:
        """Let agents leave the world, for good or until they return."""
        for row in rows:
            self._simulation.announce("removing", f"agents.{group.ids[row]}")
            self.leaving.remove((group.name, row))
            if self._interval((group.name, row)).then is not None:
                self._times_left[group.name, row] += 1
                self.waiting.add((group.name, row))
                returning = np.zeros(len(group), bool) if group.returning is None else group.returning.copy()
                returning[row] = True
                returning.flags.writeable = False
                group.returning = returning
            self._hold(group, row)
            for column in group.awareness.columns.values():
                if isinstance(column, SeriesColumn):
                    column.set_row(row, TimeSeries())
                elif isinstance(column, TableColumn):
                    column.set_row(row, ())
        self._set_present(group, rows, present=False)
        for row in rows:
            self._simulation.announce("removed", f"agents.{group.ids[row]}", "leaves")
            if (group.name, row) in self.waiting:
                self._observer.left.discard(group.ids[row])

    def _set_present(self, group: AgentGroup, rows: Sequence[int], *, present: bool) -> None:
        """Update the presence of agents in the group, the environment and the exchange."""
        simulation, environment = self._simulation, self._simulation.environment
        flags = group.in_world.copy()
        flags[list(rows)] = present
        flags.flags.writeable = False
        group.present = flags
        try:
            (environment.admit if present else environment.dismiss)(group, rows)
        except BaseException as error:
            raise self._simulation.environment_failure(error) from error
        simulation.exchange.present = environment.present

    def _schedulers_of(self, group: AgentGroup) -> list[TurnScheduler]:
        return [scheduler for scheduler in self._schedulers if scheduler.entry.group is group]

    def _hold(self, group: AgentGroup, row: int) -> bool:
        """Add a reason for which an agent takes no part; return whether it is the first.

        Its components take no further turns. Unread messages to it are discarded, and so are those that still arrive.
        """
        self._reasons[group.name, row] += 1
        if self._reasons[group.name, row] > 1:
            return False
        for scheduler in self._schedulers_of(group):
            scheduler.hold(row)
        self._simulation.exchange.inboxes.close(group.ids[row])
        return True

    def retire(self, group: AgentGroup, rows: Iterable[int], coast: Coast, reason: str) -> None:
        """Take agents out of the run: their components take no further turns, and the world still moves their bodies.

        Unread messages to them are discarded, and so are those that still arrive. They take part again when `revive`
        was called as often as this method.

        Args:
            group: The agents' group.
            rows: The agents' rows.
            coast: Their control input from now on: the last one, or one that stops them as far as the model can.
            reason: Why, in one sentence.
        """
        for row in rows:
            if coast == "safe" and not self._reasons[group.name, row]:
                one = slice(row, row + 1)
                safe = safe_input(group.model, group.control_input[one], group.awareness.state[one])
                group.control_column.set_row(row, safe)
            if self._hold(group, row):
                self._simulation.announce("terminated", f"agents.{group.ids[row]}", reason, level=Level.WARNING)

    def revive(self, group: AgentGroup, rows: Iterable[int]) -> None:
        """Remove a reason for which agents take no part; agents without reasons restart, with their components."""
        rows = [row for row in rows if self._release(group, row)]
        for row in rows:
            self._simulation.exchange.inboxes.reopen(group.ids[row])
        for scheduler in self._schedulers_of(group):
            for row in rows:
                scheduler.release(row)
            scheduler.restart_agents(rows)

    def takes_part(self, group: AgentGroup, row: int) -> bool:
        """Whether an agent takes part: it is in the world, and has neither failed nor stopped."""
        return not self._reasons[group.name, row]

    def _release(self, group: AgentGroup, row: int) -> bool:
        """Remove a reason for which an agent takes no part; return whether it was the last."""
        self._reasons[group.name, row] -= 1
        return not self._reasons[group.name, row]


def _in_order(interval: PresenceInterval) -> tuple[PresenceInterval, ...]:
    """Return an interval and all that follow it."""
    return (interval,) if interval.then is None else (interval, *_in_order(interval.then))


def safe_input(model: Model, before: Array, state: Array) -> Array:
    """Compute the control input that stops an agent, as far as its model can.

    Args:
        model: The agent's dynamics.
        before: Its present control input; shape (1, nu).
        state: Its state; shape (1, nx).

    Returns:
        Shape (nu,).
    """
    try:
        chosen = model.limit(model.slowed(state, before, np.zeros(1)))
    except NotImplementedError:
        chosen = model.limit(np.zeros_like(before))
    safe: Array = chosen[0] if is_finite(chosen) else before[0]
    return safe
