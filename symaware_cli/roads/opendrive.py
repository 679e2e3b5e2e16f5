"""Driving lanes from OpenDRIVE files, with their widths, links, junctions and speed limits.

Format: ASAM OpenDRIVE 1.7. Elevation is left out, as lanes are in the plane.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from symaware_cli.assets import XmlElement
from symaware_cli.geometry import Array
from symaware_cli.roads.lane import Lane, simplified
from symaware_cli.roads.reference_line import ReferenceLine
from symaware_cli.roads.road_file import (
    check_line,
    first,
    needed,
    number,
    refuse_crossed,
    road_tree,
    text,
    whole,
)

#: The greatest numbers of roads, of lanes of a side of a section, of points along a section, and of all lanes.
MOST_ROADS, MOST_SIDE, MOST_POINTS, MOST_TOGETHER = 2_000, 50, 20_000, 100_000
#: The greatest number of parts of a polynomial.
_MOST_PARTS = 1_000
#: A lane ends where it is narrower than this [m].
_NARROWEST = 0.1

#: The types of lanes that cars drive on.
DRIVEN = frozenset(
    {
        "driving",
        "entry",
        "exit",
        "onRamp",
        "offRamp",
        "connectingRamp",
        "mwyEntry",
        "mwyExit",
        "slipLane",
        "bidirectional",
    }
)

_SPEEDS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}


@dataclass
class _Section:
    """A part of a road with the same lanes.

    Attributes:
        start: The distance along the road at which it begins [m].
        end: The distance along the road at which it ends [m].
        lanes: The element of each lane that cars drive on, by id: right ones are negative.
        sides: The left and right boundary of each lane, along the road; shape (k, 2) each.
    """

    start: float
    end: float
    lanes: dict[int, XmlElement] = field(default_factory=dict)
    sides: dict[int, tuple[Array, Array]] = field(default_factory=dict)


@dataclass
class _Road:
    """A road.

    Attributes:
        element: The element of the road.
        id: The id of the road.
        is_right_hand: Whether traffic keeps to the right.
        sections: The sections of the road, in order.
        limits: The positions along the road at which the speed limit changes, and the new limits [m, m/s].
    """

    element: XmlElement
    id: str
    is_right_hand: bool
    sections: list[_Section]
    limits: list[tuple[float, float]]

    def name(self, section: int, lane: int) -> str:
        """Return the name of a lane: the road, the section if there are several, and the lane's number on its side."""
        road = re.sub(r"[^A-Za-z0-9]", "_", self.id)
        within = f"_s{section}" if len(self.sections) > 1 else ""
        return f"{road}{within}_{'L' if lane > 0 else 'R'}{abs(lane)}"

    def goes_ahead(self, lane: int) -> bool:
        """Whether a lane is driven along the road."""
        return (lane < 0) == self.is_right_hand


def lanes_of(data: bytes, step: float) -> list[Lane]:
    """Read the lanes of a file that cars drive on.

    Args:
        data: The file.
        step: The greatest distance between two points of a curve [m].

    Raises:
        AssetError: The file is invalid; contains the place of the problem.
    """
    root = road_tree(data, "OpenDRIVE", "OpenDRIVE")
    roads: dict[str, _Road] = {}
    points = 0
    for element in root.children("road"):
        road = _road(element, step)
        if road.id in roads:
            element.refuse(f"two roads have the id {road.id}")
        roads[road.id] = road
        points += sum(len(left) for section in road.sections for left, _ in section.sides.values())
        if points > MOST_TOGETHER:
            element.refuse(f"its lanes have more than {MOST_TOGETHER:,} points; increase `step`")
        if len(roads) > MOST_ROADS:
            element.refuse(f"it has more than {MOST_ROADS:,} roads")
    junctions = {text(element, "id"): element for element in root.children("junction")}
    names: dict[str, str] = {}
    lanes = []
    for road in roads.values():
        for number_, section in enumerate(road.sections):
            for id, element in section.lanes.items():
                name = road.name(number_, id)
                if name in names:
                    element.refuse(f"the lanes of the roads {names[name]} and {road.id} have the same name {name}")
                names[name] = road.id
                lanes.append(_lane(name, road, number_, id, roads, junctions))
    if not lanes:
        root.refuse("it has no lane that cars drive on")
    return lanes


