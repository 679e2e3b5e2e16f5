"""Average consensus: agents agree on the mean of their initial values by messages between neighbours.

Lost messages do no harm: agents send running sums, from which the flows between neighbours follow.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from symaware_cli.core import (
    AgentGroup,
    Delivery,
    GroupCommunicationReceiver,
    Level,
    MessageBatch,
    Parameters,
    ScenarioView,
)
from symaware_cli.core.message import Indices, Times
from symaware_cli.engine.components.communication.consensus_check import check_consensus
from symaware_cli.geometry import Array
from symaware_cli.world import is_finite

#: For how many past turns the own sums are kept; older messages are ignored.
_MEMORY = 256
#: The kind of its messages.
CONSENSUS = "consensus"


class TurnSums(NamedTuple):
    """The sums of one turn.

    Attributes:
        number: The number of turns before it.
        before: The sum of all values before it, of each agent of a group; shape (n, k).
        after: The sum with the values of this turn; shape (n, k).
    """

    number: int
    before: Array
    after: Array


class SumHistory:
    """The sums of a group in its last turns, by their instants.

    Attributes:
        count: The number of turns.
        epoch: The instant of the first turn, in nanoseconds; -1 before it.
        sum: The sum of all values so far; shape (n, k).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.count = 0
        self.epoch = -1
        self.sum: Array = np.zeros(shape)
        self._turns: dict[int, TurnSums] = {}

    def add(self, now: int, value: Array) -> TurnSums:
        """Add the values of a new turn."""
        turn = TurnSums(self.count, self.sum, self.sum + value)
        if not self.count:
            self.epoch = now
        self.sum = turn.after
        self.count += 1
        self._turns[now] = turn
        if len(self._turns) > _MEMORY:
            del self._turns[next(iter(self._turns))]
        return turn

    def at(self, instant: int) -> TurnSums | None:
        """Return the turn at an instant, in nanoseconds; None if there was none, or it is forgotten."""
        return self._turns.get(instant)

    def since(self, instant: int) -> TurnSums | None:
        """Return the first turn at or after an instant; None if it is forgotten, or to come."""
        first = next(iter(self._turns), instant)
        return None if first > instant else next((turn for time, turn in self._turns.items() if time >= instant), None)

    def misses(self, instant: int) -> bool:
        """Return whether this group missed a turn that a neighbour took at a past instant."""
        return instant not in self._turns and instant > next(iter(self._turns), instant)


