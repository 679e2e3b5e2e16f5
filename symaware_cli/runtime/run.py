"""A run: from the first instant to the last, in either mode, whatever ends it.

Both modes are one loop over the instants of simulated time. In the synchronous mode all instants are steps of the
world; in the asynchronous mode components have instants of their own in between, and may wait within their turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import contextmanager, suppress
from itertools import repeat
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.column import Array
from symaware_cli.core import AgentGroup, Level, SubscriberError
from symaware_cli.recording.error import LogError
from symaware_cli.runtime.attribution import attribute_livelock, attribute_subscriber_error
from symaware_cli.runtime.awaiting import Awaiter
from symaware_cli.runtime.coroutine import is_coroutine
from symaware_cli.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.runtime.event_recorder import record_events
from symaware_cli.runtime.event_router import EventRouter
from symaware_cli.runtime.failure import RunError, describe
from symaware_cli.runtime.fault_scheduler import FaultScheduler
from symaware_cli.runtime.interruption import Interrupted, Interruption
from symaware_cli.runtime.kernel import Kernel
from symaware_cli.runtime.membership import Membership
from symaware_cli.runtime.options import RunOptions
from symaware_cli.runtime.pacer import Pacer
from symaware_cli.runtime.process_exit import deadline, exits_refused, leave
from symaware_cli.runtime.queue import LivelockError, Queue
from symaware_cli.runtime.run_summary import Observer, RunSummary, summarise
from symaware_cli.runtime.scheduler import TurnScheduler
from symaware_cli.runtime.shared import Shared, Sharing
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.runtime.simulation_hooks import SimulationHooks
from symaware_cli.runtime.specifications import Specifications
from symaware_cli.runtime.workers import Workers

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder
    from symaware_cli.runtime.asyncio_bridge import AsyncioBridge


def run(
    simulation: Simulation,
    steps: int,
    recorder: Recorder | None = None,
    on_progress: Callable[[int], None] | None = None,
    options: RunOptions | None = None,
    participant: Sharing | None = None,
) -> RunSummary:
    """Run a simulation to its end, its failure or its interruption.

    Whatever ends it, the log is finished first.

    Args:
        simulation: What to run; it cannot be run twice.
        steps: How many steps to make, at most.
        recorder: Where to write it down.
        on_progress: Called now and then with simulated time in nanoseconds.
        options: In which way to run; by default in the synchronous mode, as fast as possible.
        participant: What this process is among those that share the run; None where it is alone.

    Raises:
        LogError: The log cannot be written.
    """
    return Run(simulation, steps, recorder, on_progress, options or RunOptions(), participant).execute()


class Run:
    """One run: puts together what it takes, makes the steps, and finishes the log.

    Nobody but who started it is handed the run: each of its parts is given what it needs.

    Attributes:
        simulation: What runs.
        kernel: Goes from instant to instant.
        schedulers: The turns of each entry.
        membership: Which agents take part.
        recorder: Writes it down; None where nobody does.
        status: How it ended, as `RunSummary` says it; None while it goes on.
        failure: Why it failed, if it did.
        signal: The signal that ended it, or came as it ended by itself; None where there was none.
    """

    #: What is the same in every run of the scenario, or belongs to the process.
    uncaptured: ClassVar[Collection[str]] = (
        *("recorder", "_options", "_participant", "_course"),
        *("_on_progress", "_progress_due", "_waited", "_spent"),
    )

    def __init__(
        self,
        simulation: Simulation,
        steps: int,
        recorder: Recorder | None,
        on_progress: Callable[[int], None] | None,
        options: RunOptions,
        participant: Sharing | None = None,
    ) -> None:
        self.simulation = simulation
        self.recorder = recorder
        self.status: str | None = None
        self.failure: RunError | None = None
        self.signal: int | None = None
        self._options = options
        self._participant = participant
        is_asynchronous = options.mode == "asynchronous"
        time_step = simulation.environment.time_step
        queue = Queue(simulation.clock, 0 if is_asynchronous else time_step)
        router = EventRouter(simulation.events)
        self.kernel = Kernel(queue, time_step, steps)
        self._interruption = Interruption(
            options.timeout, options.turn_limit, self._give_up if options.may_exit else None
        )
        self._motion = EnvironmentStepper(simulation, self._interruption)
        self._waited = 0.0  # for others, before the run [s]
        self._spent = 0.0  # wall time in this run's own hands [s]
        self._course = self._begin_to_end()
        self._observer = Observer(simulation)
        self._pacer = Pacer(options.pace) if options.pace else None
        self._workers = Workers(
            simulation, [entry for entry in simulation.entries if entry.timing.in_process], options.workers
        )
        if recorder:
            record_events(recorder, simulation, self._interruption, participant)
            if self._pacer:
                recorder.pace = self._pacer.kept.figures
        components = [each for entry in simulation.entries for each in entry.components]
        self._bridge: AsyncioBridge | None = None
        if is_asynchronous and self._pacer and any(is_coroutine(each) for each in components):
            # asyncio takes as long to import as a short run does.
            from symaware_cli.runtime.asyncio_bridge import AsyncioBridge

            self._bridge = AsyncioBridge()
        self.schedulers: list[TurnScheduler] = []
        self.membership = Membership(simulation, self.schedulers, options.presence, self._observer, router)
        awaiter = Awaiter(router, simulation.exchange, self._bridge) if is_asynchronous else None
        self.schedulers += [
            TurnScheduler(
                simulation,
                entry,
                place,
                queue=queue,
                router=router,
                interruption=self._interruption,
                workers=self._workers,
                isolate=self.membership.retire,
                awaiter=awaiter,
            )
            for place, entry in enumerate(simulation.entries)
        ]
        self.kernel.steady = [(each.place, each.take) for each in self.schedulers if each.is_steady]
        self._faults = FaultScheduler(
            options.faults, simulation, self.schedulers, self.membership, self._motion, queue, router
        )
        self._specifications = Specifications(
            simulation,
            options.specifications,
            options.instances,
            router,
            self._observer,
            recorder,
            decides=participant is None or participant.decides,
        )
        self._instants = SimulationHooks(
            simulation,
            self.kernel,
            self._motion,
            self._observer,
            self.membership,
            self._interruption,
            is_asynchronous=is_asynchronous,
            until=options.until,
            recorder=recorder,
            pacer=self._pacer,
            bridge=self._bridge,
            sharing=participant,
            specifications=self._specifications,
            on_progress=on_progress,
        )

    @property
    def imposed(self) -> dict[AgentGroup, tuple[NDArray[np.bool_], Array]]:
        """Control inputs that stand in for what components request; see `SimulationHooks`."""
        return self._instants.imposed

    @property
    def done(self) -> int:
        """How many steps were made."""
        return self.kernel.done

    def execute(self) -> RunSummary:
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
                    self._interruption.unshield()
                    self._interruption.shield()
                else:
                    self._end("finished", ending)
                    # It came too late for the run, and not for whoever made it.
                    self.signal = self._interruption.held
            except Interrupted as signal:
                self.signal = signal.number
                self._cut_off(f"ended by {signal}")
            except RunError as error:
                self._interruption.shield()
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
            if self.kernel.has_begun:
                self._observer.look(self.simulation.clock.now)
                if self.recorder:
                    self.recorder.record(self.simulation.clock.now, self.done)
            self._cut_off(reason)

    @property
    def summary(self) -> RunSummary:
        """The figures of the run so far."""
        return summarise(
            self.simulation,
            self._observer,
            self.recorder,
            status=self.status or "interrupted",
            agents=self.simulation.agent_count - len(self.membership.waiting),
            turns=sum(each.turns for each in self.schedulers),
            overruns=sum(each.overruns for each in self.schedulers),
            failures=sum(each.failures for each in self.schedulers),
            steps=self.done,
            began=self.kernel.began,
            wall_time=self._spent - self._waited,
            pace=self._pacer.kept if self._pacer else None,
            failure=self.failure,
            specifications=self._specifications.outcomes(),
        )

    @contextmanager
    def _in_progress(self) -> Iterator[None]:
        """Have the process as a run needs it."""
        started = time.monotonic()
        # Numbers that are not finite fail where they are written, with who wrote them; a warning of NumPy would only
        # add noise.
        limit = self._options.timeout if self._options.may_exit else None
        with np.errstate(all="ignore"), self._interruption, deadline(limit, self.recorder), exits_refused():
            self._interruption.shield()
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
            if not self.kernel.has_begun:
                next(course)
            for _ in repeat(None) if steps is None else repeat(None, steps):
                next(course)
        except StopIteration as end:
            return str(end.value)
        return None

    def _cut_off(self, reason: str) -> None:
        self._interruption.shield()
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
        for scheduler in self.schedulers:
            # A subscriber that raises now has nothing to end any more.
            with suppress(SubscriberError, LogError):
                scheduler.end()
        if self._participant:
            with suppress(SubscriberError, LogError):
                self._participant.end(status, failure.problem if failure else ending, failure)
        if self._bridge:
            self._bridge.close()
        self._workers.close()

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
            self._begin()
            yield
            if self._pacer:
                self._pacer.lead(0)  # the clock on the wall starts
            over = yield from self.kernel.run(self._instants)
            reason = f"{self.done} steps made"
            if over is not None:
                reason += f"; {over}"
            else:
                over = self._instants.look_last()
                if over is not None:
                    reason += f"; {over}"
                elif self._options.until is not None:
                    reason += f"; never {self._options.until.text}"
            self._specifications.finish(simulation.clock.now)
            waiting = [each for scheduler in self.schedulers for each in scheduler.end()]
            if waiting:
                reason += f"; {len(waiting)} turns still waited: {waiting[0]}" + (", ..." if len(waiting) > 1 else "")
            data = {"waiting": waiting} if waiting else {}
            simulation.announce("finished", "run", reason, level=Level.WARNING if waiting else Level.INFO, **data)
            return reason
        except SubscriberError as error:
            raise attribute_subscriber_error(simulation, error) from error
        except LivelockError as error:
            raise attribute_livelock(simulation, error) from error
        except (RunError, LogError, Interrupted, GeneratorExit):
            raise
        except BaseException as error:
            raise RunError("run", "symaware", simulation.clock.now, describe(error), error) from error

    def _begin(self) -> None:
        """Let the components take up their work, and enter what is to happen."""
        simulation = self.simulation
        simulation.announce("started", "run", f"{simulation.agent_count} agents, seed {simulation.seed}")
        self._interruption.unshield(watched=False)
        simulation.initialise()
        self._workers.start()
        self._interruption.shield()
        if self._participant:
            began = time.monotonic()
            self._participant.begin(
                Shared(
                    simulation=simulation,
                    kernel=self.kernel,
                    schedulers=self.schedulers,
                    motion=self._motion,
                    observer=self._observer,
                    interruption=self._interruption,
                    pacer=self._pacer,
                    asynchronous=self._options.mode == "asynchronous",
                )
            )
            self._waited = time.monotonic() - began
        self.kernel.has_begun = True
        self.membership.begin()
        for scheduler in self.schedulers:
            scheduler.begin()
        self._faults.begin()
        self._motion.announce_contacts()

    def _announce_end(self, name: str, source: str, text: str, level: Level, **data: Any) -> None:
        with suppress(SubscriberError):
            self.simulation.exchange.flush()
        try:
            self.simulation.announce(name, source, text, level=level, **data)
        except SubscriberError:
            # The run is over, and one subscriber that raises does not keep the others, the recorder among them,
            # from being told.
            return
