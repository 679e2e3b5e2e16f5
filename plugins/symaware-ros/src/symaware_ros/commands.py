"""Commands of ROS: twists, as messages and as control inputs of models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

TWIST = "geometry_msgs/msg/Twist"
"""The type of a command."""

STAMPED = "geometry_msgs/msg/TwistStamped"
"""The type of a command with the time of its turn."""

#: The element of a twist, of three linear and three angular velocities, that corresponds to each control input.
_ELEMENTS: Mapping[str, int] = {
    "speed": 0,
    "velocity_x": 0,
    "velocity_y": 1,
    "velocity_z": 2,
    "climb_rate": 2,
    "turn_rate": 5,
}


class CommandError(ValueError):
    """A message is no valid command."""


def elements(names: Sequence[str]) -> list[int] | None:
    """Return the element of a twist for each control input of a model; None if an input has none."""
    found = [_ELEMENTS.get(name) for name in names]
    known = [each for each in found if each is not None]
    return known if len(known) == len(found) else None


def twist(content: Any) -> list[float]:
    """Return the linear velocities [m/s] and the angular velocities [rad/s] of a Twist.

    Raises:
        CommandError: The message is no twist, or has numbers that are not finite.
    """
    return [_number(content, part, axis) for part in ("linear", "angular") for axis in "xyz"]


def stamp(content: Any) -> int:
    """Return the time of a TwistStamped [ns].

    Raises:
        CommandError: The message has no valid stamp.
    """
    try:
        time = content["header"]["stamp"]
        sec, nanosec = time["sec"], time["nanosec"]
    except (KeyError, TypeError):
        raise CommandError("it has no header.stamp") from None
    if type(sec) is not int or type(nanosec) is not int:
        raise CommandError("its header.stamp is no time")
    return sec * 1_000_000_000 + nanosec


def _number(content: Any, part: str, axis: str) -> float:
    try:
        value = content[part][axis]
    except (KeyError, TypeError):
        raise CommandError(f"it has no {part}.{axis}") from None
    # A rosbridge sends null for numbers that are not finite.
    if not isinstance(value, int | float) or isinstance(value, bool) or not _is_finite(value):
        raise CommandError(f"its {part}.{axis} is no finite number: {str(value)[:40]}")
    return float(value)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the range of a float
        return False
