"""Motion of bodies and obstacles at common instants, assembled from marks."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Shape
from symaware_cli.geometry import yaws
from symaware_cli.views.outline import Piece
from symaware_cli.views.palette import hexadecimal
from symaware_cli.views.scene.marks import Bodies, Solid

Array = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True)
class Motion:
    """The motion of n bodies.

    Attributes:
        names: (n,) names of the bodies.
        times: (k,) simulated time [ns].
        positions: (k, n, 3) [m]; NaN where unknown.
        headings: (k, n) [rad].
        shapes: (n,) outlines; None for points.
        nosed: (n,) whether the heading of a body is drawn.
    """

    names: tuple[str, ...]
    times: Times
    positions: Array
    headings: Array
    shapes: tuple[Shape | None, ...]
    nosed: tuple[bool, ...]

    def index(self, time: int) -> int:
        """Return the index of the last instant that is no later than a time [ns]; 0 if there is none."""
        return max(0, int(np.searchsorted(self.times, time, side="right")) - 1)


def motion_of(marks: Sequence[Bodies], names: Collection[str], start: int, end: int) -> Motion | None:
    """Return the motion of some bodies from one instant to another [ns]; None if no position is known."""
    times = instants([mark.times for mark in marks], start, end)
    wanted = {*names}
    chosen = [(mark, [row for row, name in enumerate(mark.names) if name in wanted]) for mark in marks]
    chosen = [(mark, rows) for mark, rows in chosen if rows]
    if not chosen:
        return None
    positions = np.concatenate([held(mark.times, mark.positions[:, rows], times) for mark, rows in chosen], axis=1)
    turned = np.concatenate([held(mark.times, mark.orientations[:, rows], times) for mark, rows in chosen], axis=1)
    known = np.isfinite(positions).all(axis=2).any(axis=1)
    if known.any():
        # Instants between others stay although nobody is there, so that no line leads across them.
        first, last = np.flatnonzero(known)[[0, -1]]
        known[first : last + 1] = True
    if not known.any():
        return None
    return Motion(
        names=tuple(mark.names[row] for mark, rows in chosen for row in rows),
        times=times[known],
        positions=positions[known],
        headings=yaws(turned[known].reshape(-1, 4)).reshape(turned[known].shape[:2]),
        shapes=tuple(mark.shape for mark, rows in chosen for _ in rows),
        nosed=tuple(mark.nosed for mark, rows in chosen for _ in rows),
    )


@dataclass(frozen=True)
class Obstacles:
    """The motion of m obstacles, at the instants of a `Motion`.

    Attributes:
        names: (m,) names of the obstacles.
        pieces: (m,) the convex pieces of each, relative to its position.
        colours: (m,) as ``#rrggbb``.
        positions: (k, m, 3) [m].
        headings: (k, m) [rad].
        movable: (m,) whether other bodies move the obstacle, such as a crate that is pushed.
    """

    names: tuple[str, ...]
    pieces: Sequence[Sequence[Piece]]
    colours: Sequence[str]
    positions: Array
    headings: Array
    movable: tuple[bool, ...] = ()

    def moves(self, number: int) -> bool:
        """Return whether the pose of an obstacle changes."""
        return bool(np.ptp(self.positions[:, number], axis=0).any() or np.ptp(self.headings[:, number]))


def obstacles_of(marks: Sequence[Solid], times: Times) -> Obstacles:
    """Return the motion of solid bodies at some instants [ns]."""
    shape = (len(times), len(marks))
    positions = [held(mark.times, mark.positions, times) for mark in marks]
    headings = [yaws(held(mark.times, mark.orientations, times)) for mark in marks]
    return Obstacles(
        names=tuple(mark.name for mark in marks),
        pieces=[mark.pieces for mark in marks],
        colours=[hexadecimal(mark.colour) for mark in marks],
        positions=np.stack(positions, axis=1) if marks else np.empty((*shape, 3)),
        headings=np.stack(headings, axis=1) if marks else np.empty(shape),
        movable=tuple(mark.movable for mark in marks),
    )


def instants(times: Sequence[Times], start: int, end: int) -> Times:
    """Return all instants of several series from one instant to another, ascending [ns]."""
    union = np.unique(np.concatenate([np.empty(0, np.int64), *times]))
    return union[(union >= start) & (union <= end)]


def held(times: Times, values: Array, at: Times) -> Array:
    """Return the values (k, ...), set at times (k,), valid at other times (m,): (m, ...), NaN before the first."""
    index = np.searchsorted(times, at, side="right") - 1
    stood = values[np.maximum(index, 0)]
    stood[index < 0] = np.nan
    return stood
