"""The synchronous mode: at each step every component takes one turn, then the world moves."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NoReturn

from symaware_cli.core import Component, Event, GroupComponent, Level, SubscriberError
from symaware_cli.core.column import Column, is_finite
from symaware_cli.recording.error import LogError
from symaware_cli.recording.recorder import Recorder
from symaware_cli.runtime.faults import RunError, describe
from symaware_cli.runtime.interruption import Interrupted, Interruption
from symaware_cli.runtime.simulation import Simulation, Slot
from symaware_cli.runtime.summary import Observer, Summary

#: Wall time between two calls of the progress callback [s].
_PROGRESS_INTERVAL = 0.1


def run(
    simulation: Simulation,
    steps: int,
    recorder: Recorder | None = None,
    on_progress: Callable[[int], None] | None = None,
) -> Summary:
    """Run a simulation to its end, its failure or its interruption.

    Whatever ends it, the log is finished first.

    Args:
        simulation: What to run; it cannot be run twice.
        steps: How many steps to make.
        recorder: Where to write it down.
        on_progress: Called now and then with simulated time in nanoseconds.

    Raises:
        LogError: The log cannot be written.
    """
    return _Run(simulation, steps, recorder, on_progress).execute()


class _Run:
    def __init__(
        self,
        simulation: Simulation,
        steps: int,
        recorder: Recorder | None,
        on_progress: Callable[[int], None] | None,
    ) -> None:
        self._simulation = simulation
        self._steps = steps
        self._done = 0
        self._recorder = recorder
        self._on_progress = on_progress
        self._progress_due = 0.0
        self._observer = Observer(simulation)
        self._interruption = Interruption()
        if recorder:
            events, clock = simulation.events, simulation.clock
            for name, record in (
                ("*", recorder.event),
                ("contact", lambda event: recorder.contact(event.subject, event.time)),
                ("sent", lambda event: recorder.message(event.subject, clock.now, delivered=False)),
                ("received", lambda event: recorder.message(event.subject, clock.now, delivered=True)),
            ):
                # Events fire within turns, too, where signals are let through.
                events.subscribe(name, self._interruption.shielded(record))

    def execute(self) -> Summary:
        simulation = self._simulation
        started = time.monotonic()
        status, failure = "finished", None
        with self._interruption as interruption:
            interruption.shield()
            try:
                self._begin_to_end()
            except Interrupted as signal:
                status = "interrupted"
                interruption.shield()
                self._announce_end("interrupted", "run", f"ended by {signal}", level=Level.WARNING)
            except RunError as error:
                status, failure = "failed", error
                interruption.shield()
                self._announce_end("failed", error.source, str(error), level=Level.ERROR, **error.data)
            if self._recorder:
                outcome = {"status": status, "steps": self._done, "time": simulation.clock.now}
                self._recorder.finish(simulation.clock.now, self._done, outcome)
        return self._summary(status, failure, time.monotonic() - started)

    def _begin_to_end(self) -> None:
        """Make the whole run.

        Raises:
            RunError: Something went wrong, whatever it was.
            Interrupted: Somebody ended it.
            LogError: The log cannot be written.
        """
        simulation = self._simulation
        try:
            simulation.announce("started", "run", f"{simulation.agent_count} agents, seed {simulation.seed}")
            self._interruption.unshield()
            simulation.initialise()
            self._interruption.shield()
            self._announce_contacts()
            self._loop()
            simulation.announce("finished", "run", f"{self._done} steps made")
        except SubscriberError as error:
            self._blame_subscriber(error)
        except (RunError, LogError):
            raise
        except Exception as error:
            raise RunError("run", "symaware", simulation.clock.now, describe(error), error) from error

    def _loop(self) -> None:
        simulation, recorder, interruption = self._simulation, self._recorder, self._interruption
        environment, clock, exchange = simulation.environment, simulation.clock, simulation.exchange
        observer, time_step = self._observer, environment.time_step
        turns = [(slot, slot.group.control_column, slot.group.awareness.state_column) for slot in simulation.slots]
        while self._done < self._steps:
            simulation.announce("iterating", "run")
            exchange.deliver(clock.now)
            for slot, control, state in turns:
                self._take_turns(slot)
                if control.fresh:
                    self._check(slot, control, "control input")
                if state.fresh:
                    self._check(slot, state, "state")
            observer.look(clock.now)
            if recorder:
                recorder.record(clock.now, self._done)
            simulation.announce("iterated", "run")
            simulation.announce("stepping", "environment")
            self._step_world()
            clock.now += time_step
            self._done += 1
            self._check_world()
            self._announce_contacts()
            simulation.announce("stepped", "environment")
            if self._on_progress:
                self._progress(clock.now)
        observer.look(clock.now)
        if recorder:
            recorder.record(clock.now, self._done)
        interruption.unshield()
        interruption.shield()

    def _take_turns(self, slot: Slot) -> None:
        self._interruption.unshield()
        component = slot.components[0]
        try:
            if slot.turns and not self._simulation.events.turns_wanted:
                # What compute_and_update does where nobody listens, for half its price.
                for component, compute, update in slot.turns:  # noqa: B007 (tells which one raised)
                    update(compute())
            else:
                for component in slot.components:
                    component.compute_and_update()
        except (SubscriberError, Interrupted, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise RunError(component.path, slot.use, self._simulation.clock.now, describe(error), error) from error
        finally:
            self._interruption.shield()

    def _step_world(self) -> None:
        simulation = self._simulation
        self._interruption.unshield()
        try:
            simulation.environment.step()
        except (Interrupted, KeyboardInterrupt):
            raise
        except BaseException as error:
            self._blame_world(error)
        finally:
            self._interruption.shield()

    def _check(self, slot: Slot, column: Column, what: str) -> None:
        column.fresh = False
        rows = column.non_finite_rows()
        if rows:
            ids = [slot.group.ids[row] for row in rows]
            self._blame(f"agents.{ids[0]}.{slot.name}", slot.use, f"its {what}", column.row(rows[0]).tolist(), ids)

    def _check_world(self) -> None:
        simulation = self._simulation
        for group in simulation.groups:
            try:
                truth = simulation.environment.state(group)
            except Exception as error:
                self._blame_world(error)
            if not is_finite(truth):
                row = next(row for row, state in enumerate(truth) if not is_finite(state))
                source = "environment"
                self._blame(
                    source, simulation.environment_use, f"the state of {group.ids[row]}", truth[row].tolist(), []
                )

    def _blame(self, source: str, plugin: str, what: str, value: list[float], ids: list[str]) -> NoReturn:
        others = f", and so for {len(ids) - 1} more agents" if len(ids) > 1 else ""
        problem = f"{what} is not finite: {value}{others}"
        raise RunError(source, plugin, self._simulation.clock.now, problem)

    def _blame_world(self, error: BaseException) -> NoReturn:
        use, now = self._simulation.environment_use, self._simulation.clock.now
        raise RunError("environment", use, now, describe(error), error) from error

    def _blame_subscriber(self, error: SubscriberError) -> NoReturn:
        cause = error.__cause__ or error
        problem = f"{error}: {describe(cause)}"
        owner = getattr(error.subscriber, "__self__", None)
        source, plugin = error.event.source, "subscriber"
        if isinstance(owner, Component | GroupComponent):
            source, plugin = owner.path, owner.use
        raise RunError(source, plugin, self._simulation.clock.now, problem, cause) from error

    def _announce_contacts(self) -> None:
        now = self._simulation.clock.now
        try:
            contacts = self._simulation.environment.contacts()
        except Exception as error:
            self._blame_world(error)
        for contact in contacts:
            verb = "touch" if contact.begins else "part"
            text = f"{contact.first} and {contact.second} {verb}"
            data = {"first": contact.first, "second": contact.second, "begins": contact.begins}
            event = Event("contact", "environment", now, Level.WARNING, text, data, contact)
            self._simulation.events.fire(event)

    def _announce_end(self, name: str, source: str, text: str, level: Level, **data: Any) -> None:
        try:
            self._simulation.announce(name, source, text, level=level, **data)
        except SubscriberError:
            # The run is over, and one subscriber that raises does not keep the others, the recorder among them,
            # from being told.
            return

    def _progress(self, now: int) -> None:
        monotonic = time.monotonic()
        if monotonic >= self._progress_due and self._on_progress:
            self._progress_due = monotonic + _PROGRESS_INTERVAL
            self._on_progress(now)

    def _summary(self, status: str, failure: RunError | None, wall_time: float) -> Summary:
        simulation, recorder, observer = self._simulation, self._recorder, self._observer
        return Summary(
            name=simulation.name,
            seed=simulation.seed,
            status=status,
            agents=simulation.agent_count,
            steps=self._done,
            simulated_time=simulation.clock.now / 1e9,
            wall_time=wall_time,
            updates=recorder.updates if recorder else 0,
            contacts=observer.contacts,
            minimum_separation=observer.minimum_separation,
            highest_risk=observer.highest_risk,
            goals_reached=tuple(sorted(observer.goals)),
            log=str(recorder.writer.path) if recorder else None,
            log_size=recorder.writer.size if recorder else None,
            failure=str(failure) if failure else None,
        )
