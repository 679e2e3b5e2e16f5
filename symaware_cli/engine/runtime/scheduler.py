"""The turn scheduler: runs the turns of one component entry at steps, periods, events or conditions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Event, GroupComponent, Level, SubscriberError
from symaware_cli.core.component import may_wait
from symaware_cli.engine.runtime.delayed_turns import DelayedTurns
from symaware_cli.engine.runtime.event_router import EventRouter
from symaware_cli.engine.runtime.failure import describe
from symaware_cli.engine.runtime.guard import Guard, Isolate
from symaware_cli.engine.runtime.interruption import Interrupted, Interruption
from symaware_cli.engine.runtime.queue import Phase, Queue
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.engine.runtime.supervision import Supervision
from symaware_cli.engine.runtime.timing import Timetable, concerned
from symaware_cli.engine.runtime.turn import TurnsInProgress, in_turn
from symaware_cli.world import key_of

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.awaiting import Awaiter
    from symaware_cli.engine.runtime.coroutine import CoroutineTurns
    from symaware_cli.engine.runtime.scope import ConditionScope
    from symaware_cli.engine.runtime.workers import Workers


class TurnScheduler:
    """Runs the turns of the components of one entry.

    A row is that of a component: the row of its agent, or 0 for a group component. Its queue entries, at its place, are
    of these kinds:

    ``period``: the next periodic turn; the payload is its rows, None for all, and its number in the timetable.
    ``trigger``: turns triggered by events; the payload is the set of agents concerned, which grows until the turn.
    ``again``: the next turn of a component with the period 0; no payload.
    ``update`` and ``resume``: see `DelayedTurns` and `CoroutineTurns`.

    Attributes:
        entry: The component entry.
        place: Its index among all entries.
        turns: The number of turns taken by all components of the entry.
        overruns: The number of turns that were due while the previous one still computed.
        supervision: Suspended agents, and the effects of faults.
        stands_in: Whether its components are substitutes, and a fault lets them take the turns of others at the moment.
    """

    def __init__(
        self,
        simulation: Simulation,
        entry: ComponentEntry,
        place: int,
        *,
        queue: Queue,
        router: EventRouter,
        interruption: Interruption,
        workers: Workers,
        isolate: Isolate,
        awaiter: Awaiter | None,
    ) -> None:
        """Prepare; `begin` queues the first turns.

        Args:
            simulation: The simulation.
            entry: The component entry.
            place: Its index among all entries.
            queue: The queue for turns.
            router: Connects triggers with events.
            interruption: Defers signals.
            workers: Run the computations of components with `run_in: process`.
            isolate: Takes agents out of the run.
            awaiter: Converts awaited objects into conditions; None if turns may not wait.
        """
        self.entry = entry
        self.place = place
        self.turns = 0
        self.overruns = 0
        self.stands_in = False
        self._simulation = simulation
        self._timing = entry.timing
        self._group = entry.group
        self._is_group = isinstance(entry.components[0], GroupComponent)
        self._row_of = {id: row for row, id in enumerate(entry.group.ids)}
        self._queue = queue
        self._router = router
        self._interruption = interruption
        self._workers = workers
        self._scope: ConditionScope | None = None
        if self._timing.condition:
            from symaware_cli.engine.runtime.scope import ConditionScope

            self._scope = ConditionScope(entry.group)
        self._progress = TurnsInProgress()
        #: The number of postponed turns of each row, and the agents of the queued triggered turn.
        self._backlog: Counter[int] = Counter()
        self._triggered: set[int] | None = None
        #: The rows whose components took a turn and were not off since, if that makes a difference.
        self._shown: set[int] = set()
        #: The number of reasons for which each agent does not use this component, as another one replaces it.
        self._unused: Counter[int] = Counter()
        self.supervision = Supervision(simulation, entry, self._update_flags)
        self._guard = Guard(simulation, entry, self.supervision, interruption, isolate, self.restart)
        common = simulation, entry, place, queue, self._guard, self._progress
        self._delayed = DelayedTurns(*common, workers, self._on_turn_done)
        self._coroutines: CoroutineTurns | None = None
        if awaiter is not None and any(may_wait(type(each)) for each in entry.components):
            from symaware_cli.engine.runtime.coroutine import CoroutineTurns

            self._coroutines = CoroutineTurns(*common, awaiter, self._on_turn_done)
        queue.register(place, {"period": self._on_period, "trigger": self._on_triggered_turn, "again": self._on_again})
        self._timetables: dict[int, Timetable] = {}
        self._update_flags()

    def _update_flags(self) -> None:
        """Determine whether turns are plain, that is, nothing but computing and updating, for agents not suspended.

        They are free if besides no agent is suspended.
        """
        timing, supervision = self._timing, self.supervision
        self._takes_time = supervision.slows_down or not timing.latency.is_zero or timing.in_process
        self._plain = (
            not supervision.disturbances
            and not (self._is_group and supervision.suspends(0))
            and timing.on_failure == "stop"
            and self._coroutines is None
            and timing.condition is None
            and timing.trigger is None
            and not self._takes_time
            and timing.period != 0
        )
        self._is_free = self._plain and not supervision.suspended

    @property
    def failures(self) -> int:
        """The number of failures that did not end the run."""
        return self._guard.failures

    @property
    def is_steady(self) -> bool:
        """Whether there is a turn at each step of the world, which the kernel calls directly."""
        return self._timing.is_steady(self._simulation.environment.time_step)

    @property
    def is_remote(self) -> bool:
        """Whether all agents run in other processes."""
        return len(self.supervision.remote) == len(self._group)

    def begin(self) -> None:
        """Queue the first turns, and subscribe to the trigger's event."""
        timing, queue = self._timing, self._queue
        for agent in range(len(self._group)) if self.entry.is_substitute else self.entry.others:
            self.put_out_of_use(agent)
        if timing.trigger is not None:
            self._router.connect(timing.trigger.event, timing.trigger.source, self._on_trigger)
        if self.is_steady or (timing.trigger is not None and timing.period is None):
            return
        step = self._simulation.environment.time_step
        if not timing.jitter:
            self._timetables[0] = Timetable(timing, step, queue.grid)
            self._enter_turn(None, 0, queue.clock.now)
            return
        for row, component in enumerate(self.entry.components):
            key = key_of(self._simulation.seed, component.path, "jitter")
            self._timetables[row] = Timetable(timing, step, queue.grid, key)
            self._enter_turn([row], 0, queue.clock.now)

    def reseed(self, seed: int) -> None:
        """Draw the jitter of the turns that are not yet queued from another seed."""
        if self._timing.jitter:
            for row, component in enumerate(self.entry.components):
                self._timetables[row].rekey(key_of(seed, component.path, "jitter"))

    def _enter_turn(self, rows: Sequence[int] | None, number: int, earliest: int) -> None:
        """Queue the next periodic turn; turns that were due before this process joined the run are skipped."""
        row = rows[0] if rows else 0
        turn = self._timetables[row].turn(number, earliest)
        if turn is not None:
            time, number = turn
            self._queue.put(time, self.place, Phase.TURN, row, "period", (rows, number))

    def _on_period(self, row: int, payload: tuple[Sequence[int] | None, int]) -> None:
        """Queue the next turn, then take this one: entries made by the turn follow the next one."""
        rows, number = payload
        self._enter_turn(rows, number + 1, self._queue.clock.now + 1)
        self.take(rows)

    def _on_trigger(self, event: Event) -> None:
        """Queue a turn for the agents that an event concerns; one turn, even if several events fire before it."""
        trigger = self._timing.trigger
        assert trigger is not None
        agents = set(concerned(event, trigger, self._group.name, self._row_of)).difference(self.entry.others)
        if not agents:
            return
        if self._triggered is None:
            self._triggered = set()
            self._queue.put(self._queue.clock.now, self.place, Phase.TURN, 0, "trigger", self._triggered)
        self._triggered.update(agents)

    def _on_triggered_turn(self, row: int, called: set[int]) -> None:
        self._triggered = None
        agents = sorted(called)
        if not self._is_group:
            self.take(agents)
            return
        component = vars(self.entry.components[0])
        component["_triggered"] = agents
        try:
            self.take([0])
        finally:
            del component["_triggered"]

    def _on_again(self, row: int, payload: None) -> None:
        self.take([row])

    def take(self, rows: Sequence[int] | None = None) -> None:
        """Take a turn with the components of some rows, or of all.

        Raises:
            RunError: A component failed, and that ends the run.
        """
        if self._is_free:
            self._take_plain(rows)
        elif not self._plain:
            self._take_each(range(len(self.entry.components)) if rows is None else rows)
            return
        elif (held := self.supervision.held()) is not None:
            with held:
                self._take_plain(rows)
        else:
            suspended = self.supervision.suspended
            rows = range(len(self.entry.components)) if rows is None else rows
            self._take_plain([row for row in rows if row not in suspended])
        self._guard.check(None)

    def _take_plain(self, rows: Sequence[int] | None) -> None:
        """Take plain turns, one after the other: the hot loop."""
        entry, interruption = self.entry, self._interruption
        component = entry.components[0]
        update, value = None, None
        interruption.unshield()
        try:
            if entry.turns and not self._simulation.events.turns_wanted:
                # The same as `compute_and_update` without subscribers, in half the time.
                turns = entry.turns if rows is None else map(entry.turns.__getitem__, rows)
                self.turns += len(entry.turns if rows is None else rows)
                for component, compute, update in turns:  # noqa: B007 (tells which one raised)
                    value = compute()
                    update(value)
            else:
                components = entry.components if rows is None else [entry.components[row] for row in rows]
                self.turns += len(components)
                for component in components:
                    component.compute_and_update()
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            if update is not None and isinstance(error, Exception) and _is_raised_in(update, error):
                raise self._guard.failure(component, describe(component.explained(value, error)), error) from error
            raise self._guard.failure(component, describe(error), error) from error
        finally:
            interruption.shield()

    def _take_each(self, rows: Iterable[int]) -> None:
        """Take a turn with some components, each treated separately."""
        rows = [row for row in rows if self._is_ready(row)]
        if not rows:
            return
        self.turns += len(rows)
        guard = self._guard
        before = guard.snapshot()
        if self._coroutines is not None:
            self._coroutines.take(rows)
        elif self._takes_time:
            self._delayed.take(rows)
        else:
            with self.supervision.supervised():
                for row in rows:
                    component = self.entry.components[row]
                    with in_turn(component, self._progress.begin(row, self._queue.clock.now)):
                        guard.attempt(row, component.compute_and_update)
        guard.check(before)
        if self._timing.when_off == "clear":
            self._shown.update(row for row in rows if row not in self._progress)
        if self._timing.period == 0:
            for row in rows:
                if row not in self._progress:
                    self._enter_next(row, self._queue.clock.now)

    def _is_ready(self, row: int) -> bool:
        """Whether a component can take a turn that is due; otherwise handle the overrun or the waiting."""
        if self.supervision.suspends(row):
            return False
        if not self._condition_holds(row):
            if row in self._shown:
                self._clear(row)
            if self._timing.period == 0:
                self._wait_for_step(row)
            return False
        if row not in self._progress:
            return True
        self._overrun(row)
        return False

    def _clear(self, row: int) -> None:
        """Clear the values that a component wrote, as it is off now."""
        self._shown.discard(row)
        suspended = self.supervision.suspended
        agents = [each for each in range(len(self._group)) if each not in suspended] if self._is_group else [row]
        self._guard.clear(agents)

    def _condition_holds(self, row: int) -> bool:
        """Whether the condition holds; for a group component, whether it holds for any of its agents."""
        scope, condition = self._scope, self._timing.condition
        if scope is None or condition is None:
            return True
        from symaware_cli.specification.expression import EvaluationError

        suspended = self.supervision.suspended
        rows = [each for each in range(len(self._group)) if each not in suspended] if self._is_group else [row]
        try:
            return any(condition.holds(partial(scope.look_up, each)) for each in rows)
        except EvaluationError as error:
            self._guard.handle_failure(row, self._guard.failure(self.entry.components[row], str(error), error))
            return False

    def _overrun(self, row: int) -> None:
        self.overruns += 1
        component, overrun = self.entry.components[row], self._timing.overrun
        done = {"skip": "is left out", "queue": "is put off", "fail": "is a failure"}[overrun]
        text = f"a turn is due while the one before still computes; it {done}"
        self._simulation.announce("overrun", component.path, text, level=Level.WARNING, overrun=overrun)
        if overrun == "fail":
            self._guard.handle_failure(
                row, self._guard.failure(component, "a turn was due while the one before still computed")
            )
        elif overrun == "queue":
            self._backlog[row] += 1

    def _on_turn_done(self, row: int) -> None:
        """After a turn that took time, take a postponed turn or queue the next one."""
        if self._timing.when_off == "clear":
            self._shown.add(row)
        if self._backlog[row]:
            self._backlog[row] -= 1
            self._take_each([row])
        elif self._timing.period == 0:
            self._enter_next(row, self._queue.clock.now)

    def _enter_next(self, row: int, time: int) -> None:
        self._queue.put(time, self.place, Phase.TURN, row, "again")

    def _wait_for_step(self, row: int) -> None:
        """Queue a component with the period 0 at the next step, as its condition does not hold or it was restarted."""
        step = self._simulation.environment.time_step
        self._enter_next(row, (self._queue.clock.now // step + 1) * step)

    def restart(self, row: int) -> None:
        """Cancel the turn of a component and initialise it again.

        Raises:
            RunError: Its initialisation failed.
        """
        component, tried = self.entry.components[row], self._guard.tries[row]
        self._reinitialise(row)
        tries = f", for the {_ordinal(tried)} of {self._timing.tries} times" if tried else ""
        self._simulation.announce("restarted", component.path, f"begins anew{tries}", level=Level.WARNING)
        if self._timing.period == 0:
            self._wait_for_step(row)

    def enter(self, agent: int) -> None:
        """Initialise the component of an agent that enters; a group component continues.

        Raises:
            RunError: Its initialisation failed.
        """
        if self._is_group or agent in self._unused:
            return
        self._reinitialise(agent)
        if self._timing.period == 0:
            self._wait_for_step(agent)

    def _reinitialise(self, row: int) -> None:
        self._cancel_turn(row)
        if self._timing.in_process:
            self._workers.restart(self.entry, row)
        # What it subscribes to when it begins, it subscribes to anew.
        self._simulation.events.cancel_all_of(self.entry.components[row])
        with self._simulation.held(self.entry):
            self.entry.initialise_one(row, self._simulation.clock.now)
        self._guard.check(None)

    def hold(self, agent: int) -> None:
        """Suspend an agent until it is released as often as it was held."""
        self.supervision.hold(agent)
        if not self._is_group:
            self._cancel_turn(agent)

    def leave(self, agent: int) -> None:
        """Suspend an agent, as it runs in another process."""
        self.supervision.remote.add(agent)
        self.hold(agent)

    def release(self, agent: int) -> None:
        """Resume an agent, unless there are other reasons to suspend it."""
        self.supervision.release(agent)

    def restart_agents(self, agents: Sequence[int]) -> None:
        """Restart the components of some agents that use them; a group component only if these are all its agents."""
        if not self._is_group:
            for row in agents:
                if row not in self._unused:
                    self.restart(row)
        elif {*agents, *self.entry.others} == {*range(len(self._group))} and len(self._unused) < len(self._group):
            self.restart(0)

    def put_out_of_use(self, agent: int) -> None:
        """Let another component take the turns for an agent, until `put_into_use` was called as often."""
        self._unused[agent] += 1
        self.hold(agent)

    def put_into_use(self, agent: int) -> None:
        """Let this component take the turns for an agent again, unless there are other reasons against it."""
        self._unused[agent] -= 1
        if not self._unused[agent]:
            del self._unused[agent]
        self.release(agent)

    def _cancel_turn(self, row: int) -> None:
        self._backlog.pop(row, None)
        turn = self._progress.pop(row)
        if self._coroutines is not None:
            self._coroutines.cancel(turn)

    def end(self) -> list[str]:
        """Cancel all unfinished turns, and describe those that awaited something that may never happen."""
        waiting = self._coroutines.waiting if self._coroutines is not None else []
        for row in self._progress.rows:
            self._cancel_turn(row)
        return waiting


def _is_raised_in(method: Any, error: Exception) -> bool:
    """Whether an exception was raised within a method called directly by the function that catches it."""
    trace = error.__traceback__ and error.__traceback__.tb_next
    return trace is not None and trace.tb_frame.f_code is method.__code__


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")
