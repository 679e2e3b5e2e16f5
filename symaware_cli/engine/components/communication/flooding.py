"""Flooding: spreads knowledge to all agents of the network over multiple hops."""

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
    seconds,
)
from symaware_cli.engine.components.communication.equality import same

#: The kind of its messages.
FLOOD = "flood"

#: The number of messages remembered of each origin, to bound memory.
_MOST_REMEMBERED = 4096


class Flooding(CommunicationReceiver):
    """Sends knowledge to all neighbours of an agent, which each forward it once to theirs.

    A change is sent at the agent's next turn, and forwarded by one link in each turn until its time to live is reached.
    If it arrives over several paths, all but the first copy are discarded. It is stored in the receiver's knowledge of
    the origin. Agents that only forward need this component, too, without `names`.
    """

    events: ClassVar[Mapping[str, str]] = {"heard": "the agent received something new"}

    class Parameters(Parameters):
        """Which knowledge is sent, when, and how far."""

        names: tuple[str, ...] = Field((), description="Which knowledge is told: at first and when it has changed.")
        interval: float | None = Field(
            None, gt=0, description="After which time it is told again, changed or not [s]; never if null."
        )
        time_to_live: int = Field(16, ge=1, le=1_000_000, description="Over how many links it goes at most.")

    @property
    def kinds(self) -> Collection[str]:
        """The kind of its messages."""
        return (FLOOD,)

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start without any messages sent or received."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._sent_values: dict[str, Any] | None = None
        self._sent_at = -1
        #: The send times [ns] of messages received from each component of each origin, in order of arrival.
        self._received: dict[tuple[str, str], dict[int, None]] = {}
        self._latest: dict[tuple[str, str], int] = {}

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            self._receive(message)
        known, names = self._agent.self_knowledge, self.parameters.names
        present = {name: known[name] for name in names if name in known}
        if present and self._is_due(present):
            # The time identifies a message, also after a restart: each is sent at another instant.
            self._sent_values, self._sent_at = present, max(self.now, self._sent_at + 1)
            origin = {"origin": self._agent.id, "component": self.name, "time": self._sent_at}
            self._send({**origin, "hops": 1, "told": present}, ())

    def _is_due(self, present: Mapping[str, Any]) -> bool:
        sent, interval = self._sent_values, self.parameters.interval
        if sent is None or not same(sent, present):
            return True
        return interval is not None and self.now - self._sent_at >= nanoseconds(interval)

    def _receive(self, message: Message) -> None:
        payload, agent = message.payload, self._agent
        origin, time, hops = payload["origin"], payload["time"], payload["hops"]
        source = (origin, payload["component"])
        heard = self._received.setdefault(source, {})
        if origin == agent.id or time in heard:
            return
        heard[time] = None
        if len(heard) > _MOST_REMEMBERED:
            del heard[next(iter(heard))]
        if time > self._latest.get(source, -1):
            self._latest[source] = time
            agent.knowledge_database.setdefault(origin, KnowledgeDatabase()).update(payload["told"])
        self.emit("heard", f"of {origin}, over {hops} links", origin=origin, told_at=seconds(time), hops=hops)
        if hops < self.parameters.time_to_live:
            self._send({**payload, "hops": hops + 1}, (message.sender, origin))

    def _send(self, payload: Mapping[str, Any], excluded: Collection[str]) -> None:
        own = self._agent.id
        for id in self._surroundings.exchange.neighbours(own):
            if id not in excluded:
                self.send(Message(own, id, payload, FLOOD))
