"""What `control.mpc` expects of its surroundings: where others will be, and which side of an obstacle is free."""

from __future__ import annotations

from collections.abc import Mapping
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from symaware_cli.components.control.mpc_problem import Sizes
from symaware_cli.core import Agent, Environment, Scenery
from symaware_cli.geometry.pieces import Pieces, separation_from_points
from symaware_cli.world.time import SECOND

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: [m] Distances to keep are at least this, so that points without a margin have a direction to avoid each other in.
_LEAST = 1e-3

#: [m] Nearer than this, there is no telling which side of an outline is nearer.
_TINY = 1e-9

#: [m] How far away those are who are not there, but for whom there is room.
_NOWHERE = 1e3


def sizes(environment: Environment, others: int, obstacles: int) -> Sizes:
    """How much to make room for.

    There is room for others even where there are none: with another number of constraints a solver finds another last
    bit, and what an agent does must not depend on somebody far away.

    Args:
        environment: Knows all obstacles.
        others: Room for this many agents.
        obstacles: For this many pieces of obstacles at most.
    """
    discs = int(_discs(environment.scenery).sum())
    return Sizes(others, min(obstacles, discs), min(obstacles, len(environment.scenery.pieces) - discs))


def _discs(scenery: Scenery) -> NDArray[np.bool_]:
    """Which pieces are rounded points."""
    vertices = scenery.pieces.vertices
    discs: NDArray[np.bool_] = (vertices == vertices[:, :1]).all(axis=(1, 2))
    return discs


#: Obstacles that move at coming times, by the scenery of the present step, and no longer than that is in use.
_MOVING: WeakKeyDictionary[Scenery, dict[bytes, Pieces]] = WeakKeyDictionary()


