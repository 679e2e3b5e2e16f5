"""A run: from the first instant to the last, in either mode.

Both modes are one loop over the instants of simulated time. In the synchronous mode all instants are steps of the
world; in the asynchronous mode components have instants of their own in between, and may wait within their turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Level, SubscriberError
from symaware_cli.core.column import Array, Column
from symaware_cli.recording.error import LogError
from symaware_cli.runtime.activity import Activity
from symaware_cli.runtime.agenda import Agenda, LivelockError
from symaware_cli.runtime.blame import blame_circle, blame_subscriber
from symaware_cli.runtime.departure import deadline, exits_refused, leave
from symaware_cli.runtime.expression import EvaluationError, Expression
from symaware_cli.runtime.failure import RunError, describe
from symaware_cli.runtime.interruption import Interrupted, Interruption
from symaware_cli.runtime.membership import Membership
from symaware_cli.runtime.motion import Motion
from symaware_cli.runtime.pacer import Pacer
from symaware_cli.runtime.scope import WorldScope
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.runtime.summary import Observer, Summary, summarise
from symaware_cli.runtime.switchboard import Switchboard
from symaware_cli.runtime.terms import Terms
from symaware_cli.runtime.witness import witness
from symaware_cli.runtime.workers import Workers

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder
    from symaware_cli.runtime.distributed.company import Company
    from symaware_cli.runtime.outside import Outside

#: Wall time between two calls of the progress callback [s].
_PROGRESS_INTERVAL = 0.1


def run(
    simulation: Simulation,
    steps: int,
    recorder: Recorder | None = None,
    on_progress: Callable[[int], None] | None = None,
    terms: Terms | None = None,
    company: Company | None = None,
) -> Summary:
    """Run a simulation to its end, its failure or its interruption.

    Whatever ends it, the log is finished first.

    Args:
        simulation: What to run; it cannot be run twice.
        steps: How many steps to make, at most.
        recorder: Where to write it down.
        on_progress: Called now and then with simulated time in nanoseconds.
        terms: In which way to run; by default in the synchronous mode, as fast as possible.
        company: What this process is among those that share the run; None where it is alone.

    Raises:
        LogError: The log cannot be written.
    """
    return Run(simulation, steps, recorder, on_progress, terms or Terms(), company).execute()


class Run:
    """One run, and what the turns of its components share.

    Attributes:
        simulation: What runs.
        agenda: What is to happen when.
        activities: The turns of each slot.
        membership: Which agents take part.
        switchboard: Connects events with what they trigger.
        interruption: Holds signals back and lets them through.
        motion: What the world does.
        asynchronous: Whether components may wait within their turns.
        workers: The processes of components that compute in one of their own.
        recorder: Writes it down; None where nobody does.
        observer: Watches it for what the summary tells.
        outside: What lets components await real input and output; None where they must not.
        next_step: The next instant at which the world will have moved, in nanoseconds.
        ongoing_faults: What ends each fault that has begun, by its name.
        pacer: What ties simulated time to wall time; None where nothing does.
        began: The first instant, in nanoseconds: later than 0 where this process joined a run of others.
        done: How many steps were made.
        is_under_way: Whether the first instant has come.
        is_at_step: Whether the present instant is one at which the world has moved.
        status: How it ended, as `Summary` says it; None while it goes on.
        failure: Why it failed, if it did.
        signal: The signal that ended it, or came as it ended by itself; None where there was none.
        imposed: Control inputs that stand in for what the components of a group request, whatever that is: which rows,
            and what for each row of the group.
    """

    def __init__(
        self,
        simulation: Simulation,
        steps: int,
        recorder: Recorder | None,
        on_progress: Callable[[int], None] | None,
        terms: Terms,
        company: Company | None = None,
    ) -> None:
        self.simulation = simulation
        self.asynchronous = terms.mode == "asynchronous"
        self.agenda = Agenda(0 if self.asynchronous else simulation.environment.time_step)
        self.switchboard = Switchboard(simulation.events)
        self.interruption = Interruption(terms.timeout, terms.turn_limit, self._give_up if terms.may_exit else None)
        self.next_step = simulation.environment.time_step
        self.motion = Motion(simulation, self.interruption)
        self.began = 0
        self.is_under_way = self.is_at_step = False
        self.done = 0
        self.status: str | None = None
        self.failure: RunError | None = None
        self.signal: int | None = None
        self.imposed: dict[AgentGroup, tuple[NDArray[np.bool_], Array]] = {}
        self._terms = terms
        self._company = company
        self._steps = steps
        self.recorder = recorder
        self._on_progress = on_progress
        self._progress_due = 0.0
        self._waited = 0.0  # for others, before the run [s]
        self._spent = 0.0  # wall time in this run's own hands [s]
        self._course = self._begin_to_end()
        self.observer = Observer(simulation)
        self._world = WorldScope(simulation, self.observer)
        self.pacer = Pacer(terms.pace) if terms.pace else None
        self.outside: Outside | None = None
        remote = [slot for slot in simulation.slots if slot.timing.in_process]
        self.workers = Workers(simulation, remote, terms.workers)
        self.ongoing_faults: dict[str, Callable[[], None]] = {}
        if recorder:
            witness(recorder, simulation, self.interruption, company)
            if self.pacer:
                recorder.pace = self.pacer.kept.figures
        self.activities = [Activity(self, slot, place) for place, slot in enumerate(simulation.slots)]
        self.membership = Membership(simulation, self.activities)
        if self.pacer and any(activity.awaits for activity in self.activities):
            # asyncio takes as long to import as a short run does.
            from symaware_cli.runtime.outside import Outside

            self.outside = Outside()

    def execute(self) -> Summary:
        """Make the run, whatever becomes of it, and finish its log.

        Raises:
            LogError: The log cannot be written.
        """
        self.advance()
        return self.summary

    def advance(self, steps: int | None = None) -> None:
        """Make some steps, or fewer where the run ends before; its log is finished with its end.

        The first call lets the components take up their work, even if no steps are asked for. Between two calls no turn
        is in progress, and nothing of the process is as the run needs it: signals are handled as before.

        Args:
            steps: How many; None for all that are left.

        Raises:
            LogError: The log cannot be written.
        """
        with self._in_progress():
            try:
                ending = self._proceed(steps)
                if ending is None:
                    self.interruption.unshield()
                    self.interruption.shield()
                else:
                    self._end("finished", ending)
                    # It came too late for the run, and not for whoever made it.
                    self.signal = self.interruption.held
            except Interrupted as signal:
                self.signal = signal.number
                self._cut_off(f"ended by {signal}")
            except RunError as error:
                self.interruption.shield()
                self._announce_end("failed", error.source, str(error), level=Level.ERROR, **error.data)
                self._end("failed", error.problem, error)
            except LogError as error:
                self._abandon("failed", str(error))
                raise

    def leave(self, reason: str) -> None:
        """End a run between two steps, unless it is over; its log ends with the present state.

        Args:
            reason: Why, in one sentence.

        Raises:
            LogError: The log cannot be written.
        """
        if self.status is not None:
            return
        with self._in_progress():
            if self.is_under_way:
                self.observer.look(self.simulation.clock.now)
                if self.recorder:
                    self.recorder.record(self.simulation.clock.now, self.done)
            self._cut_off(reason)

    @property
    def summary(self) -> Summary:
        """The figures of the run so far."""
        return summarise(self, self.status or "interrupted", self.failure, self._spent - self._waited)

    @contextmanager
    def _in_progress(self) -> Iterator[None]:
        """Have the process as a run needs it."""
        started = time.monotonic()
        # Numbers that are not finite fail where they are written, with who wrote them; a warning of NumPy would only
        # add noise.
        limit = self._terms.timeout if self._terms.may_exit else None
        with np.errstate(all="ignore"), self.interruption, deadline(limit, self.recorder), exits_refused():
            self.interruption.shield()
            try:
                yield
            except Interrupted as interrupted:
                # Somebody insisted while the run was about to end.
                raise KeyboardInterrupt(str(interrupted)) from None
            finally:
                self._spent += time.monotonic() - started

    def _proceed(self, steps: int | None) -> str | None:
        """Make some steps, and say why the run is over if it is."""
        course = self._course
        try:
            if not self.is_under_way:
                next(course)
            for _ in repeat(None) if steps is None else repeat(None, steps):
                next(course)
        except StopIteration as end:
            return str(end.value)
        return None

    def _cut_off(self, reason: str) -> None:
        self.interruption.shield()
        self._announce_end("interrupted", "run", reason, level=Level.WARNING)
        self._end("interrupted", reason)

    def _end(self, status: str, ending: str, failure: RunError | None = None) -> None:
        """Give up all that is under way, and finish the log."""
        self._abandon(status, ending, failure)
        if self.recorder:
            now = self.simulation.clock.now
            self.recorder.finish(now, self.done, {"status": status, "steps": self.done, "time": now})

    def _abandon(self, status: str, ending: str, failure: RunError | None = None) -> None:
        """Give up all that is under way."""
        self.status, self.failure = status, failure
        self._course.close()
        for activity in self.activities:
            # A subscriber that raises now has nothing to end any more.
            with suppress(SubscriberError, LogError):
                activity.end()
        if self._company:
            with suppress(SubscriberError, LogError):
                self._company.end(status, failure.problem if failure else ending, failure)
        if self.outside:
            self.outside.close()
        self.workers.close()

    def _give_up(self) -> None:
        """End the process: somebody insists, and the run does not come to its end."""
        said = "; the log ends without an outcome" if self.recorder else ""
        leave(130, f"interrupted again{said}", self.recorder)

    def _begin_to_end(self) -> Generator[None, None, str]:
        """Make the whole run with a pause before each step, and say why it ended where it did.

        Raises:
            RunError: Something went wrong, whatever it was.
            Interrupted: Somebody ended it.
            LogError: The log cannot be written.
        """
        simulation = self.simulation
        try:
            simulation.announce("started", "run", f"{simulation.agent_count} agents, seed {simulation.seed}")
            self.interruption.unshield(watched=False)
            simulation.initialise()
            self.workers.start()
            self.interruption.shield()
            if self._company:
                began = time.monotonic()
                self._company.begin(self)
                self._waited = time.monotonic() - began
            self.is_under_way = True
            for activity in self.activities:
                activity.begin()
            for fault in self._terms.faults:
                fault.await_turn(self)
            self.motion.announce_contacts()
            yield
            reason = yield from self._loop()
            waiting = [each for activity in self.activities for each in activity.end()]
            if waiting:
                reason += f"; {len(waiting)} turns still waited: {waiting[0]}" + (", ..." if len(waiting) > 1 else "")
            data = {"waiting": waiting} if waiting else {}
            simulation.announce("finished", "run", reason, level=Level.WARNING if waiting else Level.INFO, **data)
            return reason
        except SubscriberError as error:
            raise blame_subscriber(simulation, error) from error
        except LivelockError as error:
            raise blame_circle(simulation, error) from error
        except (RunError, LogError, Interrupted, GeneratorExit):
            raise
        except BaseException as error:
            raise RunError("run", "symaware", simulation.clock.now, describe(error), error) from error

    def _loop(self) -> Generator[None, None, str]:
        """Go from instant to instant with a pause before each step but the first, and say why the last was the last."""
        simulation, recorder, agenda = self.simulation, self.recorder, self.agenda
        entries = agenda.entries
        clock, exchange, observer = simulation.clock, simulation.exchange, self.observer
        time_step, until = simulation.environment.time_step, self._terms.until
        steady = [(each.place, each.take) for each in self.activities if each.is_steady]
        latched: list[tuple[Column, Array]] | None = None
        events, sent, arrival = simulation.events, -1, None
        if self.pacer:
            self.pacer.lead(0)  # the clock on the wall starts
        company = self._company
        decides = company is None or company.decides
        self.began = self.next_step = clock.now
        while True:
            now = clock.now
            steps = self.is_at_step = now == self.next_step
            if "iterating" in events.wanted:
                simulation.announce("iterating", "run")
            if steps or (arrival is not None and arrival <= now):
                exchange.deliver(now)
                sent = -1
            else:
                exchange.now = now
            if steps:
                if company:
                    company.arrived()
                self.next_step += time_step
                for place, take in steady:
                    if entries and entries[0][0] == now:
                        agenda.run(place)
                    agenda.place = place
                    take()
            if entries:
                agenda.run()
            while exchange.flush() and entries:
                agenda.run()
            if self.imposed:
                self._impose()
            if recorder:
                recorder.record(now, self.done)
            if "iterated" in events.wanted:
                simulation.announce("iterated", "run")
            if company:
                company.acted()
            if steps:
                observer.look(now)
                if until is not None and decides and self._is_over(until):
                    return f"{self.done} steps made; {until.text}"
                simulation.announce("stepping", "environment")
                latched = None
            upcoming = self.next_step
            if entries and entries[0][0] < upcoming:
                upcoming = entries[0][0]
            if self.asynchronous:
                # Messages arrive at instants of their own; only what was sent or delivered changes which is next.
                if exchange.sent != sent:
                    sent, arrival = exchange.sent, exchange.next_time
                if arrival is not None and arrival < upcoming:
                    upcoming = max(arrival, now + 1)
            if self.pacer:
                upcoming = self._sleep(self.pacer, upcoming)
            if upcoming < self.next_step and latched is None:
                # The world moves under what was requested when its step began, whatever comes in between.
                latched = [(group.control_column, group.control_input) for group in simulation.groups]
            if upcoming < self.next_step:
                clock.now = upcoming
                agenda.begin(upcoming)
                continue
            over = self._step_world(latched or ())
            if over:
                return f"{self.done} steps made; {over}"
            clock.now = upcoming
            agenda.begin(upcoming)
            self.done += 1
            self.motion.check()
            self.motion.announce_contacts()
            simulation.announce("stepped", "environment")
            if self._on_progress:
                self._progress(upcoming)
            if self.done == self._steps:
                break
            yield
        observer.look(clock.now)
        if recorder:
            recorder.record(clock.now, self.done)
        self.interruption.unshield()
        self.interruption.shield()
        return f"{self.done} steps made" + (f"; never {until.text}" if until is not None else "")

    def _impose(self) -> None:
        """Put control inputs in the place of those that components have requested."""
        for group, (rows, values) in self.imposed.items():
            requested = group.control_input
            if not np.array_equal(requested[rows], values[rows]):
                group.control_input = np.where(rows[:, None], values, requested)

    def _is_over(self, until: Expression) -> bool:
        try:
            return until.holds(self._world.look_up)
        except EvaluationError as error:
            raise RunError("run.until", "symaware", self.simulation.clock.now, str(error), error) from error

    def _sleep(self, pacer: Pacer, upcoming: int) -> int:
        """Wait until it is time for an instant, or for an earlier one at which something outside is done."""
        outside, agenda = self.outside, self.agenda
        self.interruption.unshield(watched=False)
        try:
            if outside is None:
                pacer.wait(upcoming)
                return upcoming
            while True:
                lead = pacer.lead(upcoming)
                ready = outside.wait(lead)
                self.interruption.unshield(watched=False)  # asyncio keeps what a signal raises in its callbacks
                if ready:
                    now = min(max(pacer.simulated(), agenda.now + 1), upcoming)
                    for call in ready:
                        call(now)
                    return now
                if pacer.lead(upcoming) <= 0.0:
                    pacer.note(-pacer.lead(upcoming))
                    return upcoming
        finally:
            self.interruption.shield()

    def join(self, step: int, time: int) -> None:
        """Begin where the world of others is by now.

        Args:
            step: How many steps were made.
            time: Simulated time, in nanoseconds.
        """
        self.done = step
        self.simulation.clock.now = time
        self.agenda.begin(time)

    @property
    def is_complete(self) -> bool:
        """Whether all steps were made."""
        return self.done == self._steps

    def _step_world(self, latched: Sequence[tuple[Column, Array]]) -> str | None:
        """Move the world, under control inputs that stand in for the present ones.

        Returns:
            Why the run is over, if others say so.
        """
        present = [(column, column.exchange(values)) for column, values in latched]
        try:
            if self._company:
                return self._company.step()
            self.motion.step()
            return None
        finally:
            for column, values in present:
                column.exchange(values)

    def _announce_end(self, name: str, source: str, text: str, level: Level, **data: Any) -> None:
        with suppress(SubscriberError):
            self.simulation.exchange.flush()
        try:
            self.simulation.announce(name, source, text, level=level, **data)
        except SubscriberError:
            # The run is over, and one subscriber that raises does not keep the others, the recorder among them,
            # from being told.
            return

    def _progress(self, now: int) -> None:
        monotonic = time.monotonic()
        if monotonic >= self._progress_due and self._on_progress:
            self._progress_due = monotonic + _PROGRESS_INTERVAL
            self._on_progress(now)
