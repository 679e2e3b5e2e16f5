"""Lanes from CommonRoad files, version 2020a: lanelets with their boundaries, links, neighbours and speed limits.

Format: CommonRoad documentation of the XML format, commonroad.in.tum.de, version 2020a.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from symaware_cli.assets import XmlElement
from symaware_cli.geometry import Array, lengths
from symaware_cli.roads.lane import Lane, resampled, shares_of, simplified
from symaware_cli.roads.road_file import (
    check_line,
    finite,
    first,
    needed,
    refuse_crossed,
    road_tree,
    text,
    whole,
)

#: The greatest number of lanelets, and of points of a boundary.
MOST_LANELETS, MOST_POINTS = 2_000, 5_000

#: The sign "maximum speed" of the countries with signs in version 2020a: 274 in Germany, R301 in Spain and so on.
_SPEED_SIGNS = frozenset({"274", "R2-1", "R301", "B14", "C29", "maxspeed", "MAX_SPEED"})


def lanes_of(data: bytes) -> list[Lane]:
    """Read the lanelets of a file, named by their ids.

    Raises:
        AssetError: The file is invalid; contains the place of the problem.
    """
    root = road_tree(data, "commonRoad", "CommonRoad")
    version = text(root, "commonRoadVersion")
    if version not in ("2018b", "2020a"):
        root.refuse(f"its version is {version!r}, and 2018b and 2020a are read")
    every: dict[str, XmlElement] = {}
    for element in root.children("lanelet"):
        name = _reference(element, "id")
        if name in every:
            element.refuse(f"two lanelets have the id {name}")
        every[name] = element
        if len(every) > MOST_LANELETS:
            element.refuse(f"it has more than {MOST_LANELETS:,} lanelets")
    if not every:
        root.refuse("it has no <lanelet>")
    limits = {_reference(sign, "id"): _limit(sign) for sign in root.children("trafficSign")}
    return [_lane(name, element, every, limits) for name, element in every.items()]


def _lane(name: str, element: XmlElement, every: Mapping[str, XmlElement], limits: Mapping[str, float | None]) -> Lane:
    left, right = _boundary(element, "leftBound"), _boundary(element, "rightBound")
    if len(left) != len(right):
        shares = np.union1d(shares_of(left), shares_of(right))
        shares = shares[np.concatenate([[True], np.diff(shares) > 1e-9])]
        left, right = resampled(left, shares), resampled(right, shares)
    if lengths(left - right).min() <= 0.0:
        element.refuse(f"the boundaries of the lanelet {name} touch")
    refuse_crossed(element, left, right, name)
    left, right = simplified(left, right)
    found = []
    for reference in element.children("trafficSignRef"):
        sign = text(reference, "ref")
        if sign not in limits:
            reference.refuse(f"there is no traffic sign {sign}")
        limit = limits[sign]
        if limit is not None:
            found.append(limit)
    older = first(element, "speedLimit")
    if older is not None:
        found.append(_positive(older, older.text or ""))
    successors = tuple(_linked(each, every) for each in element.children("successor"))
    for each in element.children("predecessor"):
        _linked(each, every)
    sides = {}
    for key in ("adjacentLeft", "adjacentRight"):
        beside = first(element, key)
        same = beside is not None and text(beside, "drivingDir") == "same"
        sides[key] = _linked(beside, every) if beside is not None and same else None
        if beside is not None and not same:
            _linked(beside, every)
    limit = min(found, default=np.inf)
    return Lane(name, left, right, limit, successors, sides["adjacentLeft"], sides["adjacentRight"])


def _reference(element: XmlElement, name: str) -> str:
    number = whole(element, name)
    if number < 0:
        element.refuse(f"`{name}` is negative")
    return str(number)


def _linked(element: XmlElement, every: Mapping[str, XmlElement]) -> str:
    name = _reference(element, "ref")
    if name not in every:
        element.refuse(f"there is no lanelet {name}")
    return name


def _boundary(lanelet: XmlElement, tag: str) -> Array:
    element = needed(lanelet, tag)
    points = []
    for point in element.children("point"):
        x, y = needed(point, "x"), needed(point, "y")
        points.append([finite(x, x.text or "", "`x`"), finite(y, y.text or "", "`y`")])
        if len(points) > MOST_POINTS:
            point.refuse(f"a boundary has more than {MOST_POINTS:,} points")
    line = np.array(points).reshape(-1, 2)
    check_line(element, line, f"the <{tag}>")
    return line


def _limit(sign: XmlElement) -> float | None:
    """Return the speed limit of a traffic sign [m/s]; None for signs without one."""
    for element in sign.children("trafficSignElement"):
        kind = needed(element, "trafficSignID")
        if (kind.text or "").strip() in _SPEED_SIGNS:
            value = needed(element, "additionalValue")
            return _positive(value, value.text or "")
    return None


def _positive(element: XmlElement, value: str) -> float:
    limit = finite(element, value, "a speed limit")
    if limit <= 0.0:
        element.refuse(f"a speed limit is more than 0, not {limit:g}")
    return limit
