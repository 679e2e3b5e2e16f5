"""Dubins paths: shortest paths between poses for vehicles with a minimum turning radius that cannot reverse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli import TimeSeries, nanoseconds

Array = NDArray[np.float64]

#: The words of a path: turns to the left and right, and straight segments.
WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")

#: How turn rates are sampled from a path; see `DubinsPath.turn_rates`.
Sampling = Literal["mean", "recorded"]

_TURNS = {"L": 1.0, "S": 0.0, "R": -1.0}
#: Angles less than this below a full turn are treated as rounding errors below zero.
_ROUNDING = 1e-13
#: Centres closer than this, in radii, are treated as equal: the direction between them is undefined.
_SAME = 1e-12
#: The turn in the step between the first segment and the second in the recorded runs, as a fraction of the turn rate.
_RECORDED_REST = 0.24


@dataclass(frozen=True, slots=True)
class DubinsPath:
    """A path of three segments, each an arc of minimum radius or a straight line.

    Attributes:
        start: x [m], y [m] and heading [rad] at the beginning.
        radius: The radius of every arc [m].
        word: The types of the segments, one of `WORDS`.
        lengths: The lengths of the three segments [m].
    """

    start: tuple[float, float, float]
    radius: float
    word: str
    lengths: tuple[float, float, float]

    @property
    def length(self) -> float:
        """The length of the whole path [m]."""
        return sum(self.lengths)

    @property
    def end(self) -> Array:
        """The pose at the end: x [m], y [m], and the heading [rad], which counts turns; shape (3,)."""
        end: Array = self.poses(self.length)[0]
        return end

    def headings(self, distances: ArrayLike) -> Array:
        """Return the heading [rad] at distances from the start [m], straight on beyond the end; shape (n,)."""
        along, heading = np.atleast_1d(np.asarray(distances, float)), self.start[2]
        headings, begin = np.full(along.shape, heading), 0.0
        for letter, length in zip(self.word, self.lengths, strict=True):
            headings += _TURNS[letter] / self.radius * np.clip(along - begin, 0.0, length)
            begin += length
        return headings

    def poses(self, distances: ArrayLike) -> Array:
        """Return the poses at distances from the start [m], straight on beyond the end.

        Args:
            distances: Distances; shape (n,), or one number.

        Returns:
            x [m], y [m] and heading [rad], which counts turns; shape (n, 3).
        """
        along = np.atleast_1d(np.asarray(distances, float))
        poses = np.tile(np.array(self.start), (len(along), 1))
        begin, segments = 0.0, [*zip(self.word, self.lengths, strict=True), ("S", math.inf)]
        for letter, length in segments:
            part = np.clip(along - begin, 0.0, length)
            turned = _TURNS[letter] / self.radius * part
            # The chord of an arc, which is exact for a straight line as well.
            chord, towards = part * np.sinc(turned / (2 * np.pi)), poses[:, 2] + turned / 2
            poses[:, 0] += chord * np.cos(towards)
            poses[:, 1] += chord * np.sin(towards)
            poses[:, 2] += turned
            begin += length
        return poses

    def turn_rates(
        self, speed: float, step: float, sampling: Sampling = "mean", *, begin: int = 0, count: int | None = None
    ) -> Array:
        """Return the turn rate of each step along the path at a constant speed [rad/s]; shape (K,).

        Only the requested steps are computed, however long the path is.

        Args:
            speed: The speed along the path [m/s].
            step: The duration of a step [s].
            sampling: ``mean``: the mean over the step, so that the heading at the end of every step is that of the
                path. ``recorded``: whole steps at the turn rate of a segment, as in the published runs of the case
                study: round(t1) steps at that of the first one, one step at 0.24 of it, until round(t1) + round(t2) at
                that of the second, and round(t3) + 1 at that of the third, where segment i takes ti steps.
            begin: The first step.
            count: The number of steps; None for all until the end of the path.
        """
        if sampling == "mean":
            end = math.ceil(self.length / (speed * step) - 1e-9)
            steps = np.arange(begin, _last(begin, count, end) + 1)
            return np.diff(self.headings(speed * step * steps)) / step
        first, second, third = (speed / self.radius * _TURNS[letter] for letter in self.word)
        whole = [round(length / (speed * step)) for length in self.lengths]
        steps = np.arange(begin, _last(begin, count, sum(whole) + 1))
        rates = np.full(len(steps), third)
        rates[steps < whole[0] + whole[1]] = second
        rates[steps < whole[0] + 1] = _RECORDED_REST * first
        rates[steps < whole[0]] = first
        return rates

    def intent(self, now: int, speed: float, step: float) -> TimeSeries:
        """Return the path at a constant speed as a time series of x [m], y [m] and heading [rad].

        Args:
            now: The time of its start, in nanoseconds.
            speed: The speed along the path [m/s].
            step: The time between instants [s]; the last one is the end of the path.
        """
        instants = np.append(np.arange(0.0, self.length / speed - 1e-6, step), self.length / speed)
        times = [now + nanoseconds(instant) for instant in instants.tolist()]
        return TimeSeries.sampled(times, self.poses(speed * instants))


def _last(begin: int, count: int | None, end: int) -> int:
    """Return the step after the last one."""
    return max(begin, end if count is None else min(begin + count, end))


def dubins_paths(start: ArrayLike, end: ArrayLike, radius: float) -> list[DubinsPath]:
    """Return the paths of all words that lead from one pose to another, in the order of `WORDS`.

    L. E. Dubins, "On curves of minimal length with a constraint on average curvature, and with prescribed initial and
    terminal positions and tangents", Amer. J. Math. 79, 1957: the shortest path is one of them. The middle arc of a
    path of three arcs turns by more than half a turn; a smaller one is never part of the shortest path.

    The lengths follow from the circles of the first and the last arc. In the frame of the start, in units of the
    radius, a path that starts to the left has its first circle around (0, 1); one that starts to the right is the
    mirror image of one to the left.

    Args:
        start: x [m], y [m] and heading [rad]; shape (3,).
        end: x [m], y [m] and heading [rad]; shape (3,).
        radius: The minimum turning radius [m].

    Raises:
        ValueError: The radius is not positive.
    """
    if not radius > 0.0:
        raise ValueError(f"the radius of a turn must be positive, not {radius:g}")
    x0, y0, heading = (float(each) for each in np.asarray(start, float))
    x1, y1, final = (float(each) for each in np.asarray(end, float))
    cosine, sine = math.cos(heading), math.sin(heading)
    x = ((x1 - x0) * cosine + (y1 - y0) * sine) / radius
    y = ((y1 - y0) * cosine - (x1 - x0) * sine) / radius
    turned = final - heading
    found = []
    for word in WORDS:
        lengths = _lengths(word, x, y, turned) if word[0] == "L" else _lengths(_mirrored(word), x, -y, -turned)
        if lengths is not None:
            first, second, third = (radius * length for length in lengths)
            found.append(DubinsPath((x0, y0, heading), radius, word, (first, second, third)))
    return found


def shortest_path(start: ArrayLike, end: ArrayLike, radius: float) -> DubinsPath:
    """Return the shortest of `dubins_paths`; of equal ones the first."""
    return min(dubins_paths(start, end, radius), key=lambda path: path.length)


def _mirrored(word: str) -> str:
    return word.translate(str.maketrans("LR", "RL"))


def _lengths(word: str, x: float, y: float, turned: float) -> Sequence[float] | None:
    """Return the segment lengths of a path that starts to the left, radius 1, from (0, 0, 0) to (x, y, turned).

    Each is computed from the previous ones, which compensates their rounding errors, so that the end is met.
    """
    side = 1.0 if word[2] == "L" else -1.0
    across, along = x - side * math.sin(turned), y - 1.0 + side * math.cos(turned)  # from first centre to last
    apart, towards = math.hypot(across, along), math.atan2(along, across)
    if word == "LSL":
        first = _angle(towards) if apart > _SAME else 0.0
        return first, apart, _angle(turned - first)
    if word == "LSR":
        if apart < 2.0:
            return None
        straight = math.sqrt((apart - 2.0) * (apart + 2.0))
        first = _angle(towards + math.atan2(2.0, straight))
        return first, straight, _angle(first - turned)
    if apart > 4.0:
        return None
    lean = math.acos(apart / 4.0)
    first = _angle(towards + math.pi / 2 + lean)
    middle = math.pi + 2 * lean
    return first, middle, _angle(turned - first + middle)


def _angle(angle: float) -> float:
    """Return the angle in [0, 2 pi)."""
    angle %= 2 * math.pi
    return angle if 2 * math.pi - angle > _ROUNDING else 0.0
