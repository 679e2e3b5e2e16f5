"""The hooks of a run that several processes share, and the parts of the run that they use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from symaware_cli.runtime.environment_stepper import EnvironmentStepper
from symaware_cli.runtime.failure import RunError
from symaware_cli.runtime.interruption import Interruption
from symaware_cli.runtime.kernel import Kernel
from symaware_cli.runtime.pacer import Pacer
from symaware_cli.runtime.run_summary import Observer
from symaware_cli.runtime.scheduler import TurnScheduler
from symaware_cli.runtime.simulation import Simulation


@dataclass(frozen=True, slots=True)
class Shared:
    """The parts of a run that a process of several uses.

    Attributes:
        simulation: The simulation; every process has built the whole of it.
        kernel: The loop over instants.
        schedulers: The turn schedulers of all entries.
        motion: Steps the world.
        observer: Collects the figures of the summary.
        interruption: Holds signals back and lets them through.
        pacer: Ties simulated time to wall time; None without a pace.
        asynchronous: Whether there are instants between the steps.
    """

    simulation: Simulation
    kernel: Kernel
    schedulers: Sequence[TurnScheduler]
    motion: EnvironmentStepper
    observer: Observer
    interruption: Interruption
    pacer: Pacer | None
    asynchronous: bool


class Sharing(Protocol):
    """The hooks that a run calls in a process that shares it with others."""

    @property
    def decides(self) -> bool:
        """Whether this process decides when the run ends."""

    def begin(self, run: Shared) -> None:
        """Wait until the run can begin, after components were initialised; may advance the clock."""

    def arrived(self) -> None:
        """Called after each step of the world, when its messages have been delivered."""

    def acted(self) -> None:
        """Called after all turns of an instant."""

    def step(self) -> str | None:
        """Step the world; return why the run ends, or None."""

    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """Called when the run ends in this process."""
