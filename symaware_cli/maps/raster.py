"""Rasters: maps of square cells that are free, occupied or unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Array

#: The states of cells.
FREE, OCCUPIED, UNKNOWN = 0, 1, 2


@dataclass(frozen=True)
class Raster:
    """A map of square cells.

    Attributes:
        cells: The state of each cell; shape (rows, columns), the lowest row first.
        resolution: The side of a cell [m].
        origin: The position of the lower left corner of the first cell [m].
        yaw: The direction of the rows [rad], counter-clockwise from the x axis of the world.
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]
    yaw: float

    def placed(self, columns: Array, rows: Array) -> Array:
        """Return the positions of points that are given in cells from the lower left corner [m]; shape (n, 2)."""
        x, y = columns * self.resolution, rows * self.resolution
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.stack([self.origin[0] + cosine * x - sine * y, self.origin[1] + sine * x + cosine * y], axis=-1)

    def at(self, points: Array) -> NDArray[np.int8]:
        """Return the states of the cells that contain points (n, 2) [m]; unknown beyond the map; shape (n,)."""
        x, y = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        column = np.floor((cosine * x + sine * y) / self.resolution).astype(np.intp)
        row = np.floor((cosine * y - sine * x) / self.resolution).astype(np.intp)
        height, width = self.cells.shape
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return np.where(inside, self.cells[np.where(inside, row, 0), np.where(inside, column, 0)], UNKNOWN)
