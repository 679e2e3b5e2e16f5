"""Predictions of `control.mpc`: future positions of other agents, and constraints by obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Agent, Environment, Scenery
from symaware_cli.engine import confined_to
from symaware_cli.geometry import Array, Mask, Pieces, separation_from_points
from symaware_cli.planning.control.mpc_problem import Sizes
from symaware_cli.world import SECOND

Times = NDArray[np.int64]

#: [m] The smallest distance to keep, so that points without a margin have a direction to avoid each other in.
_MIN_DISTANCE = 1e-3

#: [m] Nearer than this, the nearer side of an outline is undefined.
_TINY = 1e-9

#: [m] The distance of the placeholders for agents and obstacles that do not exist.
_FAR_AWAY = 1e3


def sizes(environment: Environment, others: int, obstacles: int) -> Sizes:
    """Return the numbers of agents and obstacles that the problem has constraints for.

    The problem has placeholders for others even without any: with another number of constraints a solver returns a
    result with other last bits, and an agent's actions must not depend on other agents that are far away.

    Args:
        environment: The world, with all its obstacles.
        others: The number of other agents to avoid.
        obstacles: The greatest number of discs, and of other pieces of obstacles, to avoid.
    """
    discs = int(_discs(environment.scenery).sum())
    return Sizes(others, min(obstacles, discs), min(obstacles, len(environment.scenery.pieces) - discs))


def _discs(scenery: Scenery) -> Mask:
    """Return which pieces are rounded points."""
    vertices = scenery.pieces.vertices
    discs: Mask = (vertices == vertices[:, :1]).all(axis=(1, 2))
    return discs


#: Moving obstacles at future times, by the scenery of the present step; entries live as long as their scenery.
_MOVING: WeakKeyDictionary[Scenery, dict[bytes, Pieces]] = WeakKeyDictionary()


class AgentPrediction:
    """Predicts the positions of other agents.

    Others are expected to keep their believed velocity, except for those with a known intent: one that the agent's own
    components wrote into its awareness is followed until it ends. Those who are known to stay in a set, such as from a
    promise, are expected at the nearest place of it.
    """

    def __init__(self, agent: Agent, radii: Array, margin: float, reach: float, room: int) -> None:
        """Choose which agents to avoid.

        Args:
            agent: The avoiding agent.
            radii: Bounding radius of each agent by index in the roster [m]; shape (N,).
            margin: Distance to keep from their bodies [m].
            reach: The greatest distance of agents to avoid [m].
            room: The number of agents to avoid; the nearest ones.
        """
        self._agent = agent
        self._keep = agent.entity.radius + margin + radii
        self._reach = reach
        self._room = room

    def ahead(self, times: Times) -> dict[str, Array]:
        """Return the parameters ``others``, shape (N + 1, d, room), and ``others_keep``, shape (room,).

        Args:
            times: The times of the stages, in nanoseconds; shape (N + 1,).
        """
        if not self._room:
            return {}
        agent = self._agent
        own = agent.group.model.positions(agent.self_state[None])[0]
        dimensions = len(own)
        tracks = agent.group.others(self._reach)
        rows = slice(tracks.pointers[agent.row], tracks.pointers[agent.row + 1])
        indices = tracks.others[rows]
        positions, velocities = tracks.positions[rows, :dimensions], tracks.velocities[rows, :dimensions]
        order = np.argsort(np.square(positions - own).sum(axis=1), kind="stable")[: self._room]
        passed = (times - tracks.time) / SECOND
        places = np.empty((len(times), dimensions, self._room))
        keep = np.full(self._room, 0.1 * _FAR_AWAY)
        places[:] = (own + _FAR_AWAY)[:, None]
        expected = np.zeros((len(times), len(tracks), dimensions))
        for row in order.tolist():
            straight = positions[row] + passed[:, None] * velocities[row]
            expected[:, rows.start + row] = self._intended(int(indices[row]), times, straight)
        expected = confined_to(agent.group, tracks, expected)
        for place, row in enumerate(order.tolist()):
            places[:, :, place] = expected[:, rows.start + row]
            keep[place] = max(self._keep[indices[row]], _MIN_DISTANCE)
        return {"others": places, "others_keep": keep}

    def _intended(self, index: int, times: Times, straight: Array) -> Array:
        """Return positions by the intent of another agent, straight on outside of its times; shape (N + 1, d)."""
        agent, dimensions = self._agent, straight.shape[1]
        roster = agent.surroundings.environment.roster
        belief = agent.awareness_database.get(roster.ids[index])
        if belief is None or not len(belief.intent) or belief.intent.values.shape[1] < dimensions:
            return straight
        intent = belief.intent
        covered = (times >= intent.times[0]) & (times <= intent.times[-1])
        if not covered.any():
            return straight
        places = straight.copy()
        for axis in range(dimensions):
            places[covered, axis] = np.interp(times[covered], intent.times, intent.values[:, axis])
        after = times > intent.times[-1]
        last = np.flatnonzero(covered)[-1]
        places[after] += places[last] - straight[last]
        return places


def clearance(path: Array, others: Mapping[str, Array]) -> Array:
    """Return the distance of a path (N + 1, d) from the nearest other, in distances to keep; shape (N + 1,)."""
    apart = np.sqrt(np.square(path[:, :, None] - others["others"]).sum(axis=1))
    nearest: Array = (apart / others["others_keep"]).min(axis=1)
    return nearest


class ObstaclePrediction:
    """Predicts the obstacles near a plan, and constrains the plan to the free side of each."""

    def __init__(self, environment: Environment, keep: float, room: Sizes) -> None:
        """Choose which obstacles to avoid.

        Args:
            environment: The world with the obstacles; all agents know them.
            keep: Distance to keep from them [m].
            room: The number of pieces to avoid; those nearest to the plan.
        """
        self._environment = environment
        self._keep = max(keep, _MIN_DISTANCE)
        self._room = room

    def ahead(self, path: Array, times: Times, reach: float) -> dict[str, Array]:
        """Return ``discs`` (N + 1, 2, nd), ``discs_keep`` (nd,), ``sides`` (N + 1, 2, ns), ``sides_offset``.

        Discs are constrained as discs. For other pieces, each stage has a half-plane that touches the piece where it is
        nearest to the path: a position in it is clear of the whole piece, and the path satisfies it if it is clear.

        Args:
            path: The expected positions of the plan [m]; shape (N + 1, 2).
            times: The times of the stages, in nanoseconds; shape (N + 1,).
            reach: The greatest distance of obstacles from the path [m].
        """
        room, count = self._room, len(path)
        if not room.discs and not room.sides:
            return {}
        pieces, round_ones = self._pieces(path, times, reach)
        found = separation_from_points(np.repeat(path, len(round_ones), axis=0), np.zeros(len(pieces)), pieces)
        distance, point = found.distance.reshape(count, -1), found.second.reshape(count, -1, 2)
        nearest = distance.min(axis=0)
        near = np.argsort(nearest, kind="stable")
        near = near[nearest[near] <= reach]
        values: dict[str, Array] = {}
        if room.discs:
            some = near[round_ones[near]][: room.discs]
            places, keep = np.empty((count, 2, room.discs)), np.full(room.discs, 0.1 * _FAR_AWAY)
            places[:] = (path[0] + _FAR_AWAY)[:, None]
            places[:, :, : len(some)] = pieces.vertices[:, 0].reshape(count, -1, 2)[:, some].transpose(0, 2, 1)
            keep[: len(some)] = self._keep + pieces.rounding[some]
            values |= {"discs": places, "discs_keep": keep}
        if room.sides:
            some = near[~round_ones[near]][: room.sides]
            normals, offsets = np.zeros((count, 2, room.sides)), np.full((count, room.sides), -1.0)
            # Inside of an obstacle the distance is negative, so the normal points to the nearest way out. On the
            # outline the normal is undefined, and there is no constraint.
            clear = np.abs(distance[:, some]) > _TINY
            away = np.where(clear, distance[:, some], np.inf) * self._keep
            normal = (path[:, None] - point[:, some]) / away[..., None]
            normals[:, :, : len(some)] = normal.transpose(0, 2, 1)
            offsets[:, : len(some)] = np.where(clear, 1.0 + (normal * point[:, some]).sum(axis=2), -1.0)
            values |= {"sides": normals, "sides_offset": offsets}
        return values

    def clear(self, path: Array) -> bool:
        """Return whether a path (N + 1, 2) keeps its distance from all obstacles at their present positions."""
        pieces = self._environment.scenery.pieces
        row, piece = self._environment.scenery.candidates(path, self._keep)
        found = separation_from_points(path[row, :2], np.zeros(len(row)), pieces.take(piece))
        return bool((found.distance >= self._keep).all())

    def _pieces(self, path: Array, times: Times, reach: float) -> tuple[Pieces, Mask]:
        """Return the pieces within reach, stage after stage, and which of them are discs; (N + 1) m and m."""
        now = self._environment.scenery
        if now.moves:
            return _moving(now, times), _discs(now)
        some = np.unique(now.candidates(path, reach)[1])
        return now.pieces.take(np.tile(some, len(path))), _discs(now)[some]


def _moving(now: Scenery, times: Times) -> Pieces:
    """Return all pieces at some times, time after time; computed once for all agents that plan at an instant."""
    known = _MOVING.setdefault(now, {})
    key = times.tobytes()
    if key not in known:
        parts = [now.at(int(time)).pieces for time in times]
        columns = zip(*((each.vertices, each.normals, each.offsets, each.rounding) for each in parts), strict=True)
        known[key] = Pieces(*(np.concatenate(column) for column in columns))
    return known[key]
