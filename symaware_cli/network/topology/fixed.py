"""Topologies that stay as they are."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from symaware_cli.core import Environment, ErrorCollector, Links
from symaware_cli.core.message import Indices
from symaware_cli.network.topology.topology import Topology, TopologyError, TopologyParameters
from symaware_cli.world.chance import Numbers, combined, key_of, uniform

Id = Annotated[str, Field(min_length=1, max_length=200)]


class FixedTopology(Topology):
    """A topology whose links are laid once."""

    def initialise(self, environment: Environment, seed: int) -> None:
        """Lay the links."""
        super().initialise(environment, seed)
        self._links = self.lay()

    @abstractmethod
    def lay(self) -> Links:
        """Make the links."""

    def links(self, now: int) -> Links:
        """The same at all times."""
        return self._links

    def between(self, one: Indices, other: Indices, *, both_ways: bool = True) -> Links:
        """Links between members, given by their places among them."""
        return Links.of(len(self.roster), self.members[one], self.members[other], both_ways=both_ways)


class Complete(FixedTopology):
    """Everybody reaches everybody."""

    def lay(self) -> Links:
        """A link from each to each."""
        places = np.arange(len(self.members))
        return self.between(np.repeat(places, len(places)), np.tile(places, len(places)), both_ways=False)


class Star(FixedTopology):
    """All talk with one, and with nobody else."""

    class Parameters(TopologyParameters):
        """Who is in the middle."""

        hub: Id | None = Field(None, description="Who is in the middle, an id; the first member if left out.")

    def lay(self) -> Links:
        """A link from the hub to each, and back."""
        hub = int(self.members[0])
        if self.parameters.hub is not None:
            found = self.find_members(self.parameters.hub, "hub")
            if len(found) > 1:
                raise TopologyError(f"`{self.parameters.hub}` are {len(found)} agents, and one is in the middle", "hub")
            hub = found[0]
        return Links.of(len(self.roster), np.full(len(self.members), hub), self.members, both_ways=True)


class Succession(TopologyParameters):
    """How far each reaches along a ring or a line."""

    neighbours: int = Field(1, ge=1, le=1000, description="How many each reaches in each direction.")
    directed: bool = Field(False, description="Whether each only reaches those after it.")


class Ring(FixedTopology):
    """Each talks with the next and the one before, in a circle."""

    Parameters = Succession

    def lay(self) -> Links:
        """Links to the next ones."""
        places, count = np.arange(len(self.members)), len(self.members)
        steps = np.arange(1, self.parameters.neighbours + 1)
        one, other = np.repeat(places, len(steps)), (places[:, None] + steps).reshape(-1) % max(count, 1)
        return self.between(one, other, both_ways=not self.parameters.directed)


class Line(FixedTopology):
    """Each talks with the next and the one before, in a row, such as the vehicles of a platoon."""

    Parameters = Succession

    def lay(self) -> Links:
        """Links to the next ones, as far as there are any."""
        places, count = np.arange(len(self.members)), len(self.members)
        steps = np.arange(1, self.parameters.neighbours + 1)
        one, other = np.repeat(places, len(steps)), (places[:, None] + steps).reshape(-1)
        return self.between(one[other < count], other[other < count], both_ways=not self.parameters.directed)


class Grid(FixedTopology):
    """Members stand in rows and columns and talk with those beside, above and below them."""

    class Parameters(TopologyParameters):
        """How the grid is laid out."""

        columns: int | None = Field(None, ge=1, description="Members in a row; about a square if left out.")
        wraps: bool = Field(False, description="Whether the last of each row and column reaches the first: a torus.")

    def lay(self) -> Links:
        """Links to the right and down."""
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
    """Each talks with the one above it and with those below; the first member is at the top."""

    class Parameters(TopologyParameters):
        """How the tree grows."""

        branches: int = Field(2, ge=1, le=100_000, description="How many are below each.")

    def lay(self) -> Links:
        """Links to the one above."""
        below = np.arange(1, len(self.members))
        return self.between(below, (below - 1) // self.parameters.branches)


def _pair(edge: Any) -> Any:
    """Say where that belongs which somebody wrote into an edge besides its ends."""
    if isinstance(edge, list | tuple) and len(edge) > 2:
        raise ValueError("an edge is a pair; a channel of its own stands under `topology.links`")
    return tuple(edge) if isinstance(edge, list) else edge


class Graph(FixedTopology):
    """A graph that is written down edge by edge."""

    class Parameters(TopologyParameters):
        """Its edges."""

        edges: tuple[Annotated[tuple[Id, Id], BeforeValidator(_pair)], ...] = Field(
            min_length=1,
            description="Pairs of ids, groups or patterns: who of the first is linked with whom of the second.",
        )
        directed: bool = Field(False, description="Whether the first of each pair only sends to the second.")

    def lay(self) -> Links:
        """The links of every pair."""
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
    """Each pair is linked with a probability, drawn once (P. Erdos, A. Renyi, "On random graphs I", 1959).

    Whether two are linked depends on the seed and on these two, not on who else is there.
    """

    class Parameters(TopologyParameters):
        """How dense it is."""

        probability: float = Field(ge=0, le=1, description="Probability that two are linked.")
        directed: bool = Field(False, description="Whether each direction is drawn by itself.")
        connected: bool = Field(
            False, description="Whether to draw again until everybody reaches everybody, at last through others."
        )

    #: How often a graph is drawn, at most, before it is given up that it is connected; and of large ones, as often as
    #: there are so many pairs, which take some 20 s, but a few times in any case.
    _MOST_TRIES, _FEWEST_TRIES, _MOST_PAIRS = 1000, 10, 10**8

    #: How many pairs are drawn at a time: so many that what is computed on the way stays in the processor's cache.
    _BLOCK = 8192

    def lay(self) -> Links:
        """Draw the links."""
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
        raise TopologyError(f"of {tries} graphs that were drawn none is connected", "probability")

    def _tries(self, count: int) -> int:
        """How often it is worth while to draw until a graph is connected.

        Raises:
            TopologyError: That is as good as never.
        """
        pairs = max(count * (count - 1) // 2, 1)
        tries = min(self._MOST_TRIES, max(self._FEWEST_TRIES, self._MOST_PAIRS // pairs))
        if self._lonely(count) > math.log(tries) + 3.0:
            raise TopologyError(
                f"{count} agents of which any two are linked with a probability of {self.parameters.probability:g} are "
                f"hardly ever connected; they often are from about ln(n)/n = {math.log(count) / count:.2g} on",
                "probability",
            )
        return tries

    def _lonely(self, count: int) -> float:
        """How many agents are to be expected who reach nobody, or whom nobody reaches.

        Below the threshold of connectivity, ln(n)/n, it is they who are missing, and the chance that there are none is
        about e to the minus this number (P. Erdos, A. Renyi, "On random graphs I", 1959).
        """
        alone: float = count * (1.0 - self.parameters.probability) ** (count - 1)
        return 2.0 * alone if self.parameters.directed else alone

    def _draw(self, keys: Numbers, attempt: int) -> tuple[Indices, Indices] | None:
        """Draw every pair, as places among the members; None where the graph is to be connected and cannot be."""
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
                # The same draw whichever of both comes first in the roster.
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
                # All pairs of these have been drawn by now.
                if not (reaches[begin:end] & is_reached[begin:end]).all():
                    return None
            begin = end
        return np.concatenate(ones), np.concatenate(others)


def _pairs(begin: int, end: int, count: int) -> tuple[Indices, Indices]:
    """All pairs of so many whose first is in a phase and whose second comes after it; each of shape (m,)."""
    rows = np.arange(begin, end)
    lengths = count - 1 - rows
    one = np.repeat(rows, lengths)
    starts = np.repeat(np.cumsum(lengths) - lengths, lengths)
    return one, np.arange(len(one)) - starts + one + 1
