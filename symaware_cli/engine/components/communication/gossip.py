"""Gossip: spreads knowledge by messages to a few randomly drawn neighbours."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli.core import AgentGroup, Delivery, GroupCommunicationReceiver, MessageBatch, Parameters
from symaware_cli.core.message import Indices, objects
from symaware_cli.engine.components.communication.equality import same

#: The kind of its messages.
GOSSIP = "gossip"


class Gossip(GroupCommunicationReceiver):
    """Sends a piece of an agent's knowledge to a few neighbours drawn at random at each turn, which adopt it.

    Push gossip: starting at one agent, it reaches all of n fully connected agents in about log2(n) + ln(n) rounds (B.
    Pittel, "On Spreading a Rumor", SIAM Journal on Applied Mathematics 47, 1987). An agent has the knowledge from the
    start in its `knowledge`, or by a message. If an agent changes it, the later version spreads; of versions of the
    same time, that of the greater id. Initial knowledge is a version of the start, whenever the agent begins to send
    it, and a restart of the component creates no new version.
    """

    events: ClassVar[Mapping[str, str]] = {"informed": "the agent received it, or a later version"}

    class Parameters(Parameters):
        """Which knowledge is sent, and to how many agents."""

        name: str = Field("rumour", min_length=1, description="Which knowledge is told.")
        fanout: int = Field(1, ge=1, le=1000, description="How many others are told at each turn.")

    @property
    def kinds(self) -> Collection[str]:
        """The kind of messages for the name of its knowledge, so that several can run side by side."""
        return (self._kind,)

    @property
    def _kind(self) -> str:
        return f"{GOSSIP}:{self.parameters.name}"

    def initialise_component(self, group: AgentGroup) -> None:
        """Adopt the agents' knowledge as first versions; versions persist over a restart, as knowledge does."""
        super().initialise_component(group)
        if "_times" not in self.__dict__:
            self._start = self.environment.roster.start(group.name)
            #: Creation time of each agent's version, in nanoseconds, and its origin; -1 without one.
            self._times = np.full(len(group), -1, np.int64)
            self._origins, self._values = objects([""] * len(group)), objects([None] * len(group))
            self._changed = group.knowledge_changes.watch(self.parameters.name)
        for row in np.flatnonzero(self._times < 0).tolist():
            if self.parameters.name in group.knowledge[row]:
                self._adopt(row, 0, group.ids[row])

    def _adopt(self, row: int, time: int, origin: str) -> None:
        """Adopt the present knowledge of an agent as a version."""
        self._times[row], self._origins[row] = time, origin
        self._values[row] = self._group.knowledge[row][self.parameters.name]

    def _update(self, value: Sequence[Delivery]) -> None:
        name = self.parameters.name
        for row in sorted(self._changed):
            known = self._group.knowledge[row]
            if name in known and (self._times[row] < 0 or not same(known[name], self._values[row])):
                self._adopt(row, self.now, self._group.ids[row])
        for delivery in value:
            self._receive(delivery)
        self._changed.clear()
        self._send()

    def _receive(self, delivery: Delivery) -> None:
        """Store received versions that are later than the agents' own."""
        name, ids, group = self.parameters.name, self.environment.roster.ids, self._group
        rows, origins = delivery.receivers - self._start, delivery.column("origin")
        times, own = delivery.column("time").astype(np.int64), self._times[rows]
        later = (times > own) | ((times == own) & (origins > self._origins[rows]))
        indices = np.flatnonzero(later)
        values, senders = delivery.column("value"), delivery.senders[indices].tolist()
        for index, sender in zip(indices.tolist(), senders, strict=True):
            row, version = int(rows[index]), (int(times[index]), str(origins[index]))
            if version > (int(self._times[row]), self._origins[row]):
                group.knowledge[row][name] = values[index]
                self._adopt(row, *version)
                self.emit_for(row, "informed", f"by {ids[sender]}", other=ids[sender], origin=version[1])

    def _send(self) -> None:
        known = self._times >= 0
        if not known.any():
            return
        rows, receivers = self._draw_neighbours(np.flatnonzero(known))
        if len(rows):
            columns = {"value": self._values[rows], "time": self._times[rows], "origin": self._origins[rows]}
            self.post(MessageBatch(rows + self._start, columns, self._kind, receivers))

    def _draw_neighbours(self, rows: Indices) -> tuple[Indices, Indices]:
        """Draw neighbours of given agents, all equally likely.

        Sampling without replacement: R. W. Floyd, in J. Bentley, "Programming Pearls: A Sample of Brilliance",
        Communications of the ACM 30, 1987.

        Returns:
            The rows of the agents, repeated for each drawn neighbour, and these neighbours as indices in the roster;
            each of shape (m,).
        """
        exchange, senders, fanout = self._surroundings.exchange, rows + self._start, self.parameters.fanout
        links, everyone = exchange.links, exchange.present_indices
        place = np.searchsorted(everyone, senders)
        if links is None:
            degrees = np.full(len(rows), max(0, len(everyone) - 1))
        else:
            degrees = links.pointers[senders + 1] - links.pointers[senders]
        chance, counts = self.random.uniform(fanout)[rows], np.minimum(fanout, degrees)
        chosen = np.full((len(rows), fanout), -1)
        for index in range(fanout):
            last = degrees - counts + index
            drawn = (chance[:, index] * (last + 1)).astype(np.intp)
            is_there = (chosen[:, :index] == drawn[:, None]).any(axis=1)
            chosen[:, index] = np.where(index < counts, np.where(is_there, last, drawn), -1)
        drawing, indices = np.nonzero(chosen >= 0)
        picked = chosen[drawing, indices]
        if links is None:
            return rows[drawing], everyone[picked + (picked >= place[drawing])]
        return rows[drawing], links.receivers[links.pointers[senders[drawing]] + picked]
