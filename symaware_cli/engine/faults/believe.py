"""Beliefs about another agent that are true for a while, and the placebo: beliefs whose errors are drawn anew.

Reasons: docs/decisions/0090-explanations.md
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from symaware_cli import core
from symaware_cli.core import AgentGroup, GroupComponent, Snapshot, Tracks
from symaware_cli.core.identifiers import AgentPattern
from symaware_cli.engine.runtime.fault import AgentSelection, ComponentSelection, Fault, FaultContext, FaultTargets
from symaware_cli.geometry import Array
from symaware_cli.world import SECOND, Roster, agent_numbers

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
"""The believing agents as rows of their group, and for each the index in the roster of the agent believed about."""

Named = Sequence[tuple[int, str]]
"""Pairs before the run: the believing agents as rows, with the ids of the agents believed about."""


class Believe(Fault):
    """Agents believe the truth about others; or, as a placebo, the errors of these beliefs are drawn anew.

    The truth about the state is the position and velocity of the other agent, or the whole state for an agent's belief
    about itself. It replaces the belief of every source (perception, estimator, messages, components of the agent)
    after each turn of any component of the agent, and is added if there is none. Covariances stay as the agent's own
    estimator computes them from its true measurements. The truth about the intent is the intent that the other agent
    holds at that time.

    The placebo draws anew what sensors of the agent draw about the other one, from keys of their own; all other draws
    of the run are as they were. Components of single agents draw from one generator, and so everything that such a
    sensor draws is drawn anew.
    """

    class Parameters(core.Parameters):
        """The agent whose belief is true, and the subject of the belief."""

        agent: AgentPattern
        about: AgentPattern
        part: Literal["state", "intent", "uncertainty", "risk"] = Field(
            "state", description="The part of awareness: `state`, or `intent`."
        )
        truth: bool = Field(
            True, description="Whether the belief is true; if false, its errors are drawn anew, which is a placebo."
        )
        draw: int = Field(0, ge=0, le=2**53, description="With `truth: false`, tells one placebo from another.")

    #: The believing agents, and for each selection the pairs.
    believers: Sequence[tuple[AgentSelection, Named]]
    #: The components whose draws the placebo draws anew, each with its pairs.
    sensors: Sequence[tuple[ComponentSelection, Named]]
    #: All components of the believing agents, after whose turns the beliefs are made true.
    components: Sequence[tuple[ComponentSelection, Named]]

    @property
    def source(self) -> str:
        """The believing agents."""
        return f"agents.{self.parameters.agent}"

    @property
    def text(self) -> str:
        """Names the agents and the part."""
        given = self.parameters
        belief = f"what {given.agent} believes of the {given.part} of {given.about}"
        return f"makes true {belief}" if given.truth else f"draws anew the errors of {belief}"

    def resolve(self, context: FaultContext) -> None:
        """Find the pairs of agents, and check that the belief can be made true or drawn anew."""
        given = self.parameters
        if given.part in ("uncertainty", "risk"):
            context.refuse(
                f"an agent computes its {given.part} from its beliefs, and from nothing that could be true by itself",
                "part",
                code="unsuitable",
                expected="`state`: with true states, the agent's own components compute it from these",
            )
        abouts = context.ids(given.about, "about")
        agents = context.agents(given.agent, "agent")
        others = any(set(abouts) - {each.group.ids[row]} for each in agents for row in each.rows)
        if given.part == "intent" and not others:
            context.refuse("an agent knows its own intent", "about", expected="another agent")
        self.believers = [(each, _named(each, abouts, with_oneself=given.part == "state")) for each in agents]
        self.components = [
            (found, [pair for pair in pairs if pair[0] in found.rows])
            for each, pairs in self.believers
            for found in _components(context, each)
        ]
        self.sensors = [
            (found, pairs)
            for found, pairs in self.components
            if any(each.perceives() or each.sees_world for each in found.entry.components)
        ]
        if given.truth:
            return
        if given.part != "state":
            context.refuse(
                "nothing is drawn for beliefs of intents, so there is no placebo", "truth", code="unsuitable"
            )
        if not self.sensors:
            context.refuse(f"no component of {context.quoted(given.agent)} perceives states", "agent")
        for found, _ in self.sensors:
            if found.entry.timing.in_process:
                context.refuse(f"{context.quoted(found.entry.name)} draws in a process of its own", "truth")

    def begin(self, run: FaultTargets) -> Any:
        """Make the beliefs true from now on, or draw their errors anew."""
        if not self.parameters.truth:
            for selected, pairs in self.sensors:
                _redraw(selected, pairs, str(self.parameters.draw))
            return None
        roster, begun = run.environment.roster, []
        for selected, pairs in self.components:
            disturbance = partial(self._correct, _indexed(pairs, roster))
            run.add_disturbance(selected, disturbance)
            begun.append(disturbance)
        for (group, _), pairs in self.believers:
            self._correct(_indexed(pairs, roster), group, ())
        return begun

    def end(self, run: FaultTargets, begun: Any) -> None:
        """Leave the beliefs to the agents' components again, from their next turns on."""
        if not self.parameters.truth:
            for selected, pairs in self.sensors:
                _redraw(selected, pairs, None)
            return
        for (selected, _), disturbance in zip(self.components, begun, strict=True):
            run.remove_disturbance(selected, disturbance)

    def _correct(self, pairs: Pairs, group: AgentGroup, measured: Sequence[int]) -> None:
        """Make the beliefs of some pairs true."""
        snapshot = group.surroundings.environment.snapshot()
        there = _present(snapshot, group, pairs)
        if self.parameters.part == "intent":
            _correct_intents(group, there)
        else:
            _correct_states(group, snapshot, there)


