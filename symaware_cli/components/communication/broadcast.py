"""Broadcasts: each agent sends its awareness and chosen knowledge to all its neighbours."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydantic import Field

from symaware_cli.components.communication.body import KnowledgeName, position_covariance
from symaware_cli.core import EVERYBODY, AgentGroup, CommunicationSender, Message, Parameters

#: The kind of its messages.
BROADCAST = "broadcast"


class Broadcast(CommunicationSender):
    """Sends an agent's whole awareness of itself, and chosen knowledge of any kind, to all agents it reaches.

    The awareness has state, intent, uncertainty and risk, as they are at the agent's turn. Position and velocity, and
    the covariance of the position if it is estimated, are sent as well, for receivers that do not know the sender's
    model. `communication.inbox` reads the messages; for states alone `communication.state` is many times as fast.
    """

    class Parameters(Parameters):
        """Contents of the messages."""

        awareness: bool = Field(True, description="Whether the agent's awareness of itself is told.")
        knowledge: tuple[KnowledgeName, ...] = Field((), description="Which knowledge is told, by name.")

    def check(self, group: AgentGroup) -> None:
        """Check that the agents have the knowledge that is to be sent."""
        for name in self.parameters.knowledge:
            if any(name not in known for known in group.knowledge):
                raise ValueError(f"the agents do not know `{name}`")
        if not self.parameters.awareness and not self.parameters.knowledge:
            raise ValueError("there is nothing to send: neither `awareness` nor `knowledge`")

    def _compute(self) -> Iterable[Message]:
        agent = self._agent
        payload = {name: agent.self_knowledge[name] for name in self.parameters.knowledge}
        if self.parameters.awareness:
            own, model = agent.self_awareness, agent.group.model
            state = own.state
            payload["awareness"] = own.replaced()
            payload["position"] = model.positions(state[None])[0]
            payload["velocity"] = model.velocity(state[None], agent.control_input[None])[0]
            covariance = position_covariance(model, own.uncertainty)
            if not np.isnan(covariance).any():
                payload["covariance"] = covariance
        return [Message(agent.id, EVERYBODY, payload, BROADCAST)]
