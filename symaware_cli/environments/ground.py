"""The ground of the spatial world: a plane for what rolls, and a slab of the same height for what has faces.

On a plane PyBullet finds one more point of contact of a box in each physics step, so that a box that lands flat is
tipped first, and one that slides turns. On another box it finds all four at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from pydantic import Field

from symaware_cli.core import Parameters, Shape
from symaware_cli.environments import bullet_collisions
from symaware_cli.environments.bullet import engine

#: [m] How far the slab reaches beyond where bodies start, and how thick it is. The larger it is, the less exact is
#: where round faces touch it: the engine looks for that from the corners.
_REACH = 1000.0

#: [m] How much higher the slab is than the plane: boxes that only just touch a box are not found to.
_RAISED = 1e-5


class GroundPlane(Parameters):
    """A plane that everything falls on."""

    height: float = Field(0.0, ge=-1e9, le=1e9, description="Where it is [m].")
    friction: float = Field(1.0, ge=0, description="Coefficient of friction, times that of what lies on it.")
    elasticity: float = Field(1.0, ge=0, le=1, description="Elasticity, times that of what falls on it.")


def footing(shape: Shape | None) -> int:
    """The kind of a body that nothing holds: whether it meets the plane or the slab."""
    return bullet_collisions.FREE if shape is None or shape.circle else bullet_collisions.FACED


def make_plane(client: int, height: float) -> int:
    """Make what balls and vehicles stand on, without end.

    Args:
        client: The engine's client.
        height: How high it is [m].
    """
    shape = engine.createCollisionShape(engine.GEOM_PLANE, physicsClientId=client)
    return _made(client, shape, (0.0, 0.0, height))


def make_slab(client: int, height: float, starts: Iterable[Sequence[float]]) -> int:
    """Make what everything else stands on, around where it starts.

    Args:
        client: The engine's client.
        height: How high its top is [m].
        starts: Where bodies start that are to stand on it; at least one.
    """
    places = np.array([start[:2] for start in starts])
    low, high = places.min(axis=0), places.max(axis=0)
    half = [*(0.5 * (high - low) + _REACH).tolist(), 0.5 * _REACH]
    shape = engine.createCollisionShape(engine.GEOM_BOX, halfExtents=half, physicsClientId=client)
    x, y = (0.5 * (low + high)).tolist()
    # What is seen is the plane. Of a body that is said to look like nothing, its shape would be seen.
    speck = engine.createVisualShape(engine.GEOM_SPHERE, radius=1e-3, physicsClientId=client)
    return _made(client, shape, (x, y, height + _RAISED - 0.5 * _REACH), speck)


def _made(client: int, shape: int, position: Sequence[float], look: int = -1) -> int:
    body: int = engine.createMultiBody(0.0, shape, look, position, useMaximalCoordinates=1, physicsClientId=client)
    return body