def _lane(
    name: str,
    road: _Road,
    place: int,
    id: int,
    roads: Mapping[str, _Road],
    junctions: Mapping[str, XmlElement],
) -> Lane:
    section = road.sections[place]
    element, (left, right) = section.lanes[id], section.sides[id]
    ahead = road.goes_ahead(id)
    if not ahead:
        left, right = right[::-1], left[::-1]
    check_line(element, 0.5 * (left + right), f"the centre of the lane {name}")
    refuse_crossed(element, left, right, name)
    left, right = simplified(left, right)
    limit = min(_limits_of(element, section, road), default=np.inf)
    inner, outer = _beside(section, id)
    if (id > 0) == ahead:
        # A lane on the left side in the direction of the road, as with left-hand traffic: the middle is to its right.
        inner, outer = outer, inner
    sides = [None if each is None else road.name(place, each) for each in (inner, outer)]
    return Lane(name, left, right, limit, _successors(road, place, id, roads, junctions), sides[0], sides[1])


def _beside(section: _Section, id: int) -> tuple[int | None, int | None]:
    """Return the adjacent lanes of the same direction: nearer to the middle of the road, and farther from it."""
    sign = 1 if id > 0 else -1
    inner, outer = id - sign, id + sign
    return inner if inner in section.lanes else None, outer if outer in section.lanes else None


# -- links


def _successors(
    road: _Road, place: int, id: int, roads: Mapping[str, _Road], junctions: Mapping[str, XmlElement]
) -> tuple[str, ...]:
    """Return the lanes that continue a lane in its direction of travel."""
    ahead = road.goes_ahead(id)
    key, following = ("successor", place + 1) if ahead else ("predecessor", place - 1)
    link = first(road.sections[place].lanes[id], "link")
    named = None if link is None else first(link, key)
    lane = None if named is None else whole(named, "id")
    if 0 <= following < len(road.sections):
        return () if lane is None or lane not in road.sections[following].lanes else (road.name(following, lane),)
    outer = first(road.element, "link")
    onward = None if outer is None else first(outer, key)
    if onward is None:
        return ()
    kind, target = text(onward, "elementType"), text(onward, "elementId")
    if kind == "road":
        if target not in roads:
            onward.refuse(f"there is no road {target}")
        return () if lane is None else _entered(roads[target], text(onward, "contactPoint"), lane, onward)
    if kind != "junction":
        onward.refuse(f"`elementType` is `road` or `junction`, not {kind[:40]!r}")
    if target not in junctions:
        onward.refuse(f"there is no junction {target}")
    found: list[str] = []
    for connection in junctions[target].children("connection"):
        if text(connection, "incomingRoad") != road.id:
            continue
        connecting = text(connection, "connectingRoad")
        if connecting not in roads:
            connection.refuse(f"there is no road {connecting}")
        for each in connection.children("laneLink"):
            if whole(each, "from") == id:
                found += _entered(roads[connecting], text(connection, "contactPoint"), whole(each, "to"), each)
    return tuple(dict.fromkeys(found))


def _entered(road: _Road, contact: str, lane: int, element: XmlElement) -> tuple[str, ...]:
    """Return the lane of a road that is entered at its start or its end; none if cars do not drive there."""
    if contact not in ("start", "end"):
        element.refuse(f"`contactPoint` is `start` or `end`, not {contact[:40]!r}")
    place = 0 if contact == "start" else len(road.sections) - 1
    if lane not in road.sections[place].lanes or road.goes_ahead(lane) != (contact == "start"):
        return ()
    return (road.name(place, lane),)


