"""The geometries of the engine: which bodies they belong to, which of them collide, and what rays and cameras see.

Reasons: docs/decisions/0079-mujoco.md
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, ClassVar

import mujoco
import numpy as np

from symaware_cli.core import Image
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.worlds import body_colour
from symaware_mujoco.cameras import render
from symaware_mujoco.scene import AGENTS, ENTITIES, FLOOR, HIDDEN, LOOKS, Surface

#: The groups of geometries that rays of a lidar meet, and those that hide agents from each other.
_SOLID, _OPAQUE = np.array([1, 1, 1, 0, 1, 0], np.uint8), np.array([1, 0, 0, 0, 0, 0], np.uint8)


class Geometries:
    """The geometries of a compiled model.

    Attributes:
        owners: The index of the body that each belongs to: agents, then entities, then the ground.
        types: The collision types (bits) of each while its agent is present.
    """

    #: All of it follows from the scenario.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self, model: Any, surfaces: Sequence[Surface], agents: int, ground: int, dressed: Sequence[int]
    ) -> None:
        """Set the groups of the geometries in the engine.

        Args:
            model: The engine's model.
            surfaces: The surface of each geometry.
            agents: The number of agents.
            ground: The index of the ground.
            dressed: The indices of bodies with visual shapes.
        """
        self.owners = owners = np.array([each.owner for each in surfaces], np.intp)
        self.types = model.geom_contype.copy()
        self._affinities = model.geom_conaffinity.copy()
        looks = model.geom_group == LOOKS
        kinds = np.select([owners < agents, owners >= ground], [AGENTS, FLOOR], ENTITIES)
        model.geom_group[:] = self._groups = np.where(looks, LOOKS, kinds).astype(np.int32)
        #: Geometries that cameras do not see: collision shapes of bodies with visual shapes.
        self._unseen = np.flatnonzero(~looks & np.isin(owners, np.array(dressed, np.intp)))
        plain = [body_colour(index, agents) for index in owners.tolist()]
        self._colours = np.where(looks[:, None], model.geom_rgba[:, :3], np.array(plain).reshape(-1, 3))
        self._of_agents = [np.flatnonzero(owners == index) for index in range(agents)]
        self._hit = np.zeros(1, np.int32)

    def show(self, model: Any, present: Mask | None) -> None:
        """Let the bodies of present agents, but not of absent ones, collide and stop rays.

        Args:
            model: The engine's model.
            present: Whether each agent is present; None if all of them are.
        """
        bits = (model.geom_contype, self.types), (model.geom_conaffinity, self._affinities)
        for index, geometries in enumerate(self._of_agents):
            there = present is None or bool(present[index])
            for into, own in bits:
                into[geometries] = own[geometries] if there else 0
            model.geom_group[geometries] = self._groups[geometries] if there else HIDDEN

    def ray_cast(
        self, model: Any, data: Any, senders: Indices, starts: Array, directions: Array, reach: float
    ) -> Array:
        """Measure horizontal rays, which pass through the bodies of their senders.

        Args:
            model: The engine's model.
            data: The engine's data.
            senders: The agents that send rays; shape (n,).
            starts: The origins of the rays [m]; shape (n, 3).
            directions: The directions of the rays of each sender in the plane, unit vectors; shape (n, k, 2).
            reach: The greatest distance [m].

        Returns:
            Distances [m], infinite for rays that meet nothing; shape (n, k).
        """
        mujoco.mj_kinematics(model, data)
        distances = np.full(directions.shape[:2], np.inf)
        count = directions.shape[1]
        geometries, found, normals = np.empty(count, np.int32), np.empty(count), np.empty((3 * count, 1))
        for row, sender in enumerate(senders.tolist()):
            towards = np.zeros((count, 3))
            towards[:, :2] = directions[row]
            # A body may have several parts.
            own = self._of_agents[sender]
            groups = model.geom_group[own]
            model.geom_group[own] = HIDDEN
            mujoco.mj_multiRay(
                model, data, starts[row], towards.ravel(), _SOLID, True, -1, geometries, found, normals, count, reach
            )
            model.geom_group[own] = groups
            distances[row] = np.where(found < 0.0, np.inf, found)
        return distances

    def is_free(self, model: Any, data: Any, start: Array, end: Array) -> bool:
        """Return whether no opaque body is between two points [m], shape (3,), in up-to-date data."""
        hit = mujoco.mj_ray(model, data, start, end - start, _OPAQUE, True, -1, self._hit, None)
        return not 0.0 <= hit <= 1.0

    def image(
        self,
        model: Any,
        data: Any,
        position: Sequence[float],
        target: Sequence[float],
        size: tuple[int, int],
        field_of_view: float,
    ) -> Image:
        """Make an image from a position towards a target; see `Environment.camera_image`."""
        mujoco.mj_kinematics(model, data)
        ground = np.flatnonzero(self._groups == FLOOR)
        seen = self.owners, self._colours, self._unseen, ground
        return render(model, data, *seen, position, target, size, field_of_view)
