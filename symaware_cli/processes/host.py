"""The host: the process that steps the world and carries all messages.

Reasons: docs/decisions/0017-several-processes.md
"""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType

import numpy as np

from symaware_cli.core import Delivery, Level
from symaware_cli.engine import FrameError, RunError
from symaware_cli.processes.codec import decode
from symaware_cli.processes.frame import (
    End,
    Hello,
    Notice,
    Post,
    Refusal,
    Report,
    Step,
    Welcome,
)
from symaware_cli.processes.lost_members import LostMembers
from symaware_cli.processes.participant import Identity, Participant, rows_of
from symaware_cli.processes.rejections import Rejections
from symaware_cli.processes.remote_inputs import RemoteInputs, RemoteMember
from symaware_cli.processes.sent_frames import SentFrames
from symaware_cli.processes.transport import Port, PortEvent
from symaware_cli.world import listed

#: How a farewell describes the run, by the status with which it ended.
_SAID = {"finished": "is over", "failed": "failed", "interrupted": "was interrupted"}

#: Most events of the port that are handled before the run continues, if it need not wait for more.
_MOST_AT_ONCE = 4096

#: Longest reason given by another process that is repeated, in characters.
_REASON = 200


class Host(Participant):
    """Steps the world, carries the messages, and admits the members.

    Without a pace it waits in each step for the reports of all members, so that the run is the same as in one process.
    With a pace it does not wait: the world moves under the last control input of each agent.
    """

    decides = True

    def __init__(self, identity: Identity, port: Port, patience: float, silence: float) -> None:
        """Initialise.

        Args:
            identity: How this process identifies itself.
            port: Its connections to the members; closed at the end.
            patience: How long to wait for members, before the run begins and when one is lost [s].
            silence: How long a connection may take to ask to take part [s].
        """
        super().__init__(identity, port, patience)
        self._silence = silence
        self._members: dict[int, RemoteMember] = {}
        #: Tells checkpoints of this run from those of others.
        self._token = os.urandom(16)
        self._inputs: RemoteInputs
        self._lost: LostMembers
        self._posts: list[tuple[int, Post]] = []
        self._notices: list[tuple[int, int, Notice]] = []
        self._losses: Counter[str] = Counter()
        #: The agents for whose return the run waits, and until when.
        self._awaited: set[str] = set()
        self._return_due = 0.0
        #: Connections that are not members, and until when each may send `Hello`.
        self._guests: dict[int, float] = {}
        self._rejections = Rejections(port.rejected)

    def _meet(self) -> None:
        simulation, here = self._simulation, frozenset(self.identity.agents)
        away = [id for id in simulation.environment.roster.ids if id not in here]
        self._away = frozenset(away)
        simulation.exchange.redirect_arrivals(away, self._forward)
        self._inputs = RemoteInputs(simulation, away)
        self._lost = LostMembers(self._run.schedulers, self._inputs)
        text = f"waits at {self.port.address} for {listed(away)}"
        simulation.announce("waiting", "run", text, agents=away, address=self.port.address)
        deadline = time.monotonic() + self._patience
        while missing := self._missing:
            happening = self._wait(deadline)
            if happening is None:
                self._fail("run", f"no process joined within {self._patience:g} s for {listed(missing)}")
            self._take(happening)
        # The log must not depend on who came first.
        for member in self._in_order:
            self._tell_all("joined", member, f"{member.name} takes part and runs {listed(member.agents)}")

    @property
    def _missing(self) -> list[str]:
        present = {id for member in self._members.values() for id in member.agents}
        return [id for id in self._simulation.environment.roster.ids if id in self._away and id not in present]

    @property
    def _in_order(self) -> list[RemoteMember]:
        """The members whose agents take part, in the order of their first agents."""
        return sorted((each for each in self._members.values() if each.absent is None), key=lambda each: each.rank)

    @property
    def _returning(self) -> list[RemoteMember]:
        """The rejoining members that still repeat the steps they missed; their agents do not take part yet."""
        return [each for each in self._members.values() if each.absent is not None]

    def begun(self) -> None:
        """Continue: a host never restores a state."""

    def stepped(self) -> None:
        """Continue: a host stores no state."""

    def arrived(self) -> None:
        """Send the state of the world, and the messages that arrived, to all members."""
        super().arrived()
        self._lost.update(self._run.kernel.done)
        self._tell(self._run.kernel.done)

    def _tell(self, step: int) -> None:
        simulation, environment = self._simulation, self._simulation.environment
        members = [*self._in_order, *self._returning, *self._lost.absent]
        if not members:
            return
        world, contacts = environment.share(), tuple(environment.contacts())
        started = self._started
        for member in members:
            arrived = tuple(member.arrived)
            member.arrived.clear()
            frame = Step(step, simulation.clock.now, world, contacts, arrived, started)
            self._deliver(member, frame)

    @property
    def _started(self) -> float:
        pacer = self._run.pacer
        return float("nan") if pacer is None or pacer.started is None else pacer.started

    def _forward(self, arrived: Delivery) -> None:
        """Keep messages for agents of members until the next `Step` is sent."""
        for member in self._members.values():
            if member.absent is not None:
                continue
            mine = member.is_here[arrived.receivers]
            if mine.any():
                member.arrived.append(arrived.some(mine))

    def acted(self) -> None:
        """Collect the reports of this instant, if the run keeps step."""
        if self._keeps_step:
            self._collect()

    def step(self) -> str | None:
        """Step the world under the control inputs of all agents."""
        if not self._keeps_step:
            self._collect()
        self._tell_rejections()
        # With the control inputs of the members' agents.
        present = self._inputs.exchange()
        try:
            self._run.motion.step()
        finally:
            self._inputs.restore(present)
        return None

    def _collect(self) -> None:
        """Handle received messages; without a pace, wait until all members have reported and lost ones are back."""
        if self._run.pacer is None and self._in_order:
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
        while self._awaited or self._reports_missing:
            happening = self._wait(self._return_due if self._awaited else None)
            if happening is not None:
                self._take(happening)
            elif self._awaited:
                ids = listed(id for id in self._simulation.environment.roster.ids if id in self._awaited)
                self._fail("run", f"no process rejoined within {self._patience:g} s for {ids}")

    @property
    def _reports_missing(self) -> bool:
        done = self._run.kernel.done
        return any(
            member.reported < done or member.repeated if member.absent is None else member.heard < done
            for member in self._members.values()
        )

    def _deliver_posts(self) -> None:
        """Send the messages of members on, in an order that does not depend on which report came first."""
        if not self._posts:
            return
        exchange = self._simulation.exchange
        posts, self._posts = sorted(self._posts, key=lambda each: (each[1].time, each[0])), []
        for _, post in posts:
            exchange.post(post.batch, min(post.time, exchange.now))

    def _deliver_notices(self) -> None:
        """Fire the events of members here and pass them on; the logs of the members record them."""
        if self._keeps_step:
            # All turns of this instant are over: triggered turns follow with the next step, as in other processes.
            self._run.kernel.queue.place = len(self._run.schedulers)
        if not self._notices:
            return
        notices, self._notices = sorted(self._notices, key=lambda each: each[0]), []
        for _, peer, notice in notices:
            if self._keeps_step:
                self._fire(notice, recorded=False)
            else:
                self._report(notice, recorded=False)
            for other in (*self._in_order, *self._returning, *self._lost.absent):
                if other.peer != peer:
                    self._deliver(other, notice)

    def _take(self, happening: PortEvent) -> None:
        """Handle an event of the port."""
        member = self._members.get(happening.peer)
        if happening.kind == "gone":
            self._guests.pop(happening.peer, None)
            if member:
                self._lose(member, happening.reason)
            return
        if happening.kind == "came":
            self._guests[happening.peer] = time.monotonic() + self._silence
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
                if member.heard < member.repeats:
                    return
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
        """Admit a process as a member, or refuse it."""
        refusal = self._objection(peer, hello)
        if refusal:
            self._send(peer, refusal)
            if refusal.final:
                self._guests.pop(peer, None)
                self.port.cut(peer, refusal.reason)
            elif peer in self._guests:
                self._guests[peer] = time.monotonic() + self._silence
            return
        self._guests.pop(peer, None)
        self.port.accept(peer)
        run, roster = self._run, self._simulation.environment.roster
        agents = tuple(sorted(hello.agents, key=roster.index))
        member, since = self._lost.take_back(hello, agents, self._token), None
        restores = member is not None
        if member is None:
            indices = [roster.index(id) for id in agents]
            is_here = np.zeros(len(roster), bool)
            is_here[indices] = True
            # In the middle of a run it begins with the next step.
            reported = run.kernel.done if run.kernel.has_begun else -1
            member = RemoteMember(peer, hello.name, agents, is_here, indices[0], reported)
            since = self._lost.give_up(agents)
            if self._goes_on_without(agents):
                member.sent = SentFrames()
        elif member.absent is None and member.reported < run.kernel.done:
            # It fires the events of the present step again.
            self._notices = [each for each in self._notices if each[1] != member.peer]
        member.peer = peer
        self._members[peer] = member
        self._welcome(member, restores=restores)
        self._repeat(member)
        self._awaited.difference_update(agents)
        if member.absent is not None:
            self._admit_again(member)
        elif run.kernel.has_begun:
            self._tell_return(member, since)
        elif missing := self._missing:
            # For observers only; the log records all members when the run begins.
            text = f"{member.name} is there; waits for {listed(missing)}"
            self._fire(Notice("waiting", "run", "INFO", text, {"agents": missing}), recorded=False)

    def _admit_again(self, member: RemoteMember) -> None:
        """Let the agents of a member take part again from the next step on, once it has made all steps until now.

        With a pace it may be one step behind, as the run does not wait for it.
        """
        done = self._run.kernel.done
        if member.repeated or member.heard < done - (self._run.pacer is not None):
            return
        since, member.absent = member.absent, None
        # The checkpoint from which it continued is of no further use: its agents were absent since then.
        member.sent, member.reported, member.repeats = SentFrames(), done, done
        self._welcome(member)
        self._tell_return(member, since)

    def _welcome(self, member: RemoteMember, *, restores: bool = False) -> None:
        """Tell a member that it is admitted, or that its agents take part again."""
        run = self._run
        pace, now = run.pacer.factor if run.pacer else 0.0, self._simulation.clock.now
        welcome = Welcome(run.kernel.done, now, pace, self._started, self._token, restores, member.absent)
        self._send(member.peer, welcome)

    def _tell_return(self, member: RemoteMember, since: int | None) -> None:
        """Have every process record that a member rejoined, and from which step on its agents were absent."""
        data: dict[str, float] = {}
        text = f"{member.name} is back and runs {listed(member.agents)}"
        if since is not None:
            time_step, upcoming = self._run.kernel.time_step, self._run.kernel.done + 1
            data = {"absent_from": since * time_step / 1e9, "absent_until": upcoming * time_step / 1e9}
            text += f", which were absent from {data['absent_from']:.9g} s to {data['absent_until']:.9g} s"
        self._tell_all("rejoined", member, text, Level.WARNING, data)

    def _deliver(self, member: RemoteMember, frame: Step | Notice) -> None:
        """Send a frame to a member, after those that are to be repeated.

        Raises:
            RunError: It cannot be sent.
        """
        data = self._encoded(frame)
        step = frame.step if isinstance(frame, Step) else None
        if member.sent is not None:
            member.sent.add(data, step)
        if member.peer not in self._members:
            return
        if member.repeated or member.absent is not None:
            member.repeated.add(data, step)
            self._repeat(member)
        else:
            self._send_encoded(member.peer, data)

    def _repeat(self, member: RemoteMember) -> None:
        """Send frames again, as far as the member can take them."""
        for data in member.repeated.due(member.heard):
            self._send_encoded(member.peer, data)

    def _objection(self, peer: int, hello: Hello) -> Refusal | None:
        """Why a process is refused; None if it is admitted."""
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
        for member in self._members.values():
            taken = [id for id in member.agents if id in hello.agents]
            if taken:
                return Refusal(f"{listed(taken)} run in {member.name}", final=False)
        if hello.name in (identity.name, *(member.name for member in self._members.values())):
            return Refusal(f"another process is called {hello.name}; give this one a --name of its own")
        return None

    def _hear(self, member: RemoteMember, report: Report) -> None:
        """Store the report of a member."""
        if report.checkpoint is not None and member.sent is not None:
            member.sent.keep_since(report.checkpoint)
        member.heard = report.step
        self._repeat(member)
        if member.absent is not None:
            self._admit_again(member)
            return
        if report.step <= member.repeats:
            return
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
        """Wait for the next event as `Participant` does, and cut off silent connections meanwhile."""
        while True:
            if not self._guests:
                return super()._wait(deadline)
            self._send_off_silent()
            soonest = min([each for each in (deadline, *self._guests.values()) if each is not None], default=None)
            happening = super()._wait(soonest)
            if happening is not None or (deadline is not None and time.monotonic() >= deadline):
                return happening

    def _send_off_silent(self) -> None:
        """Cut off connections that did not send `Hello` in time."""
        if not self._guests:
            return
        now = time.monotonic()
        for peer in [peer for peer, until in self._guests.items() if until <= now]:
            del self._guests[peer]
            self.port.cut(peer, f"it did not say within {self._silence:g} s what it wants")
            self._rejections.count(f"a stranger did not say within {self._silence:g} s what it wants")

    def _part(self, member: RemoteMember, end: End) -> None:
        """Handle the `End` of a member."""
        if end.status == "failed":
            self._members.pop(member.peer)
            self._fail(end.source, f"in {member.name}: {end.reason}")
        self._lose(member, f"it was {end.status}" if end.status != "finished" else "it has finished")

    def _lose(self, member: RemoteMember, reason: str) -> None:
        """Handle the loss of a member, as `on_failure` of the components of its agents states.

        Raises:
            RunError: The loss ends the run.
        """
        if self._members.pop(member.peer, None) is None:
            return
        self.port.cut(member.peer, reason)
        run = self._run
        if member.absent is not None:
            self._lost.add(member)  # it died again before its agents took part again
            return
        text = f"{member.name}, which runs {listed(member.agents)}, is gone: {reason}"
        self._tell_all("lost", member, text, Level.WARNING)
        if not run.kernel.has_begun:
            return
        self._return_due = time.monotonic() + self._patience
        if not self._waits_for(member.agents):
            member.absent = member.reported + 1
        self._lost.add(member)
        self._lost.update(run.kernel.done)
        for scheduler in run.schedulers:
            group, timing = scheduler.entry.group, scheduler.entry.timing
            rows = rows_of(group, member.agents)
            if not len(rows):
                continue
            self._losses[scheduler.entry.label] += 1
            path, restarts = scheduler.entry.path, timing.on_failure == "restart"
            if timing.on_failure == "stop":
                self._fail(f"processes.{member.name}", f"{text}; `{path}` has `on_failure: stop`")
            if restarts and self._losses[scheduler.entry.label] > timing.tries:
                self._fail(f"processes.{member.name}", f"{text}; `{path}` has `tries: {timing.tries}`")
            if restarts and run.pacer is None:
                self._awaited.update(id for id in member.agents if id in group.ids)
        if self._awaited:
            # For observers only; the log records the loss when turns may follow from it.
            waits = f"{text}; waits {self._patience:g} s for it"
            self._fire(Notice("waiting", "run", "WARNING", waits), recorded=False)

    def _tell_all(
        self,
        name: str,
        member: RemoteMember,
        text: str,
        level: Level = Level.INFO,
        further: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        """Have every process record that a member came or went."""
        data = {"process": member.name, "agents": list(member.agents), **further}
        notice = Notice(name, f"processes.{member.name}", level.name, text, data)
        self._report(notice)
        for each in (*self._in_order, *self._returning, *self._lost.absent):
            self._deliver(each, notice)

    def _tell_rejections(self, at_last: bool = False) -> None:
        """Record the number of rejected frames, at most once a second."""
        notice = self._rejections.news(at_last)
        if notice is not None:
            self._report(notice)

    def end(self, status: str, reason: str, error: RunError | None) -> None:
        """Send the final state of the world and the end of the run to all members."""
        if self._has_begun:
            self._tell_rejections(at_last=True)
            self._publish()
        with suppress(RunError):
            if status == "finished" and self._has_begun and self._run.kernel.is_complete:
                self._tell(self._run.kernel.done)
        for peer in list(self._members):
            with suppress(RunError):
                self._send(peer, End(status, reason, error.source if error else ""))
        # Connections that are not members get only the reason in the farewell.
        self.port.close(f"the host's run {_SAID[status]}: {reason}")
