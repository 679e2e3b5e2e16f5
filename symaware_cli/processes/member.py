"""The member: a process that runs some of the agents in a copy of the host's world."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Any, ClassVar, NoReturn

from symaware_cli.core import Contact, Delivery, Event, Level, MessageBatch
from symaware_cli.core.stateful import StateError
from symaware_cli.engine import FrameError, Interrupted, RunError, SimulationState, entries_to_wire
from symaware_cli.log import LogError, plain
from symaware_cli.processes.absent_agents import Absence
from symaware_cli.processes.checkpoint_file import CheckpointFile
from symaware_cli.processes.codec import decode, encode
from symaware_cli.processes.frame import (
    CROWDED,
    Checkpoint,
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
from symaware_cli.processes.participant import Identity, Participant, rows_of
from symaware_cli.processes.transport import Port

#: The pause before another `Hello`, where another process still runs the agents [s].
_PAUSE = 0.2

#: The least wall time between two checkpoints [s], and in multiples of what the last one took.
_INTERVAL, _SPARING = 0.5, 20.0


class Member(Participant):
    """Runs its agents in a copy of the world that the host steps.

    It goes through the same instants as the host. If it is late, or its connection was lost for a while, it makes up
    for missed steps one after the other, in the latest state of the world.

    If the run goes on when its process dies, it stores its state at intervals. A process that is started in its place
    restores the state, and the host sends it again all frames since then. If the run does not wait for it, its agents
    miss the steps until it is back.
    """

    decides = False

    #: `captured` returns the messages received for the present step; everything else belongs to the process.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self, identity: Identity, port: Port, patience: float, absence: float, checkpoints: CheckpointFile | None = None
    ) -> None:
        """Initialise.

        Args:
            identity: How this process identifies itself.
            port: Its connection to the host; closed at the end.
            patience: How long to wait for the host before the run begins [s].
            absence: How long the host may be gone during the run [s].
            checkpoints: Where to store the state; None not to store it.
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
        self._checkpoints = checkpoints
        #: The state from which this process could continue, and whether the host lets it.
        self._stored: tuple[Checkpoint, SimulationState] | None = None
        self._restores = False
        #: The steps that its agents miss; None if they take part.
        self._missed: Absence | None = None
        #: Whether they take part from the next step on that the host sends.
        self._is_back = False
        #: Why there is no such state though there is a file.
        self._unusable = ""
        self._token = b""
        #: The step of the last checkpoint, until it is reported, and when the next one is due on the monotonic clock.
        self._reached: int | None = None
        self._due = 0.0
        self._is_warned = False

    def _meet(self) -> None:
        simulation, run = self._simulation, self._run
        here = self.identity.agents
        names = [*here, *(group.name for group in simulation.groups if set(group.ids) <= set(here))]
        self._own = tuple(f"agents.{name}." for name in names)
        self._rows = [(group, rows) for group in simulation.groups if len(rows := rows_of(group, here))]
        simulation.exchange.redirect_sent(self._post, _require_portable)
        simulation.events.subscribe("*", self._on_event)
        if not self._goes_on_without(here):
            self._checkpoints = None
        problem = f"no host at {self.port.address} took us in within {self._patience:g} s"
        step = self._await(-1, time.monotonic() + self._patience, problem)
        if self._restores:
            return  # `begun` restores the state
        if step is None:
            self._blame_end()
        if step.step and self._checkpoints is not None:
            path = self._checkpoints.path
            old = f"{path} is of another run, or the host no longer has what it sent since then"
            why = self._unusable or (f"there is no stored state: {path} is missing" if self._stored is None else old)
            self._warn("not-restored", f"{why}; the agents of {self.identity.name} begin anew", recorded=True)
        self._stored = None
        run.kernel.join(step.step, step.time)
        self._follow(step)

    def _look_for_state(self) -> None:
        """Read the state that an earlier process of this member has stored last."""
        if self._checkpoints is None or self._world is not None or self._restores:
            return
        self._stored, self._unusable = None, ""
        try:
            self._stored = self._checkpoints.read()
        except StateError as error:
            self._unusable = str(error)

    def begun(self) -> None:
        """Restore the stored state, if the host repeats the frames that it has sent since then."""
        if self._stored is None or self._checkpoints is None:
            return
        (_, state), self._stored = self._stored, None
        identity = self.identity
        try:
            self._run.restore(state, identity.scenario.hex(), identity.version)
        except StateError as error:
            # The run goes on: the host loses this process, as if it had died.
            self._peer = None
            self._checkpoints.remove()
            said = f"{self._checkpoints.path} cannot be restored, and is removed: {error}"
            self._fail("run", f"{said}; start the process again to let the agents begin anew", error)
        text = f"{identity.name} continues from its state at {state.time / 1e9:g} s"
        self._warn("restored", text, recorded=True)

    def stepped(self) -> None:
        """Store the state at intervals, if this process has followed all steps of the host."""
        file, run, world, began = self._checkpoints, self._run, self._world, time.monotonic()
        if file is None or began < self._due or world is None or world.step != run.kernel.done:
            return
        if self._missed is not None and run.kernel.done >= self._missed.first:
            return
        try:
            file.write(self._token, run.capture(self.identity.scenario.hex(), self.identity.version))
            self._reached = run.kernel.done
        except (StateError, LogError) as error:
            if not self._is_warned:
                # Not recorded: it depends on wall time.
                self._is_warned = True
                self._warn("not-stored", f"the state of {self.identity.name} is not stored: {error}", recorded=False)
        now = time.monotonic()
        self._due = now + max(_INTERVAL, _SPARING * (now - began))

    def captured(self) -> dict[str, Any]:
        """The messages received for the present step that did not take effect yet, as encoded frames."""
        done, now = self._run.kernel.done, self._simulation.clock.now
        return {
            "step": encode(Step(done, now, {}, (), tuple(self._arrived))),
            "report": encode(Report(done, {}, tuple(self._posts))),
            "news": [[encode(notice), recorded] for notice, recorded in self._news],
        }

    def restored(self, state: Mapping[str, Any]) -> None:
        """Restore the messages that `captured` returned."""
        step, report = decode(state["step"]), decode(state["report"])
        news = [(decode(data), recorded) for data, recorded in state["news"]]
        if not isinstance(step, Step) or not isinstance(report, Report):
            raise TypeError("the frames are of other kinds")
        self._world, self._arrived, self._posts = step, list(step.arrived), list(report.posts)
        self._contacts, self._news = [], [(each, recorded) for each, recorded in news if isinstance(each, Notice)]

    def _warn(self, name: str, text: str, *, recorded: bool) -> None:
        self._fire(Notice(name, f"processes.{self.identity.name}", "WARNING", text), recorded=recorded)

    def _on_event(self, event: Event) -> None:
        """Send the events of our agents' components to the host; errors end the run, which `End` reports."""
        if self._peer is None or event.subject is self:
            return
        if event.level is Level.ERROR and event.name == "failed":
            return
        if self._missed is not None:
            return  # the host has had the events of the steps that are repeated
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
        """Deliver the messages that the host sent, and let our agents miss the steps that the run made without them."""
        super().arrived()
        missed, done = self._missed, self._run.kernel.done
        arrived, self._arrived = self._arrived, []
        self._simulation.exchange.arrive(arrived)
        if missed is not None:
            if missed.until is not None and done >= missed.until:
                self._missed, self._due = None, 0.0
            missed.update(done)

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
        reached, self._reached = self._reached, None
        self._send(self._peer, Report(self._run.kernel.done, requested, posts, self._run.observer.peak(), reached))

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
        while not (self._restores and self._world is None):
            is_made = self._world is not None and self._world.step > beyond
            if is_made and (self._run.pacer is None or self._repeats):
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
        return None

    @property
    def _repeats(self) -> bool:
        """Whether it goes through steps of the past, one after the other."""
        return self._missed is not None and self._missed.until is None

    def _introduce(self, peer: int) -> None:
        identity = self.identity
        self._peer = peer
        # At each attempt: until the host has room, the earlier process may be running and storing its state.
        self._look_for_state()
        offered = None if self._stored is None else self._stored[0]
        self._send(peer, Hello(identity.name, identity.scenario, identity.version, identity.agents, offered))

    def _take(self, frame: Frame) -> None:
        if isinstance(frame, Step):
            self._world = frame
            self._contacts += frame.contacts
            self._arrived += frame.arrived
            if self._is_back and self._missed is not None:
                self._is_back, self._missed.until = False, frame.step
        elif isinstance(frame, End):
            self._over = frame
        elif isinstance(frame, Notice):
            # Every process records the host's own notices; what agents do is in the log of their process.
            self._report(frame, recorded=frame.source.startswith("processes.") or frame.source == "run")
        elif isinstance(frame, Refusal):
            if frame.final:
                self._fail("run", f"the host at {self.port.address} refuses: {frame.reason}")
            if frame.reason != self._refusal:
                # For observers only: it depends on wall time.
                self._fire(Notice("waiting", "run", "INFO", f"{frame.reason}; waits for them"), recorded=False)
            self._refusal = frame.reason
            self._retry = time.monotonic() + _PAUSE
        elif isinstance(frame, Welcome):
            self._refusal, self._token, self._restores = "", frame.run, frame.restores
            if frame.absent is not None:
                self._missed = Absence(frame.absent, self._run, self._rows)
            else:
                self._is_back = self._missed is not None
            if self._run.pacer is not None and not math.isnan(frame.started):
                self._run.pacer.start_at(frame.started - self.port.offset(self._peer or 0))
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
        took_part = self._world is not None
        if took_part and self._checkpoints is not None and (status != "interrupted" or self._over is not None):
            self._checkpoints.remove()
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
