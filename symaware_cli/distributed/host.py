"""The host: the process in which the world is, and over which all messages go."""

from __future__ import annotations

import math
import time
from collections import Counter
from contextlib import suppress

import numpy as np

from symaware_cli.core import Delivery, Level
from symaware_cli.distributed.codec import decode
from symaware_cli.distributed.frame import (
    End,
    Hello,
    Notice,
    Post,
    Refusal,
    Report,
    Step,
    Welcome,
)
from symaware_cli.distributed.participant import Identity, Participant, listed, rows_of
from symaware_cli.distributed.rejections import Rejections
from symaware_cli.distributed.remote_inputs import RemoteInputs
from symaware_cli.distributed.remote_member import RemoteMember
from symaware_cli.distributed.transport import Port, PortEvent
from symaware_cli.network.value import FrameError
from symaware_cli.runtime.failure import RunError

#: For how long who came may say nothing that makes it a member [s].
_SILENCE = 2.0

#: What is said of a run, by the status with which it ended.
_SAID = {"finished": "is over", "failed": "failed", "interrupted": "was interrupted"}

#: So many things that happened at the port are taken before the run goes on, if it need not wait for more.
_MOST_AT_ONCE = 4096

#: So much of a reason that somebody else gave is told, in characters.
_REASON = 200


