"""Flooding: what one tells reaches everybody, over however many links."""

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
    nanoseconds,
)

#: The kind of its messages.
FLOOD = "flood"

#: Of each origin so many numbers are remembered, so that memory is bounded.
_MOST = 4096


class Flooding(CommunicationReceiver):
    """Tells knowledge to all whom an agent reaches, who tell it on to all whom they reach, each once.

    What is new goes out at the agent's next turn, and on, one link a turn, until its time to live is over. Where it
    comes to an agent several ways, all but the first are suppressed. It goes into the knowledge that the agent has of
    the origin. Give it to those who only pass things on, too, with nothing to tell.
    """

    events: ClassVar[Mapping[str, str]] = {"heard": "something new came to the agent"}

    class Parameters(Parameters):
        """What is told, and how far it goes."""

        names: tuple[str, ...] = Field((), description="Which knowledge is told: at first and when it has changed.")
        interval: float | None = Field(
            None, gt=0, description="After which time it is told again, changed or not [s]; never if null."
        )
        time_to_live: int = Field(16, ge=1, le=1_000_000, description="Over how many links it goes at most.")

    @property
    def kinds(self) -> Collection[str]:
        """What is flooded."""
        return (FLOOD,)

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Nothing was told or heard yet."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._told: dict[str, Any] | None = None
        self._told_at = 0
        self._number = 0
        #: The numbers heard of each origin; a dictionary keeps their order.
        self._heard: dict[str, dict[int, None]] = {}

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            self._hear(message)
        known, names = self._agent.self_knowledge, self.parameters.names
        present = {name: known[name] for name in names if name in known}
        if present and self._is_news(present):
            self._told, self._told_at = present, self.now
            payload = {"origin": self._agent.id, "number": self._number, "hops": 1, "told": present}
            self._number += 1
            self._send(payload, ())

    def _is_news(self, present: Mapping[str, Any]) -> bool:
        told, interval = self._told, self.parameters.interval
        if told is None or told.keys() != present.keys():
            return True
        if any(told[name] is not value for name, value in present.items()):
            return True
        return interval is not None and self.now - self._told_at >= nanoseconds(interval)

    def _hear(self, message: Message) -> None:
        payload, agent = message.payload, self._agent
        origin, number, hops = payload["origin"], payload["number"], payload["hops"]
        heard = self._heard.setdefault(origin, {})
        if origin == agent.id or number in heard:
            return
        heard[number] = None
        if len(heard) > _MOST:
            del heard[next(iter(heard))]
        if number == max(heard):
            agent.knowledge_database.setdefault(origin, KnowledgeDatabase()).update(payload["told"])
        self.emit("heard", f"of {origin}, over {hops} links", origin=origin, number=number, hops=hops)
        if hops < self.parameters.time_to_live:
            self._send({**payload, "hops": hops + 1}, (message.sender, origin))

    def _send(self, payload: Mapping[str, Any], known_to: Collection[str]) -> None:
        exchange, own = self._surroundings.exchange, self._agent.id
        for id in exchange.neighbours(own):
            if id not in known_to:
                exchange.send(Message(own, id, payload, FLOOD))
