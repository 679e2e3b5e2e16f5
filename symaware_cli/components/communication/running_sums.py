"""Running sums: the flows between neighbours in a consensus that tolerates lost messages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery
from symaware_cli.core.message import Indices, Times

Array = NDArray[np.float64]

#: For how many past turns the own sums are kept; older messages are ignored.
_MEMORY = 256


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