class Flows:
    """The flows to each agent of a group from each of its neighbours.

    The flow between two agents is the difference between the sums of their values since both of them take part. An
    agent that starts restarted starts with a sum of 0, and sends the time of its start: its *epoch*. Earlier flows are
    settled then, and later flows are counted from the neighbour's sum at that instant. An agent that started after a
    neighbour cannot know that sum: it counts from the first turn that it receives.

    Each flow has the weight of its pair: 1, or if neighbours send their degrees, 1 / (1 + max(d_i, d_j)). The weight of
    a pair must stay constant while sums are kept, as one sum covers all turns.

    Attributes:
        rows: The row of the agent of each pair, ascending; shape (m,).
        values: The value that each neighbour sent last; shape (m, k).
    """

    def __init__(self, shape: tuple[int, ...], start: int, roster_size: int) -> None:
        """Start without neighbours.

        Args:
            shape: The shape of the group's values, (n, k).
            start: The index of its first agent in the roster.
            roster_size: The number of agents in the roster.
        """
        self._start = start
        self._roster_size = roster_size
        self._settled_flows: Array = np.zeros(shape)
        width = shape[1:]
        #: row * roster_size + index of the neighbour, ascending.
        self._keys = np.empty(0, np.int64)
        self._epochs = np.empty(0, np.int64)
        self._instants = np.empty(0, np.int64)
        self._turns = np.empty(0, np.int64)
        self._delays = np.empty(0, np.int64)
        self._weights: Array = np.empty(0)
        self._origins: Array = np.empty((0, *width))
        self._flows: Array = np.empty((0, *width))
        self.values: Array = np.empty((0, *width))
        self.rows: Indices = np.empty(0, np.intp)

    def total(self) -> Array:
        """Return the weighted sum of all flows to each agent; shape (n, k)."""
        total = self._settled_flows.copy()
        np.add.at(total, self.rows, self._weights[:, None] * self._flows)
        return total

    def receive(self, delivery: Delivery, history: SumHistory, degrees: Indices | None = None) -> None:
        """Process messages of neighbours: ``value`` at a turn, ``sum`` of those before, and ``epoch``.

        Args:
            delivery: The messages.
            history: The sums of the group.
            degrees: The number of links of each agent of the group, if neighbours send their ``degree`` as well; shape
                (n,). None if all weights are 1.
        """
        turn, instant = history.at(delivery.sent_time), delivery.sent_time
        if turn is None:
            return
        # A message may have arrived twice.
        keys, one = np.unique(
            (delivery.receivers - self._start).astype(np.int64) * self._roster_size + delivery.senders,
            return_index=True,
        )
        before, value, epochs = (delivery.column(name)[one] for name in ("sum", "value", "epoch"))
        epochs = epochs.astype(np.int64)
        indices = self._indices(keys)
        if degrees is not None:
            # Both agents compute the weight from the same two numbers, so one gains what the other loses.
            greater = np.maximum(degrees[self.rows[indices]], delivery.column("degree")[one])
            self._weights[indices] = 1.0 / (1.0 + greater)
        restarted = epochs > self._epochs[indices]
        if restarted.any():
            self._settle(indices[restarted], epochs[restarted], before[restarted], turn, history)
        newer = (epochs == self._epochs[indices]) & (instant > self._instants[indices])
        indices, before, value = indices[newer], before[newer], value[newer]
        self._flows[indices] = before + value - turn.after[self.rows[indices]] - self._origins[indices]
        self._instants[indices] = instant
        self._turns[indices] = history.count
        self._delays[indices] = history.count - turn.number - 1
        self.values[indices] = value

    def pairs_of_turn(self, turn: int) -> tuple[Indices, Times, Array]:
        """Return the pairs whose neighbour was heard in a turn, by its number.

        Returns:
            The rows of the agents, the delays in turns, and the weights of the pairs; each (m,).
        """
        now = self._turns == turn
        return self.rows[now], self._delays[now], self._weights[now]

    def _indices(self, keys: Times) -> Indices:
        """Return the indices of pairs, which are added if they are new."""
        indices = np.searchsorted(self._keys, keys)
        known = indices < len(self._keys)
        known[known] = self._keys[indices[known]] == keys[known]
        if known.all():
            return indices
        new, where = keys[~known], indices[~known]
        self._keys = np.insert(self._keys, where, new)
        self.rows = (self._keys // self._roster_size).astype(np.intp)
        for name in ("_epochs", "_instants", "_turns"):
            setattr(self, name, np.insert(getattr(self, name), where, -1))
        self._delays = np.insert(self._delays, where, 0)
        self._weights = np.insert(self._weights, where, 1.0)
        for name in ("_origins", "_flows", "values"):
            setattr(self, name, np.insert(getattr(self, name), where, 0.0, axis=0))
        return np.searchsorted(self._keys, keys)

    def _settle(self, indices: Indices, epochs: Times, before: Array, turn: TurnSums, history: SumHistory) -> None:
        """Settle the flows of neighbours that are new or have started anew, and set the origins of their sums."""
        rows = self.rows[indices]
        np.add.at(self._settled_flows, rows, self._weights[indices, None] * self._flows[indices])
        self._flows[indices] = 0.0
        self._instants[indices] = -1
        self._epochs[indices] = epochs
        origins = before - turn.before[rows]
        origins[epochs == history.epoch] = 0.0
        for epoch in np.unique(epochs[epochs > history.epoch]).tolist():
            common = history.since(epoch)
            if common is not None:
                later = epochs == epoch
                origins[later] = -common.before[rows[later]]
        self._origins[indices] = origins


class Consensus(GroupCommunicationReceiver):
    """Moves a number or vector of each agent towards those of its neighbours, until all have the mean.

    With the graph Laplacian L and the gain e, x(k + 1) = x(k) - e L x(k) (R. Olfati-Saber, J. A. Fax, R. M. Murray,
    "Consensus and Cooperation in Networked Multi-Agent Systems", Proceedings of the IEEE 95, 2007). On a connected
    graph of undirected links with a gain below one over the greatest degree, the distance to the mean shrinks in each
    turn at least by the factor max(1 - e lambda_2, e lambda_n - 1).

    If messages are lost, this would not converge to the mean: one of two neighbours would move towards the other, but
    not vice versa. So each agent sends the sum S of all its values so far, and x_i = x_i(0) + e sum_j (S_j - S_i), with
    both sums of the latest turn whose sum of j has reached i. Without losses this is the same, and any later message
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

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that it suits the consensus of other groups, and the links."""
        check_consensus(view)

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
        self.post(MessageBatch(np.arange(len(self._value)) + self._start, columns, self._kind))

    def _degrees(self) -> Indices | None:
        """Return the number of links of each agent, shape (n,); None if all weights are 1."""
        if self.parameters.weights == "uniform":
            return None
        exchange, count = self._surroundings.exchange, len(self._group)
        if exchange.links is None:
            return np.full(count, max(0, len(exchange.present_indices) - 1))
        return exchange.links.degrees()[self._start : self._start + count]

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
