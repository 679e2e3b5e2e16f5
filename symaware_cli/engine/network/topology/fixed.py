"""Topologies with constant links: complete, star, ring, line, grid, tree, graph, random."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from symaware_cli.core import Environment, ErrorCollector, Links
from symaware_cli.core.message import Indices
from symaware_cli.engine.network.topology.topology import Topology, TopologyError, TopologyParameters
from symaware_cli.world import Numbers, combined, key_of, uniform

Id = Annotated[str, Field(min_length=1, max_length=200)]


class FixedTopology(Topology):
    """A topology whose links are created once."""

    def initialise(self, environment: Environment, seed: int) -> None:
        """Create the links."""
        super().initialise(environment, seed)
        self._links = self.lay()

    @abstractmethod
    def lay(self) -> Links:
        """Return the links."""

    def links(self, now: int) -> Links:
        """Return the links, which are constant."""
        return self._links

    def between(self, one: Indices, other: Indices, *, both_ways: bool = True) -> Links:
        """Return links between members, given by their indices in `members`."""
        return Links.of(len(self.roster), self.members[one], self.members[other], both_ways=both_ways)


class Complete(FixedTopology):
    """Links between all agents."""

    def lay(self) -> Links:
        """Return a link from each member to each other."""
        indices = np.arange(len(self.members))
        return self.between(np.repeat(indices, len(indices)), np.tile(indices, len(indices)), both_ways=False)


class Star(FixedTopology):
    """Links between a hub and all other agents."""

    class Parameters(TopologyParameters):
        """The hub."""

        hub: Id | None = Field(None, description="Who is in the middle, an id; the first member if left out.")

    def lay(self) -> Links:
        """Return links in both directions between the hub and each other member."""
        hub = int(self.members[0])
        if self.parameters.hub is not None:
            found = self.find_members(self.parameters.hub, "hub")
            if len(found) > 1:
                raise TopologyError(f"`{self.parameters.hub}` matches {len(found)} agents; a star has one hub", "hub")
            hub = found[0]
        return Links.of(len(self.roster), np.full(len(self.members), hub), self.members, both_ways=True)


class Succession(TopologyParameters):
    """Extent and direction of links along a ring or a line."""

    neighbours: int = Field(1, ge=1, le=1000, description="How many each reaches in each direction.")
    directed: bool = Field(False, description="Whether each only reaches those after it.")


class Ring(FixedTopology):
    """Links between successive members, closed to a ring."""

    Parameters = Succession

    def lay(self) -> Links:
        """Return links to the next members."""
        indices, count = np.arange(len(self.members)), len(self.members)
        steps = np.arange(1, self.parameters.neighbours + 1)
        one, other = np.repeat(indices, len(steps)), (indices[:, None] + steps).reshape(-1) % max(count, 1)
        return self.between(one, other, both_ways=not self.parameters.directed)


class Line(FixedTopology):
    """Links between successive members, such as the vehicles of a platoon."""

    Parameters = Succession

    def lay(self) -> Links:
        """Return links to the next members."""
        indices, count = np.arange(len(self.members)), len(self.members)
        steps = np.arange(1, self.parameters.neighbours + 1)
        one, other = np.repeat(indices, len(steps)), (indices[:, None] + steps).reshape(-1)
        return self.between(one[other < count], other[other < count], both_ways=not self.parameters.directed)


class Grid(FixedTopology):
    """Links between horizontal and vertical neighbours in rows and columns of members."""

    class Parameters(TopologyParameters):
        """Layout of the grid."""

        columns: int | None = Field(None, ge=1, description="Members in a row; about a square if left out.")
        wraps: bool = Field(False, description="Whether the last of each row and column reaches the first: a torus.")

    def lay(self) -> Links:
        """Return links to the right and down."""
        count = len(self.members)
        columns = self.parameters.columns or max(1, round(float(np.sqrt(count))))
        rows = -(-count // columns)
        row, column = np.divmod(np.arange(count), columns)
        right, down = column + 1, row + 1
        if self.parameters.wraps:
            if count != rows * columns:
                raise TopologyError(f"{count} members do not fill {rows} rows of {columns}", "columns")
            right, down = right % columns, down % rows
        ends = np.concatenate([np.where(right < columns, row * columns + right, count), down * columns + column])
        ends[count:][down >= rows] = count
        one = np.tile(np.arange(count), 2)
        return self.between(one[ends < count], ends[ends < count])


class Tree(FixedTopology):
    """Links between parents and children of a tree; the first member is the root."""

    class Parameters(TopologyParameters):
        """Branching of the tree."""

        branches: int = Field(2, ge=1, le=100_000, description="How many are below each.")

    def lay(self) -> Links:
        """Return links to the parents."""
        below = np.arange(1, len(self.members))
        return self.between(below, (below - 1) // self.parameters.branches)


def _pair(edge: Any) -> Any:
    """Check that an edge is a pair, and point out where channels belong."""
    if isinstance(edge, list | tuple) and len(edge) > 2:
        raise ValueError("an edge is a pair; channels of single links belong under `topology.links`")
    return tuple(edge) if isinstance(edge, list) else edge


class Graph(FixedTopology):
    """A graph given by its edges."""

    class Parameters(TopologyParameters):
        """The edges of the graph."""

        edges: tuple[Annotated[tuple[Id, Id], BeforeValidator(_pair)], ...] = Field(
            min_length=1,
            description="Pairs of ids, groups or patterns: who of the first is linked with whom of the second.",
        )
        directed: bool = Field(False, description="Whether the first of each pair only sends to the second.")

    def lay(self) -> Links:
        """Return the links of all edges."""
        senders: list[int] = []
        receivers: list[int] = []
        errors = ErrorCollector()
        for number, (one, other) in enumerate(self.parameters.edges):
            ends: list[list[int]] = []
            with errors.catch():
                if one == other and one in self.roster:
                    raise TopologyError(f"`{one}` cannot be linked with itself", "edges", number)
            for place, end in enumerate((one, other)):
                with errors.catch():
                    ends.append(self.find_members(end, "edges", number, place))
            if len(ends) == 2:
                senders += [each for each in ends[0] for _ in ends[1]]
                receivers += [each for _ in ends[0] for each in ends[1]]
        errors.raise_first()
        both_ways = not self.parameters.directed
        return Links.of(len(self.roster), np.array(senders), np.array(receivers), both_ways=both_ways)


class Random(FixedTopology):
    """Each pair of agents is linked with a probability, drawn once (P. Erdos, A. Renyi, "On random graphs I", 1959).

    Whether two agents are linked depends on the seed and on their ids only, not on other agents.
    """

    class Parameters(TopologyParameters):
        """Density and connectivity."""

        probability: float = Field(ge=0, le=1, description="Probability that two are linked.")
        directed: bool = Field(False, description="Whether each direction is drawn by itself.")
        connected: bool = Field(
            False, description="Whether to draw again until everybody reaches everybody, at last through others."
        )

    #: The most and the fewest attempts to draw a connected graph, and the number of pairs to draw in between, which
    #: takes some 20 s.
    _MOST_TRIES, _FEWEST_TRIES, _MOST_PAIRS = 1000, 10, 10**8

    #: How many pairs are drawn at a time: small enough for intermediate results to stay in the processor's cache.
    _BLOCK = 8192

    def lay(self) -> Links:
        """Draw and return the links."""
        parameters, count = self.parameters, len(self.members)
        numbers = self.roster.numbers[self.members]
        keys = combined(numbers, np.zeros_like(numbers), key_of(self.seed, "topology"))
        tries = self._tries(count) if parameters.connected else 1
        for attempt in range(tries):
            drawn = self._draw(keys, attempt)
            if drawn is None:
                continue
            links = self.between(*drawn, both_ways=not parameters.directed)
            if not parameters.connected or len(np.unique(links.parts()[self.members])) <= 1:
                return links
        raise TopologyError(f"none of {tries} drawn graphs is connected", "probability")

    def _tries(self, count: int) -> int:
        """Return the number of attempts to draw a connected graph.

        Raises:
            TopologyError: Connected graphs are too rare.
        """
        pairs = max(count * (count - 1) // 2, 1)
        tries = min(self._MOST_TRIES, max(self._FEWEST_TRIES, self._MOST_PAIRS // pairs))
        if self._expected_isolated(count) > math.log(tries) + 3.0:
            raise TopologyError(
                f"{count} agents of which any two are linked with a probability of {self.parameters.probability:g} are "
                f"hardly ever connected; they often are from about ln(n)/n = {math.log(count) / count:.2g} on",
                "probability",
            )
        return tries

    def _expected_isolated(self, count: int) -> float:
        """Return the expected number of agents without outgoing or without incoming links.

        Below the threshold of connectivity, ln(n)/n, these agents are what disconnects the graph, and the probability
        that there are none is about e to the minus this number (P. Erdos, A. Renyi, "On random graphs I", 1959).
        """
        alone: float = count * (1.0 - self.parameters.probability) ** (count - 1)
        return 2.0 * alone if self.parameters.directed else alone

    def _draw(self, keys: Numbers, attempt: int) -> tuple[Indices, Indices] | None:
        """Draw every pair, as indices of members; None if the graph shall be connected and is not."""
        parameters, count = self.parameters, len(keys)
        ones, others = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
        reaches, is_reached = np.zeros(count, bool), np.zeros(count, bool)
        begin = 0
        while begin < count - 1:
            end = min(begin + max(1, self._BLOCK // (count - 1 - begin)), count - 1)
            one, other = _pairs(begin, end, count)
            if parameters.directed:
                one, other = np.concatenate([one, other]), np.concatenate([other, one])
            else:
                # Order pairs by key, so that the draw does not depend on the order in the roster.
                turned = keys[one] > keys[other]
                one, other = np.where(turned, other, one), np.where(turned, one, other)
            chosen = uniform(keys[one], keys[other], attempt, 1)[:, 0] < parameters.probability
            one, other = one[chosen], other[chosen]
            ones.append(one)
            others.append(other)
            if parameters.connected:
                reaches[one] = is_reached[other] = True
                if not parameters.directed:
                    reaches[other] = is_reached[one] = True
                # All pairs of these members have been drawn by now.
                if not (reaches[begin:end] & is_reached[begin:end]).all():
                    return None
            begin = end
        return np.concatenate(ones), np.concatenate(others)


def _pairs(begin: int, end: int, count: int) -> tuple[Indices, Indices]:
    """Return all pairs of members with the first in [begin, end) and a later second; each of shape (m,)."""
    rows = np.arange(begin, end)
    lengths = count - 1 - rows
    one = np.repeat(rows, lengths)
    starts = np.repeat(np.cumsum(lengths) - lengths, lengths)
    return one, np.arange(len(one)) - starts + one + 1
