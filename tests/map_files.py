"""A small floor that is drawn with characters, as a map of ROS."""

from typing import Any

#: A room of 3 x 2 m with a door to the right, a pillar, and one cell that nobody has seen.
ROOM = """
##############
#............#
#............#
#............#
#.....##......
#.....##......
#............#
#............#
#?...........#
##############
"""
LEVELS = {"#": 0, ".": 254, "?": 205}

#: What a map server writes.
YAML: dict[str, Any] = {
    "image": "room.pgm",
    "mode": "trinary",
    "resolution": 0.2,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def picture(rows: str = ROOM) -> bytes:
    """A picture of a floor that is drawn with characters."""
    lines = rows.split()
    pixels = bytes(LEVELS[each] for line in lines for each in line)
    return b"P5\n%d %d\n255\n" % (len(lines[0]), len(lines)) + pixels
