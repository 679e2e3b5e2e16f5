"""Requests: agents ask others for knowledge, and answer their requests."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

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


class Question(NamedTuple):
    """The state of a request that has not been answered yet.

    Attributes:
        tries: How often it was sent.
        time: When it was sent last, in nanoseconds.
    """

    tries: int
    time: int


class Request(CommunicationReceiver):
    """Asks other agents for knowledge, repeats unanswered requests, and answers requests of others.

    Answers are stored in the agent's knowledge of the other. An agent that is out of reach when a request is due is
    asked when it is reached. An agent that does not answer is given up after some tries, until the next interval
    begins. Agents that only answer need this component, too, with an empty `whom`.
    """

    bodies: ClassVar[Mapping[str, str]] = {"whom": "agents"}
    events: ClassVar[Mapping[str, str]] = {
        "answered": "an answer arrived",
        "unanswered": "no answer arrived to any of the tries",
        "unknown": "an answer arrived, but the other lacks some or all of the requested knowledge",
    }

    class Parameters(Parameters):
        """Which agents to ask for which knowledge."""

        whom: tuple[str, ...] = Field((), description="Whom to ask: ids, groups or patterns; nobody if empty.")
        names: tuple[str, ...] = Field((), description="Which knowledge to ask for, by name.")
        interval: float | None = Field(
            None,
            gt=0,
            description="After which time to ask anew those who answered, or were given up [s]; never if null.",
        )
        timeout: float = Field(1.0, gt=0, description="How long to wait for an answer [s].")
        tries: int = Field(3, ge=1, le=1_000_000, description="How often to ask before it is given up.")

    @property
    def kinds(self) -> Collection[str]:
        """The kinds of messages that it reads: requests and replies."""
        return (REQUEST, REPLY)

    def check(self, group: AgentGroup) -> None:
        """Check that a request names some knowledge."""
        if self.parameters.whom and not self.parameters.names:
            raise ValueError("`whom` needs `names`, the knowledge to ask for, and these are empty")

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start without requests."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        roster = self.environment.roster
        self._asked_agents = {
            roster.ids[index] for pattern in self.parameters.whom for index in roster.matching(pattern)
        }
        self._open: dict[str, Question] = {}
        #: Time of the first request to each agent that has not answered yet, in nanoseconds.
        self._since: dict[str, int] = {}
        #: When each agent without an open request answered or was given up, in nanoseconds.
        self._settled: dict[str, int] = {}

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            if message.kind == REQUEST:
                self._answer(message)
            else:
                self._learn(message)
        if self.parameters.whom:
            self._ask()

    def _answer(self, message: Message) -> None:
        known, question = self._agent.self_knowledge, message.payload
        values = {name: known[name] for name in question["names"] if name in known}
        # Several components of an agent may ask: `asks` tells their replies apart.
        reply = {"asked": message.sent_time, "asks": question["asks"], "told": values}
        self._send(message.sender, reply, REPLY)

    def _learn(self, message: Message) -> None:
        sender, reply = message.sender, message.payload
        since = self._since.get(sender)
        if reply["asks"] != self.name or since is None or reply["asked"] < since:
            return  # for another component, or a second answer to a repeated request
        del self._since[sender]
        self._open.pop(sender, None)
        self._settled[sender] = self.now
        values, took = reply["told"], (self.now - reply["asked"]) / 1e9
        unknown = [name for name in self.parameters.names if name not in values]
        if values:
            self._agent.knowledge_database.setdefault(sender, KnowledgeDatabase()).update(values)
            self.emit("answered", f"{sender} answered after {took:g} s", other=sender, names=sorted(values))
        if unknown:
            text = f"{sender} answered after {took:g} s, and does not know {', '.join(f'`{name}`' for name in unknown)}"
            self.emit("unknown", text, level=Level.WARNING, other=sender, names=unknown)

    def _ask(self) -> None:
        parameters = self.parameters
        for id in self._surroundings.exchange.neighbours(self._agent.id):
            if id not in self._asked_agents:
                continue
            question = self._open.get(id)
            if question is None:
                if not self._is_due(id):
                    continue
                question = Question(0, self.now)
                self._since[id] = self.now
            elif self.now - question.time < nanoseconds(parameters.timeout):
                continue
            if question.tries == parameters.tries:
                del self._open[id]
                self._settled[id] = self.now
                text = f"{id} did not answer any of {question.tries} times"
                self.emit("unanswered", text, level=Level.WARNING, other=id)
                continue
            self._open[id] = Question(question.tries + 1, self.now)
            self._send(id, {"names": list(parameters.names), "asks": self.name}, REQUEST)

    def _is_due(self, id: str) -> bool:
        """Return whether an agent without an open request is to be asked."""
        interval, settled = self.parameters.interval, self._settled.get(id)
        return settled is None or (interval is not None and self.now - settled >= nanoseconds(interval))

    def _send(self, receiver: str, payload: Mapping[str, Any], kind: str) -> None:
        self.send(Message(self._agent.id, receiver, payload, kind))
