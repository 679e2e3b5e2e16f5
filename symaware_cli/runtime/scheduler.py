"""The turn scheduler: when the components of one entry of one group take their turns, and in which way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

from symaware_cli.core import Event, GroupComponent, Level, SubscriberError
from symaware_cli.runtime.awaiting import Awaiter
from symaware_cli.runtime.coroutine import CoroutineTurns, is_coroutine
from symaware_cli.runtime.delayed import DelayedTurns
from symaware_cli.runtime.event_router import EventRouter
from symaware_cli.runtime.failure import describe
from symaware_cli.runtime.guard import Guard, Isolate
from symaware_cli.runtime.interruption import Interrupted, Interruption
from symaware_cli.runtime.queue import Phase, Queue
from symaware_cli.runtime.scope import ConditionScope
from symaware_cli.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.runtime.supervision import Supervision
from symaware_cli.runtime.timing import Timetable
from symaware_cli.runtime.trigger import concerned
from symaware_cli.runtime.turn import in_turn
from symaware_cli.runtime.turns_in_progress import TurnsInProgress
from symaware_cli.runtime.workers import Workers
from symaware_cli.specification.expression import EvaluationError
from symaware_cli.world.chance import key_of


class TurnScheduler:
    """Lets the components of one entry take their turns.

    A row here is that of a component: of an agent, or 0 where one component serves the whole group. In the queue there
    are, at its place, entries of these kinds:

    ``period``: the next turn of a period; the payload has its rows, None for all, and its number in the timetable.
    ``trigger``: turns that events ask for; the payload is the set of the agents concerned, which grows until then.
    ``again``: the next turn of a component that takes one after the other; no payload.
    ``update`` and ``resume``: see `DelayedTurns` and `CoroutineTurns`.

    Attributes:
        entry: Whose turns they are.
        place: Its position among all entries.
        turns: How many turns were taken, each component's counted.
        overruns: How many were due while the one before still computed.
        supervision: Who takes no part at present, and what faults make of the others.
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
        """Prepare; `begin` enters the first turns.

        Args:
            simulation: What runs.
            entry: Whose turns they are.
            place: Its position among all entries.
            queue: Where turns are entered.
            router: Where triggers are heard.
            interruption: Holds signals back.
            workers: Where components compute that have a process of their own.
            isolate: Takes agents out of the run.
            awaiter: What components may wait for within their turns; None where they may not.
        """
        self.entry = entry
        self.place = place
        self.turns = 0
        self.overruns = 0
        self._simulation = simulation
        self._timing = entry.timing
        self._group = entry.group
        self._is_group = isinstance(entry.components[0], GroupComponent)
        self._written = entry.group.control_column, entry.group.awareness.state_column
        self._row_of = {id: row for row, id in enumerate(entry.group.ids)}
        self._queue = queue
        self._router = router
        self._interruption = interruption
        self._workers = workers
        self._scope = ConditionScope(entry.group) if self._timing.condition else None
        self._progress = TurnsInProgress()
        #: How many turns of each row were put off, and who is to take one that an event asked for.
        self._backlog: Counter[int] = Counter()
        self._called: set[int] | None = None
        self.supervision = Supervision(simulation, entry, self._review)
        self._guard = Guard(simulation, entry, self.supervision, interruption, isolate, self.restart)
        common = simulation, entry, place, queue, self._guard, self._progress
        self._delayed = DelayedTurns(*common, workers, self._over)
        self._coroutines: CoroutineTurns | None = None
        if awaiter is not None and any(is_coroutine(each) for each in entry.components):
            self._coroutines = CoroutineTurns(*common, awaiter, self._over)
        queue.register(place, {"period": self._on_period, "trigger": self._on_called, "again": self._on_again})
        self._timetables: dict[int, Timetable] = {}
        self._review()

    def _review(self) -> None:
        """Find out whether there is nothing to think of but computing and updating."""
        timing, supervision = self._timing, self.supervision
        self._takes_time = supervision.slows_down or not timing.latency.is_zero or timing.in_process
        self._plain = (
            not supervision.interferes
            and timing.on_failure == "stop"
            and self._coroutines is None
            and timing.condition is None
            and timing.trigger is None
            and not self._takes_time
            and timing.period != 0
        )

    @property
    def failures(self) -> int:
        """How many components failed without ending the run."""
        return self._guard.failures

    @property
    def is_steady(self) -> bool:
        """Whether it takes its turns at each step of the world, for the kernel to see to."""
        return self._timing.is_steady(self._simulation.environment.time_step)

    def begin(self) -> None:
        """Enter the first turns in the queue, and listen for what triggers further ones."""
        timing, queue = self._timing, self._queue
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

    def _enter_turn(self, rows: Sequence[int] | None, number: int, earliest: int) -> None:
        """Enter the next turn of a period; those that a run has missed that joined late are left out."""
        row = rows[0] if rows else 0
        turn = self._timetables[row].turn(number, earliest)
        if turn is not None:
            time, number = turn
            self._queue.put(time, self.place, Phase.TURN, row, "period", (rows, number))

    def _on_period(self, row: int, payload: tuple[Sequence[int] | None, int]) -> None:
        """Take a turn, and enter the next one before: what the turn causes comes behind."""
        rows, number = payload
        self._enter_turn(rows, number + 1, self._queue.clock.now + 1)
        self.take(rows)

    def _on_trigger(self, event: Event) -> None:
        """Enter a turn for those whom an event concerns; one turn, however many events fire before it."""
        trigger = self._timing.trigger
        assert trigger is not None
        agents = concerned(event, trigger, self._group.name, self._row_of)
        if not agents:
            return
        if self._called is None:
            self._called = set()
            self._queue.put(self._queue.clock.now, self.place, Phase.TURN, 0, "trigger", self._called)
        self._called.update(agents)

    def _on_called(self, row: int, called: set[int]) -> None:
        self._called = None
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
        """Let the components of some rows, or of all, take a turn.

        Raises:
            RunError: One failed, and that ends the run.
        """
        if not self._plain:
            self._take_each(range(len(self.entry.components)) if rows is None else rows)
            return
        # One after the other, with nothing to think of: the hot loop.
        entry, interruption = self.entry, self._interruption
        component = entry.components[0]
        update, value = None, None
        interruption.unshield()
        try:
            if entry.turns and not self._simulation.events.turns_wanted:
                # What compute_and_update does where nobody listens, for half its price.
                turns = entry.turns if rows is None else [entry.turns[row] for row in rows]
                self.turns += len(turns)
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
        control, state = self._written
        if control.fresh or state.fresh:
            self._guard.check(None)

    def _take_each(self, rows: Iterable[int]) -> None:
        """Some components, each looked at by itself."""
        rows = [row for row in rows if self._may(row)]
        if not rows:
            return
        self.turns += len(rows)
        guard = self._guard
        before = guard.present()
        if self._coroutines is not None:
            self._coroutines.take(rows)
        elif self._takes_time:
            self._delayed.take(rows)
        else:
            with self.supervision.watched():
                for row in rows:
                    component = self.entry.components[row]
                    with in_turn(component, self._progress.begin(row, self._queue.clock.now)):
                        guard.attempt(row, component.compute_and_update)
        guard.check(before)
        if self._timing.period == 0:
            for row in rows:
                if row not in self._progress:
                    self._again(row, self._queue.clock.now)

    def _may(self, row: int) -> bool:
        """Whether a component takes a turn that is due."""
        if self.supervision.keeps_off(row):
            return False
        if not self._holds(row):
            if self._timing.period == 0:
                self._wait_for_step(row)
            return False
        if row not in self._progress:
            return True
        self._overrun(row)
        return False

    def _holds(self, row: int) -> bool:
        """Whether the condition holds; for a component of the whole group, for any of its agents."""
        scope, condition = self._scope, self._timing.condition
        if scope is None or condition is None:
            return True
        off = self.supervision.off
        rows = [each for each in range(len(self._group)) if each not in off] if self._is_group else [row]
        try:
            return any(condition.holds(partial(scope.look_up, each)) for each in rows)
        except EvaluationError as error:
            self._guard.fail(row, self._guard.failure(self.entry.components[row], str(error), error))
            return False

    def _overrun(self, row: int) -> None:
        self.overruns += 1
        component, overrun = self.entry.components[row], self._timing.overrun
        done = {"skip": "is left out", "queue": "is put off", "fail": "is a failure"}[overrun]
        text = f"a turn is due while the one before still computes; it {done}"
        self._simulation.announce("overrun", component.path, text, level=Level.WARNING, overrun=overrun)
        if overrun == "fail":
            self._guard.fail(row, self._guard.failure(component, "a turn was due while the one before still computed"))
        elif overrun == "queue":
            self._backlog[row] += 1

    def _over(self, row: int) -> None:
        """A turn that took time is over: take the ones that were put off, or the next one."""
        if self._backlog[row]:
            self._backlog[row] -= 1
            self._take_each([row])
        elif self._timing.period == 0:
            self._again(row, self._queue.clock.now)

    def _again(self, row: int, time: int) -> None:
        self._queue.put(time, self.place, Phase.TURN, row, "again")

    def _wait_for_step(self, row: int) -> None:
        """What takes turn after turn looks at a condition that does not hold once a step."""
        step = self._simulation.environment.time_step
        self._again(row, (self._queue.clock.now // step + 1) * step)

    def restart(self, row: int) -> None:
        """Give up what a component is doing and let it begin anew.

        Raises:
            RunError: It cannot.
        """
        component, tried = self.entry.components[row], self._guard.tries[row]
        self._renew(row)
        tries = f", for the {_ordinal(tried)} of {self._timing.tries} times" if tried else ""
        self._simulation.announce("restarted", component.path, f"begins anew{tries}", level=Level.WARNING)
        if self._timing.period == 0:
            self._wait_for_step(row)

    def enter(self, agent: int) -> None:
        """Let the component of an agent that enters take up its work; one of the whole group goes on.

        Raises:
            RunError: It cannot.
        """
        if self._is_group:
            return
        self._renew(agent)
        if self._timing.period == 0:
            self._wait_for_step(agent)

    def _renew(self, row: int) -> None:
        self._give_up(row)
        if self._timing.in_process:
            self._workers.restart(self.entry, row)
        self.entry.initialise_one(row, self._simulation.clock.now)

    def hold(self, agent: int) -> None:
        """Let an agent take no part until it is released as often as it was held."""
        self.supervision.hold(agent)
        if not self._is_group:
            self._give_up(agent)

    def leave(self, agent: int) -> None:
        """Let an agent take no part here, as it runs in another process."""
        self.supervision.away.add(agent)
        self.hold(agent)

    def release(self, agent: int) -> None:
        """Let an agent take part again, unless there are other reasons against it."""
        self.supervision.release(agent)

    def begin_anew(self, agents: Sequence[int]) -> None:
        """Restart the components of some agents; one that serves the whole group only if it is for all of them."""
        if not self._is_group:
            for row in agents:
                self.restart(row)
        elif len(agents) == len(self._group):
            self.restart(0)

    def _give_up(self, row: int) -> None:
        self._backlog.pop(row, None)
        turn = self._progress.give_up(row)
        if self._coroutines is not None:
            self._coroutines.give_up(turn)

    def end(self) -> list[str]:
        """Give up all that is under way, and name what was waited for without an end in sight."""
        waiting = self._coroutines.waiting if self._coroutines is not None else []
        for row in self._progress.rows:
            self._give_up(row)
        return waiting


def _is_raised_in(method: Any, error: Exception) -> bool:
    """Whether an exception came out of a method that was called where it is caught."""
    trace = error.__traceback__ and error.__traceback__.tb_next
    return trace is not None and trace.tb_frame.f_code is method.__code__


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")
