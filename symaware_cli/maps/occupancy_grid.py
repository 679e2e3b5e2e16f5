"""Occupancy grids: the log odds that the cells of a map are occupied, updated by scans.

H. P. Moravec, A. Elfes, "High resolution maps from wide angle sonar", ICRA 1985; S. Thrun, W. Burgard, D. Fox,
Probabilistic Robotics, 2005, table 9.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import Array, Indices
from symaware_cli.maps.planning_grid import GridFrame
from symaware_cli.maps.raster import FREE, OCCUPIED, UNKNOWN

Odds = NDArray[np.float32]

#: The distance between sample points of a ray, as a share of the side of a cell.
_STEP = 0.5

#: The distance behind its end at which a ray is taken to meet an obstacle, as a share of the side of a cell: a wall
#: along the border of a cell is in the cell behind it, whatever rounding errors the distance has.
_BEHIND = 0.25


@dataclass(frozen=True)
class OccupancyModel:
    """The probabilities by which scans change the belief about cells.

    Attributes:
        hit: The probability that a cell is occupied in which a ray ends.
        miss: The probability that a cell is occupied through which a ray passes.
        certain: The greatest probability of a cell; one minus it is the least.
        occupied: The probability above which a cell counts as occupied.
        free: The probability below which a cell counts as free.
    """

    hit: float
    miss: float
    certain: float
    occupied: float
    free: float

    def updated(self, odds: Odds, frame: GridFrame, origin: Array, ends: Array, is_hit: NDArray[np.bool_]) -> Odds:
        """Return the log odds of all cells after the rays of a scan.

        A cell changes once for each scan, however many rays meet it; a cell in which a ray ends counts as hit.

        Args:
            odds: The log odds of each cell, 0 where nothing is known; shape (cells,).
            frame: The frame of the grid.
            origin: The beginning of the rays [m]; shape (2,).
            ends: The ends of the rays [m]; shape (k, 2).
            is_hit: Whether each ray ended at an obstacle; shape (k,).
        """
        way = ends - origin
        length = np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2)
        unit = way / np.where(length > 0.0, length, 1.0)[:, None]
        step = _STEP * frame.resolution
        along = step * np.arange(int(length.max(initial=0.0) / step) + 1)
        ray, number = np.nonzero(along < length[:, None])
        passed = _cells(frame, origin + along[number, None] * unit[ray])
        ended = _cells(frame, ends[is_hit] + _BEHIND * frame.resolution * unit[is_hit])
        change = np.zeros(len(odds), np.float32)
        change[passed] = _log_odds(self.miss)
        change[ended] = _log_odds(self.hit)
        return self.limited(odds + change)

    def limited(self, odds: Odds) -> Odds:
        """Return log odds within the greatest certainty."""
        most = np.float32(_log_odds(self.certain))
        limited: Odds = np.clip(odds, -most, most)
        return limited

    def cells(self, odds: Odds, frame: GridFrame) -> NDArray[np.int8]:
        """Return the states of cells, as in a `Raster`; shape (rows, columns)."""
        states = np.full(len(odds), UNKNOWN, np.int8)
        states[odds > _log_odds(self.occupied)] = OCCUPIED
        states[odds < _log_odds(self.free)] = FREE
        return states.reshape(frame.shape)


def _log_odds(probability: float) -> float:
    return float(np.log(probability / (1.0 - probability)))


def _cells(frame: GridFrame, points: Array) -> Indices:
    """Return the cells of points (m, 2), row by row; points beyond the grid are left out."""
    rows, columns = frame.shape
    place = np.floor(frame.cells(points)).astype(np.intp)
    inside = (place >= 0).all(axis=1) & (place[:, 0] < columns) & (place[:, 1] < rows)
    cells: Indices = place[inside, 1] * columns + place[inside, 0]
    return cells
