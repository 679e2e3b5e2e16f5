"""Average consensus: agents agree on the mean of their initial values by messages between neighbours."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from symaware_cli.components.communication.running_sums import Flows, SumHistory
from symaware_cli.core import AgentGroup, Delivery, GroupCommunicationReceiver, Level, MessageBatch, Parameters
from symaware_cli.core.message import Indices
from symaware_cli.world.arrays import is_finite

Array = NDArray[np.float64]

#: The kind of its messages.
CONSENSUS = "consensus"


class Consensus(GroupCommunicationReceiver):
    """Moves a number or vector of each agent towards those of its neighbours, until all have the mean.

    With the graph Laplacian L and the gain e, x(k + 1) = x(k) - e L x(k) (R. Olfati-Saber, J. A. Fax, R. M. Murray,
    "Consensus and Cooperation in Networked Multi-Agent Systems", Proceedings of the IEEE 95, 2007). On a connected
    graph of undirected links with a gain below one over the greatest degree, the distance to the mean shrinks in each
    turn at least by the factor max(1 - e lambda_2, e lambda_n - 1).

    If messages are lost, this would not converge to the mean: one of two neighbours would move towards the other, but
    not vice versa. So each agent sends the sum S of all its values so far, and x_i = x_i(0) + e sum_j (S_j - S_i), with
    both sums of the latest turn of which i received that of j. Without losses this is the same, and any later message
    makes up for a loss (running sums are due to N. H. Vaidya, C. N. Hadjicostis, A. D. Dominguez-Garcia, "Robust
    Distributed Average Consensus via Exchange of Running Sums", IEEE Transactions on Automatic Control 61, 2016). All
    agents must take their turns at the same times.

    With messages d turns late, x(k + 1) = x(k) - e L x(k - d), which converges if and only if e lambda_n <
    2 sin(pi / (4 d + 2)) (S. A. Levin, R. M. May, "A Note on Difference-Delay Equations", Theoretical Population
    Biology 9, 1976, for each eigenvalue). As lambda_n is at most twice the greatest degree, a gain below
    sin(pi / (4 d + 2)) over that degree is small enough on every graph.

    With Metropolis weights, x_i(k + 1) = x_i(k) + e sum_j w_ij (x_j(k) - x_i(k)), where w_ij = 1 / (1 + max(d_i, d_j))
    and d_i is the number of links of i (L. Xiao, S. Boyd, S.-J. Kim, "Distributed average consensus with
    least-mean-square deviation", Journal of Parallel and Distributed Computing 67, 2007). An agent's weights sum to
    less than one, so a gain of 1 converges on every connected graph, and with delay a gain below sin(pi / (4 d + 2)).
    Each agent sends its degree with its value, and w_ij = w_ji keeps the mean. As a sum covers all turns, weights must
    not change: links must be constant and bidirectional. A degree counts all links, also those to agents without
    consensus.

    If something else changes the knowledge of an agent, consensus continues from there, towards the new mean.
    """

    events: ClassVar[Mapping[str, str]] = {
        "agreed": "the agent and all its neighbours differ by no more than the tolerance",
        "unstable": "the gain is too great for the number of neighbours and the delay of messages; values may diverge",
    }

    class Parameters(Parameters):
        """The value to agree on, weights and gain."""

        name: str = Field("value", min_length=1, description="Which knowledge: a number or a list of numbers.")
        weights: Literal["uniform", "metropolis"] = Field(
            "uniform",
            description="How much each neighbour counts: all 1, or 1 / (1 + the greater degree of the two), for which "
            "links must go both ways and stay as they are.",
        )
        gain: float | None = Field(
            None,
            gt=0,
            le=1,
            description="How far to move at each turn. With uniform weights it is required: less than one over the "
            "greatest number of neighbours. With Metropolis weights 1 if left out. Still less where messages are late.",
        )
        tolerance: float = Field(1e-6, gt=0, description="When agents count as agreed, in the units of the value.")

        @model_validator(mode="after")
        def _gain_of_uniform_weights(self) -> Consensus.Parameters:
            if self.gain is None and self.weights == "uniform":
                raise ValueError("`gain` is missing: it is optional with `weights: metropolis` only")
            return self

    @property
    def gain(self) -> float:
        """The gain of the weighted differences; 1 by default with Metropolis weights."""
        return 1.0 if self.parameters.gain is None else self.parameters.gain

    @property
    def kinds(self) -> Collection[str]:
        """The kind of messages for the name of its value, so that several can run side by side."""
        return (self._kind,)

    @property
    def _kind(self) -> str:
        return f"{CONSENSUS}:{self.parameters.name}"

    def check(self, group: AgentGroup) -> None:
        """Check that all agents have a finite value, of one shape."""
        try:
            known = group.known(self.parameters.name)
        except KeyError:
            raise ValueError(f"the agents do not know `{self.parameters.name}`") from None
        if not is_finite(known):
            raise ValueError(f"the knowledge `{self.parameters.name}` is not finite")

    def initialise_component(self, group: AgentGroup) -> None:
        """Start with the present knowledge of each agent."""
        super().initialise_component(group)
        self._start = self.environment.roster.start(group.name)
        known = group.known(self.parameters.name)
        self._shape = known.shape
        self._agreed = np.zeros(len(group), bool)
        self._has_warned = False
        self._start_epoch(known.reshape(len(group), -1))

    def _start_epoch(self, value: Array) -> None:
        """Start a new epoch with given values."""
        self._first = self._value = value
        self._history = SumHistory(value.shape)
        self._flows = Flows(value.shape, self._start, len(self.environment.roster))

    def _known_values(self) -> Array:
        """Return the present knowledge of each agent; shape (n, k)."""
        known = self._group.known(self.parameters.name)
        if known.shape != self._shape:
            raise ValueError(
                f"the knowledge `{self.parameters.name}` had the shape {self._shape} and has {known.shape}"
            )
        return known.reshape(len(known), -1)

    def _update(self, value: Sequence[Delivery]) -> None:
        known = self._known_values()
        if not np.array_equal(known, self._value):
            self._start_epoch(known)  # something else changed the knowledge of an agent
        history, now, degrees = self._history, self.now, self._degrees()
        has_missed = False
        # Overflow is reported below, not by NumPy.
        with np.errstate(over="ignore", invalid="ignore"):
            for each in value:
                has_missed |= history.misses(each.sent_time)
                self._flows.receive(each, history, degrees)
            if history.count:
                self._set(self._first + self.gain * self._flows.total())
            if has_missed:
                # Neighbours have taken turns that this group has missed: the sums are not of the same turns any more.
                self._start_epoch(self._value)
                history = self._history
            elif history.at(now) is not None:
                return  # a second turn at one instant: the values were sent in the first
            turn = history.add(now, self._value)
            self._check_finite(turn.after)
        columns = {"value": self._value, "sum": turn.before, "epoch": np.full(len(self._value), float(history.epoch))}
        if degrees is not None:
            columns["degree"] = degrees.astype(float)
        self._surroundings.exchange.post(MessageBatch(np.arange(len(self._value)) + self._start, columns, self._kind))

    def _degrees(self) -> Indices | None:
        """Return the number of links of each agent, shape (n,); None if all weights are 1."""
        if self.parameters.weights == "uniform":
            return None
        links, count = self._surroundings.exchange.links, len(self._group)
        if links is None:
            return np.full(count, len(self.environment.roster) - 1)
        return links.degrees()[self._start : self._start + count]

    def _set(self, value: Array) -> None:
        """Store the new values in the agents' knowledge.

        Raises:
            ArithmeticError: They are not finite.
        """
        self._check_finite(value)
        self._value = value
        shaped = value.reshape(self._shape)
        for row, knowledge in enumerate(self._group.knowledge):
            knowledge[self.parameters.name] = shaped[row].tolist()
        if not self._has_warned:
            self._warn()
        self._announce_agreement()

    def _check_finite(self, value: Array) -> None:
        if not is_finite(value):
            row = int(np.flatnonzero(~np.isfinite(value).all(axis=1))[0])
            text = f"the consensus on `{self.parameters.name}` diverges: that of {self._group.ids[row]}"
            raise ArithmeticError(f"{text} was {self._value.reshape(self._shape)[row].tolist()} and is not finite now")

    def _warn(self) -> None:
        """Warn once if the gain is not small enough for every graph with these numbers of links and this delay."""
        rows, late, weights = self._flows.pairs_of_turn(self._history.count)
        if not len(rows):
            return
        # Twice the greatest sum of an agent's weights is a bound of the greatest eigenvalue (Gershgorin).
        sums = np.bincount(rows, weights)
        row, delay, gain = int(sums.argmax()), float(late.mean()), self.gain
        limit = math.sin(math.pi / (4.0 * delay + 2.0)) / float(sums[row])
        if gain < limit:
            return
        self._has_warned = True
        heard = f"hears {np.count_nonzero(rows == row)} neighbours" + (f", {delay:.3g} turns late" if delay else "")
        text = f"a gain of {gain:g} is not below {limit:.3g}, for one who {heard}; values may grow without bound"
        self.emit_for(row, "unstable", text, level=Level.WARNING, gain=gain, limit=limit)

    def _announce_agreement(self) -> None:
        rows, values = self._flows.rows, self._flows.values
        apart = np.abs(values - self._value[rows]).max(axis=1)
        greatest = np.full(len(self._value), -1.0)
        np.maximum.at(greatest, rows, apart)
        agreed = (greatest >= 0.0) & (greatest <= self.parameters.tolerance)
        for row in np.flatnonzero(agreed & ~self._agreed).tolist():
            self.emit_for(row, "agreed", f"on {self._group.knowledge[row][self.parameters.name]}")
        # When a divided network reconnects, agents that had agreed differ, and agree anew.
        self._agreed = (self._agreed & (greatest <= 10.0 * self.parameters.tolerance)) | agreed
