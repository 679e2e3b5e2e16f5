"""What a process does in a run that it shares with others, beside what every run does; and what it is given for it."""

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
    """What of a run is shared with other processes.

    Attributes:
        simulation: What runs; all processes have built the whole of it.
        kernel: Goes from instant to instant.
        schedulers: The turns of each entry.
        motion: What the world does.
        observer: Watches the run for what the summary tells.
        interruption: Holds signals back and lets them through.
        pacer: What ties simulated time to wall time; None where nothing does.
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
    """What a process is asked for as it goes through the instants that it shares with others."""

    @property
    def decides(self) -> bool:
        """Whether this process says when the run is over."""

    def begin(self, run: Shared) -> None:
        """Wait until the run can begin; components are initialised, and the clock may move on to when it goes on."""

    def arrived(self) -> None:
        """A step of the world is made, and its messages are delivered."""

    def acted(self) -> None:
        """All turns of an instant are taken."""

    def step(self) -> str | None:
        """Let the world make its step; return why the run is over, if it is."""

    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """The run is over here."""
