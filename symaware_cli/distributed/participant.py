"""What a process of a run that is spread over several does beside what every run does."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NoReturn

import numpy as np

from symaware_cli.core import Event, Level
from symaware_cli.core.message import Indices
from symaware_cli.distributed.codec import encode
from symaware_cli.distributed.frame import Frame, Notice
from symaware_cli.distributed.transport import Port, PortEvent
from symaware_cli.runtime.failure import RunError

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup
    from symaware_cli.runtime.shared import Shared
    from symaware_cli.runtime.simulation import Simulation

#: Longest wait between two checks for signals [s].
_BREATH = 0.2


@dataclass(frozen=True, slots=True)
class Identity:
    """What a process says of itself to the others.

    Attributes:
        name: What to call it.
        scenario: A digest of what it runs.
        version: Of the package.
        agents: The ids of those that it runs.
    """

    name: str
    scenario: bytes
    version: str
    agents: tuple[str, ...]


class Participant(ABC):
    """One of the processes of a run.

    All of them build the whole scenario and go through the same instants; each lets only its own agents take turns.

    Attributes:
        identity: Which one.
        port: Where the others are.
        decides: Whether this process says when the run is over.
    """

    decides: ClassVar[bool]

    def __init__(self, identity: Identity, port: Port, patience: float) -> None:
        """Prepare.

        Args:
            identity: Which process this is.
            port: Where the others are; closed at the end.
            patience: For how long to wait for others before the run begins [s].
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
        """Wait until the run can begin; components are initialised, and the clock may move on to when it goes on.

        Raises:
            RunError: It never can.
            Interrupted: Somebody ended it.
        """
        self._run = run
        self._has_begun = True
        here = frozenset(self.identity.agents)
        for scheduler in run.schedulers:
            for row, id in enumerate(scheduler.entry.group.ids):
                if id not in here:
                    scheduler.leave(row)
        self._meet()

    @abstractmethod
    def _meet(self) -> None:
        """Find the others."""

    def arrived(self) -> None:
        """A step of the world is made, and its messages are delivered."""
        self._publish()

    @abstractmethod
    def acted(self) -> None:
        """All turns of an instant are taken."""

    @abstractmethod
    def step(self) -> str | None:
        """Let the world make its step; return why the run is over, if it is."""

    @abstractmethod
    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """The run is over here."""

    def _report(self, notice: Notice, *, recorded: bool = True) -> None:
        """Let something be known here as soon as turns may follow from it.

        Args:
            notice: What happened.
            recorded: Whether it goes into this part of the log.
        """
        self._news.append((notice, recorded))

    def _publish(self) -> None:
        """Fire the events of what was reported."""
        news, self._news = self._news, []
        for notice, recorded in news:
            self._fire(notice, recorded=recorded)

    def _fire(self, notice: Notice, *, recorded: bool) -> None:
        """Fire the event of what happened elsewhere."""
        simulation = self._simulation
        level = Level[notice.level] if notice.level in Level.__members__ else Level.INFO
        now, data, subject = simulation.clock.now, dict(notice.data), None if recorded else self
        agent = simulation.agent_of(notice.source)
        simulation.events.fire(Event(notice.name, notice.source, now, level, notice.text, data, subject, agent))

    def _wait(self, deadline: float | None = None) -> PortEvent | None:
        """Wait for what happens next, with signals let through; None if a moment of the monotonic clock comes first."""
        interruption = self._run.interruption
        while True:
            # Not while the port is at work: that must not be left half done.
            interruption.unshield(watched=False)
            interruption.shield()
            breath = _BREATH if deadline is None else min(_BREATH, deadline - time.monotonic())
            happening = self.port.receive(max(0.0, breath))
            if happening is not None or breath <= 0.0:
                return happening

    @property
    def _keeps_step(self) -> bool:
        """Whether all processes know what each of them did before they go on to the next instant."""
        return self._run.pacer is None and not self._run.asynchronous

    def _fail(self, source: str, problem: str, cause: Exception | None = None) -> NoReturn:
        """End the run here because of something that happened elsewhere; what led to it is recorded first.

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
        try:
            self.port.send(peer, encode(frame))
        except (TypeError, ValueError) as error:
            self._fail("run", f"other processes cannot be told: {error}", error)


def rows_of(group: AgentGroup, ids: Iterable[str]) -> Indices:
    """The rows of those agents that are of a group, ascending."""
    wanted = frozenset(ids)
    return np.array([row for row, id in enumerate(group.ids) if id in wanted], np.intp)


def listed(ids: Iterable[str], most: int = 6) -> str:
    """Name some agents, and say how many more there are."""
    names = list(ids)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
