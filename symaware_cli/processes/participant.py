"""The base of host and member: one process of a run that several processes share."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NoReturn

import numpy as np

from symaware_cli.core import Event, Level
from symaware_cli.core.message import Indices
from symaware_cli.engine import OnFailure, RunError
from symaware_cli.processes.codec import encode
from symaware_cli.processes.frame import Frame, Notice
from symaware_cli.processes.transport import Port, PortEvent

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup
    from symaware_cli.engine import Shared, Simulation

#: Longest wait between two checks for signals [s].
_BREATH = 0.2


@dataclass(frozen=True, slots=True)
class Identity:
    """How a process identifies itself to the other processes.

    Attributes:
        name: Its name in logs and messages.
        scenario: The digest of its scenario.
        version: The version of its package.
        agents: The ids of the agents that it runs.
    """

    name: str
    scenario: bytes
    version: str
    agents: tuple[str, ...]


class Participant(ABC):
    """One of the processes of a run.

    Every process builds the whole scenario and goes through the same instants, but only its own agents take turns.

    Attributes:
        identity: How it identifies itself.
        port: Its connections to the other processes.
        decides: Whether this process decides when the run ends.
    """

    decides: ClassVar[bool]

    def __init__(self, identity: Identity, port: Port, patience: float) -> None:
        """Initialise.

        Args:
            identity: How this process identifies itself.
            port: Its connections to the other processes; closed at the end.
            patience: How long to wait for other processes before the run begins [s].
        """
        self.identity = identity
        self.port = port
        self._patience = patience
        self._run: Shared
        self._has_begun = False
        self._news: list[tuple[Notice, bool]] = []

    @property
    def _simulation(self) -> Simulation:
        return self._run.simulation

    def begin(self, run: Shared) -> None:
        """Wait until the run can begin, after components were initialised; may advance the clock to a run in progress.

        Raises:
            RunError: The run cannot begin.
            Interrupted: The run was interrupted.
        """
        self._run = run
        self._has_begun = True
        here = frozenset(self.identity.agents)
        for scheduler in run.schedulers:
            for row, id in enumerate(scheduler.entry.group.ids):
                if id not in here:
                    scheduler.leave(row)
        # Components all of whose agents run in other processes take no turns.
        run.kernel.steady = [each for each in run.kernel.steady if not run.schedulers[each[0]].is_remote]
        self._meet()

    @abstractmethod
    def _meet(self) -> None:
        """Connect to the other processes."""

    def arrived(self) -> None:
        """Called after each step of the world, when its messages have been delivered."""
        self._publish()

    @abstractmethod
    def acted(self) -> None:
        """Called after all turns of an instant."""

    @abstractmethod
    def step(self) -> str | None:
        """Step the world; return why the run ends, or None."""

    @abstractmethod
    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """Called when the run ends in this process."""

    def _report(self, notice: Notice, *, recorded: bool = True) -> None:
        """Fire the event of a notice when turns may follow from it: with the next step.

        Args:
            notice: What happened.
            recorded: Whether the event goes into the log of this process.
        """
        self._news.append((notice, recorded))

    def _publish(self) -> None:
        """Fire the events of the notices that were reported."""
        news, self._news = self._news, []
        for notice, recorded in news:
            self._fire(notice, recorded=recorded)

    def _fire(self, notice: Notice, *, recorded: bool) -> None:
        """Fire the event of a notice."""
        simulation = self._simulation
        level = Level[notice.level] if notice.level in Level.__members__ else Level.INFO
        now, data, subject = simulation.clock.now, dict(notice.data), None if recorded else self
        agent = simulation.agent_of(notice.source)
        simulation.events.fire(Event(notice.name, notice.source, now, level, notice.text, data, subject, agent))

    def _wait(self, deadline: float | None = None) -> PortEvent | None:
        """Wait for the next event of the port, and handle signals; None if the deadline passes first."""
        interruption = self._run.interruption
        while True:
            # Not while the port works: it must not be interrupted halfway.
            interruption.unshield(watched=False)
            interruption.shield()
            breath = _BREATH if deadline is None else min(_BREATH, deadline - time.monotonic())
            happening = self.port.receive(max(0.0, breath))
            if happening is not None or breath <= 0.0:
                return happening

    @property
    def _keeps_step(self) -> bool:
        """Whether each instant ends only when every process has received the results of all others."""
        return self._run.pacer is None and not self._run.asynchronous

    def _goes_on_without(self, agents: Iterable[str]) -> bool:
        """Whether the run does not end when the process of these agents dies."""
        policies = self._policies(agents)
        return bool(policies) and "stop" not in policies

    def _waits_for(self, agents: Iterable[str]) -> bool:
        """Whether the run waits for a process of these agents to rejoin when it dies, so that they miss no step."""
        return self._run.pacer is None and self._goes_on_without(agents) and "restart" in self._policies(agents)

    def _policies(self, agents: Iterable[str]) -> set[OnFailure]:
        """The values of `on_failure` of the components of some agents."""
        here = frozenset(agents)
        entries = [each.entry for each in self._run.schedulers if not here.isdisjoint(each.entry.group.ids)]
        return {entry.timing.on_failure for entry in entries}

    @abstractmethod
    def begun(self) -> None:
        """Called when the first turns are queued, before the first instant."""

    @abstractmethod
    def stepped(self) -> None:
        """Called after each step of the world, before the next instant begins."""

    def _fail(self, source: str, problem: str, cause: Exception | None = None) -> NoReturn:
        """Fail the run because of something that happened in another process; earlier notices are recorded first.

        Raises:
            RunError: Always.
        """
        self._publish()
        simulation = self._simulation
        owner, _, name = source.removeprefix("agents.").rpartition(".")
        entries = [
            entry
            for entry in simulation.entries
            if entry.name == name and owner in (entry.group.name, *entry.group.ids)
        ]
        plugin = entries[0].use if entries else "symaware"
        raise RunError(source or "run", plugin, simulation.clock.now, problem) from cause

    def _send(self, peer: int, frame: Frame) -> None:
        """Send a frame.

        Raises:
            RunError: It cannot be sent.
        """
        self._send_encoded(peer, self._encoded(frame))

    def _encoded(self, frame: Frame) -> bytes:
        """Encode a frame.

        Raises:
            RunError: It cannot be encoded.
        """
        try:
            return encode(frame)
        except (TypeError, ValueError) as error:
            self._fail("run", f"other processes cannot be told: {error}", error)

    def _send_encoded(self, peer: int, data: bytes) -> None:
        """Send an encoded frame.

        Raises:
            RunError: It is too long.
        """
        try:
            self.port.send(peer, data)
        except (TypeError, ValueError) as error:
            self._fail("run", f"other processes cannot be told: {error}", error)


def rows_of(group: AgentGroup, ids: Iterable[str]) -> Indices:
    """The rows of those of the agents that belong to a group, ascending."""
    wanted = frozenset(ids)
    return np.array([row for row, id in enumerate(group.ids) if id in wanted], np.intp)
