"""Running sums: what flowed between agents and their neighbours, whatever was lost of what they told each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Delivery
from symaware_cli.core.message import Indices, Times

Array = NDArray[np.float64]

#: So many turns back agents know their own sums; what is older than that comes too late.
_MEMORY = 256


class TurnSums(NamedTuple):
    """The sums of one turn.

    Attributes:
        number: How many turns were before it.
        before: The sum of all values before it, of each agent of a group; shape (n, k).
        after: The sum with the values of this turn; shape (n, k).
    """

    number: int
    before: Array
    after: Array


class SumHistory:
    """The sums of the last turns of a group, by their instants.

    Attributes:
        count: How many turns there were.
        epoch: The instant of the first, in nanoseconds; -1 before it.
        sum: The sum of all values so far; shape (n, k).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.count = 0
        self.epoch = -1
        self.sum: Array = np.zeros(shape)
        self._turns: dict[int, TurnSums] = {}

    def add(self, now: int, value: Array) -> TurnSums:
        """Remember the values of a turn, which comes after all others."""
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
        """The turn at an instant, in nanoseconds; None where there was none, or longer ago than is remembered."""
        return self._turns.get(instant)

    def since(self, instant: int) -> TurnSums | None:
        """The first turn at an instant or after it; None where it is not remembered, or not yet."""
        first = next(iter(self._turns), instant)
        return None if first > instant else next((turn for time, turn in self._turns.items() if time >= instant), None)

    def misses(self, instant: int) -> bool:
        """Whether somebody who took a turn at an instant in the past took one that was left out here."""
        return instant not in self._turns and instant > next(iter(self._turns), instant)


class Flows:
    """What flowed to each agent of a group from each neighbour that it heard of.

    The flow between two is the difference between the sums of their values since both of them take part. Who begins
    anew begins with a sum of 0, and says when that was: its *epoch*. What flowed before is settled then, and what flows
    from then on is counted from the sum that the other had at that instant. Who began later than a neighbour cannot
    know that sum: it counts from the first turn of which it hears.

    Each flow counts with the weight of its pair, which is 1, or where neighbours tell their degrees, 1 / (1 + max(d_i,
    d_j)). A pair's weight is to stay the same for as long as sums are kept, as one sum covers all turns.

    Attributes:
        rows: Whose neighbour each is, ascending; shape (m,).
        told: The value that each told last; shape (m, k).
    """

    def __init__(self, shape: tuple[int, ...], start: int, everybody: int) -> None:
        """Nobody was heard of yet.

        Args:
            shape: Of the values of the group, (n, k).
            start: The index of its first agent in the roster.
            everybody: How many agents there are.
        """
        self._start = start
        self._everybody = everybody
        self._settled: Array = np.zeros(shape)
        width = shape[1:]
        #: row * everybody + index of the neighbour, ascending.
        self._keys = np.empty(0, np.int64)
        self._epochs = np.empty(0, np.int64)
        self._instants = np.empty(0, np.int64)
        self._heard = np.empty(0, np.int64)
        self._late = np.empty(0, np.int64)
        self._weights: Array = np.empty(0)
        self._origins: Array = np.empty((0, *width))
        self._flows: Array = np.empty((0, *width))
        self.told: Array = np.empty((0, *width))
        self.rows: Indices = np.empty(0, np.intp)

    def total(self) -> Array:
        """What flowed to each agent in all, weighted; shape (n, k)."""
        total = self._settled.copy()
        np.add.at(total, self.rows, self._weights[:, None] * self._flows)
        return total

    def hear(self, delivery: Delivery, history: SumHistory, degrees: Indices | None = None) -> None:
        """Take over what neighbours tell: their ``value`` at a turn, the ``sum`` of those before, their ``epoch``.

        Args:
            delivery: What they tell.
            history: The sums of the group.
            degrees: How many links each agent of the group has, where neighbours tell their own ``degree`` as well;
                shape (n,). None where all weights are 1.
        """
        turn, instant = history.at(delivery.sent_time), delivery.sent_time
        if turn is None:
            return
        # A message may have come twice.
        keys, one = np.unique(
            (delivery.receivers - self._start).astype(np.int64) * self._everybody + delivery.senders, return_index=True
        )
        before, value, epochs = (delivery.column(name)[one] for name in ("sum", "value", "epoch"))
        epochs = epochs.astype(np.int64)
        places = self._places(keys)
        if degrees is not None:
            # Both ends compute it from the same two numbers, so what one gains the other loses.
            greater = np.maximum(degrees[self.rows[places]], delivery.column("degree")[one])
            self._weights[places] = 1.0 / (1.0 + greater)
        anew = epochs > self._epochs[places]
        if anew.any():
            self._settle(places[anew], epochs[anew], before[anew], turn, history)
        news = (epochs == self._epochs[places]) & (instant > self._instants[places])
        places, before, value = places[news], before[news], value[news]
        self._flows[places] = before + value - turn.after[self.rows[places]] - self._origins[places]
        self._instants[places] = instant
        self._heard[places] = history.count
        self._late[places] = history.count - turn.number - 1
        self.told[places] = value

    def heard(self, turn: int) -> tuple[Indices, Times, Array]:
        """Whose neighbours were heard of in a turn, by its number.

        Returns:
            Their agents' rows, how many turns later than at once, and the weights of the pairs; each (m,).
        """
        now = self._heard == turn
        return self.rows[now], self._late[now], self._weights[now]

    def _places(self, keys: Times) -> Indices:
        """Where neighbours stand, who are entered if they are new."""
        places = np.searchsorted(self._keys, keys)
        known = places < len(self._keys)
        known[known] = self._keys[places[known]] == keys[known]
        if known.all():
            return places
        new, where = keys[~known], places[~known]
        self._keys = np.insert(self._keys, where, new)
        self.rows = (self._keys // self._everybody).astype(np.intp)
        for name in ("_epochs", "_instants", "_heard"):
            setattr(self, name, np.insert(getattr(self, name), where, -1))
        self._late = np.insert(self._late, where, 0)
        self._weights = np.insert(self._weights, where, 1.0)
        for name in ("_origins", "_flows", "told"):
            setattr(self, name, np.insert(getattr(self, name), where, 0.0, axis=0))
        return np.searchsorted(self._keys, keys)

    def _settle(self, places: Indices, epochs: Times, before: Array, turn: TurnSums, history: SumHistory) -> None:
        """Count anew for neighbours that are heard of for the first time, or began anew."""
        rows = self.rows[places]
        np.add.at(self._settled, rows, self._weights[places, None] * self._flows[places])
        self._flows[places] = 0.0
        self._instants[places] = -1
        self._epochs[places] = epochs
        origins = before - turn.before[rows]
        origins[epochs == history.epoch] = 0.0
        for epoch in np.unique(epochs[epochs > history.epoch]).tolist():
            common = history.since(epoch)
            if common is not None:
                later = epochs == epoch
                origins[later] = -common.before[rows[later]]
        self._origins[places] = origins
