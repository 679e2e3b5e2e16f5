"""Flooding: what one tells reaches everybody, over however many links."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field

from symaware_cli.components.communication.equality import same
from symaware_cli.core import (
    Agent,
    AwarenessDatabase,
    CommunicationReceiver,
    KnowledgeDatabase,
    Message,
    Parameters,
    nanoseconds,
    seconds,
)

#: The kind of its messages.
FLOOD = "flood"

#: Of what each origin told so much is remembered, so that memory is bounded.
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
        self._told_at = -1
        #: When that was told, in nanoseconds, which was heard of each component of each origin; in that order.
        self._heard: dict[tuple[str, str], dict[int, None]] = {}
        self._latest: dict[tuple[str, str], int] = {}

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            self._hear(message)
        known, names = self._agent.self_knowledge, self.parameters.names
        present = {name: known[name] for name in names if name in known}
        if present and self._is_news(present):
            # The time tells apart what is told, also from what was told before a restart: each is of another instant.
            self._told, self._told_at = present, max(self.now, self._told_at + 1)
            origin = {"origin": self._agent.id, "component": self.name, "time": self._told_at}
            self._send({**origin, "hops": 1, "told": present}, ())

    def _is_news(self, present: Mapping[str, Any]) -> bool:
        told, interval = self._told, self.parameters.interval
        if told is None or not same(told, present):
            return True
        return interval is not None and self.now - self._told_at >= nanoseconds(interval)

    def _hear(self, message: Message) -> None:
        payload, agent = message.payload, self._agent
        origin, time, hops = payload["origin"], payload["time"], payload["hops"]
        source = (origin, payload["component"])
        heard = self._heard.setdefault(source, {})
        if origin == agent.id or time in heard:
            return
        heard[time] = None
        if len(heard) > _MOST:
            del heard[next(iter(heard))]
        if time > self._latest.get(source, -1):
            self._latest[source] = time
            agent.knowledge_database.setdefault(origin, KnowledgeDatabase()).update(payload["told"])
        self.emit("heard", f"of {origin}, over {hops} links", origin=origin, told_at=seconds(time), hops=hops)
        if hops < self.parameters.time_to_live:
            self._send({**payload, "hops": hops + 1}, (message.sender, origin))

    def _send(self, payload: Mapping[str, Any], known_to: Collection[str]) -> None:
        exchange, own = self._surroundings.exchange, self._agent.id
        for id in exchange.neighbours(own):
            if id not in known_to:
                exchange.send(Message(own, id, payload, FLOOD))
