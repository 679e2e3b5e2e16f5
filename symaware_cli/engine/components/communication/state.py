"""Messages about the sender: its state in columns, or a broadcast of its awareness, with chosen knowledge."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from symaware_cli.core import (
    EVERYBODY,
    AgentGroup,
    CommunicationSender,
    GroupComponent,
    Links,
    Message,
    MessageBatch,
    Model,
    Parameters,
    TimeSeries,
    nanoseconds,
)
from symaware_cli.geometry import Array, Indices

#: The fields of a message that describe its sender's body and awareness; all other fields are knowledge.
BODY_FIELDS = frozenset({"position", "velocity", "state", "covariance", "awareness"})
#: The kind of its messages.
STATE = "state"
#: A time before any run.
_NEVER = -(1 << 62)
#: The kind of its messages.
BROADCAST = "broadcast"


def _check_name(name: str) -> str:
    if name in BODY_FIELDS:
        raise ValueError(f"knowledge cannot be sent as `{name}`: messages use this name for the sender's own state")
    return name


#: The name of knowledge that is sent along with the sender's state.
KnowledgeName = Annotated[str, AfterValidator(_check_name)]


def position_covariance(model: Model, uncertainty: TimeSeries) -> Array:
    """Return the covariance of the position; shape (d, d). NaN if the uncertainty is not that of the state.

    Args:
        model: The model with the state.
        uncertainty: At its first instant the covariance of the state, row by row, or something else.
    """
    size, columns = len(model.state), np.array(model.position)
    if not len(uncertainty) or uncertainty.values.shape[1] != size * size:
        return np.full((len(columns), len(columns)), np.nan)
    covariance: Array = uncertainty.values[0].reshape(size, size)[np.ix_(columns, columns)]
    return covariance


class StateSender(GroupComponent):
    """Sends each agent's belief of its position, velocity and state, and chosen knowledge, to all it reaches.

    It sends at each of its turns (`period`), or only when needed: receivers extrapolate a sender's motion with constant
    velocity, and with a `threshold` an agent sends when it is farther than that from its extrapolated position. It also
    sends after a time of `silence`, so that a lost message does no lasting harm and no receiver forgets it, and at its
    next turn after a new neighbour has come into reach. `communication.inbox` reads the messages.
    """

    class Parameters(Parameters):
        """Contents of the messages, and when they are sent."""

        knowledge: tuple[KnowledgeName, ...] = Field(
            (), description="Which knowledge is told along, by name; numbers only."
        )
        uncertainty: bool = Field(
            False, description="Whether the covariance of the own position is told, where it is estimated."
        )
        threshold: float | None = Field(
            None,
            ge=0,
            description="An agent speaks only when it is farther than this from where others take it to be [m]; at "
            "every turn if null.",
        )
        silence: float | None = Field(
            2.0,
            gt=0,
            description="With a threshold, the longest time that an agent says nothing [s]; any if null. Receivers "
            "forget it where it is longer than their `memory`.",
        )

    def check(self, group: AgentGroup) -> None:
        """Check that the agents have the knowledge, and that it consists of numbers."""
        for name in self.parameters.knowledge:
            try:
                group.known(name)
            except KeyError:
                raise ValueError(f"the agents do not know `{name}`") from None
        parameters = self.parameters
        if "silence" in parameters.model_fields_set and parameters.silence is not None and parameters.threshold is None:
            raise ValueError("`silence` has an effect only with a `threshold`, which is missing")

    def initialise_component(self, group: AgentGroup) -> None:
        """Start without messages sent."""
        super().initialise_component(group)
        self._start = self.environment.roster.start(group.name)
        count, dimensions = len(group), len(group.model.position)
        self._sent_position = np.full((count, dimensions), np.nan)
        self._sent_velocity = np.zeros((count, dimensions))
        self._sent_at = np.full(count, _NEVER, np.int64)
        self._links: Links | None = None

    def _compute(self) -> MessageBatch | None:
        group, parameters = self._group, self.parameters
        state = group.awareness.state
        position, velocity = group.model.positions(state), group.model.velocity(state, group.control_input)
        rows = np.arange(len(group)) if parameters.threshold is None else self._due(position)
        if not len(rows):
            return None
        columns = {"position": position[rows], "velocity": velocity[rows], "state": state[rows]}
        if parameters.uncertainty:
            columns["covariance"] = self._covariance(rows)
        columns |= {name: group.known(name)[rows] for name in parameters.knowledge}
        return MessageBatch(rows + self._start, columns, STATE)

    def _update(self, value: MessageBatch | None) -> None:
        if self.parameters.threshold is not None:
            self._detect_new_receivers()
        if value is None:
            return
        if self.parameters.threshold is not None:
            rows = value.senders - self._start
            self._sent_position[rows], self._sent_velocity[rows] = value.columns["position"], value.columns["velocity"]
            self._sent_at[rows] = self.now
        self.post(value)

    def _detect_new_receivers(self) -> None:
        """Make agents with a new neighbour send at their next turn, unless they send now."""
        links, before = self._surroundings.exchange.links, self._links
        if links is before:
            return
        self._links = links
        if links is None or before is None:
            return
        new = np.setdiff1d(links.keys, before.keys, assume_unique=True) // links.count - self._start
        self._sent_position[new[(new >= 0) & (new < len(self._group))]] = np.nan

    def _due(self, position: Array) -> Indices:
        """Return the rows of agents that are too far from where others assume them."""
        age = (self.now - self._sent_at)[:, None] / 1e9
        error = np.linalg.norm(position - (self._sent_position + age * self._sent_velocity), axis=1)
        due = ~(error <= self.parameters.threshold)
        if self.parameters.silence is not None:
            due |= self.now - self._sent_at >= nanoseconds(self.parameters.silence)
        return np.flatnonzero(due)

    def _covariance(self, rows: Indices) -> Array:
        """Return the covariance of each position; NaN if none is estimated."""
        model, uncertainty = self._group.model, self._group.awareness.uncertainty
        return np.array([position_covariance(model, uncertainty.row(row)) for row in rows.tolist()])


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
