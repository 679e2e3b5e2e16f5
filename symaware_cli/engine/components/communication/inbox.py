"""The inbox: turns received messages into tracks and knowledge of other agents."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

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
    Tracks,
    nanoseconds,
)
from symaware_cli.engine.components.communication.state import BODY_FIELDS, BROADCAST, STATE
from symaware_cli.geometry import Array, Indices, Mask


class PositionReports(NamedTuple):
    """Stored reports in columns, ordered by receiver, sender and time.

    Attributes:
        keys: receiver row * roster_size + sender's index, ascending; shape (m,).
        sent: Send times, in nanoseconds, ascending for each key; shape (m,).
        positions: Positions of the senders [m]; shape (m, d).
        velocities: Velocities of the senders [m/s]; shape (m, d).
        variances: Variance of the position, along any axis [m^2]; shape (m,).
    """

    keys: NDArray[np.int64]
    sent: NDArray[np.int64]
    positions: Array
    velocities: Array
    variances: Array

    @classmethod
    def empty(cls, dimensions: int) -> PositionReports:
        """Return an empty collection."""
        nowhere = np.empty((0, dimensions))
        return cls(np.empty(0, np.int64), np.empty(0, np.int64), nowhere, nowhere, np.empty(0))

    def select(self, rows: Mask | Indices) -> PositionReports:
        """Return the selected reports."""
        keys, sent, positions, velocities, variances = self
        return PositionReports(keys[rows], sent[rows], positions[rows], velocities[rows], variances[rows])

    def merged(self, further: Sequence[PositionReports], *, latest: bool) -> PositionReports:
        """Return these and further reports, which need not be in order.

        Args:
            further: The reports to add.
            latest: Whether to keep only the last report of each sender.
        """
        merged = PositionReports(*(np.concatenate(columns) for columns in zip(self, *further, strict=True)))
        # A message may have arrived twice: of reports of one time only one is kept.
        order = np.lexsort((merged.sent, merged.keys))
        keys, sent = merged.keys[order], merged.sent[order]
        last = np.ones(len(keys), bool)
        last[:-1] = keys[1:] != keys[:-1]
        if not latest:
            last[:-1] |= sent[1:] != sent[:-1]
        return merged.select(order[last])

    def tracks(self, now: int, count: int, roster_size: int, speed: float, intensity: float) -> Tracks:
        """Extrapolate the positions of the senders to the present.

        Args:
            now: The present time, in nanoseconds.
            count: The number of receivers.
            roster_size: The number of agents in the roster.
            speed: Variance of velocities, along any axis [m^2/s^2].
            intensity: Power spectral density of accelerations, along any axis [m^2/s^3].
        """
        age = (now - self.sent) / 1e9
        positions = self.positions + age[:, None] * self.velocities
        spread = self.variances + speed * age**2 + intensity * age**3 / 3.0
        between, moving = speed * age + intensity * age**2 / 2.0, speed + intensity * age
        firsts = np.flatnonzero(np.r_[True, self.keys[1:] != self.keys[:-1]]) if len(self.keys) else np.empty(0, int)
        lasts = np.r_[firsts[1:], len(self.keys)] - 1 if len(firsts) else firsts
        if len(lasts) < len(self.keys):
            weights = 1.0 / np.maximum(spread, 1e-12)
            total = np.add.reduceat(weights, firsts)
            positions = np.add.reduceat(weights[:, None] * positions, firsts) / total[:, None]
        else:
            positions = positions[lasts]
        dimensions = positions.shape[1]
        covariances = np.zeros((len(lasts), 2 * dimensions, 2 * dimensions))
        axes = np.arange(dimensions)
        covariances[:, axes, axes] = spread[lasts, None]
        covariances[:, axes, axes + dimensions] = covariances[:, axes + dimensions, axes] = between[lasts, None]
        covariances[:, axes + dimensions, axes + dimensions] = moving[lasts, None]
        receivers, senders = np.divmod(self.keys[lasts], roster_size)
        velocities, ages = self.velocities[lasts], age[lasts]
        for array in (positions, velocities, covariances, ages):
            array.flags.writeable = False  # spares the tracks a copy
        return Tracks.of(now, count, receivers, senders, positions, velocities, covariances=covariances, ages=ages)


class Inbox(GroupCommunicationReceiver):
    """Stores the messages of other agents, and makes tracks of them, with more uncertainty for older messages.

    A message contains the position of its sender when it was sent. The position now is extrapolated with constant
    velocity, and its variance grows with the age T of the message as for a body with white noise of acceleration of
    intensity q (see `uncertainty.gaussian`): v + s T^2 + q T^3 / 3, where v is the variance that the sender states, or
    else `position_noise` squared, and s is `velocity_noise` squared.

    With the policy `latest`, only the message of each sender that was sent last counts, whenever it arrived. With
    `window` and `all`, the stored messages are averaged with the inverse of their variances as weights; the result is
    never more certain than the best of them, because their errors are not independent.

    Perception takes precedence over messages, unless a message is more recent. A broadcast contains also an intent and
    a risk, which the receiver's awareness of the sender has for as long as the sender is remembered. Further knowledge
    in a message is stored in the agent's knowledge of the sender; with any policy the knowledge that was sent last
    stays, also when the sender is forgotten.
    """

    class Parameters(Parameters):
        """Which messages are kept, and their uncertainty."""

        policy: Literal["latest", "window", "all"] = Field(
            "latest", description="Which messages of each sender count: the latest, those of a while, or all."
        )
        window: float = Field(
            1.0, gt=0, description="With the policy `window`, how old messages before the latest may be [s]."
        )
        memory: float = Field(5.0, gt=0, description="For how long a sender is remembered that says nothing more [s].")
        position_noise: float = Field(
            0.0, ge=0, description="Standard deviation of positions of which nothing is stated, along each axis [m]."
        )
        velocity_noise: float = Field(0.0, ge=0, description="Standard deviation of velocities, along each axis [m/s].")
        acceleration_noise: float = Field(
            0.5,
            ge=0,
            description="Root of the power spectral density of the acceleration of others, along each axis "
            "[m/s^2/sqrt(Hz)].",
        )

    #: The most messages of one sender that the policy `all` keeps, to bound memory.
    _MOST = 1000

    @property
    def kinds(self) -> Collection[str]:
        """The kinds of messages that it reads: states and broadcasts."""
        return (STATE, BROADCAST)

    def initialise_component(self, group: AgentGroup) -> None:
        """Start with an empty inbox."""
        super().initialise_component(group)
        environment = self.environment
        self._roster_size = len(environment.roster)
        self._start = environment.roster.start(group.name)
        self._reports = PositionReports.empty(environment.snapshot().positions.shape[1])
        #: The sequence number of the latest message with each knowledge, by its name, then by receiver and sender.
        self._learnt: defaultdict[str, dict[int, int]] = defaultdict(dict)
        #: Send time and sequence number of each awareness vector in use, by the receiver's row and the id.
        self._received: dict[tuple[int, str], tuple[int, int]] = {}
        group.awareness.received = None
        for agent in vars(group).get("agents", ()):
            for id in list(agent.awareness_database.received):
                agent.awareness_database.forget(id)

    @property
    def kept(self) -> PositionReports:
        """The stored messages."""
        return self._reports

    def _update(self, value: Sequence[Delivery]) -> None:
        further: list[PositionReports] = []
        for each in value:
            if each.batch.kind == STATE:
                further.append(self._state_reports(each))
            else:
                for message in each.messages(self.environment.roster.ids):
                    further += self._broadcast_reports(message)
        parameters, awareness = self.parameters, self._group.awareness
        if further:
            self._reports = self._reports.merged(further, latest=parameters.policy == "latest")
        self._forget()
        if len(self._reports.keys) or awareness.received is not None:
            awareness.received = self._reports.tracks(
                self.computed_at,
                len(self._group),
                self._roster_size,
                parameters.velocity_noise**2,
                parameters.acceleration_noise**2,
            )

    def _state_reports(self, delivery: Delivery) -> PositionReports:
        """Return the reports in messages of states, and store the knowledge in them."""
        columns = delivery.batch.columns
        names = [name for name in columns if name not in BODY_FIELDS]
        keys = (delivery.receivers - self._start).astype(np.int64) * self._roster_size + delivery.senders
        if names:
            self._store_knowledge_of_states(delivery, keys, names)
        covariance = delivery.column("covariance") if "covariance" in columns else None
        return PositionReports(
            keys,
            np.full(len(delivery), delivery.sent_time, np.int64),
            self._in_space(delivery.column("position")),
            self._in_space(delivery.column("velocity")),
            self._variance(covariance, len(delivery)),
        )

    def _broadcast_reports(self, message: Message) -> Sequence[PositionReports]:
        """Return the report in a broadcast, if any, and store its awareness vector and knowledge."""
        roster, payload = self.environment.roster, message.payload
        row, sender = roster.index(message.receiver) - self._start, roster.index(message.sender)
        agent, key = self._group.agents[row], row * self._roster_size + sender
        for name, value in payload.items():
            if isinstance(value, AwarenessVector):
                self._store_awareness(agent, message, value)
            elif name not in BODY_FIELDS:
                self._store_knowledge(agent, message.sender, key, message.sequence, name, value)
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
        """Return vectors with as many columns as the world; planar agents are at height 0."""
        vectors = np.asarray(values, float)
        missing = self._reports.positions.shape[1] - vectors.shape[1]
        return np.pad(vectors, ((0, 0), (0, missing))) if missing else vectors

    def _variance(self, covariance: ArrayLike | None, count: int) -> Array:
        """Return the variances of senders' positions: as stated, or else as assumed."""
        own = self.parameters.position_noise**2
        if covariance is None:
            return np.full(count, own)
        matrices = np.asarray(covariance, float)
        stated = np.trace(matrices, axis1=1, axis2=2) / matrices.shape[1]
        variance: Array = np.where(np.isnan(stated), own, stated)
        return variance

    def _store_awareness(self, agent: Agent, message: Message, vector: AwarenessVector) -> None:
        """Store an awareness vector, unless a later one is known."""
        received, key, sent = self._received, (agent.row, vector.id), (message.sent_time, message.sequence)
        if vector.id == agent.id or received.get(key, sent) > sent:
            return
        received[key] = sent
        # Its uncertainty is of the time when it was sent.
        uncertainty = vector.uncertainty
        if not len(uncertainty):
            uncertainty = TimeSeries.sampled([message.sent_time], [self.parameters.position_noise])
        payload, state = message.payload, self._group.awareness.motion(vector.id, vector.state, is_state=True)
        if vector.id == message.sender and "position" in payload:
            state = np.concatenate(self._in_space([payload["position"], payload["velocity"]]))
        told = vector.replaced(state=state, uncertainty=uncertainty)
        agent.awareness_database.receive(told, message.sent_time, alone="position" not in payload)

    def _store_knowledge_of_states(self, delivery: Delivery, keys: NDArray[np.int64], names: Sequence[str]) -> None:
        """Store the knowledge in messages."""
        ids, agents, start = self.environment.roster.ids, self._group.agents, self._start
        columns = (delivery.receivers, delivery.senders, keys, delivery.sequences)
        messages = list(zip(*(column.tolist() for column in columns), strict=True))
        for name in names:
            for (receiver, sender, key, sequence), value in zip(messages, delivery.column(name), strict=True):
                self._store_knowledge(agents[receiver - start], ids[sender], key, sequence, name, value)

    def _store_knowledge(self, agent: Agent, sender: str, key: int, sequence: int, name: str, value: object) -> None:
        """Store a piece of another agent's knowledge, unless a later one is known."""
        learnt = self._learnt[name]
        if learnt.get(key, -1) <= sequence:
            learnt[key] = sequence
            known = agent.knowledge_database
            if sender not in known:
                known[sender] = KnowledgeDatabase()
            known[sender][name] = value

    def _forget(self) -> None:
        """Drop messages that are too old."""
        parameters, kept = self.parameters, self._reports
        memory = nanoseconds(parameters.memory)
        for (row, id), (sent, _) in list(self._received.items()):
            if self.computed_at - sent > memory:
                del self._received[row, id]
                self._group.agents[row].awareness_database.forget(id)
        if not len(kept.keys):
            return
        recent = self.computed_at - kept.sent <= memory
        if parameters.policy != "latest":
            # The number of messages of the same sender that are not older, and whether the sender is remembered.
            ends = np.searchsorted(kept.keys, kept.keys, "right")
            ranks, recent = ends - np.arange(len(ends)), recent[ends - 1]
            if parameters.policy == "window":
                recent &= (self.computed_at - kept.sent <= nanoseconds(parameters.window)) | (ranks == 1)
            else:
                recent &= ranks <= self._MOST
        if not recent.all():
            self._reports = kept.select(recent)
