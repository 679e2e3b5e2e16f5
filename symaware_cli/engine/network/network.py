"""The network: present links between agents, and the channel of each link.

Reasons: docs/decisions/0016-network.md
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Links, Roster
from symaware_cli.core.message import Indices, Times
from symaware_cli.engine.network.channel.channel import Channel
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.channel.fates import NO_LINK, Fates, Impairment
from symaware_cli.engine.network.channel.link_states import LinkStates
from symaware_cli.engine.network.topology.topology import Topology


@dataclass(frozen=True, slots=True)
class TopologyPhase:
    """A topology and the time from which it holds.

    Attributes:
        start: In nanoseconds.
        topology: The topology.
        source: Its path in the scenario.
        use: Its entry-point name.
    """

    start: int
    topology: Topology
    source: str = "topology"
    use: str = ""


def links_of(topology: Topology, now: int, count: int) -> Links:
    """Return the checked links of a topology, which may be a plugin's, at an instant in nanoseconds.

    Raises:
        TypeError: They are not `Links`.
        ValueError: They are for another number of agents.
    """
    links = topology.links(now)
    if not isinstance(links, Links):
        raise TypeError(f"its links are of the type {type(links).__name__} instead of `Links`")
    if links.count != count:
        raise ValueError(f"its links are those of {links.count} agents, and there are {count}")
    return links


@dataclass(frozen=True, slots=True)
class ChannelOverride:
    """Links whose channel differs from the common one.

    Attributes:
        senders: The senders, as indices in the roster.
        receivers: The receivers, as indices in the roster.
        channel: The parameters that differ.
    """

    senders: frozenset[int]
    receivers: frozenset[int]
    channel: ChannelParameters


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the links.

    Attributes:
        links: The present number of links.
        begun: New links, as pairs of ids.
        ended: Links that ended, as pairs of ids.
        parts: The number of connected components; None if not counted.
        breaks: Whether the network has just become disconnected.
        moves: Whether the topology may change at each step.
    """

    links: int
    begun: Sequence[tuple[str, str]]
    ended: Sequence[tuple[str, str]]
    parts: int | None
    breaks: bool
    moves: bool


