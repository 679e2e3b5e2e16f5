"""State lattices of cars: positions and headings that arcs and straight lines join exactly.

M. Pivtoraiko, R. A. Knepper and A. Kelly, Differentially constrained mobile robot motion planning in state lattices,
Journal of Field Robotics 26 (2009). The primitives are those of Dubins' car, which drives forwards (L. E. Dubins, On
curves of minimal length with a constraint on average curvature, American Journal of Mathematics 79, 1957).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.maps.free_space import FreeSpace
from symaware_cli.maps.graph_search import least_path
from symaware_cli.maps.planned_path import PlannedPath, no_path, polyline
from symaware_cli.maps.planning_grid import GridFrame, clearances_of_cells
from symaware_cli.specification import PlacedRegion

#: The headings, counter-clockwise, as the cells that a straight line in this direction leads to.
_AHEAD = ((1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1))
HEADINGS = np.array([*_AHEAD, *[(-x, -y) for x, y in _AHEAD]])

#: The turn of each primitive, as a number of headings.
TURNS = (-4, -2, -1, 0, 1, 2, 4)

#: The greatest distance of an arc from its chords, in radii of the tightest turn.
_SAGITTA = 0.008

#: Lengths up to this are rounding errors, in sides of a cell.
_TINY = 1e-9

#: The greatest angle of the arc that leads to a goal [rad].
_MOST_TURN = np.pi

#: The greatest distance from the centre of a cell, in its sides, with room for rounding errors.
_HALF_DIAGONAL = 0.71

#: The greatest number of cells of the field of distances from obstacles.
_MOST_CELLS = 250_000

#: The greatest distance at which a goal is reached from a state by an arc and a straight line, in radii of the tightest
#: turn.
_NEAR_GOAL = 4.0


class Primitive(NamedTuple):
    """A motion from one state of the lattice to another.

    Attributes:
        cells: The displacement in cells; shape (2,).
        heading: The number of the heading at its end.
        length: The length of the motion [m].
        radius: The radius of the arc [m]; infinite for a straight line.
        points: Points on the motion, from the origin to its end [m]; shape (k, 2).
    """

    cells: tuple[int, int]
    heading: int
    length: float
    radius: float
    points: Array


def primitive(heading: int, turn: int, side: float, radius: float) -> Primitive:
    """Return the shortest motion between states with two headings: a straight line, an arc, or both.

    For each displacement within the angle between both headings, the arc is tangent to lines in these directions; it
    begins or ends at an end of the motion, so that its radius is as large as possible.

    Args:
        heading: The number of the first heading.
        turn: The number of headings by which the motion turns.
        side: The side of the cells [m].
        radius: The least radius of arcs [m].
    """
    end = (heading + turn) % len(HEADINGS)
    if turn == 0:
        ahead = HEADINGS[heading]
        points = np.stack([np.zeros(2), side * ahead])
        return Primitive(tuple(ahead.tolist()), end, float(np.hypot(*points[1])), np.inf, points)
    one, other = (HEADINGS[each] / np.hypot(*HEADINGS[each]) for each in (heading, end))
    cross = one[0] * other[1] - one[1] * other[0]
    angle = float(np.arctan2(cross, one[0] * other[0] + one[1] * other[1]))
    most = int(np.ceil(4.0 * radius / side)) + 4
    cells = np.stack(np.meshgrid(np.arange(-most, most + 1), np.arange(-most, most + 1)), axis=-1).reshape(-1, 2)
    # The lengths in both directions if the motion had a corner instead of an arc.
    first = side * (cells[:, 0] * other[1] - cells[:, 1] * other[0]) / cross
    second = side * (one[0] * cells[:, 1] - one[1] * cells[:, 0]) / cross
    tangent = np.minimum(first, second)
    arc = tangent / np.tan(0.5 * abs(angle))
    length = first + second - 2.0 * tangent + arc * abs(angle)
    possible = np.flatnonzero(arc >= radius * (1.0 - 1e-12))
    # The first of equally long motions.
    best = int(possible[np.lexsort((cells[possible, 0], cells[possible, 1], np.round(length[possible] / side, 9)))[0]])
    begun, left = float(first[best] - tangent[best]), float(second[best] - tangent[best])
    curve = (begun if begun > _TINY * side else 0.0) * one + _arc(one, angle, float(arc[best]), radius)
    parts = [np.zeros((1, 2)), curve if left > _TINY * side else curve[:-1], side * cells[best][None]]
    return Primitive(tuple(cells[best].tolist()), end, float(length[best]), float(arc[best]), polyline(parts))


def _arc(direction: Array, angle: float, radius: float, least: float) -> Array:
    """Return points on an arc that begins at the origin in a direction and turns by an angle; shape (k, 2)."""
    chord = 2.0 * np.arccos(1.0 - _SAGITTA * least / radius)
    turned = np.linspace(0.0, angle, int(np.ceil(abs(angle) / chord)) + 1)
    along, across = radius * np.sin(np.abs(turned)), radius * (1.0 - np.cos(turned)) * np.sign(angle)
    normal = np.array([-direction[1], direction[0]])
    points: Array = along[:, None] * direction + across[:, None] * normal
    return points


class Lattice:
    """The primitives, and the free positions of the car.

    Attributes:
        radius: The least radius of arcs [m].
        side: The side of the cells [m].
        primitives: The primitives of each heading.
    """

    def __init__(self, space: FreeSpace, within: tuple[float, float, float, float], radius: float, side: float) -> None:
        """Compute the primitives, and distances from obstacles.

        Args:
            space: The free space of a disc around the car.
            within: The area of the positions: [x, x, y, y] [m].
            radius: The least radius of arcs [m].
            side: The side of the cells [m].
        """
        self.radius, self.side, self.space = radius, side, space
        self.low, self.high = np.array([within[0], within[2]]), np.array([within[1], within[3]])
        self.primitives = [[primitive(each, turn, side, radius) for turn in TURNS] for each in range(len(HEADINGS))]
        #: The chords of all primitives of each heading, one after the other, and where each primitive begins.
        self.chords = [np.concatenate([np.stack([p.points[:-1], p.points[1:]], 1) for p in s]) for s in self.primitives]
        self.begins = [np.cumsum([0, *[len(p.points) - 1 for p in s[:-1]]]) for s in self.primitives]
        width, height = self.high - self.low
        fine = max(0.5 * min(side, space.radius), float(np.sqrt(width * height / _MOST_CELLS)))
        fine = max(fine, max(width, height) / _MOST_CELLS)
        shape = (int(np.ceil(height / fine)), int(np.ceil(width / fine)))
        frame = GridFrame((within[0], within[2]), 0.0, fine, shape)
        self._fine, self._shape = fine, shape
        self._field = clearances_of_cells(space.scenery, frame, space.reach)

    def contains(self, points: Array) -> Mask:
        """Return whether positions (m, 2) are in the area; shape (m,)."""
        inside: Mask = np.all((points >= self.low) & (points <= self.high), axis=1)
        return inside

    def clearances(self, points: Array) -> Array:
        """Return the distances of the centres of cells near positions (m, 2) from obstacles [m]; shape (m,)."""
        cells = ((points - self.low) / self._fine).astype(np.intp)
        columns, rows = np.minimum(cells[:, 0], self._shape[1] - 1), np.minimum(cells[:, 1], self._shape[0] - 1)
        found: Array = self._field[rows * self._shape[1] + columns]
        return found

    def free(self, starts: Array, ends: Array, radii: Array) -> Mask:
        """Return whether discs of radii (m,) on straight lines in the area, (m, 2) each, touch nothing; shape (m,)."""
        error = _HALF_DIAGONAL * self._fine
        away = ends - starts
        length = np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2)
        one, other = self.clearances(starts), self.clearances(ends)
        free: Mask = np.greater_equal(np.minimum(one, other) + error, radii)
        doubtful = np.flatnonzero(free & (0.5 * (one + other - length) - error < radii))
        for radius in np.unique(radii[doubtful]).tolist():
            some = doubtful[radii[doubtful] == radius]
            free[some] = self.space.clear(starts[some], ends[some], radius)
        return free


class LatticeSearch:
    """A search on the lattice from the pose of a car to a goal.

    The lattice is placed and turned so that the pose is one of its states. The goal is a position, reached from states
    near it by an arc of the least radius and a straight line that is tangent to it.

    Attributes:
        first: The number of the state at the pose of the car.
    """

    def __init__(
        self, lattice: Lattice, position: Array, heading: float, goal: Array, closed: list[PlacedRegion]
    ) -> None:
        """Place the lattice.

        Args:
            lattice: The lattice.
            position: The position of the car [m]; shape (2,).
            heading: The heading of the car [rad].
            goal: The position of the goal [m]; shape (2,).
            closed: Regions that the disc around the car may not reach into.
        """
        self._lattice, self._position, self._goal, self._closed = lattice, position, goal, closed
        self._heading = heading
        self._cosine, self._sine = float(np.cos(heading)), float(np.sin(heading))
        self._chords = [self._turned(chords) for chords in lattice.chords]
        ends = np.stack([position, goal])
        radius = lattice.space.radius
        #: The radii of the disc near the pose and the goal, reduced where it would touch an obstacle there.
        self._narrow = np.clip(lattice.space.clearances(ends), 0.0, radius)
        size = lattice.high - lattice.low
        self._most = int(np.ceil(np.hypot(*size) / lattice.side)) + 2
        self._width = 2 * self._most + 1
        self.first = self._number(0, 0, 0)
        self._finals: dict[int, tuple[float, Array]] = {}

    def path(self, most: int) -> PlannedPath:
        """Find a shortest path on the lattice, with at most a number of states expanded."""
        found = least_path({self.first: 0.0}, self.edges, self.ending, self.estimate, most)
        if not found.nodes:
            return no_path(found.expanded, found.is_limited)
        parts = [self._position[None]]
        for node, following in zip(found.nodes, found.nodes[1:], strict=False):
            column, row, heading = self._state(node)
            cells, end = (
                (self._state(following)[0] - column, self._state(following)[1] - row),
                following % len(HEADINGS),
            )
            used = next(p for p in self._lattice.primitives[heading] if p.cells == cells and p.heading == end)
            parts.append(self._placed(column, row) + self._turned(used.points[1:]))
        parts.append(self._finals[found.nodes[-1]][1][1:])
        return PlannedPath(polyline(parts), found.cost, found.expanded, False)

    def edges(self, node: int) -> list[tuple[int, float]]:
        """Return the successors of a state, and the lengths of the motions to them [m]."""
        column, row, heading = self._state(node)
        primitives = self._lattice.primitives[heading]
        chords = self._placed(column, row) + self._chords[heading]
        free = np.logical_and.reduceat(self._are_free(chords[:, 0], chords[:, 1]), self._lattice.begins[heading])
        return [
            (self._number(column + each.cells[0], row + each.cells[1], each.heading), each.length)
            for each, is_free in zip(primitives, free.tolist(), strict=True)
            if is_free
        ]

    def ending(self, node: int) -> float:
        """Return the length of the final motion from a state to the goal [m]; infinite if none is free."""
        if node not in self._finals:
            self._finals[node] = self._final(node)
        return self._finals[node][0]

    def estimate(self, node: int) -> float:
        """Return the distance from a state to the goal [m]."""
        x, y = self._placed(*self._state(node)[:2]) - self._goal
        return float(np.sqrt(x * x + y * y))

    def pose(self, node: int) -> tuple[Array, float]:
        """Return the position of a state, (2,) [m], and its heading [rad]."""
        column, row, heading = self._state(node)
        x, y = HEADINGS[heading].tolist()
        return self._placed(column, row), self._heading + float(np.arctan2(y, x))

    def _final(self, node: int) -> tuple[float, Array]:
        """Return the length and the points of the shortest free final motion from a state to the goal."""
        radius = self._lattice.radius
        nothing: tuple[float, Array] = (np.inf, np.empty((0, 2)))
        if self.estimate(node) > _NEAR_GOAL * radius:
            return nothing
        position, heading = self.pose(node)
        direction = np.array([np.cos(heading), np.sin(heading)])
        ways = []
        for sign in (1.0, -1.0):
            away = self._goal - position - sign * radius * np.array([-direction[1], direction[0]])
            square = float(away[0] ** 2 + away[1] ** 2)
            if square < radius * radius:
                continue
            straight = float(np.sqrt(square - radius * radius))
            # The angle between the radii to the beginning and to the end of the arc.
            ends = np.arctan2(away[1], away[0]) - sign * np.arctan2(straight, radius)
            turn = float(np.mod(sign * (ends - heading) + 0.5 * np.pi, 2.0 * np.pi))
            turn = 0.0 if turn > 2.0 * np.pi - 1e-9 else turn
            if turn <= _MOST_TURN:
                curve = position + _arc(direction, sign * turn, radius, radius)
                points = [curve if straight > _TINY * self._lattice.side else curve[:-1], self._goal[None]]
                ways.append((radius * turn + straight, polyline(points)))
        for length, way in sorted(ways, key=lambda each: each[0]):
            if len(way) == 1 or self._are_free(way[:-1], way[1:]).all():
                return length, way
        return nothing

    def _are_free(self, starts: Array, ends: Array) -> Mask:
        lattice = self._lattice
        free = lattice.contains(starts) & lattice.contains(ends)
        inside: Indices = np.flatnonzero(free)
        if not len(inside):
            return free
        starts, ends = starts[inside], ends[inside]
        widest = lattice.space.radius
        radii = np.full(len(starts), widest)
        for place, narrow in zip((self._position, self._goal), self._narrow.tolist(), strict=True):
            if narrow < widest:
                near = np.minimum(((starts - place) ** 2).sum(axis=1), ((ends - place) ** 2).sum(axis=1))
                radii[near < (2.0 * widest) ** 2] = narrow
        free[inside] = lattice.free(starts, ends, radii)
        if self._closed:
            free[inside] &= lattice.space.outside(starts, ends, self._closed)
        return free

    def _placed(self, column: int, row: int) -> Array:
        """Return the position of a cell [m]; shape (2,)."""
        placed: Array = self._position + self._turned(self._lattice.side * np.array([column, row]))
        return placed

    def _turned(self, points: Array) -> Array:
        """Return points of the lattice in the directions of the world [m]; shape (..., 2)."""
        x, y = points[..., 0], points[..., 1]
        return np.stack([self._cosine * x - self._sine * y, self._sine * x + self._cosine * y], axis=-1)

    def _number(self, column: int, row: int, heading: int) -> int:
        return ((row + self._most) * self._width + column + self._most) * len(HEADINGS) + heading

    def _state(self, node: int) -> tuple[int, int, int]:
        cell, heading = divmod(node, len(HEADINGS))
        row, column = divmod(cell, self._width)
        return column - self._most, row - self._most, heading
