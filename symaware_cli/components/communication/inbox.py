"""Becoming aware of others by what they say."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from symaware_cli.components.communication.body import OF_THE_BODY
from symaware_cli.components.communication.broadcast import BROADCAST
from symaware_cli.components.communication.position_reports import PositionReports
from symaware_cli.components.communication.state import STATE
from symaware_cli.core import (
    Agent,
    AgentGroup,
    AwarenessVector,
    Delivery,
    GroupCommunicationReceiver,
    KnowledgeDatabase,
    Message,
    Parameters,
    TimeSeries,
    nanoseconds,
)

Array = NDArray[np.float64]


class Inbox(GroupCommunicationReceiver):
    """Keeps what others tell of themselves, and makes tracks of it, older messages being less certain.

    A message says where its sender was. Now it is taken to be farther on, straight ahead, and the variance of where it
    is grows with the age T of the message as that of a body whose acceleration is white noise of intensity q (see
    `uncertainty.gaussian`): v + s T^2 + q T^3 / 3, where v is what the sender says of its own uncertainty, or
    `position_noise`, and s stands for `velocity_noise`.

    With the policy `latest`, of each sender the message counts that was sent last, whenever it came. With `window` and
    `all`, the messages kept are averaged, each with the inverse of its variance as its weight, and nobody becomes more
    certain by that than by the best of them, because their errors are not independent.

    What one sees wins over what one is told, unless that is more recent. A broadcast tells the same of its sender, and
    besides an intent and a risk, which are in the awareness that the receiver has of it for as long as the sender is
    remembered. Knowledge that is told along goes into the knowledge that an agent has of others; whatever the policy,
    what was sent last stays, also when the sender is forgotten.
    """

    class Parameters(Parameters):
        """What is kept, and how certain it is."""

        policy: Literal["latest", "window", "all"] = Field(
            "latest", description="Which messages of each sender count: the latest, those of a while, or all."
        )
        window: float = Field(
            1.0, gt=0, description="With the policy `window`, how old messages before the latest may be [s]."
        )
        memory: float = Field(5.0, gt=0, description="For how long a sender is remembered that says nothing more [s].")
        position_noise: float = Field(
            0.0, ge=0, description="Standard deviation of positions of which nothing is said, along each axis [m]."
        )
        velocity_noise: float = Field(0.0, ge=0, description="Standard deviation of velocities, along each axis [m/s].")
        acceleration_noise: float = Field(
            0.5,
            ge=0,
            description="Root of the power spectral density of the acceleration of others, along each axis "
            "[m/s^2/sqrt(Hz)].",
        )

    #: With the policy `all`, so many messages of one sender are kept, that memory is bounded.
    _MOST = 1000

    @property
    def kinds(self) -> Collection[str]:
        """States and broadcasts."""
        return (STATE, BROADCAST)

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin with an empty inbox."""
        super().initialise_component(group)
        environment = self.environment
        self._everybody = len(environment.roster)
        self._start = environment.roster.start(group.name)
        self._reports = PositionReports.nothing(environment.snapshot().positions.shape[1])
        #: The number of the latest message that told each knowledge, by its name, then by receiver and sender.
        self._learnt: defaultdict[str, dict[int, int]] = defaultdict(dict)
        #: When each awareness vector that counts was sent, and its message's number, by the receiver's row and the id.
        self._heard: dict[tuple[int, str], tuple[int, int]] = {}
        group.awareness.told = None
        for agent in vars(group).get("agents", ()):
            for id in list(agent.awareness_database.told):
                agent.awareness_database.forget(id)

    @property
    def kept(self) -> PositionReports:
        """The messages in the inbox."""
        return self._reports

    def _update(self, value: Sequence[Delivery]) -> None:
        further: list[PositionReports] = []
        for each in value:
            if each.batch.kind == STATE:
                further.append(self._of_states(each))
            else:
                for message in each.messages(self.environment.roster.ids):
                    further += self._of_broadcast(message)
        parameters, awareness = self.parameters, self._group.awareness
        if further:
            self._reports = self._reports.joined(further, latest=parameters.policy == "latest")
        self._forget()
        if len(self._reports.keys) or awareness.told is not None:
            awareness.told = self._reports.tracks(
                self.computed_at,
                len(self._group),
                self._everybody,
                parameters.velocity_noise**2,
                parameters.acceleration_noise**2,
            )

    def _of_states(self, delivery: Delivery) -> PositionReports:
        """What states tell of their senders; takes over the knowledge that is told along."""
        columns = delivery.batch.columns
        told = [name for name in columns if name not in OF_THE_BODY]
        keys = (delivery.receivers - self._start).astype(np.int64) * self._everybody + delivery.senders
        if told:
            self._learn_from(delivery, keys, told)
        covariance = delivery.column("covariance") if "covariance" in columns else None
        return PositionReports(
            keys,
            np.full(len(delivery), delivery.sent_time, np.int64),
            self._in_space(delivery.column("position")),
            self._in_space(delivery.column("velocity")),
            self._variance(covariance, len(delivery)),
        )

    def _of_broadcast(self, message: Message) -> Sequence[PositionReports]:
        """What a broadcast tells of its sender, if anything; takes over the awareness vector, and knowledge."""
        roster, payload = self.environment.roster, message.payload
        row, sender = roster.index(message.receiver) - self._start, roster.index(message.sender)
        agent, key = self._group.agents[row], row * self._everybody + sender
        for name, value in payload.items():
            if isinstance(value, AwarenessVector):
                self._hear(agent, message, value)
            elif name not in OF_THE_BODY:
                self._learn(agent, message.sender, key, message.sequence, name, value)
        if "position" not in payload or "velocity" not in payload:
            return ()
        covariance = payload.get("covariance")
        return [
            PositionReports(
                np.array([key], np.int64),
                np.array([message.sent_time], np.int64),
                self._in_space([payload["position"]]),
                self._in_space([payload["velocity"]]),
                self._variance(None if covariance is None else [covariance], 1),
            )
        ]

    def _in_space(self, values: ArrayLike) -> Array:
        """Vectors with as many columns as the world; who moves in the plane stands at height 0."""
        vectors = np.asarray(values, float)
        missing = self._reports.positions.shape[1] - vectors.shape[1]
        return np.pad(vectors, ((0, 0), (0, missing))) if missing else vectors

    def _variance(self, covariance: ArrayLike | None, count: int) -> Array:
        """How sure senders are of their positions, as they say, or as is assumed where they say nothing."""
        own = self.parameters.position_noise**2
        if covariance is None:
            return np.full(count, own)
        matrices = np.asarray(covariance, float)
        said = np.trace(matrices, axis1=1, axis2=2) / matrices.shape[1]
        variance: Array = np.where(np.isnan(said), own, said)
        return variance

    def _hear(self, agent: Agent, message: Message, vector: AwarenessVector) -> None:
        """Take over an awareness vector, unless one is known that was sent later."""
        heard, key, sent = self._heard, (agent.row, vector.id), (message.sent_time, message.sequence)
        if vector.id == agent.id or heard.get(key, sent) > sent:
            return
        heard[key] = sent
        # Its uncertainty is that of then, and says when that was.
        uncertainty = vector.uncertainty
        if not len(uncertainty):
            uncertainty = TimeSeries.sampled([message.sent_time], [self.parameters.position_noise])
        payload, state = message.payload, self._group.awareness.motion(vector.id, vector.state, is_state=True)
        if vector.id == message.sender and "position" in payload:
            state = np.concatenate(self._in_space([payload["position"], payload["velocity"]]))
        told = vector.replaced(state=state, uncertainty=uncertainty)
        agent.awareness_database.hear(told, message.sent_time, alone="position" not in payload)

    def _learn_from(self, delivery: Delivery, keys: NDArray[np.int64], names: Sequence[str]) -> None:
        """Take over what senders tell of what they know."""
        ids, agents, start = self.environment.roster.ids, self._group.agents, self._start
        columns = (delivery.receivers, delivery.senders, keys, delivery.sequences)
        messages = list(zip(*(column.tolist() for column in columns), strict=True))
        for name in names:
            for (receiver, sender, key, sequence), value in zip(messages, delivery.column(name), strict=True):
                self._learn(agents[receiver - start], ids[sender], key, sequence, name, value)

    def _learn(self, agent: Agent, sender: str, key: int, sequence: int, name: str, value: object) -> None:
        """Take over something that another knows, unless it told something later."""
        learnt = self._learnt[name]
        if learnt.get(key, -1) <= sequence:
            learnt[key] = sequence
            known = agent.knowledge_database
            if sender not in known:
                known[sender] = KnowledgeDatabase()
            known[sender][name] = value

    def _forget(self) -> None:
        """Throw away what is too old to count."""
        parameters, kept = self.parameters, self._reports
        memory = nanoseconds(parameters.memory)
        for (row, id), (sent, _) in list(self._heard.items()):
            if self.computed_at - sent > memory:
                del self._heard[row, id]
                self._group.agents[row].awareness_database.forget(id)
        if not len(kept.keys):
            return
        recent = self.computed_at - kept.sent <= memory
        if parameters.policy != "latest":
            # How many messages of the same sender are not older, and whether the sender is remembered.
            ends = np.searchsorted(kept.keys, kept.keys, "right")
            ranks, recent = ends - np.arange(len(ends)), recent[ends - 1]
            if parameters.policy == "window":
                recent &= (self.computed_at - kept.sent <= nanoseconds(parameters.window)) | (ranks == 1)
            else:
                recent &= ranks <= self._MOST
        if not recent.all():
            self._reports = kept.some(recent)
