"""Runs a simulation from its first instant to its last, in either mode, and finishes its log.

Both modes are one loop over the instants of simulated time. In the synchronous mode all instants are steps of the
world; in the asynchronous mode components may have instants in between, and their turns may wait.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import Array, NotFiniteError
from symaware_cli.core import AgentGroup, Level, SubscriberError, seconds
from symaware_cli.core.component import may_wait
from symaware_cli.core.stateful import StateError
from symaware_cli.engine.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.engine.runtime.event_router import EventRouter
from symaware_cli.engine.runtime.failure import RunError, describe
from symaware_cli.engine.runtime.fault import Fault
from symaware_cli.engine.runtime.fault_scheduler import FaultScheduler
from symaware_cli.engine.runtime.interruption import Interrupted, Interruption
from symaware_cli.engine.runtime.kernel import Kernel
from symaware_cli.engine.runtime.membership import Membership
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.pacer import Pacer
from symaware_cli.engine.runtime.process_exit import ExitsRefused, deadline, end_process
from symaware_cli.engine.runtime.queue import LivelockError, Queue
from symaware_cli.engine.runtime.recording import RecordingError, RunRecording
from symaware_cli.engine.runtime.run_summary import Observer, RunSummary
from symaware_cli.engine.runtime.scheduler import TurnScheduler
from symaware_cli.engine.runtime.shared import Shared, Sharing
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.simulation_hooks import SimulationHooks
from symaware_cli.engine.runtime.specifications import Specifications
from symaware_cli.engine.runtime.workers import Workers

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.asyncio_bridge import AsyncioBridge
    from symaware_cli.specification import SpecificationMonitor


def run(
    simulation: Simulation,
    steps: int,
    recorder: RunRecording | None = None,
    on_progress: Callable[[int], None] | None = None,
    options: RunOptions | None = None,
    participant: Sharing | None = None,
) -> RunSummary:
    """Run a simulation until it ends, fails or is interrupted.

    The log is finished in each of these cases.

    Args:
        simulation: The simulation; it cannot be run twice.
        steps: The greatest number of steps to make.
        recorder: Writes the log; None for no log.
        on_progress: Called at intervals of wall time with simulated time in nanoseconds.
        options: The options of the run; by default synchronous and as fast as possible.
        participant: The role of this process in a run of several processes; None in a run of one process.

    Raises:
        RecordingError: The log cannot be written.
    """
    return Run(simulation, steps, recorder, on_progress, options or RunOptions(), participant).execute()


class Run:
    """One run: creates its parts, makes the steps, and finishes the log.

    Only the caller holds the run itself; each part is given just the objects that it needs.

    Attributes:
        simulation: The simulation.
        kernel: Advances simulated time.
        schedulers: The turn scheduler of each entry.
        membership: Takes agents out of the run and back in.
        recorder: Writes the log; None without a log.
        status: How the run ended, as in `RunSummary`; None while it is running.
        failure: Why it failed, if it did.
        signal: The signal that interrupted it, or that arrived as it ended; None without a signal.
    """

    #: These are the same in every run of the scenario, or belong to the process.
    uncaptured: ClassVar[Collection[str]] = (
        *("recorder", "_options", "_participant", "_generator"),
        *("_on_progress", "_progress_due", "_waiting_time", "_elapsed"),
    )

    def __init__(
        self,
        simulation: Simulation,
        steps: int,
        recorder: RunRecording | None,
        on_progress: Callable[[int], None] | None,
        options: RunOptions,
        participant: Sharing | None = None,
        observer: Observer | None = None,
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
        simulation.clock.end = steps * time_step
        self._interruption = Interruption(
            options.timeout, options.turn_limit, self._exit_process if options.may_exit else None
        )
        self._stepper = EnvironmentStepper(simulation, self._interruption)
        self._waiting_time = 0.0  # wall time spent waiting for other processes before the run [s]
        self._elapsed = 0.0  # wall time spent within this run [s]
        self._generator = self._run_all()
        self._observer = observer or Observer(simulation, is_member=participant is not None and not participant.decides)
        self._pacer = Pacer(options.pace) if options.pace else None
        self._workers = Workers(
            simulation, [entry for entry in simulation.entries if entry.timing.in_process], options.workers
        )
        if recorder:
            recorder.follow(simulation.events, self._interruption.shielded, participant)
            if self._pacer:
                recorder.pace = self._pacer.kept.figures
        components = [each for entry in simulation.entries for each in entry.components]
        self._bridge: AsyncioBridge | None = None
        if is_asynchronous and self._pacer and any(may_wait(type(each)) for each in components):
            # Importing asyncio takes as long as a short run.
            from symaware_cli.engine.runtime.asyncio_bridge import AsyncioBridge

            self._bridge = AsyncioBridge()
        self.schedulers: list[TurnScheduler] = []
        self.membership = Membership(simulation, self.schedulers, options.presence, self._observer, router)
        awaiter = None
        if is_asynchronous:
            from symaware_cli.engine.runtime.awaiting import Awaiter

            awaiter = Awaiter(router, simulation.exchange, self._bridge)
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
            options.faults, simulation, self.schedulers, self.membership, self._stepper, queue, router
        )
        self._specifications = Specifications(
            simulation,
            options.specifications,
            options.instances,
            router,
            self._observer,
            recorder,
            decides=participant is None or participant.decides,
            takes_part=self.membership.takes_part,
        )
        self._hooks = SimulationHooks(
            simulation,
            self.kernel,
            self._stepper,
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
        """Control inputs that override those requested by components; see `SimulationHooks`."""
        return self._hooks.imposed

    @property
    def specification_monitors(self) -> Sequence[SpecificationMonitor]:
        """The monitors of the specifications, in the scenario's order."""
        return tuple(self._specifications.monitors.values())

    @property
    def log_writers(self) -> Mapping[str, object]:
        """The objects that write the log and have state, by their names in messages; empty without a log."""
        writers = {"the log": self.recorder, "the log of specifications": self._specifications.recorder}
        return {name: each for name, each in writers.items() if each is not None}

    @property
    def done(self) -> int:
        """The number of steps made."""
        return self.kernel.done

    def execute(self) -> RunSummary:
        """Run until the end, and finish the log.

        Raises:
            RecordingError: The log cannot be written.
        """
        self.advance()
        return self.summary

    def advance(self, steps: int | None = None, until: Callable[[], bool] | None = None) -> None:
        """Make some steps, or fewer if the run ends before; the log is finished when the run ends.

        The first call initialises the components, even if no steps are requested. Between two calls no turn is in
        progress, and the process is as it was before the run: signals are handled as before.

        Args:
            steps: The number of steps; None for all remaining ones.
            until: Returns, after each step, whether no further ones are to be made.

        Raises:
            RecordingError: The log cannot be written.
        """
        with self._in_progress():
            try:
                ending = self._make_steps(steps, until)
                if ending is None:
                    self._interruption.unshield()
                    self._interruption.shield()
                else:
                    self._end("finished", ending)
                    # Too late to interrupt the run; the caller may still act on it.
                    self.signal = self._interruption.held
            except Interrupted as signal:
                self.signal = signal.number
                self._end_interrupted(f"ended by {signal}")
            except RunError as error:
                self._interruption.shield()
                self._announce_end("failed", error.source, str(error), level=Level.ERROR, **error.data)
                self._end("failed", error.problem, error)
            except RecordingError as error:
                self._shut_down("failed", str(error))
                raise

    def check_reopening(self) -> None:
        """Check that a run that is over can go on from an earlier state.

        Raises:
            StateError: It cannot; the message gives the reason.
        """
        reasons = {
            "its log is finished": self.recorder,
            "its connections to other processes are closed": self._participant,
            "its workers have ended": any(entry.timing.in_process for entry in self.simulation.entries),
            "it has a pace": self._pacer,
        }
        for reason, holds in reasons.items():
            if holds:
                raise StateError(f"the run of {self.simulation.name} is over, and {reason}: it cannot go on")

    def reopen(self) -> None:
        """Let a run that is over, or within a step, go on once an earlier state is restored."""
        self._generator.close()
        self.status = self.failure = self.signal = None
        self._generator = self._run_all()

    @property
    def faults(self) -> Sequence[Fault]:
        """The faults of the scenario."""
        return self._faults.faults

    def begin_faults(self, first: int) -> None:
        """Queue the faults from an index on, after a state of a run without them was restored."""
        self._faults.begin(first)

    def begin_fault(self, index: int) -> None:
        """Let a fault that has no time and no event begin at the present instant; see `FaultScheduler.start`."""
        self._faults.start(index)

    def leave(self, reason: str) -> None:
        """End the run between two steps, unless it has ended; its log ends with the present state.

        Args:
            reason: Why the run ends, in one sentence.

        Raises:
            RecordingError: The log cannot be written.
        """
        if self.status is not None:
            return
        with self._in_progress():
            if self.kernel.has_begun:
                self._observer.sample(self.simulation.clock.now)
                if self.recorder:
                    self.recorder.record(self.simulation.clock.now, self.done)
            self._end_interrupted(reason)

    @property
    def summary(self) -> RunSummary:
        """The figures of the run so far."""
        simulation, observer, recorder, failure = self.simulation, self._observer, self.recorder, self.failure
        return RunSummary(
            name=simulation.name,
            seed=simulation.seed,
            status=self.status or "interrupted",
            agents=simulation.agent_count - self.membership.never_present,
            steps=self.done,
            simulated_time=seconds(simulation.clock.now),
            wall_time=self._elapsed - self._waiting_time,
            updates=recorder.updates if recorder else 0,
            contacts=observer.contacts,
            minimum_separation=observer.minimum_separation,
            highest_risk=observer.highest_risk,
            goals_reached=tuple(sorted(observer.goals)),
            log=str(recorder.path) if recorder else None,
            log_size=recorder.size if recorder else None,
            failure=str(failure) if failure else None,
            traceback=failure.trace or None if failure else None,
            turns=sum(each.turns for each in self.schedulers),
            overruns=sum(each.overruns for each in self.schedulers),
            failures=sum(each.failures for each in self.schedulers),
            warnings=dict(sorted(observer.warnings.items())),
            errors=dict(sorted(observer.errors.items())),
            pace=self._pacer.kept if self._pacer else None,
            began=seconds(self.kernel.began),
            specifications=self._specifications.outcomes(),
            on_contact=simulation.environment.on_contact,
        )

    @contextmanager
    def _in_progress(self) -> Iterator[None]:
        """Set up the process for a run: NumPy's warnings, signals, the time-out, and `os._exit`."""
        started = time.monotonic()
        # Numbers that are not finite are failures of the components that write them; NumPy's warnings add nothing.
        limit = self._options.timeout if self._options.may_exit else None
        with np.errstate(all="ignore"), self._interruption, deadline(limit, self.recorder), ExitsRefused():
            self._interruption.shield()
            try:
                yield
            except Interrupted as interrupted:
                # A second signal, delivered while the run was ending.
                raise KeyboardInterrupt(str(interrupted)) from None
            finally:
                self._elapsed += time.monotonic() - started

    def _make_steps(self, steps: int | None, until: Callable[[], bool] | None) -> str | None:
        """Make some steps, and return why the run ended, if it did."""
        generator = self._generator
        try:
            if not self.kernel.has_begun:
                next(generator)
            for _ in repeat(None) if steps is None else repeat(None, steps):
                next(generator)
                if until is not None and until():
                    break
        except StopIteration as end:
            return str(end.value)
        return None

    def _end_interrupted(self, reason: str) -> None:
        self._interruption.shield()
        self._announce_end("interrupted", "run", reason, level=Level.WARNING)
        self._end("interrupted", reason)

    def _end(self, status: str, ending: str, failure: RunError | None = None) -> None:
        """Cancel unfinished turns, and finish the log."""
        self._shut_down(status, ending, failure)
        if self.recorder:
            now = self.simulation.clock.now
            outcome: dict[str, Any] = {"status": status, "steps": self.done, "time": now}
            if self._specifications.decides:
                outcome["specifications"] = [each.to_json() for each in self._specifications.outcomes()]
                if status != "finished":
                    outcome["evaluated"] = self._specifications.looked
                    outcome["complete"] = self._specifications.is_finished
            self.recorder.finish(now, self.done, outcome)

    def _shut_down(self, status: str, ending: str, failure: RunError | None = None) -> None:
        """Cancel unfinished turns, and close the connections to other processes."""
        self.status, self.failure = status, failure
        self._generator.close()
        for scheduler in self.schedulers:
            # The run has ended already, so errors of subscribers are ignored.
            with suppress(SubscriberError, RecordingError):
                scheduler.end()
        if self._participant:
            with suppress(SubscriberError, RecordingError):
                self._participant.end(status, failure.problem if failure else ending, failure)
        if self._bridge:
            self._bridge.close()
        self._workers.close()

    def _exit_process(self) -> None:
        """End the process, as the run did not end after a second signal."""
        note = "; the log ends without an outcome" if self.recorder else ""
        end_process(130, f"interrupted again{note}", self.recorder)

    def _run_all(self) -> Generator[None, None, str]:
        """Make the whole run, yielding before each step; return why it ended.

        Raises:
            RunError: The run failed.
            Interrupted: A signal or a time-out ended the run.
            RecordingError: The log cannot be written.
        """
        simulation = self.simulation
        try:
            if not self.kernel.has_begun:
                self._begin()
                yield
            if self._pacer:
                self._pacer.lead(0)  # wall time starts here
            over = yield from self.kernel.run(self._hooks)
            reason = f"{self.done} steps made"
            if over is not None:
                reason += f"; {over}"
            else:
                over = self._hooks.observe_end()
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
            raise simulation.subscriber_failure(error) from error
        except LivelockError as error:
            raise simulation.livelock_failure(error) from error
        except (RunError, RecordingError, Interrupted, GeneratorExit):
            raise
        except NotFiniteError as error:
            raise RunError(error.path, error.use, simulation.clock.now, str(error), error) from error
        except BaseException as error:
            raise RunError("run", "symaware", simulation.clock.now, describe(error), error) from error

    def _begin(self) -> None:
        """Initialise the components, and queue the first turns and the faults."""
        simulation = self.simulation
        simulation.announce("started", "run", f"{simulation.agent_count} agents, seed {simulation.seed}")
        self._interruption.unshield(watched=False)
        simulation.initialise()
        self._workers.start()
        self._interruption.shield()
        if self._participant:
            # Imported here, because it is slow to load.
            from symaware_cli.engine.runtime.state.capture import capture, restore

            began = time.monotonic()
            self._participant.begin(
                Shared(
                    simulation=simulation,
                    kernel=self.kernel,
                    schedulers=self.schedulers,
                    membership=self.membership,
                    motion=self._stepper,
                    observer=self._observer,
                    interruption=self._interruption,
                    pacer=self._pacer,
                    asynchronous=self._options.mode == "asynchronous",
                    capture=partial(capture, self),
                    restore=partial(restore, self),
                )
            )
            self._waiting_time = time.monotonic() - began
        self.kernel.has_begun = True
        self.membership.begin()
        for scheduler in self.schedulers:
            scheduler.begin()
        self._faults.begin()
        self._stepper.announce_contacts()
        if self._participant:
            self._participant.begun()

    def _announce_end(self, name: str, source: str, text: str, level: Level, **data: Any) -> None:
        with suppress(SubscriberError):
            self.simulation.exchange.flush()
        try:
            self.simulation.announce(name, source, text, level=level, **data)
        except SubscriberError:
            # The bus calls all other subscribers first, the recorder among them; the run has ended anyway.
            return
