"""The member: a process that runs some of the agents in a copy of the host's world."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NoReturn

from symaware_cli.core import Contact, Delivery, Event, Level, MessageBatch
from symaware_cli.distributed.codec import decode, encode
from symaware_cli.distributed.frame import (
    CROWDED,
    End,
    Frame,
    Hello,
    Notice,
    Post,
    Refusal,
    Report,
    Step,
    Welcome,
)
from symaware_cli.distributed.participant import Identity, Participant, rows_of
from symaware_cli.distributed.transport import Port
from symaware_cli.network.value import FrameError, entries_to_wire
from symaware_cli.recording.json_text import plain
from symaware_cli.runtime.failure import RunError
from symaware_cli.runtime.interruption import Interrupted

#: The pause before another `Hello`, where another process still runs the agents [s].
_PAUSE = 0.2


class Member(Participant):
    """Runs its agents in a copy of the world that the host steps.

    It goes through the same instants as the host. If it is late, or its connection was lost for a while, it makes up
    for missed steps one after the other, in the latest state of the world.
    """

    decides = False

    def __init__(self, identity: Identity, port: Port, patience: float, absence: float) -> None:
        """Initialise.

        Args:
            identity: How this process identifies itself.
            port: Its connection to the host; closed at the end.
            patience: How long to wait for the host before the run begins [s].
            absence: How long the host may be gone during the run [s].
        """
        super().__init__(identity, port, patience)
        self._absence = absence
        self._peer: int | None = None
        self._world: Step | None = None
        self._over: End | None = None
        self._posts: list[Post] = []
        self._contacts: list[Contact] = []
        self._arrived: list[Delivery] = []
        self._retry: float | None = None
        self._refusal = ""

    def _meet(self) -> None:
        simulation, run = self._simulation, self._run
        here = self.identity.agents
        names = [*here, *(group.name for group in simulation.groups if set(group.ids) <= set(here))]
        self._own = tuple(f"agents.{name}." for name in names)
        self._rows = [(group, rows) for group in simulation.groups if len(rows := rows_of(group, here))]
        simulation.exchange.redirect_sent(self._post, _require_portable)
        simulation.events.subscribe("*", self._on_event)
        problem = f"no host at {self.port.address} took us in within {self._patience:g} s"
        step = self._await(-1, time.monotonic() + self._patience, problem)
        if step is None:
            self._blame_end()
        run.kernel.join(step.step, step.time)
        self._follow(step)

    def _on_event(self, event: Event) -> None:
        """Send the events of our agents' components to the host; errors end the run, which `End` reports."""
        if self._peer is None or event.subject is self or event.level is Level.ERROR:
            return
        if event.source.startswith(self._own):
            notice = Notice(event.name, event.source, event.level.name, event.text, event.data)
            try:
                encode(notice)
            except TypeError:
                # Then it is sent as it is recorded.
                notice = notice._replace(data=plain(event.data))
            self._send(self._peer, notice)

    def _post(self, batch: MessageBatch) -> None:
        """Keep messages of our agents until the next report."""
        self._posts.append(Post(batch, self._simulation.clock.now))

    def arrived(self) -> None:
        """Deliver the messages that the host sent."""
        super().arrived()
        arrived, self._arrived = self._arrived, []
        self._simulation.exchange.arrive(arrived)

    def acted(self) -> None:
        """Send a report if the host waits for it, or if the run has a pace: then the host should know at once."""
        run = self._run
        if self._keeps_step or (run.pacer is not None and (run.kernel.is_at_step or self._posts)):
            self._give_account(inputs=run.kernel.is_at_step)

    def _give_account(self, inputs: bool) -> None:
        if self._peer is None:
            return
        requested = {}
        if inputs:
            for group, rows in self._rows:
                values = group.control_input
                requested[group.name] = rows, values if len(rows) == len(values) else values[rows]
        posts, self._posts = tuple(self._posts), []
        self._send(self._peer, Report(self._run.kernel.done, requested, posts, self._run.observer.peak()))

    def step(self) -> str | None:
        """Wait until the host has made its step."""
        run = self._run
        if run.pacer is None and run.asynchronous:
            self._give_account(inputs=True)
        step = self._await(run.kernel.done, None, "")
        if step is None:
            end = self._over
            assert end is not None
            if end.status == "finished":
                return end.reason.removeprefix(f"{run.kernel.done} steps made; ")
            self._blame_end()
        self._follow(step)
        return None

    def _follow(self, step: Step) -> None:
        run, simulation = self._run, self._simulation
        if run.pacer is not None and not math.isnan(step.started) and self._peer is not None:
            run.pacer.start_at(step.started - self.port.offset(self._peer))
        try:
            contacts, self._contacts = self._contacts, []
            simulation.environment.follow(step.time, step.world, contacts)
        except ValueError as error:
            self._fail("environment", str(error), error)

    def _await(self, beyond: int, deadline: float | None, problem: str) -> Step | None:
        """Wait for the state of the world after more than a number of steps; None if the run ends before.

        Args:
            beyond: The number of steps.
            deadline: On the monotonic clock [s]; None for no limit while the host is connected.
            problem: What to report when the deadline passes.

        Raises:
            RunError: The deadline passed, or the host refused this process.
        """
        while True:
            is_made = self._world is not None and self._world.step > beyond
            if is_made and self._run.pacer is None:
                return self._world  # the host waits for our report: nothing newer can come
            happening = self.port.receive(0.0) if is_made or self._over is not None else None
            if happening is None:
                # Nothing newer has arrived.
                if is_made:
                    return self._world
                if self._over is not None:
                    return None
                limit = deadline if self._retry is None else min(self._retry, deadline or self._retry)
                happening = self._wait(limit)
            if happening is None:
                if self._retry is not None and time.monotonic() >= self._retry:
                    self._retry = None
                    if self._peer is not None:
                        self._introduce(self._peer)
                    continue
                self._fail("run", f"{problem}: {self._refusal}" if self._refusal else problem)
            if happening.kind == "came":
                self._introduce(happening.peer)
            elif happening.kind == "gone":
                if happening.peer == self._peer:
                    self._peer = None
                if self._over is not None:
                    continue
                if deadline is None:
                    deadline = time.monotonic() + self._absence
                    text = f"the host at {self.port.address} is gone: {happening.reason}"
                    self._report(Notice("lost", "processes.host", "WARNING", text))
                    # For observers only: the log records the loss when turns may follow from it.
                    waits = f"{text}; waits {self._absence:g} s for it"
                    self._fire(Notice("waiting", "run", "WARNING", waits), recorded=False)
                    problem = f"{text}, and did not come back within {self._absence:g} s"
                elif self._world is None and happening.reason.startswith(CROWDED):
                    self._refusal = happening.reason  # the port connects again; there may be room by then
                elif self._world is None:
                    self._fail("run", f"the host at {self.port.address} does not take us in: {happening.reason}")
            else:
                try:
                    frame = decode(happening.frame)
                except FrameError as error:
                    self._fail("run", f"the host says {error}", error)
                if isinstance(frame, Step) and self._world is not None:
                    deadline = None
                self._take(frame)

    def _introduce(self, peer: int) -> None:
        identity = self.identity
        self._peer = peer
        self._send(peer, Hello(identity.name, identity.scenario, identity.version, identity.agents))

    def _take(self, frame: Frame) -> None:
        if isinstance(frame, Step):
            self._world = frame
            self._contacts += frame.contacts
            self._arrived += frame.arrived
        elif isinstance(frame, End):
            self._over = frame
        elif isinstance(frame, Notice):
            # Every process records the host's own notices; what agents do is in the log of their process.
            self._report(frame, recorded=frame.source.startswith("processes.") or frame.source == "run")
        elif isinstance(frame, Refusal):
            if frame.final:
                self._fail("run", f"the host at {self.port.address} refuses: {frame.reason}")
            self._refusal = frame.reason
            self._retry = time.monotonic() + _PAUSE
        elif isinstance(frame, Welcome):
            self._refusal = ""
        else:
            self._fail("run", f"the host says {type(frame).__name__}, which is not for members")

    def _blame_end(self) -> NoReturn:
        """End the run as the host's run ended: interrupted, failed, or before this process took part."""
        end = self._over
        assert end is not None
        if end.status == "interrupted":
            self._publish()
            raise Interrupted("the end of the host's run")
        said = "failed" if end.status == "failed" else "is over"
        self._fail(end.source, f"the host {said}: {end.reason}")

    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """Send `End` to the host, unless the host sent it to us."""
        if self._has_begun:
            self._publish()
        if self._peer is not None and self._over is None:
            with suppress(RunError):
                self._send(self._peer, End(status, reason, error.source if error else ""))
        self.port.close()


def _require_portable(payload: Mapping[str, Any]) -> None:
    """Check a payload in the turn of the component that sends it.

    Raises:
        TypeError: It cannot be sent to another process.
    """
    entries_to_wire({name: [value] for name, value in payload.items()})