# -- roads and their sections


def _road(element: XmlElement, step: float) -> _Road:
    id = text(element, "id")
    if not re.fullmatch(r"[\w .:-]{1,64}", id, re.ASCII):
        element.refuse("the id of a road has up to 64 letters, digits, `_`, `-`, `.`, `:` and spaces")
    rule = element.get("rule", "RHT")
    if rule not in ("RHT", "LHT"):
        element.refuse(f"`rule` is `RHT` or `LHT`, not {rule[:40]!r}")
    line = ReferenceLine(needed(element, "planView"))
    length = number(element, "length")
    if abs(length - line.length) > max(0.1, 0.001 * line.length):
        element.refuse(f"the length of the road is {length:g} m, and that of its geometries {line.length:g} m")
    lanes = needed(element, "lanes")
    offset = _Polynomials(lanes.children("laneOffset"), "s")
    parts = lanes.children("laneSection")
    if not parts:
        lanes.refuse("<lanes> has no <laneSection>")
    starts = [number(part, "s") for part in parts]
    for part, before, start in zip(parts[1:], starts, starts[1:], strict=False):
        if start <= before:
            part.refuse("the lane sections of a road are in the order of `s`")
    if starts[0] > 1e-6:
        parts[0].refuse("the first lane section of a road begins at s = 0")
    ends = [*starts[1:], line.length]
    samples = line.samples(step)
    sections = [
        _section(part, line, offset, start, min(end, line.length), samples, step)
        for part, start, end in zip(parts, starts, ends, strict=True)
    ]
    return _Road(element, id, rule == "RHT", sections, _road_limits(element))


class _Polynomials:
    """A piecewise cubic polynomial of the distance along a road."""

    def __init__(self, parts: Sequence[XmlElement], place: str) -> None:
        """Read the elements of the parts; `place` is the attribute with the beginning of each.

        Raises:
            AssetError: An element is invalid.
        """
        if len(parts) > _MOST_PARTS:
            parts[_MOST_PARTS].refuse(f"there are more than {_MOST_PARTS:,} parts")
        self.starts = [number(part, place) for part in parts]
        for part, before, start in zip(parts[1:], self.starts, self.starts[1:], strict=False):
            if start < before:
                part.refuse(f"the parts are in the order of `{place}`")
        self._terms = [tuple(number(part, key) for key in "abcd") for part in parts]

    @property
    def is_curved(self) -> bool:
        """Whether the function has a piece that is not linear."""
        return any(c or d for _, _, c, d in self._terms)

    def at(self, along: Array) -> Array:
        """Return the values at distances; 0 before the first part."""
        values = np.zeros(len(along))
        for number_, (start, (a, b, c, d)) in enumerate(zip(self.starts, self._terms, strict=True)):
            end = self.starts[number_ + 1] if number_ + 1 < len(self.starts) else np.inf
            rows = (along >= start) & (along < end)
            p = along[rows] - start
            values[rows] = a + p * (b + p * (c + p * d))
        return values


