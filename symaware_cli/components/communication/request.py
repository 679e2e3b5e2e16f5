"""Asking others for what they know, and answering."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field

from symaware_cli.core import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    CommunicationReceiver,
    KnowledgeDatabase,
    Level,
    Message,
    Parameters,
    nanoseconds,
)

REQUEST, REPLY = "request", "reply"


class Request(CommunicationReceiver):
    """Asks agents for what they know, again where no answer comes, and answers those who ask.

    What is answered goes into the knowledge that the agent has of the other. Who is not reached when a question is due
    is asked when it is. Give it to those who are to answer, too, with nobody to ask.
    """

    events: ClassVar[Mapping[str, str]] = {
        "answered": "an answer came",
        "unanswered": "none came, however often the agent asked",
    }

    class Parameters(Parameters):
        """Whom to ask for what."""

        whom: tuple[str, ...] = Field((), description="Whom to ask: ids or patterns; nobody if empty.")
        names: tuple[str, ...] = Field((), description="Which knowledge to ask for, by name.")
        interval: float | None = Field(
            None, gt=0, description="After which time to ask anew those who answered [s]; never if null."
        )
        timeout: float = Field(1.0, gt=0, description="How long to wait for an answer [s].")
        tries: int = Field(3, ge=1, le=1_000_000, description="How often to ask before it is given up.")

    @property
    def kinds(self) -> Collection[str]:
        """Questions and answers."""
        return (REQUEST, REPLY)

    def check(self, group: AgentGroup) -> None:
        """Who asks somebody asks for something."""
        if self.parameters.whom and not self.parameters.names:
            raise ValueError("`names` says what to ask `whom` for, and is empty")

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Nobody was asked yet."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        #: For each who was asked, how often since the last answer and when, in nanoseconds.
        self._asked: dict[str, tuple[int, int]] = {}
        self._answered: dict[str, int] = {}

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            if message.kind == REQUEST:
                self._answer(message)
            else:
                self._learn(message)
        if self.parameters.whom:
            self._ask()

    def _answer(self, message: Message) -> None:
        known = self._agent.self_knowledge
        told = {name: known[name] for name in message.payload["names"] if name in known}
        self._send(message.sender, {"asked": message.sent_time, "told": told}, REPLY)

    def _learn(self, message: Message) -> None:
        sender, told = message.sender, message.payload["told"]
        if sender not in self._asked:
            return  # a second answer to what was asked twice
        del self._asked[sender]
        self._answered[sender] = self.now
        self._agent.knowledge_database.setdefault(sender, KnowledgeDatabase()).update(told)
        took = (self.now - message.payload["asked"]) / 1e9
        self.emit("answered", f"{sender} answered after {took:g} s", other=sender, names=sorted(told))

    def _ask(self) -> None:
        parameters = self.parameters
        for id in self._surroundings.exchange.neighbours(self._agent.id):
            if not any(fnmatch.fnmatchcase(id, pattern) for pattern in parameters.whom):
                continue
            tries, asked = self._asked.get(id, (0, 0))
            if tries == 0 and not self._is_due(id):
                continue
            if tries and self.now - asked < nanoseconds(parameters.timeout):
                continue
            if tries == parameters.tries:
                self._asked[id] = (tries + 1, asked)
                text = f"{id} did not answer any of {tries} times"
                self.emit("unanswered", text, level=Level.WARNING, other=id)
            elif tries < parameters.tries:
                self._asked[id] = (tries + 1, self.now)
                self._send(id, {"names": list(parameters.names)}, REQUEST)

    def _is_due(self, id: str) -> bool:
        """Whether somebody who is not being asked is to be."""
        interval, answered = self.parameters.interval, self._answered.get(id)
        return answered is None or (interval is not None and self.now - answered >= nanoseconds(interval))

    def _send(self, receiver: str, payload: Mapping[str, Any], kind: str) -> None:
        self._surroundings.exchange.send(Message(self._agent.id, receiver, payload, kind))
