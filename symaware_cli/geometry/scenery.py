"""Scenery: all obstacles of an environment at one time, with queries for nearby obstacles and lines of sight.

As in `symaware_cli.geometry.pieces`, positions in space are seen from above; but lines of sight pass over and under
obstacles whose heights the world knows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from typing import NamedTuple, Protocol

import numpy as np

from symaware_cli.geometry.path import Pose, ScriptedPath
from symaware_cli.geometry.pieces import Pieces, crosses, separation_from_points
from symaware_cli.geometry.shape import Shape
from symaware_cli.geometry.vectors import Array, Indices, Mask

#: The number of pairs of a point or line and a piece that are computed together, to bound memory.
_TOGETHER = 1 << 19

#: Nanoseconds in a second.
_SECOND = 1_000_000_000


class PlacedShape(Protocol):
    """An obstacle of the scenery, such as `symaware_cli.Obstacle`."""

    @property
    def outline(self) -> Shape:
        """Its outline, seen from above."""

    @property
    def path(self) -> ScriptedPath | None:
        """Its path; None if it does not move along one."""

    def pose(self, time: float = 0.0) -> Pose:
        """Return its pose at a time [s], and its velocities from there on."""


class HeightRange(NamedTuple):
    """The vertical extent of an obstacle.

    Attributes:
        level: The height of its position, if that has two coordinates [m].
        below: The lower end relative to the height of its position [m].
        above: The upper end relative to the height of its position [m].
    """

    level: float
    below: float
    above: float


class Nearby(NamedTuple):
    """Obstacles near points: an entry for each point and each convex piece within reach, ordered by point.

    Attributes:
        row: The row of the point, ascending; shape (m,).
        obstacle: The index of the obstacle, in the order of `Scenery.names`; shape (m,).
        point: The nearest point on its surface [m]; shape (m, 2).
        distance: The distance of that point; negative inside of the obstacle [m]; shape (m,).
        velocity: The velocity of the obstacle at that point [m/s]; shape (m, 2).
    """

    row: Indices
    obstacle: Indices
    point: Array
    distance: Array
    velocity: Array


class Course(NamedTuple):
    """Positions and velocities of obstacles, row by row.

    Attributes:
        positions: Positions [m]; shape (m, 2).
        velocities: Velocities [m/s]; shape (m, 2).
        turn_rates: Turn rates about the positions [rad/s]; shape (m,).
        heights: Lower and upper ends [m], infinite for obstacles as high as the world; shape (m, 2).
    """

    positions: Array
    velocities: Array
    turn_rates: Array
    heights: Array


class Scenery:
    """All obstacles of an environment at one time.

    Attributes:
        names: The names of the obstacles, in the order of their indices.
        moves: Whether any of them ever moves.
        pieces: The convex pieces they consist of.
        owner: The index of the obstacle that each piece belongs to, ascending; shape (p,).
        time: The time, in nanoseconds.
    """

    def __init__(
        self, obstacles: Mapping[str, PlacedShape], time: int = 0, spans: Mapping[str, HeightRange] | None = None
    ) -> None:
        """Place the obstacles.

        Args:
            obstacles: The obstacles by name.
            time: Simulated time in nanoseconds.
            spans: The vertical extent of each; by default all are as high as the world.
        """
        self.names = tuple(obstacles)
        self.time = time
        every = tuple(obstacles.values())
        self._movers = [(index, obstacle) for index, obstacle in enumerate(every) if obstacle.path]
        self.moves = bool(self._movers)
        parts = [(index, piece) for index, each in enumerate(every) for piece in each.outline.pieces]
        self.owner: Indices = np.array([index for index, _ in parts], np.intp)
        self._shapes = Pieces.of(piece for _, piece in parts)
        self._positions = np.zeros((len(every), 2))
        self._velocities = np.zeros((len(every), 2))
        self._headings = np.zeros(len(every))
        self._turn_rates = np.zeros(len(every))
        now = time / _SECOND
        unbounded = HeightRange(0.0, -np.inf, np.inf)
        self._spans = np.array([(spans or {}).get(name, unbounded) for name in self.names]).reshape(-1, 3)
        self._levels: Array = self._spans[:, 0].copy()
        self._bounded = bool(np.isfinite(self._spans).all(axis=1).any())
        self._place((index, obstacle.pose(now)) for index, obstacle in enumerate(every))

    def at(self, time: int) -> Scenery:
        """Return the scenery at another time, in nanoseconds; the same one if nothing moves."""
        if not self.moves or time == self.time:
            return self
        now = time / _SECOND
        return self.moved(time, [(index, obstacle.pose(now)) for index, obstacle in self._movers])

    def moved(self, time: int, poses: Iterable[tuple[int, Pose]]) -> Scenery:
        """Return the scenery at another time, in nanoseconds, with new poses of some obstacles, by index."""
        other = copy(self)
        other.time = time
        other.moves = True
        for name in ("_positions", "_velocities", "_headings", "_turn_rates", "_levels"):
            setattr(other, name, getattr(self, name).copy())
        other._place(poses)
        return other

    def _place(self, poses: Iterable[tuple[int, Pose]]) -> None:
        """Set the poses of some obstacles."""
        for index, pose in poses:
            self._positions[index] = pose.position[:2]
            self._velocities[index] = pose.velocity[:2]
            self._headings[index] = pose.heading
            self._levels[index] = pose.position[2] if len(pose.position) == 3 else self._spans[index, 0]
            self._turn_rates[index] = pose.turn_rate
        self.pieces = self._shapes.placed(self._positions[self.owner], self._headings[self.owner])
        self._low, self._high = self.pieces.bounds()

    def __len__(self) -> int:
        return len(self.names)

    def nearest(self, points: Array, reach: Array | float) -> Nearby:
        """Find the obstacles within reach of points.

        Args:
            points: Positions [m]; shape (n, 2), further columns are ignored.
            reach: The greatest distance to the surface of an obstacle [m], for all or for each; scalar or shape (n,).
        """
        row, piece = self.candidates(points, reach)
        if not len(row):
            return Nearby(row, piece, np.empty((0, 2)), np.empty(0), np.empty((0, 2)))
        nothing = np.zeros(len(row))
        found = separation_from_points(points[:, :2].take(row, 0), nothing, self.pieces.take(piece))
        near = np.flatnonzero(found.distance <= np.broadcast_to(np.asarray(reach, float), (len(points),)).take(row))
        row, obstacle, point = row.take(near), self.owner.take(piece.take(near)), found.second.take(near, 0)
        return Nearby(row, obstacle, point, found.distance.take(near), self.velocity(obstacle, point))

    def velocity(self, obstacle: Indices, point: Array) -> Array:
        """Return the velocities of obstacles, by index (m,), at points on them (m, 2) [m/s]; shape (m, 2)."""
        if not self.moves:
            return np.zeros((len(obstacle), 2))
        arm = point - self._positions.take(obstacle, 0)
        around = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        return self._velocities.take(obstacle, 0) + self._turn_rates.take(obstacle)[:, None] * around

    @property
    def has_heights(self) -> bool:
        """Whether the height of any obstacle is known."""
        return self._bounded

    def course(self, obstacle: Indices) -> Course:
        """Return positions and velocities of obstacles, by index (m,)."""
        heights = self._levels.take(obstacle)[:, None] + self._spans.take(obstacle, 0)[:, 1:]
        return Course(
            self._positions.take(obstacle, 0),
            self._velocities.take(obstacle, 0),
            self._turn_rates.take(obstacle),
            heights,
        )

    def candidates(self, points: Array, reach: Array | float) -> tuple[Indices, Indices]:
        """Return at least all pairs of a point and a piece within its reach.

        Args:
            points: Positions [m]; shape (n, 2), further columns are ignored.
            reach: The distance [m], for all or for each point; scalar or shape (n,).

        Returns:
            Rows of points, ascending, and rows of `pieces`, ascending for each point.
        """
        points = points[:, :2]
        margin = np.broadcast_to(np.asarray(reach, float), (len(points),))[:, None]
        return self._overlapping(points - margin, points + margin)

    def _overlapping(self, low: Array, high: Array) -> tuple[Indices, Indices]:
        """Return pairs of an axis-aligned rectangle, (n, 2) each, and a piece whose bounding rectangle meets it."""
        count = len(self.pieces)
        rows = max(1, _TOGETHER // max(count, 1))
        parts = []
        for start in range(0, len(low) if count else 0, rows):
            some = slice(start, start + rows)
            meets = (low[some, None, 0] <= self._high[:, 0]) & (high[some, None, 0] >= self._low[:, 0])
            meets &= (low[some, None, 1] <= self._high[:, 1]) & (high[some, None, 1] >= self._low[:, 1])
            row, piece = np.nonzero(meets)
            parts.append((row + start, piece))
        if len(parts) == 1:
            return parts[0]
        no_rows = np.empty(0, np.intp)
        return (
            np.concatenate([no_rows, *(row for row, _ in parts)]),
            np.concatenate([no_rows, *(piece for _, piece in parts)]),
        )

    def blocks(self, origins: Array, targets: Array) -> Mask:
        """Return whether an obstacle blocks the straight line between two points.

        A line that only grazes an obstacle is free; one that starts or ends inside of an obstacle is blocked.

        Args:
            origins: The starts of lines [m]; shape (m, 2), or (m, 3) to pass over and under obstacles with known
                heights.
            targets: The ends of lines [m]; the same shape.

        Returns:
            Shape (m,).
        """
        blocked = np.zeros(len(origins), bool)
        line, piece = self._overlapping(
            np.minimum(origins[:, :2], targets[:, :2]), np.maximum(origins[:, :2], targets[:, :2])
        )
        ones, others = origins.take(line, 0), targets.take(line, 0)
        if self._bounded and origins.shape[1] == 3:
            meets, ones, others = self._within_spans(ones, others, self.owner.take(piece))
            line, piece = line[meets], piece[meets]
        if len(line):
            lines = Pieces.lines(ones[:, :2], others[:, :2])
            blocked[line[crosses(lines, self.pieces.take(piece))]] = True
        return blocked

    def _within_spans(self, origins: Array, targets: Array, obstacle: Indices) -> tuple[Mask, Array, Array]:
        """Clip lines to the vertical extents of obstacles, row by row; (m, 3) each.

        Returns:
            Which lines have a part within, (m,), and the starts and ends of these parts.
        """
        low, high = (self._levels[obstacle] + self._spans[obstacle, column] for column in (1, 2))
        rise = targets[:, 2] - origins[:, 2]
        level = rise == 0.0
        slope = np.where(level, 1.0, rise)
        ends = np.stack([(low - origins[:, 2]) / slope, (high - origins[:, 2]) / slope])
        first, last = np.maximum(ends.min(axis=0), 0.0), np.minimum(ends.max(axis=0), 1.0)
        between = (low < origins[:, 2]) & (origins[:, 2] < high)
        first, last = np.where(level, 0.0, first), np.where(level, 1.0, last)
        meets = np.where(level, between, first < last)
        along = (targets - origins)[meets]
        start = origins[meets]
        return meets, start + first[meets, None] * along, start + last[meets, None] * along
