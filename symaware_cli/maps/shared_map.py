"""Shared maps: agents exchange the log odds of their own scans.

Reasons: docs/decisions/0098-barn-and-shared-maps.md
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli.core import AgentGroup, Delivery, GroupCommunicationReceiver, Level, MessageBatch
from symaware_cli.core.message import objects
from symaware_cli.maps.map_perception import MapPerception, MapUpdate
from symaware_cli.maps.occupancy_grid import Odds
from symaware_cli.world import nanoseconds

#: The kind of its messages.
MAP_EVIDENCE = "map-evidence"


class Evidence(NamedTuple):
    """The log odds of an agent's own scans in a message.

    Attributes:
        time: The instant of sending [ns].
        cells: The cells that the agent has observed, ascending; shape (m,).
        odds: The log odds of these cells; shape (m,).
    """

    time: int
    cells: NDArray[np.int32]
    odds: Odds


class SharedUpdate(NamedTuple):
    """The result of a turn.

    Attributes:
        own: The update by the agents' own scans.
        deliveries: The messages that arrived.
    """

    own: MapUpdate
    deliveries: Sequence[Delivery]


class SharedMap(MapPerception, GroupCommunicationReceiver):
    """Keeps for each agent a map like `perception.map`, from its own scans and from those that other agents send.

    Each `interval`, an agent sends the log odds of its own scans to its neighbours, without the data of others, so that
    its own evidence never returns to it. It keeps the last message of each sender, in the order of sending, and
    believes in the sum of its own log odds and of those received, within the limits of its own. A message replaces the
    previous one of its sender, so evidence is not counted twice, and a lost message is made up for by the next.

    Log odds of independent measurements add up (S. Thrun, W. Burgard, D. Fox, Probabilistic Robotics, 2005, chapter
    9.2). Agents with the same cells share their maps, also across groups. Messages are not forwarded.
    """

    events: ClassVar[Mapping[str, str]] = {
        "map-received": "An agent received the map of another for the first time; `cells` counts what that one saw.",
        "map-refused": "The cells of a received map differ from the agent's own; once for each sender.",
    }

    class Parameters(MapPerception.Parameters):
        """The interval between messages."""

        interval: float = Field(2.0, gt=0, le=1e6, description="Time between two messages of an agent [s].")

    @property
    def kinds(self) -> Collection[str]:
        """The kind of its messages."""
        return (MAP_EVIDENCE,)

    def initialise_component(self, group: AgentGroup) -> None:
        """Begin with unknown cells and no messages of others."""
        super().initialise_component(group)
        self._start = self.environment.roster.start(group.name)
        frame = self._frame
        self._grid = np.array([*frame.origin, frame.resolution, *frame.shape], float)
        #: The last evidence of each sender, by row and sender; None if the sender has other cells.
        self._heard: dict[tuple[int, int], Evidence | None] = {}
        self._next = 0

    def _compute(self) -> SharedUpdate:  # type: ignore[override]
        return SharedUpdate(super()._compute(), self._surroundings.exchange.collect(self.path))

    def _update(self, value: SharedUpdate) -> None:  # type: ignore[override]
        for delivery in value.deliveries:
            self._receive(delivery)
        super()._update(value.own)
        if self.computed_at >= self._next:
            every = nanoseconds(self.parameters.interval)
            self._next = (self.computed_at // every + 1) * every
            self._send()

    def _send(self) -> None:
        count = len(self._group)
        cells = [np.flatnonzero(each).astype(np.int32) for each in self._odds]
        odds = [each[some] for each, some in zip(self._odds, cells, strict=True)]
        columns = {"grid": np.tile(self._grid, (count, 1)), "cells": objects(cells), "odds": objects(odds)}
        self.post(MessageBatch(self._start + np.arange(count), columns, MAP_EVIDENCE))

    def _receive(self, delivery: Delivery) -> None:
        ids, rows, senders = self.environment.roster.ids, delivery.receivers - self._start, delivery.senders
        alike = (delivery.column("grid") == self._grid).all(axis=1)
        columns = (rows.tolist(), senders.tolist(), alike.tolist(), delivery.column("cells"), delivery.column("odds"))
        for row, sender, same, cells, odds in zip(*columns, strict=True):
            is_first, before = (row, sender) not in self._heard, self._heard.get((row, sender))
            if not same:
                self._heard[row, sender] = None
                if is_first:
                    said = f"cannot use the map of {ids[sender]}, whose cells are others"
                    self.emit_for(row, "map-refused", said, level=Level.WARNING, other=ids[sender])
            elif before is None or before.time <= delivery.sent_time:
                self._heard[row, sender] = Evidence(delivery.sent_time, cells, odds)
                if is_first:
                    said = f"knows the map of {ids[sender]}"
                    self.emit_for(row, "map-received", said, other=ids[sender], cells=len(cells))

    def _believed(self, row: int, odds: Odds) -> Odds:
        total = odds.copy()
        # A loop over senders in the order of the roster, as floating-point sums depend on their order.
        for sender in sorted(other for receiver, other in self._heard if receiver == row):
            evidence = self._heard[row, sender]
            if evidence is not None:
                total[evidence.cells] += evidence.odds
        return self._model.limited(total)
