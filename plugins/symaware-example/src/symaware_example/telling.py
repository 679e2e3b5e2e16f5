"""Agents that send each other their states and intents."""

from collections.abc import Iterable, Sequence

from pydantic import Field

from symaware_cli import (
    AwarenessVector,
    CommunicationReceiver,
    CommunicationSender,
    Message,
    Parameters,
    nanoseconds,
)


class Tell(CommunicationSender):
    """Sends its believed state and its intent to every other agent."""

    class Parameters(Parameters):
        """The period."""

        period: float = Field(0.5, ge=0, description="Simulated time between two messages to the same agent [s].")

    _due = 0

    def _compute(self) -> Iterable[Message]:
        if self.now < self._due:
            return ()
        me = self.agent.self_awareness
        others = (id for id in self.environment.roster.ids if id != me.id)
        belief = AwarenessVector(me.id, me.state, me.intent)
        return [Message(me.id, other, {"awareness": belief}, kind="position") for other in others]

    def _update(self, value: Iterable[Message]) -> None:
        super()._update(value)
        if value:
            self._due = self.now + nanoseconds(self.parameters.period)


class Listen(CommunicationReceiver):
    """Stores the states and intents that others send."""

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            if message.kind == "position":
                self.agent.awareness_database[message.sender] = message.payload["awareness"]