def _section(
    element: XmlElement,
    line: ReferenceLine,
    offset: _Polynomials,
    start: float,
    end: float,
    samples: Array,
    step: float,
) -> _Section:
    if end - start <= 1e-6:
        element.refuse("a lane section has a length")
    section = _Section(start, end)
    widths: dict[int, tuple[XmlElement, _Polynomials]] = {}
    for side, sign in (("left", 1), ("right", -1)):
        for part in element.children(side):
            for lane in part.children("lane"):
                id = whole(lane, "id")
                if id * sign <= 0 or abs(id) > MOST_SIDE:
                    lane.refuse(f"the id of a lane in <{side}> is {sign} to {sign * MOST_SIDE}, not {id}")
                if id in widths:
                    lane.refuse(f"two lanes of a section have the id {id}")
                widths[id] = (lane, _Polynomials(lane.children("width"), "sOffset"))
    places = [samples[(samples > start) & (samples < end)], np.array([start, end])]
    for each, shift in [(offset, 0.0), *((width, start) for _, width in widths.values())]:
        joints = np.array(each.starts) + shift
        places.append(joints[(joints > start) & (joints < end)])
        if each.is_curved:
            if (end - start) / step > MOST_POINTS:
                element.refuse(f"the widths of its lanes need more than {MOST_POINTS:,} points; increase `step`")
            places.append(np.linspace(start, end, max(2, int(np.ceil((end - start) / step)) + 1)))
    along = np.unique(np.concatenate(places))
    along = along[np.concatenate([[True], np.diff(along) > 1e-6])]
    if len(along) < 2 or len(along) > MOST_POINTS:
        element.refuse(f"a lane section has {len(along):,} points, and may have 2 to {MOST_POINTS:,}")
    positions, headings = line.poses(along)
    normal = np.stack([-np.sin(headings), np.cos(headings)], axis=1)
    # Just before its end, since the offset may jump at the next section.
    middle = offset.at(np.minimum(along, np.maximum(end - 1e-9, start)))
    for sign in (1, -1):
        near = middle
        for number_ in range(1, MOST_SIDE + 1):
            id = sign * number_
            if id not in widths:
                if any(each * sign > number_ for each in widths):
                    element.refuse(f"the lanes of a section are numbered without gaps, and {id} is missing")
                break
            lane, width = widths[id]
            wide = width.at(np.minimum(along, np.maximum(end - 1e-9, start)) - start)
            if (wide < -1e-6).any():
                place = float(along[int((wide < -1e-6).argmax())])
                lane.refuse(
                    f"the width of the lane {id} is negative {place - start:g} m after the start of its section"
                )
            far = near + sign * wide
            inner, outer = positions + near[:, None] * normal, positions + far[:, None] * normal
            near = far
            if text(lane, "type") not in DRIVEN:
                continue
            there = _wide(wide)
            if there is None:
                continue
            section.lanes[id] = lane
            section.sides[id] = (outer[there], inner[there]) if sign > 0 else (inner[there], outer[there])
    return section


def _wide(width: Array) -> slice | None:
    """Return the longest part of a lane that has a width; None if it has none."""
    wide = np.concatenate([[False], width >= _NARROWEST, [False]]).astype(int)
    begins, ends = np.flatnonzero(np.diff(wide) == 1), np.flatnonzero(np.diff(wide) == -1)
    sizes = ends - begins
    if not len(sizes) or sizes.max() < 2:
        return None
    longest = int(sizes.argmax())
    return slice(int(begins[longest]), int(ends[longest]))


# -- speed limits


def _road_limits(element: XmlElement) -> list[tuple[float, float]]:
    """Return the positions at which speed limits of a road begin [m], and the limits [m/s]."""
    limits = []
    for kind in element.children("type"):
        speed = first(kind, "speed")
        limits.append((number(kind, "s"), np.inf if speed is None else _speed(speed)))
    return sorted(limits)


def _limits_of(lane: XmlElement, section: _Section, road: _Road) -> list[float]:
    """Return the speed limits of a lane [m/s]: its own, or else those of the road along its section."""
    own = [_speed(speed) for speed in lane.children("speed")]
    if own or not road.limits:
        return own
    begin = max(bisect_right([start for start, _ in road.limits], section.start) - 1, 0)
    return [limit for start, limit in road.limits[begin:] if start < section.end]


def _speed(element: XmlElement) -> float:
    value, unit = text(element, "max"), element.get("unit", "m/s")
    if value in ("no limit", "undefined"):
        return np.inf
    if unit not in _SPEEDS:
        element.refuse(f"`unit` is one of {', '.join(_SPEEDS)}, not {unit[:40]!r}")
    limit = number(element, "max") * _SPEEDS[unit]
    if limit <= 0.0:
        element.refuse("a speed limit is more than 0")
    return limit