class AgentPrediction:
    """Where the other agents are expected to be.

    Everybody is expected to go straight on at its believed velocity, except for those who told their intent: what an
    agent's own components wrote into its awareness of another counts until it ends.
    """

    def __init__(self, agent: Agent, radii: Array, margin: float, reach: float, room: int) -> None:
        """Choose whom to look at.

        Args:
            agent: Who looks.
            radii: Bounding radius of each agent by index in the roster [m]; shape (N,).
            margin: Distance to keep from their bodies [m].
            reach: How far to look [m].
            room: How many to look at, at most; the nearest count.
        """
        self._agent = agent
        self._keep = agent.entity.radius + margin + radii
        self._reach = reach
        self._room = room

    def ahead(self, times: Times) -> dict[str, Array]:
        """The parameters ``others``, shape (N + 1, d, room), and ``others_keep``, shape (room,).

        Args:
            times: Of the stages, in nanoseconds; shape (N + 1,).
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
        keep = np.full(self._room, 0.1 * _NOWHERE)
        places[:] = (own + _NOWHERE)[:, None]
        for place, row in enumerate(order.tolist()):
            straight = positions[row] + passed[:, None] * velocities[row]
            places[:, :, place] = self._intended(int(indices[row]), times, straight)
            keep[place] = max(self._keep[indices[row]], _LEAST)
        return {"others": places, "others_keep": keep}

    def _intended(self, index: int, times: Times, straight: Array) -> Array:
        """Where another said that it is going to be, and straight on from where it said nothing; shape (N + 1, d)."""
        agent, dimensions = self._agent, straight.shape[1]
        roster = agent.surroundings.environment.roster
        told = agent.awareness_database.get(roster.ids[index])
        if told is None or not len(told.intent) or told.intent.values.shape[1] < dimensions:
            return straight
        intent = told.intent
        said = (times >= intent.times[0]) & (times <= intent.times[-1])
        if not said.any():
            return straight
        places = straight.copy()
        for axis in range(dimensions):
            places[said, axis] = np.interp(times[said], intent.times, intent.values[:, axis])
        after = times > intent.times[-1]
        last = np.flatnonzero(said)[-1]
        places[after] += places[last] - straight[last]
        return places


def clearance(path: Array, others: Mapping[str, Array]) -> Array:
    """How near somebody on a path (N + 1, d) comes to the nearest other, in distances to keep; shape (N + 1,)."""
    apart = np.sqrt(np.square(path[:, :, None] - others["others"]).sum(axis=1))
    nearest: Array = (apart / others["others_keep"]).min(axis=1)
    return nearest


class ObstaclePrediction:
    """Which obstacles are in the way of a plan, where they will be, and on which side of them the plan goes."""

    def __init__(self, environment: Environment, keep: float, room: Sizes) -> None:
        """Choose what to look at.

        Args:
            environment: Whose obstacles they are; all know them.
            keep: Distance to keep from them [m].
            room: How many pieces to look at, at most; the nearest to the plan count.
        """
        self._environment = environment
        self._keep = max(keep, _LEAST)
        self._room = room

    def ahead(self, path: Array, times: Times, reach: float) -> dict[str, Array]:
        """The parameters ``discs`` (N + 1, 2, nd), ``discs_keep`` (nd,), ``sides`` (N + 1, 2, ns), ``sides_offset``.

        Discs are discs. For anything else, each stage has a half-plane that touches the obstacle where it is nearest to
        the path: who keeps to it keeps clear of the whole piece, and the path does so if it is clear itself.

        Args:
            path: Where the plan is expected to go [m]; shape (N + 1, 2).
            times: Of the stages, in nanoseconds; shape (N + 1,).
            reach: How far obstacles may be from the path to be in the way [m].
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
            places, keep = np.empty((count, 2, room.discs)), np.full(room.discs, 0.1 * _NOWHERE)
            places[:] = (path[0] + _NOWHERE)[:, None]
            places[:, :, : len(some)] = pieces.vertices[:, 0].reshape(count, -1, 2)[:, some].transpose(0, 2, 1)
            keep[: len(some)] = self._keep + pieces.rounding[some]
            values |= {"discs": places, "discs_keep": keep}
        if room.sides:
            some = near[~round_ones[near]][: room.sides]
            normals, offsets = np.zeros((count, 2, room.sides)), np.full((count, room.sides), -1.0)
            # Inside of an obstacle the distance is negative, and the nearest way out is the way back. On its outline
            # there is no direction, and nothing is demanded.
            clear = np.abs(distance[:, some]) > _TINY
            away = np.where(clear, distance[:, some], np.inf) * self._keep
            normal = (path[:, None] - point[:, some]) / away[..., None]
            normals[:, :, : len(some)] = normal.transpose(0, 2, 1)
            offsets[:, : len(some)] = np.where(clear, 1.0 + (normal * point[:, some]).sum(axis=2), -1.0)
            values |= {"sides": normals, "sides_offset": offsets}
        return values

    def clear(self, path: Array) -> bool:
        """Whether a path (N + 1, 2) keeps its distance from all obstacles where they are now."""
        pieces = self._environment.scenery.pieces
        row, piece = self._environment.scenery.candidates(path, self._keep)
        found = separation_from_points(path[row, :2], np.zeros(len(row)), pieces.take(piece))
        return bool((found.distance >= self._keep).all())

    def _pieces(self, path: Array, times: Times, reach: float) -> tuple[Pieces, NDArray[np.bool_]]:
        """What may be in the way, at every stage one after the other, and which of it are discs; (N + 1) m and m."""
        now = self._environment.scenery
        if now.moves:
            return _moving(now, times), _discs(now)
        some = np.unique(now.candidates(path, reach)[1])
        return now.pieces.take(np.tile(some, len(path))), _discs(now)[some]


def _moving(now: Scenery, times: Times) -> Pieces:
    """All pieces at some times, one time after the other; worked out once for all who plan at the same instant."""
    known = _MOVING.setdefault(now, {})
    key = times.tobytes()
    if key not in known:
        parts = [now.at(int(time)).pieces for time in times]
        columns = zip(*((each.vertices, each.normals, each.offsets, each.rounding) for each in parts), strict=True)
        known[key] = Pieces(*(np.concatenate(column) for column in columns))
    return known[key]
