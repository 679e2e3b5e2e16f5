"""Names of agents in topics of ROS."""

from __future__ import annotations

import re
from collections.abc import Iterable

_NOT_ALLOWED = re.compile(r"[^A-Za-z0-9_]+")


def topic_names(ids: Iterable[str]) -> dict[str, str]:
    """Return a valid and distinct part of a topic for each id, such as ``robot_0`` for ``robot.0``.

    A part of a topic has letters, digits and single underscores, and does not begin with a digit
    (https://design.ros2.org/articles/topic_and_service_names.html).
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for id in ids:
        word = re.sub("__+", "_", _NOT_ALLOWED.sub("_", id)).strip("_") or "body"
        word = f"body_{word}" if word[0].isdigit() else word
        name, number = word, 2
        while name in taken:
            name, number = f"{word}_{number}", number + 1
        taken.add(name)
        found[id] = name
    return found
