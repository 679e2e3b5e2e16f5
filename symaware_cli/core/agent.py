"""Agents and the groups that hold their data.

Reasons: docs/decisions/0001-agents-in-columns.md
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness import (
    STATE,
    AwarenessDatabase,
    Changes,
    Column,
    GroupAwareness,
    KnowledgeDatabase,
    KnownColumn,
    Part,
    SelfAwareness,
    Signal,
    Tracks,
)
from symaware_cli.core.confinement import Confined, Confinement
from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.core.environment import Environment
from symaware_cli.core.event import EventBus
from symaware_cli.core.external_inputs import ExternalInputs
from symaware_cli.core.message import Exchange
from symaware_cli.core.verdict import OFFERS, OfferBoard, SpecificationStatus, SpecificationStatuses
from symaware_cli.world import Clock, Drive, Entity, Model, Roster

if TYPE_CHECKING:
    from symaware_cli.geometry import Region

Array = NDArray[np.float64]


class Surroundings:
    """The objects that all agents of a run share.

    Attributes:
        seed: The seed of the run.
        clock: Simulated time.
        events: The event bus.
        environment: The world.
        exchange: Sends and receives messages.
        inputs: The external inputs of components.
    """

    __slots__ = ("clock", "environment", "events", "exchange", "inputs", "seed")

    def __init__(
        self,
        seed: int,
        environment: Environment,
        exchange: Exchange,
        clock: Clock,
        events: EventBus,
        inputs: ExternalInputs,
    ) -> None:
        self.seed = seed
        self.environment = environment
        self.exchange = exchange
        self.clock = clock
        self.events = events
        self.inputs = inputs

    def reseed(self, seed: int) -> None:
        """Use another seed for components that have not drawn random numbers yet."""
        self.seed = seed


class AgentGroup(EntityGroup):
    """Agents that share a model, a body and a list of components. Their data are stored in columns.

    Attributes:
        knowledge: The knowledge database of each agent.
        knowledge_changes: The changes of the knowledge.
        awareness: The awareness of all agents.
        surroundings: The objects that all agents of the run share.
        drive: How the world moves their bodies; None if it does not state that, and before the run.
        regions: The regions of the scenario, by name.
        folder: The folder of the scenario, which contains the files that parameters name.
        sections: The objects built from the sections of the scenario that plugins add, by key.
        specifications: The statuses of the specifications of the run, by name.
        offers: Accepts specifications that are offered; None if the scenario has none.
    """

    def __init__(
        self,
        name: str,
        ids: Sequence[str],
        model: Model,
        entity: Entity,
        initial_state: ArrayLike,
        knowledge: Sequence[Mapping[str, Any]] = (),
        parts: Sequence[Part] = (),
        signals: Mapping[str, Signal] | None = None,
        seeds: Sequence[int] = (),
    ) -> None:
        self.awareness = GroupAwareness(np.array(initial_state, float), name, parts, signals)
        self.awareness.parts["state"] = STATE.of(model.state)
        super().__init__(name, ids, model, entity, self.awareness.state, seeds)
        self.knowledge_changes = Changes()
        self.knowledge = tuple(
            KnowledgeDatabase(each, row, self.knowledge_changes)
            for row, each in enumerate(knowledge or [{} for _ in self.ids])
        )
        self._known: dict[str, KnownColumn] = {}
        self.drive: Drive | None = None
        self.regions: Mapping[str, Region] = {}
        self.folder = Path()
        self.sections: Mapping[str, Any] = {}
        self.specifications: Mapping[str, SpecificationStatuses] = {}
        self.offers: OfferBoard | None = None
        self.surroundings: Surroundings

    def set_roster(self, roster: Roster) -> None:
        """Give the awareness of the group the roster of all agents."""
        self.awareness.roster = roster

    def known(self, name: str) -> Array:
        """Return one entry of the knowledge of each agent as one read-only array; shape (n, ...).

        Call it at each turn, because knowledge may change during a run. The same array is returned as long as nothing
        changes.

        Raises:
            KeyError: An agent does not know it.
            ValueError: The values are not numbers of one shape.
        """
        return self._known_column(name).values

    def known_lists(self, name: str) -> tuple[Array, NDArray[np.intp]]:
        """Like `known`, for lists that may differ in length, such as waypoints.

        Returns:
            The lists, shape (n, longest, ...), with shorter ones padded by their last element and empty ones by zeros,
            and their lengths, shape (n,). If all are empty, the shape of the lists is (n, 0).

        Raises:
            KeyError: An agent does not know it.
            ValueError: The values are not lists of numbers of one shape.
        """
        return self._known_column(name).padded

    def _known_column(self, name: str) -> KnownColumn:
        column = self._known.get(name)
        if column is None:
            column = self._known[name] = KnownColumn(self.knowledge, name, self.knowledge_changes)
        return column

    def others(self, reach: float) -> Tracks:
        """Return the beliefs of each agent about the others within reach of its own believed position.

        All components that consider other agents use this, whichever perception is in use: it returns the tracks if
        there are any, else the snapshot of a group that perceives everything, else nothing.

        Args:
            reach: The greatest distance [m].
        """
        awareness, now = self.awareness, self.surroundings.clock.now
        if awareness.tracks is not None:
            tracks = awareness.tracks
            own, apart = self.model.positions(awareness.state), tracks.positions.copy()
            apart[:, : own.shape[1]] -= own[tracks.observers]  # agents that move in the plane are at height 0
            return tracks.select(np.einsum("ij,ij->i", apart, apart) <= reach * reach)
        world = awareness.world
        if world is None:
            nobody = np.empty((0, len(self.model.position)))
            return Tracks(now, np.zeros(len(self) + 1, np.intp), np.empty(0, np.intp), nobody, nobody)
        positions = world.positions
        one, other, _ = self.surroundings.environment.proximity.directed(positions, reach)
        start = world.roster.start(self.name)
        if len(self) < len(positions):
            first, last = np.searchsorted(one, (start, start + len(self)))
            one, other = one[first:last], other[first:last]
        # `take` is many times faster than indexing, and arrays that are not writeable need not be copied.
        found, moving = positions.take(other, 0), world.velocities.take(other, 0)
        found.flags.writeable = moving.flags.writeable = False
        return Tracks.of(world.time, len(self), one - start, other, found, moving)

    def confined(self, tracks: Tracks) -> Sequence[Confined]:
        """Return the sets in which each agent knows others to stay, from each source; see `Confinement`.

        Predictions of others use it. It is empty unless the scenario has a section about that.

        Args:
            tracks: Beliefs of the group about others, such as those of `others`.
        """
        sources = (each for _, each in sorted(self.sections.items()) if isinstance(each, Confinement))
        found = (each.confined(self, tracks) for each in sources)
        return [each for each in found if each is not None]

    def breach(self, row: int, others: Collection[int]) -> float:
        """Return the declared probability that one of some others leaves the sets of `confined`, at most 1.

        The probabilities are added (Boole's inequality).

        Args:
            row: The row of the agent that relies on the sets.
            others: The others, as indices in the roster.
        """
        sources = [each.breach(self) for _, each in sorted(self.sections.items()) if isinstance(each, Confinement)]
        return min(1.0, sum(found.get((row, other), 0.0) for found in sources for other in sorted(others)))

    @cached_property
    def agents(self) -> tuple[Agent, ...]:
        """A view of each row; created on first use, for groups with components of single agents."""
        return tuple(Agent(self, row) for row in range(len(self)))


class AgentModel:
    """The model of one agent: its own control input, and the shared dynamics of its group."""

    __slots__ = ("_column", "_model", "_row")

    def __init__(self, model: Model, column: Column, row: int) -> None:
        self._model = model
        self._column = column
        self._row = row

    @property
    def control_input(self) -> Array:
        """The control input that the agent requests; shape (nu,)."""
        return self._column.row(self._row)

    @control_input.setter
    def control_input(self, value: ArrayLike) -> None:
        self._column.set_row(self._row, value)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)


class Agent:
    """One agent: a lightweight view of one row of its group.

    Attributes:
        id: Its name in the run, such as ``robot.2``, or ``robot`` for a group without a count.
        group: The group it belongs to.
        row: Its row there.
        entity: Its body.
        model: Its dynamics and the control input it requests.
        self_awareness: Its awareness of itself.
        self_knowledge: Its knowledge.
        awareness_database: Its awareness of itself and others, by id.
        knowledge_database: Its knowledge about itself and others, by id.
    """

    __slots__ = (
        "_state",
        "awareness_database",
        "entity",
        "group",
        "id",
        "knowledge_database",
        "model",
        "row",
        "self_awareness",
        "self_knowledge",
    )

    def __init__(self, group: AgentGroup, row: int) -> None:
        self.id = group.ids[row]
        self.group = group
        self.row = row
        self.entity = group.entity
        self.model = AgentModel(group.model, group.control_column, row)
        self._state = group.awareness.state_column
        self.self_awareness = SelfAwareness(self.id, group.awareness, row)
        self.awareness_database = AwarenessDatabase(self.self_awareness, group.awareness, row)
        self.self_knowledge = group.knowledge[row]
        self.knowledge_database: dict[str, KnowledgeDatabase] = {self.id: self.self_knowledge}

    @property
    def self_state(self) -> Array:
        """A copy of the agent's belief of its own state; shape (nx,)."""
        return self._state.row(self.row)

    @property
    def control_input(self) -> Array:
        """A copy of the control input that the agent requests; shape (nu,)."""
        return self.model.control_input

    @property
    def specifications(self) -> Mapping[str, SpecificationStatus]:
        """The statuses, up to the last step, of the specifications that concern the agent, by name."""
        found = {name: statuses.of(self.id) for name, statuses in self.group.specifications.items()}
        return {name: status for name, status in found.items() if status is not None}

    @property
    def offers(self) -> Mapping[str, Mapping[str, Any]]:
        """The offered specifications known to the agent, by name.

        Each has ``formula``, ``epsilon``, ``from``, ``since`` and ``until`` [s], and ``knowledge``; see
        docs/specifications.md. It is in the agent's own knowledge, from the run, or in its knowledge of others, from
        messages; its own takes precedence.
        """
        found: dict[str, Mapping[str, Any]] = {}
        for id in sorted(self.knowledge_database, key=lambda each: (each == self.id, each)):
            found.update(self.knowledge_database[id].get(OFFERS, {}))
        return found

    def measured_robustness(self, name: str) -> float:
        """Return the robustness of a specification on the samples of the agent, from its beginning up to now.

        All windows are cut to these samples: for ``eventually`` it is the greatest so far and for ``always`` the least.
        Before the specification begins, the present instant counts as its first. NaN for linear temporal logic.

        Args:
            name: The name of a specification, also of one that is offered.

        Raises:
            KeyError: There is no such specification.
        """
        return self.group.specifications[name].measured(self.id)

    @property
    def surroundings(self) -> Surroundings:
        """The objects that all agents of the run share."""
        return self.group.surroundings

    def __repr__(self) -> str:
        return f"Agent({self.id!r})"
