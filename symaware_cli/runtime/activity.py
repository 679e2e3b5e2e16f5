"""The turns of one component entry of one group: when they begin, how long they take, and what they come to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from symaware_cli.core import Component, Event, GroupComponent, Level, SubscriberError
from symaware_cli.core.chance import Turn, key_of
from symaware_cli.core.column import Array
from symaware_cli.runtime.agenda import Phase
from symaware_cli.runtime.computation import Computation
from symaware_cli.runtime.expression import EvaluationError
from symaware_cli.runtime.failure import RunError, describe
from symaware_cli.runtime.interruption import Interrupted
from symaware_cli.runtime.occasion import Recurrence, concerned
from symaware_cli.runtime.scope import AgentScope
from symaware_cli.runtime.scrutiny import Scrutiny
from symaware_cli.runtime.supervision import Disturb, Supervision
from symaware_cli.runtime.task import FAILED, Task
from symaware_cli.runtime.timing import Duration
from symaware_cli.runtime.turn import Turns, in_turn

if TYPE_CHECKING:
    from symaware_cli.runtime.run import Run
    from symaware_cli.runtime.simulation import Slot


class Activity:
    """Lets the components of one slot take their turns.

    A row here is that of a component: of an agent, or 0 where one component serves the whole group.

    Attributes:
        run: The run that it is part of.
        slot: Whose turns they are.
        place: Its position among all slots.
        turns: How many turns were taken, each component's counted.
        supervision: Who takes no part at present, and what faults make of the others.
        overruns: How many were due while the one before still computed.
        failures: How many failed without ending the run.
    """

    def __init__(self, run: Run, slot: Slot, place: int) -> None:
        self.slot = slot
        self.place = place
        self.turns = 0
        self.overruns = 0
        self.failures = 0
        self.run = run
        self._simulation = run.simulation
        self._timing = slot.timing
        self._group = slot.group
        self._is_group = isinstance(slot.components[0], GroupComponent)
        self._scrutiny = Scrutiny(slot.group)
        self._written = slot.group.control_column, slot.group.awareness.state_column
        self._row_of = {id: row for row, id in enumerate(slot.group.ids)}
        self.supervision = Supervision(run.simulation, slot)
        self._computation = Computation(self)
        self._turns = Turns()
        #: What the components of some rows are busy with, and how many turns were put off meanwhile.
        self._busy: dict[int, object] = {}
        self._backlog: Counter[int] = Counter()
        self._called: set[int] = set()
        self._tries: Counter[int] = Counter()
        self._coroutines = run.asynchronous and any(_is_coroutine(each) for each in slot.components)
        self._scope = AgentScope(slot.group) if self._timing.condition else None
        self._review()

    def _review(self) -> None:
        """Find out whether there is nothing to think of but computing and updating."""
        timing, supervision = self._timing, self.supervision
        self._takes_time = supervision.slows_down or not timing.latency.is_zero
        self._guarded = supervision.interferes or timing.on_failure != "stop"
        self._plain = (
            not self._guarded
            and not self._coroutines
            and timing.condition is None
            and timing.trigger is None
            and not self._takes_time
            and not timing.in_process
            and timing.period != 0
        )

    @property
    def is_steady(self) -> bool:
        """Whether it takes its turns at each step of the world, for the run to see to."""
        return self._timing.is_steady(self._simulation.environment.time_step)

    @property
    def awaits(self) -> bool:
        """Whether its components are coroutines of their own."""
        return self._coroutines

    def begin(self) -> None:
        """Enter the first turns in the agenda, and listen for what triggers further ones."""
        timing, run = self._timing, self.run
        if timing.trigger is not None:
            run.switchboard.connect(timing.trigger.event, timing.trigger.source, self._on_trigger)
        if self.is_steady or (timing.trigger is not None and timing.period is None):
            return
        step = self._simulation.environment.time_step
        if not timing.jitter:
            Recurrence(self, None, timing.instants(step, run.agenda.grid)).enter()
            return
        for row, component in enumerate(self.slot.components):
            key = key_of(self._simulation.seed, component.path, "jitter")
            Recurrence(self, [row], timing.instants(step, run.agenda.grid, key)).enter()

    def _on_trigger(self, event: Event) -> None:
        """Enter a turn for those whom an event concerns; one turn, however many events fire before it."""
        trigger = self._timing.trigger
        assert trigger is not None
        agents = concerned(event, trigger, self._group.name, self._row_of)
        if not agents:
            return
        if not self._called:
            run = self.run
            run.agenda.put(run.agenda.now, self.place, Phase.TURN, 0, self._answer)
        self._called.update([0] if self._is_group else agents)

    def _answer(self) -> None:
        rows = sorted(self._called)
        self._called.clear()
        self.take(rows)

    def take(self, rows: Sequence[int] | None = None) -> None:
        """Let the components of some rows, or of all, take a turn.

        Raises:
            RunError: One failed, and that ends the run.
        """
        if not self._plain:
            self._take_each(range(len(self.slot.components)) if rows is None else rows)
            return
        # One after the other, with nothing to think of: the hot loop.
        slot, run = self.slot, self.run
        component = slot.components[0]
        update, value = None, None
        run.interruption.unshield()
        try:
            if slot.turns and not self._simulation.events.turns_wanted:
                # What compute_and_update does where nobody listens, for half its price.
                turns = slot.turns if rows is None else [slot.turns[row] for row in rows]
                self.turns += len(turns)
                for component, compute, update in turns:  # noqa: B007 (tells which one raised)
                    value = compute()
                    update(value)
            else:
                components = slot.components if rows is None else [slot.components[row] for row in rows]
                self.turns += len(components)
                for component in components:
                    component.compute_and_update()
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            if update is not None and isinstance(error, Exception) and _is_raised_in(update, error):
                raise self.failure(component, describe(component.explained(value, error)), error) from error
            raise self.failure(component, describe(error), error) from error
        finally:
            run.interruption.shield()
        control, state = self._written
        if control.fresh or state.fresh:
            self.check(None)

    def _take_each(self, rows: Iterable[int]) -> None:
        """Some components, each looked at by itself."""
        rows = [row for row in rows if self._may(row)]
        if not rows:
            return
        self.turns += len(rows)
        before = self.present()
        if (self._takes_time or self._timing.in_process) and not self._coroutines:
            self._computation.begin(rows)
        else:
            components = self.slot.components
            with self.supervision.watched():
                for row in rows:
                    turn = self.begin_turn(row)
                    if self._coroutines:
                        Task(self, row, components[row], turn).start()
                    else:
                        with in_turn(components[row], turn):
                            self.attempt(row, components[row].compute_and_update)
        self.check(before)
        if self._timing.period == 0:
            for row in rows:
                if row not in self._busy:
                    self._again(row)

    def _may(self, row: int) -> bool:
        """Whether a component takes a turn that is due."""
        if self.supervision.keeps_off(row):
            return False
        if not self._holds(row):
            if self._timing.period == 0:
                self._wait_for_step(row)
            return False
        if row not in self._busy:
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
            self.fail(row, self.failure(self.slot.components[row], str(error), error))
            return False

    def _overrun(self, row: int) -> None:
        self.overruns += 1
        component, overrun = self.slot.components[row], self._timing.overrun
        said = {"skip": "is left out", "queue": "is put off", "fail": "is a failure"}[overrun]
        text = f"a turn is due while the one before still computes; it {said}"
        self._simulation.announce("overrun", component.path, text, level=Level.WARNING, overrun=overrun)
        if overrun == "fail":
            self.fail(row, self.failure(component, "a turn was due while the one before still computed"))
        elif overrun == "queue":
            self._backlog[row] += 1

    def over(self, row: int) -> None:
        """A turn that took time is over: take the ones that were put off, or the next one."""
        if self._backlog[row]:
            self._backlog[row] -= 1
            self._take_each([row])
        elif self._timing.period == 0:
            self._again(row)

    def _again(self, row: int) -> None:
        run = self.run
        run.agenda.put(run.agenda.now, self.place, Phase.TURN, row, partial(self.take, [row]))

    def _wait_for_step(self, row: int) -> None:
        """What takes turn after turn looks at a condition that does not hold once a step."""
        run = self.run
        time = run.next_step
        run.agenda.put(time, self.place, Phase.TURN, row, partial(self.take, [row]))

    def attempt(self, row: int, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call something of a component, with signals let through; what it raises is its failure."""
        interruption = self.run.interruption
        interruption.unshield()
        try:
            return call(*arguments)
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            problem = self.failure(self.slot.components[row], describe(error), error)
            self.fail(row, problem)
            return FAILED
        finally:
            interruption.shield()

    def failure(
        self, component: Component | GroupComponent, problem: str, cause: BaseException | None = None
    ) -> RunError:
        """What to say of a component that failed."""
        return RunError(component.path, self.slot.use, self._simulation.clock.now, problem, cause)

    def fail(self, row: int, failure: RunError, agents: Sequence[int] | None = None) -> None:
        """Do what the scenario says about a component that failed.

        Args:
            row: The component's row.
            failure: What happened.
            agents: The rows of the agents concerned, where those are not all that the component serves.

        Raises:
            RunError: The failure ends the run.
        """
        timing = self._timing
        if timing.on_failure == "stop" or (timing.on_failure == "restart" and self._tries[row] >= timing.tries):
            raise failure
        self.failures += 1
        self._simulation.announce("failed", failure.source, str(failure), level=Level.WARNING, **failure.data)
        if timing.on_failure == "restart":
            self._tries[row] += 1
            self.restart(row)
        else:
            everybody = range(len(self._group)) if self._is_group else [row]
            self.run.membership.retire(
                self._group, everybody if agents is None else agents, timing.coast, "a component failed"
            )

    def restart(self, row: int) -> None:
        """Give up what a component is doing and let it begin anew.

        Raises:
            RunError: It cannot.
        """
        component = self.slot.components[row]
        self._abandon(row)
        if self._timing.in_process:
            self.run.workers.restart(self.slot, row)
        self.slot.initialise_one(row, self._simulation.clock.now)
        tries = f", for the {_ordinal(self._tries[row])} of {self._timing.tries} times" if self._tries[row] else ""
        self._simulation.announce("restarted", component.path, f"begins anew{tries}", level=Level.WARNING)
        if self._timing.period == 0:
            self._wait_for_step(row)

    def hold(self, agent: int) -> None:
        """Let an agent take no part until it is released as often as it was held."""
        self.supervision.off[agent] += 1
        if not self._is_group:
            self._abandon(agent)
        self._review()

    def leave(self, agent: int) -> None:
        """Let an agent take no part here, as it runs in another process."""
        self.supervision.away.add(agent)
        self.hold(agent)

    def release(self, agent: int) -> None:
        """Let an agent take part again, unless there are other reasons against it."""
        self.supervision.release(agent)
        self._review()

    def begin_anew(self, agents: Sequence[int]) -> None:
        """Restart the components of some agents; one that serves the whole group only if it is for all of them."""
        if not self._is_group:
            for row in agents:
                self.restart(row)
        elif len(agents) == len(self._group):
            self.restart(0)

    def slow_down(self, agents: Sequence[int], duration: Duration) -> None:
        """Let computations take another time than the scenario says for the component."""
        self.supervision.slow_down([0] if self._is_group else agents, duration)
        self._review()

    def speed_up(self, agents: Sequence[int], duration: Duration) -> None:
        """Take back once what `slow_down` said."""
        self.supervision.speed_up([0] if self._is_group else agents, duration)
        self._review()

    def disturb(self, disturbance: Disturb) -> None:
        """Call something after each turn, with the group and the rows of the believed states that it wrote."""
        self.supervision.disturbances.append(disturbance)
        self._review()

    def undisturb(self, disturbance: Disturb) -> None:
        """Call it no more."""
        self.supervision.disturbances.remove(disturbance)
        self._review()

    def _abandon(self, row: int) -> None:
        doing = self._busy.pop(row, None)
        self._backlog.pop(row, None)
        if not isinstance(doing, Task):
            return
        try:
            doing.close()
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            failure = self.failure(doing.component, f"cannot give up its turn: {describe(error)}", error)
            self._simulation.announce("failed", failure.source, str(failure), level=Level.WARNING, **failure.data)

    def end(self) -> list[str]:
        """Give up all that is under way, and name what was waited for without an end in sight."""
        tasks = [each for each in self._busy.values() if isinstance(each, Task)]
        waiting = [f"{each.component.path} for {each.waiting}" for each in tasks if each.waits_for_others]
        for row in list(self._busy):
            self._abandon(row)
        return waiting

    def resume(self, call: Callable[[Any], None], value: Any) -> None:
        """Go on with a turn that waited for something."""
        if not self._guarded:
            call(value)
            self.check(None)
            return
        before = self.present()
        with self.supervision.watched():
            call(value)
        self.check(before)

    def begin_turn(self, row: int) -> Turn:
        """Tell the turn of a component that begins now from all others."""
        return self._turns.begin(row, self._simulation.clock.now)

    def occupy(self, row: int, turn: object) -> None:
        """A component is busy with a turn that may take time."""
        self._busy[row] = turn

    def vacate(self, row: int, turn: object) -> bool:
        """A component is done with a turn; False if it was made to give it up before."""
        if self._busy.get(row) is not turn:
            return False
        del self._busy[row]
        return True

    def present(self) -> Sequence[Array] | None:
        """What stands in the columns, to go back to if it is overwritten with what is not finite."""
        return None if self._timing.on_failure == "stop" else self._scrutiny.present()

    def check(self, before: Sequence[Array] | None) -> None:
        """Look for what is not finite in what was written.

        Raises:
            RunError: Something is not, and that ends the run.
        """
        ids, name, now = self._group.ids, self.slot.name, self._simulation.clock.now
        for rows, problem in self._scrutiny.offences(before):
            others = f", and so for {len(rows) - 1} more agents" if len(rows) > 1 else ""
            failure = RunError(f"agents.{ids[rows[0]]}.{name}", self.slot.use, now, problem + others)
            if before is None:
                raise failure
            if self._is_group:
                self.fail(0, failure, rows)
                continue
            for row in rows:
                self.fail(row, RunError(f"agents.{ids[row]}.{name}", self.slot.use, now, problem.partition(":")[0]))


def _is_coroutine(component: Component | GroupComponent) -> bool:
    """Whether a component takes its turns in its own way in the asynchronous mode."""
    kind, base = type(component), Component
    return any(
        getattr(kind, name) is not getattr(base, name)
        for name in ("_async_compute", "_async_update", "async_compute_and_update")
    )


def _is_raised_in(method: Any, error: Exception) -> bool:
    """Whether an exception came out of a method that was called where it is caught."""
    trace = error.__traceback__ and error.__traceback__.tb_next
    return trace is not None and trace.tb_frame.f_code is method.__code__


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")