class Host(Participant):
    """Keeps the world, carries the messages, and knows who is there.

    Without a pace it waits in each step for the reports of all members, so that the run is the same as in one process.
    With one it waits for nobody: the world moves under the last control input of each agent.
    """

    decides = True

    def __init__(self, identity: Identity, port: Port, patience: float) -> None:
        super().__init__(identity, port, patience)
        self._members: dict[int, RemoteMember] = {}
        self._inputs: RemoteInputs
        self._posts: list[tuple[int, Post]] = []
        self._notices: list[tuple[int, int, Notice]] = []
        self._losses: Counter[str] = Counter()
        #: For whose return the run waits, and how long.
        self._awaited: set[str] = set()
        self._return_due = 0.0
        #: Who came and is no member, and until when each may say that it wants to be.
        self._guests: dict[int, float] = {}
        self._rejections = Rejections(port.rejected)

    def _meet(self) -> None:
        simulation, here = self._simulation, frozenset(self.identity.agents)
        away = [id for id in simulation.environment.roster.ids if id not in here]
        self._away = frozenset(away)
        simulation.exchange.forward(away, self._forward)
        self._inputs = RemoteInputs(simulation, away)
        text = f"waits at {self.port.address} for {listed(away)}"
        simulation.announce("waiting", "run", text, agents=away, address=self.port.address)
        deadline = time.monotonic() + self._patience
        while missing := self._missing:
            happening = self._wait(deadline)
            if happening is None:
                self._fail("run", f"nobody came within {self._patience:g} s for {listed(missing)}")
            self._take(happening)
        # Who came first must not decide on what the log says.
        for member in self._in_order:
            self._tell_all("joined", member, f"{member.name} takes part and runs {listed(member.agents)}")

    @property
    def _missing(self) -> list[str]:
        present = {id for member in self._members.values() for id in member.agents}
        return [id for id in self._simulation.environment.roster.ids if id in self._away and id not in present]

    @property
    def _in_order(self) -> list[RemoteMember]:
        return sorted(self._members.values(), key=lambda member: member.rank)

    def arrived(self) -> None:
        """Tell everybody how the world is, and what arrived."""
        super().arrived()
        self._tell(self._run.kernel.done)

    def _tell(self, step: int) -> None:
        simulation, environment = self._simulation, self._simulation.environment
        if not self._members:
            return
        world, contacts = environment.share(), tuple(environment.contacts())
        started = self._started
        for member in self._in_order:
            arrived = tuple(member.arrived)
            member.arrived.clear()
            frame = Step(step, simulation.clock.now, world, contacts, arrived, started)
            self._send(member.peer, frame)

    @property
    def _started(self) -> float:
        pacer = self._run.pacer
        return float("nan") if pacer is None or pacer.started is None else pacer.started

    def _forward(self, arrived: Delivery) -> None:
        """Keep what arrived for agents that run elsewhere until their process is told."""
        for member in self._members.values():
            mine = member.is_here[arrived.receivers]
            if mine.any():
                member.arrived.append(arrived.some(mine))

    def acted(self) -> None:
        """Collect what everybody did, where that is known before the run goes on, or ends."""
        if self._keeps_step:
            self._collect()

    def step(self) -> str | None:
        """Move the world under what everybody did."""
        if not self._keeps_step:
            self._collect()
        self._tell_rejections()
        # Under what members want their agents to do, too.
        with self._inputs.applied():
            self._run.motion.step()
        return None

    def _collect(self) -> None:
        """Take what has come; without a pace, wait until all members have reported, and who is lost is back."""
        if self._run.pacer is None and self._members:
            self._wait_for_reports()
        else:
            self._take_what_came()
            if self._run.pacer is None:
                self._wait_for_reports()
        self._deliver_posts()
        self._deliver_notices()

    def _take_what_came(self) -> None:
        for _ in range(_MOST_AT_ONCE):
            happening = self.port.receive(0.0)
            if happening is None:
                break
            self._take(happening)
        self._send_off_silent()

    def _wait_for_reports(self) -> None:
        while self._awaited or any(member.reported < self._run.kernel.done for member in self._members.values()):
            happening = self._wait(self._return_due if self._awaited else None)
            if happening is not None:
                self._take(happening)
            elif self._awaited:
                ids = listed(id for id in self._simulation.environment.roster.ids if id in self._awaited)
                self._fail("run", f"nobody came back within {self._patience:g} s for {ids}")

    def _deliver_posts(self) -> None:
        """Let what members said go on its way, in an order that does not depend on who was faster."""
        exchange = self._simulation.exchange
        posts, self._posts = sorted(self._posts, key=lambda each: (each[1].time, each[0])), []
        for _, post in posts:
            exchange.post(post.batch, min(post.time, exchange.now))

    def _deliver_notices(self) -> None:
        """Let everybody know what members told of; their own parts of the log have it."""
        notices, self._notices = sorted(self._notices, key=lambda each: each[0]), []
        if self._keeps_step:
            # All turns of this instant are over: what is triggered follows with the next step, as in other processes.
            self._run.kernel.queue.place = len(self._run.schedulers)
        for _, peer, notice in notices:
            if self._keeps_step:
                self._fire(notice, recorded=False)
            else:
                self._report(notice, recorded=False)
            for other in self._in_order:
                if other.peer != peer:
                    self._send(other.peer, notice)

    def _take(self, happening: PortEvent) -> None:
        """Take note of what happened at the port."""
        member = self._members.get(happening.peer)
        if happening.kind == "gone":
            self._guests.pop(happening.peer, None)
            if member:
                self._lose(member, happening.reason)
            return
        if happening.kind == "came":
            self._guests[happening.peer] = time.monotonic() + _SILENCE
            return
        try:
            frame = decode(happening.frame)
            if isinstance(frame, Hello):
                self._greet(happening.peer, frame)
            elif member is None:
                raise FrameError("somebody who is no member speaks")
            elif isinstance(frame, Report):
                self._hear(member, frame)
            elif isinstance(frame, Notice):
                self._notices.append((member.rank, member.peer, frame))
            elif isinstance(frame, End):
                self._part(member, frame)
            else:
                raise FrameError(f"a member does not say {type(frame).__name__}")
        except FrameError as error:
            reason = str(error)[:_REASON]
            self.port.cut(happening.peer, reason)
            self._guests.pop(happening.peer, None)
            self._rejections.count(f"what {member.name if member else 'a stranger'} said is not taken: {reason}")
            if member:
                self._lose(member, reason)

    def _greet(self, peer: int, hello: Hello) -> None:
        """Take a process in, or refuse it."""
        refusal = self._objection(peer, hello)
        if refusal:
            self._send(peer, refusal)
            if refusal.final:
                self._guests.pop(peer, None)
                self.port.cut(peer, refusal.reason)
            elif peer in self._guests:
                self._guests[peer] = time.monotonic() + _SILENCE
            return
        self._guests.pop(peer, None)
        self.port.accept(peer)
        run, roster = self._run, self._simulation.environment.roster
        agents = tuple(sorted(hello.agents, key=roster.index))
        indices = [roster.index(id) for id in agents]
        is_here = np.zeros(len(roster), bool)
        is_here[indices] = True
        # In the middle of a run it begins with the step that is made next.
        reported = run.kernel.done if run.kernel.has_begun else -1
        member = self._members[peer] = RemoteMember(peer, hello.name, agents, is_here, indices[0], reported)
        pace = run.pacer.factor if run.pacer else 0.0
        self._send(peer, Welcome(run.kernel.done, self._simulation.clock.now, pace, self._started))
        self._awaited.difference_update(agents)
        if run.kernel.has_begun:
            text = f"{member.name} is back and runs {listed(agents)}"
            self._tell_all("rejoined", member, text, Level.WARNING)
        elif missing := self._missing:
            # For who watches; the log tells of all when the run begins.
            text = f"{member.name} is there; waits for {listed(missing)}"
            self._fire(Notice("waiting", "run", "INFO", text, {"agents": missing}), recorded=False)

    def _objection(self, peer: int, hello: Hello) -> Refusal | None:
        """What speaks against taking a process in."""
        identity = self.identity
        if peer in self._members:
            return Refusal("it takes part already")
        if hello.version != identity.version:
            return Refusal(f"the host is SymAware {identity.version}, and this is {hello.version}")
        if hello.scenario != identity.scenario:
            return Refusal("the host runs another scenario: file, seed and --set must be the same")
        strangers = [id for id in hello.agents if id not in self._away]
        if strangers or not hello.agents:
            return Refusal(f"the host runs {listed(strangers)} itself" if strangers else "it has no agents")
        for member in self._in_order:
            taken = [id for id in member.agents if id in hello.agents]
            if taken:
                return Refusal(f"{listed(taken)} run in {member.name}", final=False)
        if hello.name in (identity.name, *(member.name for member in self._members.values())):
            return Refusal(f"another process is called {hello.name}; give this one a --name of its own")
        return None

    def _hear(self, member: RemoteMember, report: Report) -> None:
        """Take what a member's agents did."""
        for name, (rows, inputs) in report.inputs.items():
            self._inputs.take(member, name, rows, inputs)
        everybody = len(member.is_here)
        for post in report.posts:
            senders, receivers = post.batch.senders, post.batch.receivers
            is_own = member.owns(senders, senders, everybody)
            is_known = receivers is None or bool((receivers < everybody).all())
            if not is_own:
                raise FrameError("messages of agents that are not its own")
            if not is_known:
                raise FrameError("messages to agents that do not exist")
            self._posts.append((member.rank, post))
        if report.peak is not None:
            risk, agent = report.peak
            if agent not in member.agents or math.isnan(risk):
                raise FrameError("a risk that none of its agents can see")
            self._run.observer.reported[member.rank] = report.peak
        else:
            self._run.observer.reported.pop(member.rank, None)
        member.reported = max(member.reported, report.step)

    def _wait(self, deadline: float | None = None) -> PortEvent | None:
        """Wait for what happens next, and send off meanwhile who does not say what it wants; see `Participant`."""
        while True:
            self._send_off_silent()
            soonest = min([each for each in (deadline, *self._guests.values()) if each is not None], default=None)
            happening = super()._wait(soonest)
            if happening is not None or (deadline is not None and time.monotonic() >= deadline):
                return happening

    def _send_off_silent(self) -> None:
        """Let go of who came and does not say in time that it wants to be a member."""
        if not self._guests:
            return
        now = time.monotonic()
        for peer in [peer for peer, until in self._guests.items() if until <= now]:
            del self._guests[peer]
            self.port.cut(peer, f"it did not say within {_SILENCE:g} s what it wants")
            self._rejections.count(f"a stranger did not say within {_SILENCE:g} s what it wants")

    def _part(self, member: RemoteMember, end: End) -> None:
        """A member says that it is over."""
        if end.status == "failed":
            self._members.pop(member.peer)
            self._fail(end.source, f"in {member.name}: {end.reason}")
        self._lose(member, f"it was {end.status}" if end.status != "finished" else "it has finished")

    def _lose(self, member: RemoteMember, reason: str) -> None:
        """A member is gone: do what the scenario says about a failure of the components of its agents.

        Raises:
            RunError: That ends the run.
        """
        if self._members.pop(member.peer, None) is None:
            return
        self.port.cut(member.peer, reason)
        run = self._run
        text = f"{member.name}, which runs {listed(member.agents)}, is gone: {reason}"
        self._tell_all("lost", member, text, Level.WARNING)
        if not run.kernel.has_begun:
            return
        self._return_due = time.monotonic() + self._patience
        for scheduler in run.schedulers:
            group, timing = scheduler.entry.group, scheduler.entry.timing
            rows = rows_of(group, member.agents)
            if not len(rows):
                continue
            self._losses[scheduler.entry.path] += 1
            path, restarts = scheduler.entry.path, timing.on_failure == "restart"
            if timing.on_failure == "stop":
                self._fail(f"processes.{member.name}", f"{text}; `{path}` has `on_failure: stop`")
            if restarts and self._losses[path] > timing.tries:
                self._fail(f"processes.{member.name}", f"{text}; `{path}` has `tries: {timing.tries}`")
            if restarts and run.pacer is None:
                self._awaited.update(id for id in member.agents if id in group.ids)
            if timing.coast == "safe":
                self._inputs.slow_down(group, rows)
        if self._awaited:
            # For who watches; the log tells of it when turns may follow from it.
            waits = f"{text}; waits {self._patience:g} s for it"
            self._fire(Notice("waiting", "run", "WARNING", waits), recorded=False)

    def _tell_all(self, name: str, member: RemoteMember, text: str, level: Level = Level.INFO) -> None:
        """Let everybody write down who came or went."""
        data = {"process": member.name, "agents": list(member.agents)}
        notice = Notice(name, f"processes.{member.name}", level.name, text, data)
        self._report(notice)
        for each in self._in_order:
            self._send(each.peer, notice)

    def _tell_rejections(self, at_last: bool = False) -> None:
        """Record how many frames were not taken, now and then."""
        notice = self._rejections.news(at_last)
        if notice is not None:
            self._report(notice)

    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """Tell everybody that the run is over, and how the world is then."""
        if self._has_begun:
            self._tell_rejections(at_last=True)
            self._publish()
        with suppress(RunError):
            if status == "finished" and self._has_begun and self._run.kernel.is_complete:
                self._tell(self._run.kernel.done)
        for member in self._in_order:
            with suppress(RunError):
                self._send(member.peer, End(status, reason, error.source if error else ""))
        # Who is not a member yet can only be told why the connection ends.
        self.port.close(f"the host's run {_SAID[status]}: {reason}")
