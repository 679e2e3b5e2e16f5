"""Where the links of robots from files are, computed from the states of their agents by forward kinematics.

Reasons: docs/decisions/0080-robots-as-agents.md
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np

from symaware_cli.assets import Mechanism
from symaware_cli.geometry import Array, Articulation

#: The elements of a vector or a quaternion (x, y, z, w): numbers, or columns of all robots.
_Elements: TypeAlias = Sequence[Any] | Array


class _Piece(NamedTuple):
    """A link on the way from the base to another one, as `Link` describes it.

    Attributes:
        position: The origin of its frame in the frame of the parent [m].
        orientation: The orientation of its frame in that of the parent.
        motion: How its joint moves it: ``fixed`` also if the position of the joint is not known.
        axis: The axis of the joint.
        column: The column of its joint among those of the mechanism.
    """

    position: _Elements
    orientation: _Elements
    motion: str
    axis: _Elements
    column: int


class RobotLinks:
    """The links of a robot whose joints a mechanism reads from a state; see `symaware_cli.Model.links`.

    The positions of other joints are not known, such as of wheels that roll. Of the links that such a joint carries,
    only the origin of one that turns about it is known, as it is on the axis.

    Attributes:
        tree: All links and joints.
        names: The links whose positions are known, in the order of the tree.
        unknown: The other links, each with the reason.
    """

    uncaptured: ClassVar[Collection[str]] = "*"  # all follows from the file

    def __init__(self, tree: Articulation, mechanism: Mechanism, dimensions: int) -> None:
        """Find the links that are known.

        Args:
            tree: All links and joints.
            mechanism: Tells the poses of bases and the positions of joints of states.
            dimensions: The number of coordinates of the agents' positions, which those of links have as well.
        """
        self.tree = tree
        self._mechanism = mechanism
        self._dimensions = dimensions
        #: For each known link, the links from the base to it.
        self._chains: dict[str, Sequence[_Piece]] = {}
        known = mechanism.joints if mechanism.known is None else mechanism.known
        columns = {name: mechanism.joints.index(name) for name in known}
        unknown: dict[str, str] = {}
        for place, link in enumerate(tree.links):
            chain = [place]
            while chain[0] > 0:
                chain.insert(0, tree.links[chain[0]].parent)
            carried = [tree.links[each] for each in chain]
            free = [each.joint for each in carried if each.motion != "fixed" and each.joint not in columns]
            if free and not (free == [link.joint] and link.motion == "turn"):
                unknown[link.name] = (
                    f"the state does not say where the link `{link.name}` is: it has no position of the joint "
                    f"`{free[0]}`, which carries it"
                )
                continue
            self._chains[link.name] = [
                _Piece(
                    each.position,
                    each.orientation,
                    each.motion if each.joint in columns else "fixed",
                    each.axis,
                    columns.get(each.joint, -1),
                )
                for each in carried
            ]
        self.names = tuple(self._chains)
        self.unknown: Mapping[str, str] = unknown

    def positions(self, state: Array, link: str) -> Array:
        """Return the positions of the origin of a link's frame [m]; (n, nx) to (n, d)."""
        placed = self._mechanism.placed(state)
        base: _Elements
        if len(state) == 1:  # numbers, which are faster than arrays of one
            base, orientation, joints = (each[0].tolist() for each in placed)
        else:
            base, orientation, joints = (each.T.copy() for each in placed)
        found = _sum(base, _turned(orientation, _inner(self._chains[link], joints)))
        positions = np.empty((len(state), self._dimensions))
        for axis in range(self._dimensions):
            positions[:, axis] = found[axis]
        return positions


def _inner(chain: Sequence[_Piece], joints: Sequence[Any]) -> _Elements:
    """Return the position of the last link of a chain in the frame of the base."""
    position: _Elements = (0.0, 0.0, 0.0)
    orientation: _Elements = (0.0, 0.0, 0.0, 1.0)
    for number, piece in enumerate(chain):
        own_position, own_orientation = piece.position, piece.orientation
        if piece.motion == "turn":
            half = 0.5 * joints[piece.column]
            sine, cosine = np.sin(half), np.cos(half)
            if isinstance(half, float):
                sine, cosine = float(sine), float(cosine)
            x, y, z = piece.axis
            own_orientation = _product(own_orientation, (sine * x, sine * y, sine * z, cosine))
        elif piece.motion == "slide":
            moved = joints[piece.column]
            own_position = _sum(own_position, _turned(own_orientation, [moved * each for each in piece.axis]))
        if number == 0:
            position, orientation = own_position, own_orientation
            continue
        position = _sum(position, _turned(orientation, own_position))
        if number < len(chain) - 1:
            orientation = _product(orientation, own_orientation)
    return position


def _sum(one: _Elements, other: _Elements) -> _Elements:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _turned(orientation: _Elements, vector: _Elements) -> _Elements:
    """Turn a vector, as `symaware_cli.geometry.rotated` does."""
    x, y, z, w = orientation
    a, b, c = vector
    twice_a, twice_b, twice_c = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * twice_a + (y * twice_c - z * twice_b),
        b + w * twice_b + (z * twice_a - x * twice_c),
        c + w * twice_c + (x * twice_b - y * twice_a),
    )


def _product(outer: _Elements, inner: _Elements) -> _Elements:
    """Compose rotations, as `symaware_cli.geometry.composed` does."""
    x, y, z, w = outer
    a, b, c, d = inner
    return (
        w * a + x * d + y * c - z * b,
        w * b + y * d + z * a - x * c,
        w * c + z * d + x * b - y * a,
        w * d - x * a - y * b - z * c,
    )
