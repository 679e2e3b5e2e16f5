"""Planning grids: the cells that a body fits in, and the moves between them that touch no obstacle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Obstacle
from symaware_cli.geometry import Array, Scenery, separation_from_points
from symaware_cli.geometry.vectors import Indices, Mask
from symaware_cli.maps.free_space import LEAST_RADIUS, FreeSpace

#: The greatest number of cells.
MOST_CELLS = 1_000_000

#: The moves, as columns and rows, counter-clockwise from the move along the rows. Move d + 4 is the opposite of move d.
MOVES = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))


@dataclass(frozen=True)
class GridFrame:
    """The frame of a grid: its origin, direction, resolution and shape.

    Attributes:
        origin: The lower left corner of the first cell [m].
        yaw: The direction of the rows [rad].
        resolution: The side of a cell [m].
        shape: The numbers of rows and columns.
    """

    origin: tuple[float, float]
    yaw: float
    resolution: float
    shape: tuple[int, int]

    def centres(self) -> Array:
        """Return the centres of all cells, row by row [m]; shape (rows * columns, 2)."""
        rows, columns = self.shape
        y, x = np.divmod(np.arange(rows * columns), columns)
        return self.placed(np.stack([x + 0.5, y + 0.5], axis=1))

    def placed(self, points: Array) -> Array:
        """Return the positions of points (n, 2) that are given in cells from the lower left corner [m]."""
        x, y = self.resolution * points[:, 0], self.resolution * points[:, 1]
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.stack([self.origin[0] + cosine * x - sine * y, self.origin[1] + sine * x + cosine * y], axis=1)

    def cells(self, points: Array) -> Array:
        """Return positions (n, 2) [m] in cells from the lower left corner."""
        x, y = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1) / self.resolution


class PlanningGrid:
    """The graph of the cells that a disc fits in, and of the straight moves to the eight cells around each.

    A disc fits in a cell if it touches no obstacle when its centre is that of the cell. A move is possible if the disc
    touches none on the way, so paths do not cut corners.

    The cost of a move of length L is L (1 + w (p + q) / 2), with p and q the penalties of its ends: 1 where the body
    touches an obstacle, falling linearly to 0 at the distance `comfort` from all obstacles.

    Attributes:
        frame: Where the cells are.
        radius: The radius of the disc [m].
        centres: The centres of the cells, row by row [m]; shape (n, 2).
        passable: Whether the disc fits in each cell; shape (n,).
        penalty: The penalty of each cell, times w; shape (n,).
        moves: The possible moves from each cell: bit d for `MOVES[d]`; shape (n,).
    """

    def __init__(
        self,
        frame: GridFrame,
        obstacles: Mapping[str, Obstacle],
        radius: float,
        comfort: float,
        weight: float,
        closed: Mask | None = None,
    ) -> None:
        """Compute the graph.

        Args:
            frame: Where the cells are.
            obstacles: The obstacles; moving ones are taken at their initial positions.
            radius: The radius of the disc [m].
            comfort: The distance from obstacles from which on moves have no penalty [m].
            weight: The weight w of penalties.
            closed: Cells that cannot be entered for other reasons; shape (n,).
        """
        reach = max(radius, LEAST_RADIUS) + comfort + frame.resolution
        self._space = FreeSpace(obstacles, radius, reach)
        self.frame, self.radius = frame, self._space.radius
        self.centres = frame.centres()
        radius = self.radius
        clearance = clearances_of_cells(self._space.scenery, frame, self._space.reach)
        self.passable: Mask = clearance >= radius
        if closed is not None:
            self.passable &= ~closed
        beyond = np.maximum(clearance - radius, 0.0)
        share = np.maximum(1.0 - beyond / comfort, 0.0) if comfort > 0.0 else np.zeros(len(beyond))
        self.penalty: Array = weight * share
        self.moves = self._possible_moves(clearance)

    def without(self, closed: Mask) -> PlanningGrid:
        """Return the grid without the cells that are closed; shape (n,)."""
        other = object.__new__(PlanningGrid)
        other.__dict__.update(self.__dict__)
        other.passable = self.passable & ~closed
        rows, columns = self.frame.shape
        open_cells = np.pad(other.passable.reshape(rows, columns), 1)
        moves = self.moves.reshape(rows, columns).copy()
        moves[~other.passable.reshape(rows, columns)] = 0
        for bit, (column, row) in enumerate(MOVES):
            ahead = open_cells[1 + row : 1 + row + rows, 1 + column : 1 + column + columns]
            moves[~ahead] &= 255 ^ (1 << bit)
        other.moves = moves.ravel()
        return other

    def near(self, points: Array) -> Mask:
        """Return the cells in which the disc would touch one of some points (m, 2) [m]; shape (n,).

        Points within a cell of an obstacle are taken for points of that obstacle.
        """
        points = points[self._space.clearances(points) > self.frame.resolution]
        rows, columns = self.frame.shape
        touching = np.zeros((rows, columns), bool)
        centres = self.frame.cells(points)
        reach = self.radius / self.frame.resolution
        for x, y in centres.tolist():
            left, right = max(0, int(x - reach - 0.5)), max(0, int(x + reach + 1.5))
            low, high = max(0, int(y - reach - 0.5)), max(0, int(y + reach + 1.5))
            across = np.arange(left, min(columns, right)) + 0.5 - x
            up = np.arange(low, min(rows, high)) + 0.5 - y
            touching[low:high, left:right] |= up[:, None] ** 2 + across**2 < reach**2
        return touching.ravel()

    def clear(self, starts: Array, ends: Array, radius: float) -> Mask:
        """Return whether a disc on straight lines between points, (m, 2) each, touches no obstacle; shape (m,)."""
        return self._space.clear(starts, ends, radius)

    def clearance(self, position: Array) -> float:
        """Return the distance of a position (2,) from the nearest obstacle [m], at most `reach` of the grid."""
        return float(self._space.clearances(position[None])[0])

    def _possible_moves(self, clearance: Array) -> NDArray[np.uint8]:
        rows, columns = self.frame.shape
        moves = np.zeros(rows * columns, np.uint8)
        for bit, (column, row) in enumerate(MOVES[:4]):
            start, end = self._pairs(column, row)
            both = self.passable[start] & self.passable[end]
            start, end = start[both], end[both]
            length = self.frame.resolution * (2.0**0.5 if column and row else 1.0)
            # Clearance changes by at most the distance travelled, so moves far from obstacles need no further check.
            doubtful = np.flatnonzero(0.5 * (clearance[start] + clearance[end] - length) < self.radius)
            possible = np.ones(len(start), bool)
            possible[doubtful] = self.clear(self.centres[start[doubtful]], self.centres[end[doubtful]], self.radius)
            moves[start[possible]] |= 1 << bit
            moves[end[possible]] |= 1 << (bit + 4)
        return moves

    def _pairs(self, column: int, row: int) -> tuple[Indices, Indices]:
        """Return all pairs of a cell and its neighbour in the direction of a move."""
        rows, columns = self.frame.shape
        numbers = np.arange(rows * columns).reshape(rows, columns)
        first = numbers[: rows - row, max(0, -column) : columns - max(0, column)]
        second = numbers[row:, max(0, column) : columns + min(0, column)]
        return first.ravel(), second.ravel()


def clearances_of_cells(scenery: Scenery, frame: GridFrame, reach: float) -> Array:
    """Return the distance of each cell's centre from the nearest obstacle [m], at most `reach`; shape (n,).

    The result equals that of `FreeSpace.clearances` at the centres, in less time.
    """
    rows, columns = frame.shape
    found = np.full((rows, columns), reach)
    pieces = scenery.pieces
    if not len(scenery):
        return found.ravel()
    low, high = pieces.bounds()
    corners = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], 1)
    inner = frame.cells(corners.reshape(-1, 2)).reshape(-1, 4, 2)
    margin = reach / frame.resolution + 1.0
    first = np.clip(np.floor(inner.min(axis=1) - margin), 0, [columns, rows]).astype(np.intp)
    last = np.clip(np.ceil(inner.max(axis=1) + margin), 0, [columns, rows]).astype(np.intp)
    centres = frame.centres().reshape(rows, columns, 2)
    # A loop over pieces: each concerns few cells, and all pairs together would not fit in memory.
    for number, ((left, bottom), (right, top)) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        points = centres[bottom:top, left:right].reshape(-1, 2)
        if len(points):
            same = pieces.take(np.full(len(points), number))
            distance = separation_from_points(points, np.zeros(len(points)), same).distance
            window = found[bottom:top, left:right]
            np.minimum(window, distance.reshape(window.shape), out=window)
    return found.ravel()
