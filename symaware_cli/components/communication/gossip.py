"""Gossip: what one knows is told to a few others at random, who tell it on."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field

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
    version spreads; of versions of one time, that of the greater id.
    """

    events: ClassVar[Mapping[str, str]] = {"informed": "the agent came to know it, or a later version"}

    class Parameters(Parameters):
        """What is told, and to how many."""

        name: str = Field("rumour", min_length=1, description="Which knowledge is told.")
        fanout: int = Field(1, ge=1, le=1000, description="How many others are told at each turn.")

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
        #: When the version that the agent knows was made, and by whom; and what it says.
        self._version: tuple[int, str] = (-1, "")
        self._value: Any = None

    def _update(self, value: Sequence[Message]) -> None:
        name, known = self.parameters.name, self._agent.self_knowledge
        if name in known and (self._version[0] < 0 or known[name] is not self._value):
            self._version, self._value = (self.now, self._agent.id), known[name]
        for message in value:
            version = (int(message.payload["time"]), str(message.payload["origin"]))
            if version > self._version:
                self._version, self._value = version, message.payload["value"]
                known[name] = self._value
                self.emit("informed", f"by {message.sender}", other=message.sender, origin=version[1])
        if self._version[0] >= 0:
            self._tell()

    def _tell(self) -> None:
        exchange, own = self._surroundings.exchange, self._agent.id
        neighbours = exchange.neighbours(own)
        fanout = min(self.parameters.fanout, len(neighbours))
        if not fanout:
            return
        time, origin = self._version
        payload = {"value": self._value, "time": time, "origin": origin}
        for place in self.random.choice(len(neighbours), fanout, replace=False).tolist():
            exchange.send(Message(own, neighbours[place], payload, f"{GOSSIP}:{self.parameters.name}"))
