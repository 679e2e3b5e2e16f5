"""Reading of road files: XML with places for messages, finite numbers, and bounds on sizes.

Documents are parsed by the parser of robots' files (`symaware_cli.assets.xml_tree`), which refuses document types,
entities and other files.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from symaware_cli.assets import AssetError, XmlElement, xml_tree
from symaware_cli.geometry import LARGEST, Array
from symaware_cli.roads.lane import crossing

#: The greatest size of a file [bytes].
MOST_BYTES = 20_000_000


def road_tree(data: bytes, root: str, what: str) -> XmlElement:
    """Parse the file of a road.

    Args:
        data: The file.
        root: The name of the root element.
        what: The kind of file, for messages.

    Raises:
        AssetError: The data is no such file.
    """
    if len(data) > MOST_BYTES:
        raise AssetError(f"it has {len(data):,} bytes, and a file of roads may have {MOST_BYTES:,}")
    tree = xml_tree.xml_tree(data)
    if tree.tag != root:
        tree.refuse(f"it is no {what} file: its root element is <{tree.tag}>, not <{root}>")
    return tree


def first(parent: XmlElement, tag: str) -> XmlElement | None:
    """Return the first child with a tag."""
    return next(iter(parent.children(tag)), None)


def needed(parent: XmlElement, tag: str) -> XmlElement:
    """Return the first child with a tag.

    Raises:
        AssetError: There is no such child.
    """
    found = first(parent, tag)
    if found is None:
        parent.refuse(f"<{parent.tag}> has no <{tag}>")
    return found


def text(element: XmlElement, name: str) -> str:
    """Return an attribute.

    Raises:
        AssetError: The attribute is missing.
    """
    value = element.get(name)
    if value is None:
        element.refuse(f"<{element.tag}> has no attribute `{name}`")
    return value


def number(element: XmlElement, name: str, default: float | None = None) -> float:
    """Return an attribute that is a number.

    Raises:
        AssetError: The attribute is missing and has no default, or is no finite number.
    """
    if default is not None and element.get(name) is None:
        return default
    return finite(element, text(element, name), f"`{name}`")


def whole(element: XmlElement, name: str) -> int:
    """Return an attribute that is a whole number.

    Raises:
        AssetError: The attribute is missing, or no whole number.
    """
    value = text(element, name)
    try:
        found = int(value)
    except ValueError:
        found = 10**9
    if abs(found) >= 10**9:
        element.refuse(f"`{name}` is no whole number: {_shown(value)}")
    return found


def finite(element: XmlElement, value: str, what: str) -> float:
    """Return the number in the text of an element.

    Raises:
        AssetError: The text is no number, or one that is not finite or too large.
    """
    try:
        found = float(value)
    except ValueError:
        element.refuse(f"{what} is no number: {_shown(value)}")
    if not math.isfinite(found) or abs(found) > LARGEST:
        element.refuse(f"{what} is not a finite number of at most {LARGEST:g}: {_shown(value)}")
    return found


def check_line(element: XmlElement, line: Array, what: str) -> None:
    """Check that a line has at least two points, no two successive equal ones, and does not cross itself.

    Raises:
        AssetError: The line is invalid.
    """
    if len(line) < 2:
        element.refuse(f"{what} has fewer than 2 points")
    for place, (one, other) in enumerate(pairwise(line.tolist())):
        if one == other:
            element.refuse(f"points {place} and {place + 1} of {what} are the same")
    leg = crossing(line)
    if leg is not None:
        x, y = line[leg].tolist()
        element.refuse(f"{what} crosses itself after ({x:g}, {y:g})")


def refuse_crossed(element: XmlElement, left: Array, right: Array, name: str) -> None:
    """Check that the left boundary of a lane is on the left of the right one.

    Raises:
        AssetError: The left boundary is on the right of the right one somewhere.
    """
    ahead = np.diff(0.5 * (left + right), axis=0)
    if not ahead.any(axis=1).all():
        element.refuse(f"the centre of the lane {name} stands still")
    side = left - right
    turns = ahead[:, 0] * side[:-1, 1] - ahead[:, 1] * side[:-1, 0]
    wrong = np.flatnonzero(turns <= 0.0)
    if len(wrong):
        x, y = left[wrong[0]].tolist()
        element.refuse(f"the left boundary of the lane {name} is not on its left at ({x:g}, {y:g})")


def _shown(value: str) -> str:
    return repr(value if len(value) <= 40 else value[:40] + "...")
