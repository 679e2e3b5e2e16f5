"""Situational awareness: what an agent believes, intends, doubts and fears, of itself and of others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.core.column import Column, SeriesColumn, frozen
from symaware_cli.core.series import TimeSeries

if TYPE_CHECKING:
    from symaware_cli.core.world import Snapshot

Array = NDArray[np.float64]


class AwarenessVector:
    """The situational awareness of one agent, as a plain value.

    Attributes:
        id: Whom it is about.
        state: The believed state; shape (nx,).
        intent: Where it means to go.
        uncertainty: How unsure the belief is.
        risk: How dangerous the situation is.
    """

    __slots__ = ("id", "intent", "risk", "state", "uncertainty")

    def __init__(
        self,
        id: str,
        state: ArrayLike,
        intent: TimeSeries | None = None,
        uncertainty: TimeSeries | None = None,
        risk: TimeSeries | None = None,
    ) -> None:
        self.id = id
        self.state: Array = frozen(state)
        self.intent = TimeSeries() if intent is None else intent
        self.uncertainty = TimeSeries() if uncertainty is None else uncertainty
        self.risk = TimeSeries() if risk is None else risk

    def __repr__(self) -> str:
        return f"AwarenessVector({self.id!r}, state={np.array2string(self.state, precision=4)})"


class GroupAwareness:
    """The awareness that the agents of a group have: of themselves as columns, of others sparsely.

    Attributes:
        intent: A series for each agent.
        uncertainty: A series for each agent.
        risk: A series for each agent.
        world: What all agents of the group know of everybody, where they perceive everything; one shared
            read-only snapshot, never a copy for each pair.
    """

    __slots__ = ("intent", "others_changed", "risk", "state_column", "uncertainty", "world")

    def __init__(self, state: Array) -> None:
        self.state_column = Column(state)
        self.intent = SeriesColumn(len(state))
        self.uncertainty = SeriesColumn(len(state))
        self.risk = SeriesColumn(len(state))
        self.world: Snapshot | None = None
        self.others_changed: set[int] = set()

    @property
    def state(self) -> Array:
        """What each agent believes of its own state, read-only; shape (n, nx)."""
        return self.state_column.values

    @state.setter
    def state(self, values: ArrayLike) -> None:
        self.state_column.values = values


class SelfAwareness(AwarenessVector):
    """An agent's awareness of itself: a view of its row, which a component may write."""

    __slots__ = ("_awareness", "_row")

    def __init__(self, id: str, awareness: GroupAwareness, row: int) -> None:
        self.id = id
        self._awareness = awareness
        self._row = row

    @property
    def state(self) -> Array:
        """A copy of the believed state; shape (nx,)."""
        return self._awareness.state_column.row(self._row)

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._awareness.state_column.set_row(self._row, value)

    @property
    def intent(self) -> TimeSeries:
        """Where the agent means to go."""
        return self._awareness.intent.row(self._row)

    @intent.setter
    def intent(self, series: TimeSeries) -> None:
        self._awareness.intent.set_row(self._row, series)

    @property
    def uncertainty(self) -> TimeSeries:
        """How unsure the belief is."""
        return self._awareness.uncertainty.row(self._row)

    @uncertainty.setter
    def uncertainty(self, series: TimeSeries) -> None:
        self._awareness.uncertainty.set_row(self._row, series)

    @property
    def risk(self) -> TimeSeries:
        """How dangerous the situation is."""
        return self._awareness.risk.row(self._row)

    @risk.setter
    def risk(self, series: TimeSeries) -> None:
        self._awareness.risk.set_row(self._row, series)


class AwarenessDatabase(MutableMapping[str, AwarenessVector]):
    """All that one agent is aware of, by id: itself, whom it perceives and whom it heard of.

    What the agent's own components wrote of another wins over what the group's perception shares.
    """

    __slots__ = ("_awareness", "_others", "_own", "_row", "_world")

    def __init__(self, own: SelfAwareness, awareness: GroupAwareness, row: int) -> None:
        self._own = own
        self._awareness = awareness
        self._row = row
        self._others: dict[str, AwarenessVector] = {}
        self._world: Snapshot | None = None

    @property
    def world(self) -> Snapshot | None:
        """The snapshot of the whole world that this agent knows, if it perceives everything."""
        return self._world or self._awareness.world

    @world.setter
    def world(self, snapshot: Snapshot | None) -> None:
        self._world = snapshot
        self._awareness.others_changed.add(self._row)

    @property
    def others(self) -> Mapping[str, AwarenessVector]:
        """What the agent's own components wrote of others."""
        return self._others

    def __getitem__(self, id: str) -> AwarenessVector:
        if id == self._own.id:
            return self._own
        vector = self._others.get(id)
        if vector is None:
            world = self.world
            if world is None:
                raise KeyError(id)
            vector = AwarenessVector(id, world.state(id))
        return vector

    def __setitem__(self, id: str, vector: AwarenessVector) -> None:
        if id == self._own.id:
            self._own.state = vector.state
            self._own.intent, self._own.uncertainty, self._own.risk = vector.intent, vector.uncertainty, vector.risk
            return
        self._others[id] = vector
        self._awareness.others_changed.add(self._row)

    def __delitem__(self, id: str) -> None:
        del self._others[id]
        self._awareness.others_changed.add(self._row)

    def __iter__(self) -> Iterator[str]:
        yield self._own.id
        world = self.world
        known: Sequence[str] = world.roster.ids if world else ()
        yield from (id for id in known if id != self._own.id)
        seen = set(known)
        yield from (id for id in sorted(self._others) if id not in seen)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, id: object) -> bool:
        return id == self._own.id or id in self._others or (self.world is not None and id in self.world.roster)
