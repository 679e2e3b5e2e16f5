"""Confinement: sets that others stay in according to an agent's knowledge, such as from promises.

Reasons: docs/decisions/0100-confinement.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from symaware_cli.geometry import Array, Indices, Pieces, separation_from_points

if TYPE_CHECKING:
    from symaware_cli.awareness import Tracks


class Confined(NamedTuple):
    """Convex sets of the plane that contain the present and later positions of others; one set in each row.

    Attributes:
        rows: The row of the tracks that each set confines, ascending; several sets may confine the same row; shape
            (k,).
        sets: The sets; shape (k,).
        breach: The declared probability that the other leaves the set; shape (k,).
    """

    rows: Indices
    sets: Pieces
    breach: Array

    def nearest(self, points: Array) -> Array:
        """Return points of the tracks, with those of confined others moved to the nearest point of their sets.

        The projection does not increase the distance to any point of a convex set, so no prediction becomes worse if
        the other stays in the set. With several sets, a point is projected onto one after the other.

        Args:
            points: Points of each row of the tracks [m]; shape (..., m, d).
        """
        moved = points.copy()
        flat = moved.reshape(-1, *points.shape[-2:])
        for place, row in enumerate(self.rows.tolist()):
            some = flat[:, row, :2]
            piece = self.sets.take(np.full(len(some), place))
            found = separation_from_points(some, np.zeros(len(some)), piece)
            outside = found.distance > 0.0
            flat[outside, row, :2] = found.second[outside]
        return moved

    def leave(self, tracks: Tracks) -> Array:
        """Return an upper bound of the probability that an agent's others leave their sets; shape (n,).

        The probabilities are added (Boole's inequality).
        """
        total = np.zeros(len(tracks.pointers) - 1)
        np.add.at(total, tracks.observers[self.rows], self.breach)
        return np.minimum(total, 1.0)


class Confinement(ABC):
    """A source of confinements, built by a section of the scenario and found in `AgentGroup.sections`.

    The sets depend only on the section and on the awareness of the agents, so that they are the same in every process.
    """

    @abstractmethod
    def confined(self, group: Any, tracks: Tracks) -> Confined | None:
        """Return the sets in which the agents of a group know others to stay; None if there are none.

        Args:
            group: The `AgentGroup`.
            tracks: The beliefs of the group about others; rows of others without a set are left out of the result.
        """

    def breach(self, group: Any) -> Mapping[tuple[int, int], float]:
        """Return the declared probability that an agent's other leaves its sets, whether or not the sets are known yet.

        A chance constraint accounts for it from the beginning. It is by the row of the agent, and the index of the
        other in the roster; by default there is none.

        Args:
            group: The `AgentGroup`.
        """
        return {}