def _components(context: FaultContext, agents: AgentSelection) -> Iterator[ComponentSelection]:
    """The components of some agents of one group."""
    chosen = set(agents.rows)
    for found in context.components("*.*", "agent"):
        if found.entry.group is agents.group and (rows := [row for row in found.rows if row in chosen]):
            yield ComponentSelection(found.entry, rows)


def _named(agents: AgentSelection, abouts: frozenset[str], *, with_oneself: bool) -> Named:
    """The pairs of some agents of one group and those that they believe something about."""
    ids = agents.group.ids
    return [(row, id) for row in agents.rows for id in sorted(abouts) if with_oneself or id != ids[row]]


def _indexed(pairs: Named, roster: Roster) -> Pairs:
    """The pairs in columns, ordered by agent, then by the other's index."""
    table = sorted((row, roster.index(id)) for row, id in pairs)
    columns = np.array(table, np.intp).reshape(-1, 2)
    return columns[:, 0].copy(), columns[:, 1].copy()


def _redraw(selected: ComponentSelection, pairs: Named, draw: str | None) -> None:
    """Let a sensor draw its errors about others from other keys, or from its own again."""
    ids, drawn = selected.entry.group.ids, set()
    for row, id in pairs:
        components = selected.entry.components
        component = components[row] if len(components) > 1 else components[0]
        if isinstance(component, GroupComponent):
            agent, other = agent_numbers((ids[row], id)).tolist()
            component.random.redraw(agent, None if id == ids[row] else other, draw)
        elif row not in drawn:
            component.redraw(draw)
            drawn.add(row)


def _present(snapshot: Snapshot, group: AgentGroup, pairs: Pairs) -> Pairs:
    """The pairs of agents that are both in the world."""
    if snapshot.present is None:
        return pairs
    start = snapshot.roster.start(group.name)
    here = snapshot.present[pairs[0] + start] & snapshot.present[pairs[1]]
    return pairs[0][here], pairs[1][here]


def _correct_states(group: AgentGroup, snapshot: Snapshot, pairs: Pairs) -> None:
    awareness, start = group.awareness, snapshot.roster.start(group.name)
    itself = pairs[0] + start == pairs[1]
    _correct_own(group, snapshot, pairs[0][itself])
    rows, others = pairs[0][~itself], pairs[1][~itself]
    if not len(rows):
        return
    observation = awareness.observation
    if observation is not None:
        true = _corrected(observation.tracks, snapshot, rows, others, adds=True)
        if true is not observation.tracks:
            awareness.observation = replace(observation, tracks=true)
    seen, world, received = awareness.seen, awareness.world, awareness.received
    if seen is None and world is not None and world.time != snapshot.time:
        seen, awareness.world = awareness.everybody(world), None
    adds = seen is not None or world is None
    if seen is None and world is None and received is None:
        nobody, nowhere = np.empty(0, np.intp), np.empty((0, snapshot.positions.shape[1]))
        seen = Tracks.of(snapshot.time, len(group), nobody, nobody, nowhere, nowhere)
    if seen is not None:
        true = _corrected(seen, snapshot, rows, others, adds=True)
        if true is not awareness.seen:
            awareness.seen = true
    if received is not None:
        true = _corrected(received, snapshot, rows, others, adds=adds and seen is None)
        if true is not received:
            awareness.received = true
    ids = snapshot.roster.ids
    for row, other in zip(rows.tolist(), others.tolist(), strict=True):
        database, id = group.agents[row].awareness_database, ids[other]
        motion = np.concatenate([snapshot.positions[other], snapshot.velocities[other]])
        if id in database.others.places:
            database.set_state(id, motion)
        if id in database.received.places:
            database.received.set_motion(id, motion, snapshot.time)


