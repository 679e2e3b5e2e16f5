"""The position of a link of one robot, computed joint by joint with numbers, for the independent evaluation of logs.

It shares no code with `Articulation.frames` and `RobotLinks`, which compute all robots at once: only the description of
the links and the order of operations are the same, so that both agree to the bit. Orientations are quaternions with the
vector part a and the scalar w, by which a vector v is turned to v + w t + a x t, where t = 2 a x v.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.geometry import Articulation

_Numbers = Sequence[float]


def link_here(
    tree: Articulation, link: str, joints: Mapping[str, float], position: _Numbers, orientation: _Numbers
) -> list[float]:
    """Return the position of the origin of a link's frame in the world [m].

    Args:
        tree: The links of the robot.
        link: The name of the link.
        joints: The positions of joints by name [rad] or [m]; 0 for others.
        position: The origin of the base [m].
        orientation: That of the base, a quaternion (x, y, z, w).
    """
    place = next(place for place, each in enumerate(tree.links) if each.name == link)
    inner, _ = _pose(tree, place, joints)
    return _sum(position, _turned(orientation, inner))


def _pose(tree: Articulation, place: int, joints: Mapping[str, float]) -> tuple[_Numbers, _Numbers]:
    """Return the position and the orientation of a link in the frame of the base."""
    link = tree.links[place]
    position: _Numbers = link.position
    orientation: _Numbers = link.orientation
    moved = joints.get(link.joint, 0.0)
    if link.motion == "turn":
        sine = float(np.sin(0.5 * moved))
        orientation = _product(link.orientation, [*(sine * each for each in link.axis), float(np.cos(0.5 * moved))])
    elif link.motion == "slide":
        position = _sum(position, _turned(link.orientation, [moved * each for each in link.axis]))
    if link.parent < 0:
        return position, orientation
    outer_position, outer = _pose(tree, link.parent, joints)
    return _sum(outer_position, _turned(outer, position)), _product(outer, orientation)


def _sum(one: _Numbers, other: _Numbers) -> list[float]:
    return [mine + its for mine, its in zip(one, other, strict=True)]


def _cross(a: _Numbers, b: _Numbers) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _turned(q: _Numbers, v: _Numbers) -> list[float]:
    twice = [2.0 * each for each in _cross(q[:3], v)]
    return _sum(_sum(v, [q[3] * each for each in twice]), _cross(q[:3], twice))


def _product(p: _Numbers, q: _Numbers) -> list[float]:
    """Return the quaternion of a rotation q in a frame that p has turned (Hamilton)."""
    return [
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] + p[1] * q[3] + p[2] * q[0] - p[0] * q[2],
        p[3] * q[2] + p[2] * q[3] + p[0] * q[1] - p[1] * q[0],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    ]
