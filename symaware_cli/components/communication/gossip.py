"""Gossip: what one knows is told to a few others at random, who tell it on."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field

from symaware_cli.components.communication.sameness import same
from symaware_cli.core import (
    Agent,
    AwarenessDatabase,
    CommunicationReceiver,
    KnowledgeDatabase,
    Message,
    Parameters,
)

#: The kind of its messages.
GOSSIP = "gossip"


class Gossip(CommunicationReceiver):
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

    #: When the version that the agent knows was made, and by whom; and what it says. That outlives a restart, as what
    #: the agent knows does.
    _version: tuple[int, str] | None = None
    _value: Any = None

    @property
    def kinds(self) -> Collection[str]:
        """Gossip of its own name, so that several can be told side by side."""
        return (f"{GOSSIP}:{self.parameters.name}",)

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Know what one knows, or nothing."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        if self._version is None and self.parameters.name in agent.self_knowledge:
            self._version, self._value = (0, agent.id), agent.self_knowledge[self.parameters.name]

    def _update(self, value: Sequence[Message]) -> None:
        name, known = self.parameters.name, self._agent.self_knowledge
        if name in known and (self._version is None or not same(known[name], self._value)):
            self._version, self._value = (self.now, self._agent.id), known[name]
        for message in value:
            version = (int(message.payload["time"]), str(message.payload["origin"]))
            if self._version is None or version > self._version:
                known[name] = message.payload["value"]
                self._version, self._value = version, known[name]
                self.emit("informed", f"by {message.sender}", other=message.sender, origin=version[1])
        if self._version is not None:
            self._tell(*self._version)

    def _tell(self, time: int, origin: str) -> None:
        exchange, own = self._surroundings.exchange, self._agent.id
        neighbours = exchange.neighbours(own)
        fanout = min(self.parameters.fanout, len(neighbours))
        if not fanout:
            return
        value = self._agent.self_knowledge.get(self.parameters.name, self._value)
        payload = {"value": value, "time": time, "origin": origin}
        for place in self.random.choice(len(neighbours), fanout, replace=False).tolist():
            exchange.send(Message(own, neighbours[place], payload, f"{GOSSIP}:{self.parameters.name}"))
