"""The hooks of a run that several processes share, and the parts of the run that they use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from symaware_cli.engine.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.engine.runtime.failure import RunError
from symaware_cli.engine.runtime.interruption import Interruption
from symaware_cli.engine.runtime.kernel import Kernel
from symaware_cli.engine.runtime.membership import Membership
from symaware_cli.engine.runtime.pacer import Pacer
from symaware_cli.engine.runtime.run_summary import Observer
from symaware_cli.engine.runtime.scheduler import TurnScheduler
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.state.simulation_state import SimulationState


@record
class Shared:
    """The parts of a run that a process of several uses.

    Attributes:
        simulation: The simulation; every process has built the whole of it.
        kernel: The loop over instants.
        schedulers: The turn schedulers of all entries.
        membership: Takes agents out of the run and back in.
        motion: Steps the world.
        observer: Collects the figures of the summary.
        interruption: Holds signals back and lets them through.
        pacer: Ties simulated time to wall time; None without a pace.
        asynchronous: Whether there are instants between the steps.
        capture: Captures the state of the run between two steps, given the digest of the scenario and the version.
        restore: Restores such a state, given the state, the digest and the version, in a run that has begun.
    """

    simulation: Simulation
    kernel: Kernel
    schedulers: Sequence[TurnScheduler]
    membership: Membership
    motion: EnvironmentStepper
    observer: Observer
    interruption: Interruption
    pacer: Pacer | None
    asynchronous: bool
    capture: Callable[[str, str], SimulationState]
    restore: Callable[[SimulationState, str, str], None]


class Sharing(Protocol):
    """The hooks that a run calls in a process that shares it with others."""

    @property
    def decides(self) -> bool:
        """Whether this process decides when the run ends."""

    def begin(self, run: Shared) -> None:
        """Wait until the run can begin, after components were initialised; may advance the clock."""

    def begun(self) -> None:
        """Called when the first turns are queued, before the first instant; may restore an earlier state of the run."""

    def arrived(self) -> None:
        """Called after each step of the world, when its messages have been delivered."""

    def acted(self) -> None:
        """Called after all turns of an instant."""

    def step(self) -> str | None:
        """Step the world; return why the run ends, or None."""

    def stepped(self) -> None:
        """Called after each step, before the next instant begins."""

    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """Called when the run ends in this process."""


class Role(Protocol):
    """The role of this process in a run of several."""

    @property
    def records_world(self) -> bool:
        """Whether its log has the world and the messages of all; those of the others have their own agents."""

    def take_part(self, stack: ExitStack, built: Any, log: Path | None) -> tuple[Sharing, Mapping[str, Any]]:
        """Reach the other processes.

        Args:
            stack: Closes the connections.
            built: The `symaware_cli.language.build.Built` scenario.
            log: The log of this process; None for none.

        Returns:
            The hooks that the run calls, and the description of this process for the manifest of its log.
        """
