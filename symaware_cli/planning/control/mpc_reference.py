"""The reference path of `control.mpc`: to the goal, via waypoints and around obstacles by a visibility graph."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from symaware_cli.core import Environment, Model
from symaware_cli.geometry import Array, Pieces, crosses, separation_from_points
from symaware_cli.planning.control.mpc_problem import Tracking, weights_of
from symaware_cli.world import real

#: In distances to keep: the distance of corners, and the clearance of straight lines. The difference is how far a
#: vehicle may deviate without losing its route.
_CORNERS, _LINES = 1.05, 0.9

#: The number of corners around a disc.
_DISC_CORNERS = 8

#: With more pieces than this, the visibility graph is too large.
_MOST_PIECES = 50


def standing(environment: Environment) -> Pieces:
    """Return the pieces of static obstacles."""
    scenery = environment.scenery
    entities = [environment.obstacles[name] for name in scenery.names]
    rests = [each.path is None and each.mass is None for each in entities]
    return scenery.pieces.take(np.flatnonzero(np.array(rests, bool)[scenery.owner]))


class Routes:
    """The visibility graph of the corners of obstacles: straight lines that no obstacle blocks.

    A shortest path among polygons consists of such lines (T. Lozano-Pérez, M. A. Wesley, "An algorithm for planning
    collision-free paths among polyhedral obstacles", Communications of the ACM 22, 1979). Obstacles are grown by the
    distance to keep, with polygons around roundings. Heights are ignored.
    """

    def __init__(self, pieces: Pieces, keep: float) -> None:
        """Compute the distances between all pairs of corners.

        Args:
            pieces: The obstacles; more than fifty are ignored.
            keep: Distance to keep from them [m].
        """
        few = len(pieces) <= _MOST_PIECES
        self._grown = Pieces(pieces.vertices, pieces.normals, pieces.offsets, pieces.rounding + _LINES * keep)
        corners = _corners(pieces, _CORNERS * keep) if few else np.empty((0, 2))
        count = len(corners)
        inside = np.zeros(count, bool)
        for piece in range(len(pieces)) if few else ():
            one = self._grown.take(np.full(count, piece))
            inside |= separation_from_points(corners, np.zeros(count), one).distance < 0.0
        self._corners = np.unique(corners[~inside], axis=0)
        self._lengths = np.array([self.distances(corner, self._corners) for corner in self._corners])
        if len(self._corners):
            np.fill_diagonal(self._lengths, np.inf)

    def distances(self, origin: Array, targets: Array) -> Array:
        """Return the distances of points (m, 2) from one [m], infinite behind an obstacle; shape (m,)."""
        grown = self._grown
        ways = targets - origin
        low, high = grown.bounds()
        meets = (np.minimum(targets, origin)[:, None] <= high) & (np.maximum(targets, origin)[:, None] >= low)
        line, piece = np.nonzero(meets.all(axis=2))
        hidden = np.zeros(len(targets), bool)
        lines = Pieces.lines(np.broadcast_to(origin, (len(line), 2)), targets[line])
        hidden[line[crosses(lines, grown.take(piece))]] = True
        return np.where(hidden, np.inf, np.sqrt(np.square(ways).sum(axis=1)))

    def to(self, target: Array) -> Route:
        """Return the shortest paths to a point [m], shape (2,)."""
        return Route(self, target, self._corners, self._lengths)


class Route:
    """The shortest paths from any position to one point."""

    def __init__(self, routes: Routes, target: Array, corners: Array, lengths: Array) -> None:
        """Compute the distance from each corner.

        Args:
            routes: The visibility graph.
            target: The point [m]; shape (2,).
            corners: The corners [m]; shape (c, 2).
            lengths: The distance between each two of them, infinite if blocked [m]; shape (c, c).
        """
        self._routes = routes
        self._target = target
        self._corners = corners
        self._lengths = lengths
        self._straight = routes.distances(target, corners)
        remaining = self._straight
        # Add one line in each iteration, until no path gets shorter.
        while len(corners):
            shorter = np.minimum(remaining, (lengths + remaining).min(axis=1))
            if (shorter == remaining).all():
                break
            remaining = shorter
        self._remaining = remaining

    def by_way_of(self, position: Array) -> Array:
        """Return the corners to pass from a position [m], shape (2,); none if the path is straight or blocked.

        Returns:
            Shape (w, 2).
        """
        nothing = np.empty((0, 2))
        if not len(self._corners) or np.isfinite(self._routes.distances(position, self._target[None]))[0]:
            return nothing
        ways = self._routes.distances(position, self._corners) + self._remaining
        corner = int(ways.argmin())
        if not np.isfinite(ways[corner]):
            return nothing
        passed = [corner]
        while self._straight[corner] > self._remaining[corner]:
            corner = int((self._lengths[corner] + self._remaining).argmin())
            passed.append(corner)
        return self._corners[passed]


def _corners(pieces: Pieces, distance: float) -> Array:
    """Return points around each piece, such that lines between neighbours keep the distance [m]; shape (c, 2)."""
    corners: list[Array] = []
    for vertices, normals, rounding in zip(pieces.vertices, pieces.normals, pieces.rounding, strict=True):
        radius = distance + rounding
        real = np.flatnonzero(np.abs(normals).max(axis=1) > 0.0)
        if not len(real):
            angles = 2 * np.pi * np.arange(_DISC_CORNERS) / _DISC_CORNERS
            around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            corners.extend(vertices[0] + radius / np.cos(np.pi / _DISC_CORNERS) * around)
            continue
        for before, after in pairwise([*real.tolist(), int(real[0])]):
            corners.extend(vertices[after] + radius * each for each in _outwards(normals[before], normals[after]))
    return np.array(corners).reshape(-1, 2)


def _outwards(before: Array, after: Array) -> list[Array]:
    """Return the corners around a vertex between two edges of given normals, for a distance of one."""
    cosine = float(before @ after)
    if cosine >= 0.0:
        return [(before + after) / (1.0 + cosine)]
    # A sharp vertex gets two corners, since its tip would be far out; the lines continue along the edges.
    along = np.array([-before[1], before[0]])
    back = np.array([after[1], -after[0]])
    return [before + along, after + back]


def goal_of(knowledge: Mapping[str, Any], model: Model, weights: Tracking) -> Array:
    """Return the knowledge ``goal`` of an agent: a position, shape (d,), or a whole state, shape (nx,).

    Raises:
        ValueError: It is neither, or a position where an angle has a weight.
    """
    try:
        goal = real(knowledge["goal"])
    except (TypeError, ValueError):
        goal = np.empty(0)
    if goal.shape not in ((len(model.position),), (len(model.state),)):
        raise ValueError(
            f"the knowledge `goal` of each agent must be a position of {len(model.position)} numbers, or a state of "
            f"{len(model.state)}"
        )
    if len(goal) < len(model.state):
        of = weights_of(model, weights)
        for element in model.angles:
            if of.state[element] or of.terminal[element]:
                raise ValueError(f"a weight of `{model.state[element].name}` needs a `goal` that is a whole state")
    return goal


def waypoints_of(knowledge: Mapping[str, Any], dimensions: int) -> Array:
    """Return the knowledge ``waypoints`` to pass before the goal; shape (w, d), empty without any.

    Raises:
        ValueError: They are not positions.
    """
    known = knowledge.get("waypoints")
    if known is None:
        return np.empty((0, dimensions))
    try:
        places = real(known)
    except (TypeError, ValueError):
        places = np.empty(0)
    if places.ndim != 2 or places.shape[1] != dimensions:
        raise ValueError(f"the knowledge `waypoints` of each agent must be a list of positions of {dimensions} numbers")
    return places


class ReferencePath:
    """The path of one agent to its goal, as a reference of its state."""

    def __init__(self, model: Model, goal: Array, waypoints: Array, routes: Routes | None) -> None:
        """Construct the path.

        Args:
            model: The model of the agent.
            goal: A position, shape (d,), or a whole state, shape (nx,).
            waypoints: Positions to pass before the goal; shape (w, d).
            routes: Routes around obstacles; None for straight lines.
        """
        self._model = model
        self._position = list(model.position)
        self._target = np.zeros(len(model.state))
        self._target[self._position if len(goal) < len(self._target) else slice(None)] = goal
        self._goal = self._target[self._position]
        self._given = goal
        self._waypoints = waypoints
        targets = [*waypoints, self._goal]
        self._routes = [routes.to(target) if routes else None for target in targets]
        #: The corners from each target to the goal; each of shape (c, d).
        self._onwards = [self._goal[None]]
        for target, following in zip(reversed(targets[:-1]), reversed(self._routes[1:]), strict=True):
            self._onwards.insert(0, np.concatenate([target[None], _around(target, following), self._onwards[0]]))

    def leads_to(self, goal: Array, waypoints: Array) -> bool:
        """Return whether it leads to this goal, via these waypoints."""
        return np.array_equal(self._given, goal) and np.array_equal(self._waypoints, waypoints)

    def remaining(self, position: Array) -> float:
        """Return the distance of the goal from a position [m]."""
        return float(np.sqrt(np.square(self._goal - position).sum()))

    def passed(self, position: Array, passed: int, within: float) -> int:
        """Return the updated number of passed waypoints: one more if the next is near enough."""
        if passed < len(self._waypoints):
            away = self._waypoints[passed] - position
            return passed + int(np.square(away).sum() <= within * within)
        return passed

    def is_behind(self, passed: int) -> bool:
        """Return whether a number of passed waypoints is all of them."""
        return passed == len(self._waypoints)

    def ahead(self, position: Array, passed: int, travelled: Array) -> Array:
        """Return the reference positions along the shortest path.

        Args:
            position: The position of the agent [m]; shape (d,).
            passed: The number of waypoints passed.
            travelled: The distance along the path at each stage [m]; shape (N + 1,).

        Returns:
            Shape (N + 1, d).
        """
        corners = np.concatenate([position[None], _around(position, self._routes[passed]), self._onwards[passed]])
        legs = np.sqrt(np.square(np.diff(corners, axis=0)).sum(axis=1))
        passing = np.concatenate([[0.0], np.cumsum(legs)])
        return np.stack([np.interp(travelled, passing, axis) for axis in corners.T], axis=1)

    def reference(self, state: Array, places: Array) -> Array:
        """Return the reference states.

        Elements other than the position are those of the goal if that is a whole state, else zero; angles differ from
        the present ones by at most half a turn.

        Args:
            state: The present state of the agent; shape (nx,).
            places: The reference positions [m]; shape (N + 1, d).

        Returns:
            Shape (N + 1, nx).
        """
        target = self._target.copy()
        for element in self._model.angles:
            target[element] += 2 * np.pi * np.round((state[element] - target[element]) / (2 * np.pi))
        reference = np.broadcast_to(target, (len(places), len(target))).copy()
        reference[:, self._position] = places
        return reference


def turned_right(places: Array, angle: float) -> Array:
    """Turn positions (N + 1, d) clockwise about the first of them by an angle [rad], seen from above."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = (places[:, :2] - places[0, :2]).T
    turned = places.copy()
    turned[:, 0], turned[:, 1] = places[0, 0] + cosine * x + sine * y, places[0, 1] + cosine * y - sine * x
    return turned


def _around(position: Array, route: Route | None) -> Array:
    """Return the corners to pass on the route from a position; shape (c, d)."""
    return np.empty((0, len(position))) if route is None else route.by_way_of(position)
