"""Learns which cells of a knowledge model are blocked, from lidar scans and from messages of other agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from symaware_cli.core import Agent, AgentGroup, AwarenessDatabase, Component, KnowledgeDatabase, Quantity, Scan, Signal
from symaware_cli.geometry import Array, Indices
from symaware_cli.knowledge.abstraction.knowledge_model import model_named
from symaware_cli.world import ParameterError
from symaware_cli.world import Parameters as PluginParameters

#: For how many turns poses are remembered, to bound memory.
_MOST_POSES = 1000

BLOCKED = Signal(
    "blocked",
    kind="table",
    columns=(Quantity("x", "m"), Quantity("y", "m")),
    drawn="points",
    description="the centres of the cells that the agent knows to be blocked",
)


class LearntCells(NamedTuple):
    """The blocked cells that an agent knows after a turn.

    Attributes:
        known: The names of all blocked cells, in the order of the model.
        seen: The new ones among them that its own scan shows.
        told: Further new ones, each with the first agent, by id, whose list has it.
        pose: The position [m] and heading [rad] that the agent believes to have.
    """

    known: tuple[str, ...]
    seen: tuple[str, ...]
    told: tuple[tuple[str, str], ...]
    pose: tuple[float, float, float]


class BlockedCells(Component):
    """Keeps a list of the cells that cannot be entered among an agent's knowledge.

    A cell is blocked if enough rays of a lidar end well within it, and not at another agent; or if the list of another
    agent, received in a message, has the cell. Cells are never taken off the list, so agents that exchange their lists
    come to agree, in any order of messages.

    Rays are taken to begin at the believed pose of the agent at the time of their measurement. So a scan counts only if
    the component has a turn at that instant; the scan itself may arrive later.
    """

    signals = (BLOCKED,)
    events: ClassVar[Mapping[str, str]] = {
        "cell-seen": "The agent saw that a cell is blocked; `cell` is its name.",
        "cell-told": "Another agent told that a cell is blocked; `cell` is its name, and `by` the other agent.",
    }

    class Parameters(PluginParameters):
        """Which cells count as blocked, and the name of their entry in the knowledge."""

        model: str = Field(description="The knowledge model, by its name under `knowledge_models`.")
        knowledge: str = Field(
            "blocked", min_length=1, description="The name of the list in the knowledge of the agent, and of others."
        )
        scan: str | None = Field(
            None, description="The name of the lidar; null for an agent that learns only from what others tell."
        )
        rays: int = Field(2, ge=1, description="How many rays of a scan must end within a cell.")
        margin: float = Field(
            0.05, ge=0, description="How far from the border of a cell a ray must end to count for it [m]."
        )
        agent_radius: float = Field(
            0.5,
            ge=0,
            description="Rays that end nearer than this to the believed position of another agent end at it [m].",
        )

    # The knowledge model, which is the same in each run of the scenario.
    uncaptured = ("_model",)

    def check(self, group: AgentGroup) -> None:
        """Check that the model and the list exist."""
        given = self.parameters
        model = model_named(given.model, group)
        if 2.0 * given.margin >= (model.bounds[:, :, 1] - model.bounds[:, :, 0]).min():
            raise ParameterError("no ray can end so far from the border of the smallest cell", ("margin",))
        for id, known in zip(group.ids, group.knowledge, strict=True):
            if given.knowledge not in known:
                said = f"{id} does not know `{given.knowledge}`; declare it, with the cells that are blocked at first"
                raise ParameterError(f"{said}: `knowledge: {{{given.knowledge}: {{all: []}}}}`", ("knowledge",))

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Look up the model."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._model = model_named(self.parameters.model, agent.group)
        #: The believed pose at past turns, by instant [ns], and the instant of the last scan that was read.
        self._poses: dict[int, tuple[float, float, float]] = {}
        self._read = -1

    def _compute(self) -> LearntCells:
        agent, name, pose = self._agent, self.parameters.knowledge, self._pose()
        known = {str(each) for each in agent.self_knowledge[name]}
        states = self._model.system.states
        seen = [states[cell] for cell in self._seen(pose).tolist() if states[cell] not in known]
        told: dict[str, str] = {}
        for other in sorted(agent.knowledge_database):
            cells = agent.knowledge_database[other].get(name, ())
            for each in cells if other != agent.id and isinstance(cells, tuple) else ():
                if each in states and each not in known and each not in seen:
                    told.setdefault(each, other)
        learnt = known | {*seen, *told}
        return LearntCells(
            tuple(each for each in states if each in learnt), tuple(seen), tuple(sorted(told.items())), pose
        )

    def _update(self, value: LearntCells) -> None:
        for cell in value.seen:
            self.emit("cell-seen", f"sees that {cell} is blocked", cell=cell)
        for cell, other in value.told:
            self.emit("cell-told", f"{other} told that {cell} is blocked", cell=cell, by=other)
        if value.seen or value.told:
            self._agent.self_knowledge[self.parameters.knowledge] = value.known
        states = self._model.system.states
        centres = [self._model.centre(states.index(each)) for each in value.known]
        self.record(BLOCKED, np.array(centres, float).reshape(-1, 2))
        self._poses[self.computed_at] = value.pose
        scan = self._scan()
        if scan is not None:
            self._read = scan.time
        for instant in [each for each in self._poses if each <= self._read] or list(self._poses)[:-_MOST_POSES]:
            del self._poses[instant]

    def _seen(self, pose: tuple[float, float, float]) -> Indices:
        """Return the cells in which enough rays end, ascending."""
        given, bounds = self.parameters, self._model.bounds
        ends = self._ends(pose)
        low, high = bounds[:, None, :, 0] + given.margin, bounds[:, None, :, 1] - given.margin
        inside = ((low <= ends) & (ends <= high)).all(axis=2)
        return np.flatnonzero(inside.sum(axis=1) >= given.rays)

    def _ends(self, pose: tuple[float, float, float]) -> Array:
        """Return the end points of the rays of a new scan, except rays that end at other agents [m]; shape (m, 2)."""
        scan = self._scan()
        if scan is None or scan.time == self._read:
            return np.empty((0, 2))
        measured_at = pose if scan.time == self.now else self._poses.get(scan.time)
        if measured_at is None:
            return np.empty((0, 2))
        x, y, heading = measured_at
        distances = scan.distances[self._agent.row]
        ended = np.isfinite(distances)
        directions = heading + scan.angles[ended]
        ways = distances[ended, None] * np.stack([np.cos(directions), np.sin(directions)], axis=1)
        ends = np.array([x, y]) + ways
        apart = np.linalg.norm(ends[:, None] - self._others()[None], axis=2)
        near = (apart <= self.parameters.agent_radius).any(axis=1)  # of nobody who is absent, whose position is NaN
        return np.asarray(ends[~near])

    def _scan(self) -> Scan | None:
        """Return the last scan that has arrived; None if there is none."""
        name = self.parameters.scan
        scan = None if name is None else self._agent.group.awareness.readings.get(name)
        return scan if isinstance(scan, Scan) else None

    def _pose(self) -> tuple[float, float, float]:
        model, state = self._agent.group.model, self._agent.group.awareness.state[[self._agent.row]]
        x, y = model.positions(state)[0, :2].tolist()
        return x, y, 0.0 if model.heading is None else float(state[0, model.heading])

    def _others(self) -> Array:
        """Return the positions of other agents as the agent believes them [m]; shape (k, 2)."""
        awareness, agent = self._agent.group.awareness, self._agent
        tracks, world = awareness.tracks, awareness.world
        if tracks is not None:
            return np.asarray(tracks.positions[tracks.observers == agent.row, :2])
        if world is not None:
            own = self.environment.roster.index(agent.id)
            return np.asarray(np.delete(world.positions[:, :2], own, axis=0))
        return np.empty((0, 2))
