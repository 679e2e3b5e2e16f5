"""The members whose processes died, and the control inputs of their agents until these take part again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from symaware_cli.engine import TurnScheduler
from symaware_cli.processes.frame import Hello
from symaware_cli.processes.participant import rows_of
from symaware_cli.processes.remote_inputs import RemoteInputs, RemoteMember
from symaware_cli.processes.sent_frames import RepeatedFrames


class LostMembers:
    """Keeps what other processes need to continue from the checkpoints of lost members.

    While the run waits for a member, the last control inputs of its agents stay in force. Otherwise its agents coast,
    from the first step for which it sent no report.
    """

    def __init__(self, schedulers: Sequence[TurnScheduler], inputs: RemoteInputs) -> None:
        """Initialise.

        Args:
            schedulers: The turn schedulers of all entries.
            inputs: The control inputs of the agents of members.
        """
        self._schedulers = schedulers
        self._inputs = inputs
        self._lost: dict[str, RemoteMember] = {}
        #: The members whose agents coast from the step `absent` on.
        self._leaving: list[RemoteMember] = []

    def add(self, member: RemoteMember) -> None:
        """Add a member; if the run does not wait for it, `absent` is the first step that its agents miss."""
        self._lost[member.name] = member
        if member.absent is not None:
            self._leaving.append(member)

    @property
    def absent(self) -> list[RemoteMember]:
        """The members for which the run does not wait."""
        return [each for each in self._lost.values() if each.absent is not None]

    def update(self, step: int) -> None:
        """Let agents coast that miss the present step of the world."""
        if not self._leaving:
            return
        for member in self._leaving:
            if member.absent is not None and member.absent <= step:
                self._coast(member.agents)
        self._leaving = [each for each in self._leaving if each.absent is not None and each.absent > step]

    def give_up(self, agents: Iterable[str]) -> int | None:
        """Forget the lost members of some agents, which another process runs from now on.

        Returns:
            The first step that one of their agents missed; None if they missed nothing.
        """
        here = frozenset(agents)
        absences = []
        for member in [each for each in self._lost.values() if not here.isdisjoint(each.agents)]:
            del self._lost[member.name]
            if member.absent is None:
                # The run waited for it.
                self._coast(member.agents)
            else:
                absences.append(member.absent)
        return min(absences, default=None)

    def take_back(self, hello: Hello, agents: tuple[str, ...], run: bytes) -> RemoteMember | None:
        """Remove the lost member that continues in another process, and return it; None if that is not possible.

        Args:
            hello: The first message of the process.
            agents: Its agents, in the order of the roster.
            run: The random bytes that the host drew for the run.
        """
        member, checkpoint = self._lost.get(hello.name), hello.checkpoint
        if member is None or member.sent is None or checkpoint is None:
            return None
        frames = member.sent.after(checkpoint.step)
        if checkpoint.run != run or member.agents != agents or frames is None:
            return None
        del self._lost[hello.name]
        member.repeated = RepeatedFrames(frames)
        member.repeats, member.heard = member.reported, checkpoint.step - 1
        return member

    def _coast(self, agents: Iterable[str]) -> None:
        """Let agents stop as far as they can, if a component of theirs has `coast: safe`."""
        here = frozenset(agents)
        for scheduler in self._schedulers:
            group = scheduler.entry.group
            rows = rows_of(group, here)
            if len(rows) and scheduler.entry.timing.coast == "safe":
                self._inputs.slow_down(group, rows)
