"""Becoming aware of others by what they say."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.components.communication.broadcast import BROADCAST
from symaware_cli.components.communication.state import STATE
from symaware_cli.core import (
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

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_OWN_COLUMNS = frozenset({"position", "velocity", "state", "covariance"})


class Kept(NamedTuple):
    """Messages that are kept, in columns, by receiver, sender and time.

    Attributes:
        keys: receiver row * everybody + sender's index, ascending; shape (m,).
        sent: When each was sent, in nanoseconds, ascending for each key; shape (m,).
        positions: Where the sender was [m]; shape (m, d).
        velocities: How fast it moved [m/s]; shape (m, d).
        variances: Variance of the position, along any axis [m^2]; shape (m,).
    """

    keys: NDArray[np.int64]
    sent: NDArray[np.int64]
    positions: Array
    velocities: Array
    variances: Array

    def some(self, places: NDArray[np.bool_] | Indices) -> Kept:
        """Some of them."""
        keys, sent, positions, velocities, variances = self
        return Kept(keys[places], sent[places], positions[places], velocities[places], variances[places])


class Inbox(GroupCommunicationReceiver):
    """Keeps what others tell of themselves, and makes tracks of it, older messages being less certain.

    A message says where its sender was. Now it is taken to be farther on, straight ahead, and the variance of where it
    is grows with the age T of the message as that of a body whose acceleration is white noise of intensity q (see
    `uncertainty.gaussian`): v + s T^2 + q T^3 / 3, where v is what the sender says of its own uncertainty, or
    `position_noise`, and s stands for `velocity_noise`.

    With the policy `latest`, of each sender the message counts that was sent last, whenever it came. With `window` and
    `all`, the messages kept are averaged, each with the inverse of its variance as its weight, and nobody becomes more
    certain by that than by the best of them, because their errors are not independent.

    What one sees wins over what one is told, unless that is more recent. Put it after a perception. Knowledge that is
    told along goes into the knowledge that an agent has of others; an awareness vector (`communication.broadcast`) into
    its awareness, its uncertainty as old as the message.
    """

    class Parameters(Parameters):
        """What is kept, and how certain it is."""

        policy: Literal["latest", "window", "all"] = Field(
            "latest", description="Which messages of each sender count: the latest, those of a while, or all."
        )
        window: float = Field(1.0, gt=0, description="With the policy `window`, how old a message may be [s].")
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
        dimensions = environment.snapshot().positions.shape[1]
        nothing = np.empty((0, dimensions))
        self._kept = Kept(np.empty(0, np.int64), np.empty(0, np.int64), nothing, nothing, np.empty(0))
        self._made: Tracks | None = None
        self._seen: Tracks | None = None

    @property
    def kept(self) -> Kept:
        """The messages in the inbox."""
        return self._kept

    def _update(self, value: Sequence[Delivery | Message]) -> None:
        deliveries = [each for each in value if isinstance(each, Delivery)]
        for each in value:
            if isinstance(each, Message):
                self._hear(each)
        if deliveries:
            self._keep(deliveries)
        self._forget()
        if len(self._kept.keys) or self._made is not None:
            self._merge()

    def _hear(self, message: Message) -> None:
        """Take over a broadcast: an awareness vector, and knowledge."""
        agent = self._group.agents[self.environment.roster.index(message.receiver) - self._start]
        for name, value in message.payload.items():
            if isinstance(value, AwarenessVector):
                # Its uncertainty is that of then, and says when that was.
                uncertainty = value.uncertainty
                if not len(uncertainty):
                    uncertainty = TimeSeries.sampled([message.sent_time], [self.parameters.position_noise])
                vector = AwarenessVector(value.id, value.state, value.intent, uncertainty, value.risk)
                agent.awareness_database[value.id] = vector
            else:
                agent.knowledge_database.setdefault(message.sender, KnowledgeDatabase())[name] = value

    def _keep(self, deliveries: Sequence[Delivery]) -> None:
        """Put messages into the inbox."""
        dimensions = self._kept.positions.shape[1]
        parts = [self._kept]
        for each in deliveries:
            keys = (each.receivers - self._start).astype(np.int64) * self._everybody + each.senders
            sent = np.full(len(each), each.sent_time, np.int64)
            position, velocity = (_in_space(each.column(name), dimensions) for name in ("position", "velocity"))
            parts.append(Kept(keys, sent, position, velocity, self._variance(each)))
            told = [name for name in each.mailing.columns if name not in _OWN_COLUMNS]
            if told:
                self._learn(each, told)
        joined = Kept(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        # The same message may have come twice: of equal times one counts.
        order = np.lexsort((joined.sent, joined.keys))
        keys, sent = joined.keys[order], joined.sent[order]
        last = np.ones(len(keys), bool)
        if self.parameters.policy == "latest":
            last[:-1] = keys[1:] != keys[:-1]
        else:
            last[:-1] = (keys[1:] != keys[:-1]) | (sent[1:] != sent[:-1])
        self._kept = joined.some(order[last])

    def _variance(self, delivery: Delivery) -> Array:
        own = self.parameters.position_noise**2
        if "covariance" not in delivery.mailing.columns:
            return np.full(len(delivery), own)
        covariance = delivery.column("covariance")
        said = np.trace(covariance, axis1=1, axis2=2) / covariance.shape[1]
        variance: Array = np.where(np.isnan(said), own, said)
        return variance

    def _learn(self, delivery: Delivery, names: Sequence[str]) -> None:
        """Take over what senders tell of what they know."""
        ids, agents = self.environment.roster.ids, self._group.agents
        columns = {name: delivery.column(name) for name in names}
        for place, (receiver, sender) in enumerate(
            zip(delivery.receivers.tolist(), delivery.senders.tolist(), strict=True)
        ):
            known = agents[receiver - self._start].knowledge_database.setdefault(ids[sender], KnowledgeDatabase())
            for name in names:
                known[name] = columns[name][place]

    def _forget(self) -> None:
        """Throw away what is too old to count."""
        parameters, kept = self.parameters, self._kept
        if not len(kept.keys):
            return
        oldest = min(parameters.memory, parameters.window) if parameters.policy == "window" else parameters.memory
        recent = self.now - kept.sent <= nanoseconds(oldest)
        if parameters.policy == "all":
            ends = np.searchsorted(kept.keys, kept.keys, "right")
            # All messages count as long as their sender is remembered.
            recent = self.now - kept.sent[ends - 1] <= nanoseconds(parameters.memory)
            recent &= ends - np.arange(len(ends)) <= self._MOST
        if not recent.all():
            self._kept = kept.some(recent)

    def _merge(self) -> None:
        """Make tracks of what was told, and of what perception sees."""
        awareness = self._group.awareness
        if awareness.tracks is None or awareness.tracks.origin is not self._made:
            self._seen = awareness.tracks
        told = self._tracks()
        self._made = told if self._seen is None else _joined(told, self._seen, self._everybody)
        awareness.tracks = self._made

    def _tracks(self) -> Tracks:
        """What the inbox says of others now."""
        kept, parameters = self._kept, self.parameters
        age = (self.now - kept.sent) / 1e9
        positions = kept.positions + age[:, None] * kept.velocities
        intensity, speed = parameters.acceleration_noise**2, parameters.velocity_noise**2
        place = kept.variances + speed * age**2 + intensity * age**3 / 3.0
        between, moving = speed * age + intensity * age**2 / 2.0, speed + intensity * age
        firsts = np.flatnonzero(np.r_[True, kept.keys[1:] != kept.keys[:-1]]) if len(kept.keys) else np.empty(0, int)
        lasts = np.r_[firsts[1:], len(kept.keys)] - 1 if len(firsts) else firsts
        if len(lasts) < len(kept.keys):
            weights = 1.0 / np.maximum(place, 1e-12)
            total = np.add.reduceat(weights, firsts)
            positions = np.add.reduceat(weights[:, None] * positions, firsts) / total[:, None]
        else:
            positions = positions[lasts]
        dimensions = positions.shape[1]
        covariances = np.zeros((len(lasts), 2 * dimensions, 2 * dimensions))
        axes = np.arange(dimensions)
        covariances[:, axes, axes] = place[lasts, None]
        covariances[:, axes, axes + dimensions] = covariances[:, axes + dimensions, axes] = between[lasts, None]
        covariances[:, axes + dimensions, axes + dimensions] = moving[lasts, None]
        observers, others = np.divmod(kept.keys[lasts], self._everybody)
        velocities, ages = kept.velocities[lasts], age[lasts]
        for array in (positions, velocities, covariances, ages):
            array.flags.writeable = False  # spares the tracks a copy
        return Tracks.of(
            self.now, len(self._group), observers, others, positions, velocities, covariances=covariances, ages=ages
        )


def _in_space(values: Array, dimensions: int) -> Array:
    """Vectors with at least so many columns; who moves in the plane stands at height 0."""
    missing = dimensions - values.shape[1]
    return np.pad(values, ((0, 0), (0, missing))) if missing else values


def _joined(told: Tracks, seen: Tracks, everybody: int) -> Tracks:
    """Of each other, what was told or what is seen, whichever is more recent; what is seen if they are equally so."""
    keys = np.concatenate([each.observers * everybody + each.others for each in (seen, told)])
    ages = np.concatenate([seen.ages, told.ages])
    order = np.lexsort((ages, keys))
    sorted_keys = keys[order]
    chosen = order[np.r_[True, sorted_keys[1:] != sorted_keys[:-1]]] if len(order) else order
    covariances = None
    if told.covariances is not None:
        own = np.zeros((len(seen), *told.covariances.shape[1:])) if seen.covariances is None else seen.covariances
        covariances = np.concatenate([own, told.covariances])[chosen]
    return Tracks.of(
        told.time,
        len(told.pointers) - 1,
        keys[chosen] // everybody,
        keys[chosen] % everybody,
        np.concatenate([seen.positions, told.positions])[chosen],
        np.concatenate([seen.velocities, told.velocities])[chosen],
        covariances=covariances,
        ages=ages[chosen],
    )
