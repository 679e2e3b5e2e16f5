"""Average consensus: agents agree on the mean of what each of them knows."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, Delivery, GroupCommunicationReceiver, Mailing, Message, Parameters

Array = NDArray[np.float64]

#: The kind of its messages.
CONSENSUS = "consensus"

#: So many turns back an agent knows its own sums; what is older than that comes too late.
_HISTORY = 256


class Consensus(GroupCommunicationReceiver):
    """Moves a number, or a vector, of each agent towards those of its neighbours, until all have the mean.

    With the graph Laplacian L and the gain e, x(k + 1) = x(k) - e L x(k) (R. Olfati-Saber, J. A. Fax, R. M. Murray,
    "Consensus and Cooperation in Networked Multi-Agent Systems", Proceedings of the IEEE 95, 2007). On a connected
    graph of undirected links with a gain below one over the greatest degree, the distance to the mean shrinks in each
    turn at least by the factor max(1 - e lambda_2, e lambda_n - 1).

    Where messages are lost, that would not end at the mean: one of two neighbours would move towards the other, and the
    other not towards it. So each tells the sum S of all its values so far, and x_i = x_i(0) + e sum_j (S_j - S_i), both
    sums of the latest turn of which i heard from j. With all messages on time that is the same; and what was lost is
    made up for by any later message (running sums are due to N. H. Vaidya, C. N. Hadjicostis, A. D. Dominguez-Garcia,
    "Robust Distributed Average Consensus via Exchange of Running Sums", IEEE Transactions on Automatic Control 61,
    2016). All agents must take their turns at the same times.
    """

    events: ClassVar[Mapping[str, str]] = {"agreed": "the agent and all whom it hears of differ by no more than asked"}

    class Parameters(Parameters):
        """On what to agree, and how fast."""

        name: str = Field("value", min_length=1, description="Which knowledge: a number or a list of numbers.")
        gain: float = Field(
            gt=0,
            le=1,
            description="How far to move at each turn; less than one over the greatest number of neighbours.",
        )
        tolerance: float = Field(1e-6, gt=0, description="When agents count as agreed, in the units of the value.")

    @property
    def kinds(self) -> Collection[str]:
        """Consensus on its own name, so that several can go on side by side."""
        return (self._kind,)

    @property
    def _kind(self) -> str:
        return f"{CONSENSUS}:{self.parameters.name}"

    def check(self, group: AgentGroup) -> None:
        """All agents know a value, of one shape."""
        try:
            group.known(self.parameters.name)
        except KeyError:
            raise ValueError(f"the agents do not know `{self.parameters.name}`") from None

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin with what each agent knows."""
        super().initialise_component(group)
        self._start = self.environment.roster.start(group.name)
        self._everybody = len(self.environment.roster)
        known = group.known(self.parameters.name)
        self._is_scalar = known.ndim == 1
        self._first = known.reshape(len(group), -1)
        self._value = self._first
        self._sum = np.zeros_like(self._first)
        #: The sums of the last turns; a turn's stand at its number modulo their count.
        self._sums = np.zeros((_HISTORY, *self._first.shape))
        self._turn = 0
        #: For each neighbour that was heard of: row * everybody + its index, the turn it told of, what flowed from it.
        self._keys = np.empty(0, np.int64)
        self._turns = np.empty(0, np.int64)
        self._flows = np.empty((0, self._first.shape[1]))
        self._told = np.empty((0, self._first.shape[1]))
        self._agreed = np.zeros(len(group), bool)

    def _update(self, value: Sequence[Delivery | Message]) -> None:
        for each in value:
            if isinstance(each, Delivery):
                self._hear(each)
        group, name, gain = self._group, self.parameters.name, self.parameters.gain
        if self._turn:
            rows = self._keys // self._everybody
            flow = np.zeros_like(self._first)
            np.add.at(flow, rows, self._flows)
            self._value = self._first + gain * flow
            for row, known in enumerate(self._value[:, 0].tolist() if self._is_scalar else self._value.tolist()):
                group.knowledge[row][name] = known
            self._announce_agreement(rows)
        self._sum = self._sum + self._value
        self._sums[self._turn % _HISTORY] = self._sum
        columns = {"value": self._value, "sum": self._sum, "turn": np.full(len(group), float(self._turn))}
        self._turn += 1
        self._surroundings.exchange.post(Mailing(np.arange(len(group)) + self._start, columns, self._kind))

    def _hear(self, delivery: Delivery) -> None:
        """Take over what flowed from neighbours since they were heard of last."""
        rows = delivery.receivers - self._start
        keys = rows.astype(np.int64) * self._everybody + delivery.senders
        turns = delivery.column("turn").astype(np.int64)
        recent = (self._turn - turns <= _HISTORY) & (turns < self._turn)
        flows = delivery.column("sum") - self._sums[turns % _HISTORY, rows]
        told = delivery.column("value")
        keys, turns, flows, told = (
            np.concatenate([before, now[recent]])
            for before, now in (
                (self._keys, keys),
                (self._turns, turns),
                (self._flows, flows),
                (self._told, told),
            )
        )
        order = np.lexsort((turns, keys))
        last = order[np.r_[keys[order][1:] != keys[order][:-1], True]] if len(order) else order
        self._keys, self._turns, self._flows, self._told = keys[last], turns[last], flows[last], told[last]

    def _announce_agreement(self, rows: NDArray[np.int64]) -> None:
        apart = np.abs(self._told - self._value[rows]).max(axis=1)
        greatest = np.full(len(self._value), -1.0)
        np.maximum.at(greatest, rows, apart)
        agreed = (greatest >= 0.0) & (greatest <= self.parameters.tolerance)
        for row in np.flatnonzero(agreed & ~self._agreed).tolist():
            self.emit_for(row, "agreed", f"on {self._group.knowledge[row][self.parameters.name]}")
        # Where a network comes together again that was in parts, those who had agreed come to differ, and agree anew.
        self._agreed = (self._agreed & (greatest <= 10.0 * self.parameters.tolerance)) | agreed
