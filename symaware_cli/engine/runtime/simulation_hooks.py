"""The actions of a run at each instant besides turns: messages, recording, pacing, monitoring, environment steps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import Array, Column
from symaware_cli.core import AgentGroup
from symaware_cli.engine.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.interruption import Interruption
from symaware_cli.engine.runtime.kernel import Kernel
from symaware_cli.engine.runtime.membership import Membership
from symaware_cli.engine.runtime.pacer import Pacer
from symaware_cli.engine.runtime.run_summary import Observer
from symaware_cli.engine.runtime.shared import Sharing
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.specifications import Specifications

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.asyncio_bridge import AsyncioBridge
    from symaware_cli.engine.runtime.recording import RunRecording
    from symaware_cli.specification.expression import Expression

#: Wall time between two calls of the progress callback [s].
_PROGRESS_INTERVAL = 0.1


class SimulationHooks:
    """The hooks of a kernel that runs a simulation.

    Attributes:
        imposed: Control inputs that override the requests of the components of a group: a mask of the rows, and the
            values for all rows of the group.
    """

    #: The recorder is captured with the log: a run without one can be restored as well.
    uncaptured: ClassVar[Collection[str]] = ("_recorder", "_on_progress", "_progress_due", "settle")

    def __init__(
        self,
        simulation: Simulation,
        kernel: Kernel,
        stepper: EnvironmentStepper,
        observer: Observer,
        membership: Membership,
        interruption: Interruption,
        *,
        is_asynchronous: bool,
        until: Expression | None,
        recorder: RunRecording | None,
        pacer: Pacer | None,
        bridge: AsyncioBridge | None,
        sharing: Sharing | None,
        specifications: Specifications,
        on_progress: Callable[[int], None] | None,
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation to run.
            kernel: The kernel that calls these hooks.
            stepper: Steps the environment.
            observer: Collects the figures of the summary.
            membership: Lets agents enter and leave.
            interruption: Defers signals.
            is_asynchronous: Whether there may be instants between the steps.
            until: The run ends with the first step after whose turns this condition holds.
            recorder: Writes the log; None without a log.
            pacer: Ties simulated time to wall time; None to run as fast as possible.
            bridge: Runs asyncio's loop while the run waits for wall time; None without asyncio.
            specifications: Monitors the specifications.
            sharing: The role of this process in a run of several processes; None in a run of one process.
            on_progress: Called at intervals of wall time with simulated time in nanoseconds.
        """
        self.imposed: dict[AgentGroup, tuple[NDArray[np.bool_], Array]] = {}
        #: Sends the messages of a round.
        self.settle: Callable[[], bool] = simulation.exchange.flush
        self._simulation = simulation
        self._kernel = kernel
        self._stepper = stepper
        self._observer = observer
        self._membership = membership
        self._interruption = interruption
        self._is_asynchronous = is_asynchronous
        self._until = until
        if until is not None:
            from symaware_cli.engine.runtime.scope import WorldScope

            self._world = WorldScope(simulation, observer)
        self._recorder = recorder
        self._pacer = pacer
        self._bridge = bridge
        self._sharing = sharing
        self._specifications = specifications
        self._on_progress = on_progress
        self._progress_due = 0.0
        #: The exchange's counter when the arrival of the next message was last looked up, and that arrival.
        self._sent, self._arrival = -1, math.inf
        #: The control inputs at the start of the present step; None if it has no further instants.
        self._latched: list[tuple[Column, Array]] | None = None

    def begin(self, now: int, is_step: bool) -> None:
        """Let agents leave and enter, and deliver the messages that are due."""
        simulation = self._simulation
        if "iterating" in simulation.events.wanted:
            simulation.announce("iterating", "run")
        if is_step and self._membership.is_open:
            self._membership.update(now)
        if is_step and self._specifications.offers.is_open:
            self._specifications.offers.update(now)
        if is_step or self._arrival <= now:
            simulation.exchange.deliver(now)
            self._sent = -1
        else:
            simulation.exchange.now = now
        if is_step and self._sharing:
            self._sharing.arrived()

    def end(self, now: int, is_step: bool) -> str | None:
        """Record what changed; return why the run ends, if it does."""
        simulation, until = self._simulation, self._until
        if is_step and simulation.overrides is not None:
            self.imposed = dict(simulation.overrides(self._kernel.done))
        if self.imposed:
            self._impose()
        if self._recorder:
            self._recorder.record(now, self._kernel.done)
        if "iterated" in simulation.events.wanted:
            simulation.announce("iterated", "run")
        if self._sharing:
            self._sharing.acted()
        if is_step:
            self._observer.sample(now)
            ending = self._specifications.look(now)
            if ending is not None:
                return ending
            decides = self._sharing is None or self._sharing.decides
            if self._observer.contacts and decides and simulation.environment.on_contact == "end":
                return "a contact began"
            if until is not None and decides and self._is_over(until):
                return until.text
            if "stepping" in simulation.events.wanted:
                simulation.announce("stepping", "environment")
            self._latched = None
        return None

    def await_next(self, upcoming: int) -> int:
        """Wait for the next instant; in the asynchronous mode, the arrival of a message is an instant as well."""
        if self._is_asynchronous:
            exchange = self._simulation.exchange
            if exchange.sent != self._sent:
                # The next arrival changes only when messages are sent or delivered.
                arrival = exchange.next_time
                self._sent, self._arrival = exchange.sent, math.inf if arrival is None else arrival
            if self._arrival < upcoming:
                upcoming = max(int(self._arrival), self._simulation.clock.now + 1)
        return self._sleep(self._pacer, upcoming) if self._pacer else upcoming

    def pause(self) -> None:
        """Keep the control inputs: the environment applies those requested at the start of the step."""
        self._latched = [(group.control_column, group.control_input) for group in self._simulation.groups]

    def step(self, upcoming: int) -> str | None:
        """Step the environment with the control inputs requested at the start of the step."""
        if self._latched is None:
            return self._move()
        present = [(column, column.exchange(values)) for column, values in self._latched]
        try:
            return self._move()
        finally:
            for column, values in present:
                column.exchange(values)

    def _move(self) -> str | None:
        if self._sharing:
            return self._sharing.step()
        self._stepper.step()
        return None

    def stepped(self) -> None:
        """Check the new state of the environment, and announce contacts and progress."""
        simulation = self._simulation
        self._stepper.check()
        self._stepper.announce_contacts()
        if "stepped" in simulation.events.wanted:
            simulation.announce("stepped", "environment")
        if self._on_progress:
            self._progress(simulation.clock.now)
        if self._sharing:
            self._sharing.stepped()

    def _impose(self) -> None:
        """Replace the control inputs that components have requested by the imposed ones."""
        for group, (rows, values) in self.imposed.items():
            requested = group.control_input
            if np.count_nonzero(rows) == len(rows):
                if np.count_nonzero(requested != values):
                    group.control_input = values  # which the column copies
            elif not np.array_equal(requested[rows], values[rows]):
                group.control_input = np.where(rows[:, None], values, requested)

    def _is_over(self, until: Expression) -> bool:
        from symaware_cli.specification.expression import EvaluationError

        try:
            return until.holds(self._world.look_up)
        except EvaluationError as error:
            raise RunError("run.until", "symaware", self._simulation.clock.now, str(error), error) from error

    def _sleep(self, pacer: Pacer, upcoming: int) -> int:
        """Wait until it is time for an instant, or until an asyncio future is done; return the resulting instant."""
        bridge, clock = self._bridge, self._simulation.clock
        self._interruption.unshield(watched=False)
        try:
            if bridge is None:
                pacer.wait(upcoming)
                return upcoming
            while True:
                lead = pacer.lead(upcoming)
                ready = bridge.wait(lead)
                self._interruption.unshield(watched=False)  # asyncio swallows exceptions raised in its callbacks
                if ready:
                    now = min(max(pacer.simulated(), clock.now + 1), upcoming)
                    for call in ready:
                        call(now)
                    return now
                if pacer.lead(upcoming) <= 0.0:
                    pacer.note(-pacer.lead(upcoming))
                    return upcoming
        finally:
            self._interruption.shield()

    def observe_end(self) -> str | None:
        """Observe and record the final state; return the violated specification that ends the run, if any."""
        now = self._simulation.clock.now
        self._observer.sample(now)
        if self._recorder:
            self._recorder.record(now, self._kernel.done)
        ending = self._specifications.look(now)
        self._interruption.unshield()
        self._interruption.shield()
        return ending

    def _progress(self, now: int) -> None:
        monotonic = time.monotonic()
        if monotonic >= self._progress_due and self._on_progress:
            self._progress_due = monotonic + _PROGRESS_INTERVAL
            self._on_progress(now)
