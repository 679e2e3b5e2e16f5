"""Gossip: what one knows is told to a few others at random, who tell it on."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.components.communication.equality import same
from symaware_cli.core import AgentGroup, Delivery, GroupCommunicationReceiver, MessageBatch, Parameters
from symaware_cli.core.message import Indices, objects

#: The kind of its messages.
GOSSIP = "gossip"


class Gossip(GroupCommunicationReceiver):
    """Tells a few others, drawn at random at each turn, what an agent knows under a name; they come to know it, too.

    Push gossip: from one who knows, all of n agents who reach each other come to know in about log2(n) + ln(n) rounds
    (B. Pittel, "On Spreading a Rumor", SIAM Journal on Applied Mathematics 47, 1987). Agents begin to know when
    somebody tells them, or because their `knowledge` has it from the start. If one changes what it knows, the later
    version spreads; of versions of one time, that of the greater id. What an agent knows from the start is a version of
    the start, whenever it begins to tell it, and to begin anew makes no version of what it knew before.
    """

    events: ClassVar[Mapping[str, str]] = {"informed": "the agent came to know it, or a later version"}

    class Parameters(Parameters):
        """What is told, and to how many."""

        name: str = Field("rumour", min_length=1, description="Which knowledge is told.")
        fanout: int = Field(1, ge=1, le=1000, description="How many others are told at each turn.")

    @property
    def kinds(self) -> Collection[str]:
        """Gossip of its own name, so that several can be told side by side."""
        return (self._kind,)

    @property
    def _kind(self) -> str:
        return f"{GOSSIP}:{self.parameters.name}"

    def initialise_component(self, group: AgentGroup) -> None:
        """Know what each agent knows, or nothing; that outlives a restart, as what the agents know does."""
        super().initialise_component(group)
        if "_times" not in self.__dict__:
            self._start = self.environment.roster.start(group.name)
            #: When the version that each agent knows was made, in nanoseconds, and by whom; -1 if it knows none.
            self._times = np.full(len(group), -1, np.int64)
            self._origins, self._values = objects([""] * len(group)), objects([None] * len(group))
            self._changed = group.knowledge_changes.watch(self.parameters.name)
        for row in np.flatnonzero(self._times < 0).tolist():
            if self.parameters.name in group.knowledge[row]:
                self._take_over(row, 0, group.ids[row])

    def _take_over(self, row: int, time: int, origin: str) -> None:
        """Take what an agent knows now for a version."""
        self._times[row], self._origins[row] = time, origin
        self._values[row] = self._group.knowledge[row][self.parameters.name]

    def _update(self, value: Sequence[Delivery]) -> None:
        name = self.parameters.name
        for row in sorted(self._changed):
            known = self._group.knowledge[row]
            if name in known and (self._times[row] < 0 or not same(known[name], self._values[row])):
                self._take_over(row, self.now, self._group.ids[row])
        for delivery in value:
            self._hear(delivery)
        self._changed.clear()
        self._tell()

    def _hear(self, delivery: Delivery) -> None:
        """Let agents know versions that are later than theirs."""
        name, ids, group = self.parameters.name, self.environment.roster.ids, self._group
        rows, origins = delivery.receivers - self._start, delivery.column("origin")
        times, own = delivery.column("time").astype(np.int64), self._times[rows]
        later = (times > own) | ((times == own) & (origins > self._origins[rows]))
        places = np.flatnonzero(later)
        values, senders = delivery.column("value"), delivery.senders[places].tolist()
        for place, sender in zip(places.tolist(), senders, strict=True):
            row, version = int(rows[place]), (int(times[place]), str(origins[place]))
            if version > (int(self._times[row]), self._origins[row]):
                group.knowledge[row][name] = values[place]
                self._take_over(row, *version)
                self.emit_for(row, "informed", f"by {ids[sender]}", other=ids[sender], origin=version[1])

    def _tell(self) -> None:
        known = self._times >= 0
        if not known.any():
            return
        rows, receivers = self._drawn(np.flatnonzero(known))
        if len(rows):
            columns = {"value": self._values[rows], "time": self._times[rows], "origin": self._origins[rows]}
            self._surroundings.exchange.post(MessageBatch(rows + self._start, columns, self._kind, receivers))

    def _drawn(self, rows: Indices) -> tuple[Indices, Indices]:
        """Draw some neighbours of each of some agents, all equally likely.

        Without repetition: R. W. Floyd, in J. Bentley, "Programming Pearls: A Sample of Brilliance", Communications of
        the ACM 30, 1987.

        Returns:
            Each of the agents as often as it has a neighbour among those drawn, and these, as indices in the roster;
            each of shape (m,).
        """
        links, senders, fanout = self._surroundings.exchange.links, rows + self._start, self.parameters.fanout
        if links is None:
            degrees = np.full(len(rows), len(self.environment.roster) - 1)
        else:
            degrees = links.pointers[senders + 1] - links.pointers[senders]
        chance, counts = self.random.uniform(fanout)[rows], np.minimum(fanout, degrees)
        chosen = np.full((len(rows), fanout), -1)
        for place in range(fanout):
            last = degrees - counts + place
            drawn = (chance[:, place] * (last + 1)).astype(np.intp)
            is_there = (chosen[:, :place] == drawn[:, None]).any(axis=1)
            chosen[:, place] = np.where(place < counts, np.where(is_there, last, drawn), -1)
        who, places = np.nonzero(chosen >= 0)
        picked = chosen[who, places]
        if links is None:
            return rows[who], picked + (picked >= senders[who])
        return rows[who], links.receivers[links.pointers[senders[who]] + picked]