def _correct_own(group: AgentGroup, snapshot: Snapshot, rows: NDArray[np.intp]) -> None:
    """Let agents believe their own true states."""
    if not len(rows):
        return
    awareness = group.awareness
    true = snapshot.states[snapshot.roster.number(group.name)]
    if not np.array_equal(awareness.state[rows], true[rows]):
        states = awareness.state.copy()
        states[rows] = true[rows]
        awareness.state = states
    observation = awareness.observation
    measured = None if observation is None else observation.state
    if observation is not None and measured is not None and not np.array_equal(measured[rows], true[rows]):
        states = measured.copy()
        states[rows] = true[rows]
        awareness.observation = replace(observation, state=states)


def _corrected(
    tracks: Tracks, snapshot: Snapshot, rows: NDArray[np.intp], others: NDArray[np.intp], *, adds: bool
) -> Tracks:
    """Tracks with the true motion of some pairs, such that it is exact now; pairs that are missing may be added.

    Args:
        tracks: The tracks; they may be of another instant.
        snapshot: The world now.
        rows: The believing agents, ascending; shape (m,).
        others: The others, ascending for each agent; shape (m,).
        adds: Whether to add the pairs that are missing.
    """
    count, total = len(tracks.pointers) - 1, len(snapshot.positions)
    # Rows are ordered by agent, then by the other, so the keys of all tracks ascend.
    keys, wanted = tracks.observers * total + tracks.others, rows * total + others
    places = np.searchsorted(keys, wanted)
    known = np.zeros(len(wanted), bool)
    within = places < len(keys)
    known[within] = keys[places[within]] == wanted[within]
    velocities = snapshot.velocities[others]
    positions = snapshot.positions[others] - (snapshot.time - tracks.time) / SECOND * velocities
    held = places[known]
    is_true = np.array_equal(tracks.positions[held], positions[known]) and np.array_equal(
        tracks.velocities[held], velocities[known]
    )
    if is_true and (known.all() or not adds) and not tracks.ages[held].any():
        return tracks
    columns: list[Array] = [tracks.positions.copy(), tracks.velocities.copy(), tracks.ages.copy()]
    for column, values in zip(columns, (positions, velocities, np.zeros(len(others))), strict=True):
        column[held] = values[known]
    observers, seen, covariances = tracks.observers, tracks.others, tracks.covariances
    if adds and not known.all():
        new = ~known
        at = places[new]
        observers, seen = np.insert(observers, at, rows[new]), np.insert(seen, at, others[new])
        additions = (positions[new], velocities[new], np.zeros(new.sum()))
        columns = [np.insert(column, at, values, 0) for column, values in zip(columns, additions, strict=True)]
        if covariances is not None:
            # Zeros stand for covariances that are unknown, or that beliefs without errors do not need.
            covariances = np.insert(covariances, at, 0.0, 0)
    return Tracks.of(tracks.time, count, observers, seen, columns[0], columns[1], covariances, columns[2])


def _correct_intents(group: AgentGroup, pairs: Pairs) -> None:
    """Let agents believe that others intend what these do intend."""
    roster = group.surroundings.environment.roster
    groups = [each for each in group.surroundings.environment.groups if isinstance(each, AgentGroup)]
    everybody = {id: (each, row) for each in groups for row, id in enumerate(each.ids)}
    for row, other in zip(pairs[0].tolist(), pairs[1].tolist(), strict=True):
        id = roster.ids[other]
        database, (holder, place) = group.agents[row].awareness_database, everybody[id]
        intent = holder.agents[place].self_awareness["intent"]
        if id in database.others.parts.get("intent", {}):
            database.set_part("intent", id, intent)
        elif id in database:
            database.receive_part("intent", id, intent)
