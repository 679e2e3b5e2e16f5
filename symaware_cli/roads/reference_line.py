"""Reference lines of OpenDRIVE: straight lines, arcs, spirals and polynomials one after the other.

Format: ASAM OpenDRIVE 1.7, chapter 8, Geometry.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from symaware_cli.assets import XmlElement
from symaware_cli.geometry import Array
from symaware_cli.roads.road_file import number

#: The greatest length of a geometry [m].
MOST_LENGTH = 1e6
#: The greatest number of points along a road.
MOST_SAMPLES = 20_000
#: The greatest number of geometries of a road.
_MOST_GEOMETRIES = 10_000
#: The greatest angle by which a geometry turns [rad].
_MOST_TURNED = 1e3


class CurvePiece(NamedTuple):
    """A piece of a reference line, as one element `geometry`.

    Attributes:
        start: The distance along the road at which it begins [m].
        length: Its length [m].
        curvature: The greatest curvature [1/m].
        pose: Returns positions (k, 2) [m] and headings (k,) [rad] at distances from the start of the piece (k,) [m].
    """

    start: float
    length: float
    curvature: float
    pose: Callable[[Array], tuple[Array, Array]]


class ReferenceLine:
    """The reference line of a road.

    Attributes:
        length: Its length [m].
        geometries: The pieces of the line.
    """

    def __init__(self, plan: XmlElement) -> None:
        """Read the element `planView`.

        Raises:
            AssetError: The element is invalid.
        """
        self.geometries: list[CurvePiece] = []
        for element in plan.children("geometry"):
            self.geometries.append(_geometry(element))
            if len(self.geometries) > _MOST_GEOMETRIES:
                element.refuse(f"a road has more than {_MOST_GEOMETRIES:,} geometries")
            if len(self.geometries) > 1 and self.geometries[-1].start <= self.geometries[-2].start:
                element.refuse("the geometries of a road are in the order of `s`")
        if not self.geometries:
            plan.refuse("<planView> has no <geometry>")
        self.length = self.geometries[-1].start + self.geometries[-1].length
        self._plan = plan
        self._starts = np.array([each.start for each in self.geometries])

    def poses(self, along: Array) -> tuple[Array, Array]:
        """Return positions (k, 2) [m] and headings (k,) [rad] at distances along the road (k,) [m]."""
        which = np.maximum(np.searchsorted(self._starts, along, side="right") - 1, 0)
        positions, headings = np.empty((len(along), 2)), np.empty(len(along))
        for each in np.unique(which).tolist():
            rows, geometry = which == each, self.geometries[each]
            # The length of a road may exceed that of its geometries by a rounding error.
            within = np.minimum(np.maximum(along[rows] - geometry.start, 0.0), geometry.length)
            positions[rows], headings[rows] = geometry.pose(within)
        return positions, headings

    def samples(self, step: float) -> Array:
        """Return distances along the road at which geometries begin and end, and in curves also at most a step apart.

        Raises:
            AssetError: There would be too many distances.
        """
        found: list[Array] = []
        total = 0
        for each in self.geometries:
            # The chord of an arc of radius r is at most step^2 / (8 r) from it: three centimetres are enough.
            fine = min(step, np.sqrt(0.24 / each.curvature)) if each.curvature else each.length
            count = max(1, int(np.ceil(each.length / max(fine, 0.05))))
            total += count
            if total > MOST_SAMPLES:
                self._plan.refuse(f"its curves need more than {MOST_SAMPLES:,} points; increase `step`")
            found.append(np.linspace(each.start, each.start + each.length, count + 1))
        return np.unique(np.concatenate(found))


def _geometry(element: XmlElement) -> CurvePiece:
    start, length = number(element, "s"), number(element, "length")
    if not 0.0 < length <= MOST_LENGTH:
        element.refuse(f"the length of a geometry is more than 0 and at most {MOST_LENGTH:g} m, not {length:g}")
    if start < 0.0:
        element.refuse("`s` is negative")
    origin = np.array([number(element, "x"), number(element, "y")])
    heading = number(element, "hdg")
    shapes = element.children("line", "arc", "spiral", "paramPoly3")
    if len(shapes) != 1:
        element.refuse("a geometry has one of <line>, <arc>, <spiral> and <paramPoly3>")
    shape = shapes[0]
    if shape.tag == "line":
        curvatures = (0.0, 0.0)
    elif shape.tag == "arc":
        curvatures = (number(shape, "curvature"),) * 2
    elif shape.tag == "spiral":
        curvatures = (number(shape, "curvStart"), number(shape, "curvEnd"))
    else:
        return _polynomial(shape, start, length, origin, heading)
    most = max(abs(each) for each in curvatures)
    if most * length > _MOST_TURNED:
        shape.refuse(f"it turns by {most * length:g} rad, and a geometry by at most {_MOST_TURNED:g}")

    def pose(along: Array) -> tuple[Array, Array]:
        first, rate = curvatures[0], (curvatures[1] - curvatures[0]) / length
        towards = heading + along * (first + 0.5 * rate * along)
        return origin + _integrated(heading, first, rate, along), towards

    return CurvePiece(start, length, most, pose)


#: Nodes and weights of a Gauss-Legendre rule on [0, 1].
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


def _integrated(heading: float, curvature: float, rate: float, along: Array) -> Array:
    """Return the integrals of the direction of a clothoid from its start; shape (k, 2).

    Each piece between two successive distances is integrated by a Gauss rule of 12 nodes, which is exact to rounding
    where a piece turns by less than a radian; longer pieces are split.
    """
    if not len(along):
        return np.empty((0, 2))
    turn = np.abs(curvature) + np.abs(rate) * float(along.max())
    count = max(1, int(np.ceil(turn * float(along.max()))))
    edges = np.unique(np.concatenate([np.linspace(0.0, float(along.max()), count + 1), along, [0.0]]))
    size = np.diff(edges)
    points = edges[:-1, None] + size[:, None] * _NODES
    towards = heading + points * (curvature + 0.5 * rate * points)
    parts = size[:, None] * np.stack(
        [(np.cos(towards) * _WEIGHTS).sum(axis=1), (np.sin(towards) * _WEIGHTS).sum(axis=1)], axis=1
    )
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(parts, axis=0)])
    found: Array = total[np.searchsorted(edges, along)]
    return found


def _polynomial(shape: XmlElement, start: float, length: float, origin: Array, heading: float) -> CurvePiece:
    """Return a geometry of polynomials u(p) and v(p)."""
    u = [number(shape, f"{key}U") for key in "abcd"]
    v = [number(shape, f"{key}V") for key in "abcd"]
    # With `arcLength` the parameter is the distance, otherwise it runs from 0 to 1.
    kind = shape.get("pRange", "normalized")
    if kind not in ("arcLength", "normalized"):
        shape.refuse(f"`pRange` is `arcLength` or `normalized`, not {kind[:40]!r}")
    last = length if kind == "arcLength" else 1.0
    cosine, sine = np.cos(heading), np.sin(heading)
    table = _distances(shape, u, v, last)

    def pose(along: Array) -> tuple[Array, Array]:
        at = np.interp(along / length, table, np.linspace(0.0, 1.0, len(table))) * last
        x, y = _value(u, at), _value(v, at)
        dx, dy = _slope(u, at), _slope(v, at)
        positions = np.stack([origin[0] + cosine * x - sine * y, origin[1] + sine * x + cosine * y], axis=1)
        return positions, heading + np.arctan2(dy, dx)

    fine = np.linspace(0.0, last, 257)
    dx, dy = _slope(u, fine), _slope(v, fine)
    bend = dx * _second(v, fine) - dy * _second(u, fine)
    square = np.maximum(dx * dx + dy * dy, 1e-12)
    curvature = float((np.abs(bend) / (square * np.sqrt(square))).max())
    return CurvePiece(start, length, min(curvature, 10.0), pose)


def _distances(shape: XmlElement, u: Sequence[float], v: Sequence[float], last: float) -> Array:
    """Return the share of its length that a curve has at even steps of its parameter, up to the last.

    Raises:
        AssetError: The curve stands still.
    """
    at = np.linspace(0.0, last, 1025)
    speed = np.sqrt(_slope(u, at) ** 2 + _slope(v, at) ** 2)
    if not (speed > 0.0).all() or not np.isfinite(speed).all():
        shape.refuse("the curve stands still, or is not finite")
    shares = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    return shares / float(shares[-1])


def _value(k: Sequence[float], p: Array) -> Array:
    return k[0] + p * (k[1] + p * (k[2] + p * k[3]))


def _slope(k: Sequence[float], p: Array) -> Array:
    return k[1] + p * (2.0 * k[2] + p * 3.0 * k[3])


def _second(k: Sequence[float], p: Array) -> Array:
    return 2.0 * k[2] + 6.0 * k[3] * p