class Network:
    """Links between agents, and their channels.

    Attributes:
        links: The present links.
        connected: Whether the scenario requires the network to be connected.
        on_failure: Called with a phase whose topology raised, and the exception; must raise. None re-raises.
    """

    def __init__(
        self,
        roster: Roster,
        phases: Sequence[TopologyPhase],
        *,
        repeat: int | None = None,
        channel: ChannelParameters | None = None,
        overrides: Sequence[ChannelOverride] = (),
        connected: bool = False,
    ) -> None:
        """Start without links; `update` sets them.

        Args:
            roster: All agents.
            phases: Initialised topologies, in the order of their starts; the first starts at 0.
            repeat: The time after which the phases repeat, in nanoseconds; None for never.
            channel: The channel of links; perfect if None.
            overrides: Links with other channels; later ones take precedence.
            connected: Whether to count connected components.
        """
        self._roster = roster
        self._phases = tuple(phases)
        self._repeat = repeat
        self._base = channel or ChannelParameters()
        self._overrides = tuple(overrides)
        self._channels = [Channel(self._base)]
        self._numbers: dict[tuple[int, ...], int] = {(): 0}
        self.connected = connected
        self.present: NDArray[np.bool_] | None = None
        self.links: Links | None = None
        self.on_failure: Callable[[TopologyPhase, BaseException], NoReturn] | None = None
        self._present: TopologyPhase | None = None
        self._is_whole = True
        #: Whether all links deliver every message without delay.
        self.is_perfect = self._base.is_perfect and not self._overrides
        #: Whether messages may be dropped from the head of a queue.
        parts = [self._base, *(each.channel for each in self._overrides)]
        self.has_queues = any(each.drop == "head" for each in parts) and any(each.is_bounded for each in parts)

    def phase(self, now: int) -> TopologyPhase:
        """Return the phase at an instant, in nanoseconds."""
        time = now % self._repeat if self._repeat else now
        return [each for each in self._phases if each.start <= time][-1]

    @property
    def topologies(self) -> list[Topology]:
        """The topologies of all phases."""
        return [phase.topology for phase in self._phases]

    def _current_links(self, phase: TopologyPhase, now: int) -> Links:
        """Return the links of a phase's topology, restricted to present agents."""
        try:
            if phase is not self._present:
                self._present = phase
                phase.topology.begin(now)
            links = links_of(phase.topology, now, len(self._roster))
            return links if self.present is None else links.among(self.present)
        except BaseException as error:
            if self.on_failure is None:
                raise
            self.on_failure(phase, error)

    def update(self, now: int) -> Change | None:
        """Update the links at a step of the world; return None if nothing changed."""
        phase = self.phase(now)
        before, topology = self.links, phase.topology
        links = self.links = self._current_links(phase, now)
        if links is before:
            return None
        if before is None:
            begun = ended = np.empty(0, np.int64)
        else:
            begun = np.setdiff1d(links.keys, before.keys, assume_unique=True)
            ended = np.setdiff1d(before.keys, links.keys, assume_unique=True)
            if not len(begun) and not len(ended):
                return None
        parts = len(np.unique(links.parts()[self._members(topology)])) if self.connected else None
        was_whole, self._is_whole = self._is_whole, parts is None or parts <= 1
        breaks = was_whole and not self._is_whole
        return Change(len(links), self._named(begun), self._named(ended), parts, breaks, topology.changes)

    def _members(self, topology: Topology) -> Indices:
        """Return the present members of a topology, as indices in the roster."""
        members = np.asarray(topology.members, np.intp)
        return members if self.present is None else members[self.present[members]]

    def _named(self, keys: NDArray[np.int64]) -> list[tuple[str, str]]:
        ids = self._roster.ids
        senders, receivers = np.divmod(keys, len(ids))
        return [(ids[one], ids[other]) for one, other in zip(senders.tolist(), receivers.tolist(), strict=True)]

    def reached(self, senders: Indices) -> tuple[Indices, Indices]:
        """Return the links of some senders.

        Args:
            senders: The senders, ascending; shape (s,).

        Returns:
            For each link the index of its sender among them, ascending, and its receiver; each of shape (m,).
        """
        links = self.links
        assert links is not None
        if len(senders) == links.count:
            return links.senders, links.receivers
        starts, ends = links.pointers[senders], links.pointers[senders + 1]
        degrees = ends - starts
        rows = np.repeat(np.arange(len(senders)), degrees)
        within = np.arange(len(rows)) - np.repeat(np.cumsum(degrees) - degrees, degrees)
        return rows, links.receivers[starts[rows] + within]

    def has(self, senders: Indices, receivers: Indices) -> NDArray[np.bool_]:
        """Return which pairs of senders and receivers have a link; shape (m,)."""
        assert self.links is not None
        return self.links.has(senders, receivers)

    def enter(self, states: LinkStates, new: slice) -> None:
        """Set the channels of links that are used for the first time."""
        if not self._overrides:
            return
        senders, receivers = states.ends(new)
        for row, sender, receiver in zip(range(new.start, new.stop), senders.tolist(), receivers.tolist(), strict=True):
            concerned = tuple(
                number
                for number, each in enumerate(self._overrides)
                if sender in each.senders and receiver in each.receivers
            )
            states.channel[row] = self._numbers.setdefault(concerned, len(self._channels))
            if states.channel[row] == len(self._channels):
                parameters = self._base
                for number in concerned:
                    parameters = parameters.changed(self._overrides[number].channel)
                self._channels.append(Channel(parameters))

    def channel(self, number: int) -> Channel:
        """Return a channel by its number in the states."""
        return self._channels[number]

    def waits(self, states: LinkStates, rows: Indices, linked: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        """Return which messages must be queued because later messages may displace them from a full queue.

        Args:
            states: The states of the links.
            rows: The rows of the links; shape (m,).
            linked: Which of them exist at present; None for all.
        """
        heads = np.array([channel.drops_heads for channel in self._channels])
        waits: NDArray[np.bool_] = heads[states.channel[rows]]
        return waits if linked is None else waits & linked

    def carry(
        self,
        states: LinkStates,
        rows: Indices,
        numbers: Times,
        now: int,
        sizes: NDArray[np.int64],
        linked: NDArray[np.bool_] | None,
        waits: NDArray[np.bool_] | None = None,
        impairment: Impairment | None = None,
    ) -> Fates:
        """Decide the fates of messages that are sent now; see `Channel.carry`.

        Args:
            states: The states of the links.
            rows: The rows of the links, each at most once; shape (m,).
            numbers: The numbers of the messages on their links; shape (m,).
            now: The present time, in nanoseconds.
            sizes: In bytes; shape (m,).
            linked: Which links exist at present; None for all.
            waits: Which messages are left undecided; None for none.
            impairment: Disturbances; None for none.
        """
        if linked is None and waits is None and len(self._channels) == 1:
            return self._channels[0].carry(states, rows, numbers, now, sizes, impairment)
        due, reason = np.full(len(rows), now, np.int64), np.zeros(len(rows), np.uint8)
        copies, copies_due = [np.empty(0, np.intp)], [np.empty(0, np.int64)]
        if linked is not None:
            reason[~linked] = NO_LINK
        decided = reason == 0 if waits is None else (reason == 0) & ~waits
        for number, channel in enumerate(self._channels):
            chosen = np.flatnonzero(decided & (states.channel[rows] == number))
            if len(chosen):
                worse = None if impairment is None else impairment.take(chosen)
                fates = channel.carry(states, rows[chosen], numbers[chosen], now, sizes[chosen], worse)
                due[chosen], reason[chosen] = fates.due, fates.reason
                copies.append(chosen[fates.copies])
                copies_due.append(fates.copies_due)
        return Fates(due, reason, np.concatenate(copies), np.concatenate(copies_due))
