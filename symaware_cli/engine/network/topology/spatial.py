"""Topologies that depend on the true positions of agents: range, nearest neighbours, line of sight."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import Environment, Links
from symaware_cli.core.message import Indices
from symaware_cli.engine.network.topology.topology import Topology, TopologyParameters


class SpatialTopology(Topology):
    """A topology that depends on true positions."""

    changes: ClassVar[bool] = True

    def initialise(self, environment: Environment, seed: int) -> None:
        """Start without links."""
        super().initialise(environment, seed)
        self._links: Links | None = None

    def begin(self, now: int) -> None:
        """Forget the links of an earlier phase."""
        self._links = None

    def within(self, reach: float) -> tuple[Indices, Indices, NDArray[np.float64]]:
        """Return ordered pairs of members within reach of each other, and their distances [m]; each of shape (m,)."""
        environment = self.environment
        one, other, distance = environment.proximity.directed(environment.snapshot().positions, reach)
        if not self.takes_part.all():
            chosen = self.takes_part.take(one) & self.takes_part.take(other)
            one, other, distance = one[chosen], other[chosen], distance[chosen]
        return one, other, distance

    def renewed(self, senders: Indices, receivers: Indices) -> Links:
        """Return links for sorted pairs; the previous object if they are equal."""
        before = self._links
        if (
            before is None
            or len(before) != len(senders)
            or not np.array_equal(before.receivers, receivers)
            or not np.array_equal(before.senders, senders)
        ):
            self._links = before = Links(len(self.roster), senders, receivers)
        return before


class Range(SpatialTopology):
    """Links between agents within a distance of each other: a disk graph on true positions."""

    class Parameters(TopologyParameters):
        """Range and hysteresis."""

        range: float = Field(gt=0, description="Greatest distance at which two come to reach each other [m].")
        hysteresis: float = Field(
            0.0, ge=0, description="How much farther apart they still do, once they reach each other [m]."
        )

    def links(self, now: int) -> Links:
        """Return links within range, and existing ones within the hysteresis."""
        reach, slack = self.parameters.range, self.parameters.hysteresis
        one, other, distance = self.within(reach + slack)
        if slack:
            held = distance <= reach
            if self._links is not None and len(self._links):
                keys, before = one.astype(np.int64) * len(self.roster) + other, self._links.keys
                indices = np.minimum(np.searchsorted(before, keys), len(before) - 1)
                held |= before[indices] == keys
            one, other = one[held], other[held]
        return self.renewed(one, other)


class Nearest(SpatialTopology):
    """Links from each agent to its nearest neighbours, on true positions."""

    class Parameters(TopologyParameters):
        """Number and direction of links."""

        count: int = Field(ge=1, le=1000, description="How many each reaches.")
        directed: bool = Field(
            False, description="Whether it is not for those nearest to answer; otherwise links go both ways."
        )

    def links(self, now: int) -> Links:
        """Return links to the nearest members."""
        from scipy.spatial import cKDTree

        snapshot = self.environment.snapshot()
        members = np.flatnonzero(self.takes_part if snapshot.present is None else self.takes_part & snapshot.present)
        positions = snapshot.positions[members]
        count = min(self.parameters.count, len(members) - 1)
        if count < 1:
            return self.renewed(np.empty(0, np.intp), np.empty(0, np.intp))
        # The first result is the agent itself, or another one at the same position.
        found = np.asarray(cKDTree(positions).query(positions, k=count + 1)[1])
        own = found == np.arange(len(members))[:, None]
        own[~own.any(axis=1), -1] = True
        nearest = found[~own].reshape(len(members), count)
        one, other = members.repeat(count), members[nearest.reshape(-1)]
        links = Links.of(len(self.roster), one, other, both_ways=not self.parameters.directed)
        return self.renewed(links.senders, links.receivers)


class LineOfSight(SpatialTopology):
    """Links between agents within a distance and without an obstacle of the environment between them."""

    class Parameters(TopologyParameters):
        """Range of links."""

        range: float = Field(gt=0, description="Greatest distance at which two reach each other [m].")

    def links(self, now: int) -> Links:
        """Return links within range whose line of sight is free."""
        one, other, _ = self.within(self.parameters.range)
        if len(self.environment.scenery):
            # Both directions share a line.
            first = one < other
            keys = one[first].astype(np.int64) * len(self.roster) + other[first]
            free = self.environment.in_sight(one[first], other[first])
            links = Links.of(len(self.roster), *np.divmod(keys[free], len(self.roster)), both_ways=True)
            one, other = links.senders, links.receivers
        return self.renewed(one, other)
