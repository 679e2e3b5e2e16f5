"""Telling all others what one is aware of and what one knows."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydantic import Field

from symaware_cli.components.communication.body import ToldAlong, position_covariance
from symaware_cli.core import EVERYBODY, AgentGroup, CommunicationSender, Message, Parameters

#: The kind of its messages.
BROADCAST = "broadcast"


class Broadcast(CommunicationSender):
    """Tells all whom an agent reaches its whole awareness of itself, and chosen knowledge of any kind.

    The awareness has state, intent, uncertainty and risk, as they are at its turn; position and velocity, and the
    covariance of the position where it is estimated, are told with it, for those who do not know the sender's model.
    `communication.inbox` reads its messages; for states alone `communication.state` is many times as fast.
    """

    class Parameters(Parameters):
        """What is told."""

        awareness: bool = Field(True, description="Whether the agent's awareness of itself is told.")
        knowledge: tuple[ToldAlong, ...] = Field((), description="Which knowledge is told, by name.")

    def check(self, group: AgentGroup) -> None:
        """What is told is known."""
        for name in self.parameters.knowledge:
            if any(name not in known for known in group.knowledge):
                raise ValueError(f"the agents do not know `{name}`")
        if not self.parameters.awareness and not self.parameters.knowledge:
            raise ValueError("there is nothing to tell: neither `awareness` nor `knowledge`")

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
