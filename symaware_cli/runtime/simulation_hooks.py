"""What each instant of a run calls for beside the turns: messages, the log, the pace, and the world."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.column import Array, Column
from symaware_cli.core import AgentGroup
from symaware_cli.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.runtime.failure import RunError
from symaware_cli.runtime.interruption import Interruption
from symaware_cli.runtime.kernel import Kernel
from symaware_cli.runtime.membership import Membership
from symaware_cli.runtime.pacer import Pacer
from symaware_cli.runtime.run_summary import Observer
from symaware_cli.runtime.scope import WorldScope
from symaware_cli.runtime.shared import Sharing
from symaware_cli.runtime.simulation import Simulation
from symaware_cli.runtime.specifications import Specifications
from symaware_cli.specification.expression import EvaluationError, Expression

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder
    from symaware_cli.runtime.asyncio_bridge import AsyncioBridge

#: Wall time between two calls of the progress callback [s].
_PROGRESS_INTERVAL = 0.1


class SimulationHooks:
    """The hooks of a kernel that runs a simulation.

    Attributes:
        imposed: Control inputs that stand in for what the components of a group request, whatever that is: which rows,
            and what for each row of the group.
    """

    def __init__(
        self,
        simulation: Simulation,
        kernel: Kernel,
        motion: EnvironmentStepper,
        observer: Observer,
        membership: Membership,
        interruption: Interruption,
        *,
        is_asynchronous: bool,
        until: Expression | None,
        recorder: Recorder | None,
        pacer: Pacer | None,
        bridge: AsyncioBridge | None,
        sharing: Sharing | None,
        specifications: Specifications,
        on_progress: Callable[[int], None] | None,
    ) -> None:
        """Prepare.

        Args:
            simulation: What runs.
            kernel: Whose hooks these are.
            motion: What the world does.
            observer: Watches the run for what the summary tells.
            membership: Lets agents enter and leave.
            interruption: Holds signals back.
            is_asynchronous: Whether there may be instants between the steps.
            until: The run ends with the first step after whose turns this holds.
            recorder: Writes the run down; None where nobody does.
            pacer: What ties simulated time to wall time; None where nothing does.
            bridge: Turns asyncio's loop while there is nothing else to do; None where there is none.
            specifications: Monitors what is to hold.
            sharing: The other processes of the run; None where it is alone.
            on_progress: Called now and then with simulated time in nanoseconds.
        """
        self.imposed: dict[AgentGroup, tuple[NDArray[np.bool_], Array]] = {}
        self._simulation = simulation
        self._kernel = kernel
        self._motion = motion
        self._observer = observer
        self._membership = membership
        self._world = WorldScope(simulation, observer)
        self._interruption = interruption
        self._is_asynchronous = is_asynchronous
        self._until = until
        self._recorder = recorder
        self._pacer = pacer
        self._bridge = bridge
        self._sharing = sharing
        self._specifications = specifications
        self._on_progress = on_progress
        self._progress_due = 0.0
        #: What was sent and delivered when it was last asked when the next message arrives, and the answer.
        self._sent, self._arrival = -1, math.inf
        #: What control inputs were as the step began that the world is making; None where nothing comes in between.
        self._latched: list[tuple[Column, Array]] | None = None

    def begin(self, now: int, is_step: bool) -> None:
        """Let agents leave and enter, and deliver the messages that are due."""
        simulation = self._simulation
        if "iterating" in simulation.events.wanted:
            simulation.announce("iterating", "run")
        if is_step and self._membership.is_open:
            self._membership.look(now)
        if is_step or self._arrival <= now:
            simulation.exchange.deliver(now)
            self._sent = -1
        else:
            simulation.exchange.now = now
        if is_step and self._sharing:
            self._sharing.arrived()

    def settle(self) -> bool:
        """Let messages go on their way."""
        return self._simulation.exchange.flush()

    def end(self, now: int, is_step: bool) -> str | None:
        """Record what changed, and look whether the run is over."""
        simulation, until = self._simulation, self._until
        if self.imposed:
            self._impose()
        if self._recorder:
            self._recorder.record(now, self._kernel.done)
        if "iterated" in simulation.events.wanted:
            simulation.announce("iterated", "run")
        if self._sharing:
            self._sharing.acted()
        if is_step:
            self._observer.look(now)
            ending = self._specifications.look(now)
            if ending is not None:
                return ending
            decides = self._sharing is None or self._sharing.decides
            if until is not None and decides and self._is_over(until):
                return until.text
            if "stepping" in simulation.events.wanted:
                simulation.announce("stepping", "environment")
            self._latched = None
        return None

    def await_next(self, upcoming: int) -> int:
        """Messages arrive at instants of their own in the asynchronous mode; sleep where there is a pace to be kept."""
        if self._is_asynchronous:
            exchange = self._simulation.exchange
            if exchange.sent != self._sent:
                # Only what was sent or delivered changes which is next.
                arrival = exchange.next_time
                self._sent, self._arrival = exchange.sent, math.inf if arrival is None else arrival
            if self._arrival < upcoming:
                upcoming = max(int(self._arrival), self._simulation.clock.now + 1)
        return self._sleep(self._pacer, upcoming) if self._pacer else upcoming

    def pause(self) -> None:
        """Keep the control inputs: the world moves under what was requested when its step began."""
        self._latched = [(group.control_column, group.control_input) for group in self._simulation.groups]

    def step(self, upcoming: int) -> str | None:
        """Move the world, under what was requested when its step began."""
        present = [(column, column.exchange(values)) for column, values in self._latched or ()]
        try:
            if self._sharing:
                return self._sharing.step()
            self._motion.step()
            return None
        finally:
            for column, values in present:
                column.exchange(values)

    def stepped(self) -> None:
        """Look at what came of it."""
        simulation = self._simulation
        self._motion.check()
        self._motion.announce_contacts()
        if "stepped" in simulation.events.wanted:
            simulation.announce("stepped", "environment")
        if self._on_progress:
            self._progress(simulation.clock.now)

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
            raise RunError("run.until", "symaware", self._simulation.clock.now, str(error), error) from error

    def _sleep(self, pacer: Pacer, upcoming: int) -> int:
        """Wait until it is time for an instant, or for an earlier one at which something outside is done."""
        bridge, clock = self._bridge, self._simulation.clock
        self._interruption.unshield(watched=False)
        try:
            if bridge is None:
                pacer.wait(upcoming)
                return upcoming
            while True:
                lead = pacer.lead(upcoming)
                ready = bridge.wait(lead)
                self._interruption.unshield(watched=False)  # asyncio keeps what a signal raises in its callbacks
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

    def look_last(self) -> str | None:
        """Take note of how the world and the agents are at the end, and say what that violates that ends the run."""
        now = self._simulation.clock.now
        self._observer.look(now)
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
