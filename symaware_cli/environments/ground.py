"""The ground of the spatial world: a plane for balls and wheels, and a slab of the same height for all other bodies.

On a plane PyBullet finds only one more contact point of a box in each physics step, so a box that lands flat is tipped
first, and a sliding box turns. On another box it finds all four at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from pydantic import Field

from symaware_cli.core import Parameters, Shape
from symaware_cli.environments import bullet_collisions
from symaware_cli.environments.bullet import engine

#: [m] How far the slab reaches beyond the bodies' initial positions, and its thickness. The larger it is, the less
#: exact are its contacts with round faces, which the engine computes from the corners.
_REACH = 1000.0

#: [m] How much higher the slab is than the plane: the engine misses the contacts of boxes that only just touch.
_RAISED = 1e-5


class GroundPlane(Parameters):
    """A plane that everything falls on."""

    height: float = Field(0.0, ge=-1e9, le=1e9, description="Where it is [m].")
    friction: float = Field(1.0, ge=0, description="Coefficient of friction, times that of what lies on it.")
    elasticity: float = Field(1.0, ge=0, le=1, description="Elasticity, times that of what falls on it.")


def collision_kind(shape: Shape | None) -> int:
    """Return the collision kind of a free body: whether it collides with the plane or with the slab."""
    return bullet_collisions.FREE if shape is None or shape.circle else bullet_collisions.FACED


def make_plane(client: int, height: float) -> int:
    """Create the infinite plane that balls and vehicles stand on.

    Args:
        client: The engine's client.
        height: Its height [m].
    """
    shape = engine.createCollisionShape(engine.GEOM_PLANE, physicsClientId=client)
    return _create(client, shape, (0.0, 0.0, height))


def make_slab(client: int, height: float, starts: Iterable[Sequence[float]]) -> int:
    """Create the slab that all other bodies stand on, around their initial positions.

    Args:
        client: The engine's client.
        height: The height of its top [m].
        starts: Initial positions of these bodies; at least one.
    """
    places = np.array([start[:2] for start in starts])
    low, high = places.min(axis=0), places.max(axis=0)
    half = [*(0.5 * (high - low) + _REACH).tolist(), 0.5 * _REACH]
    shape = engine.createCollisionShape(engine.GEOM_BOX, halfExtents=half, physicsClientId=client)
    x, y = (0.5 * (low + high)).tolist()
    # The plane is visible instead. Without a visual shape of its own the slab would be drawn as its collision shape.
    speck = engine.createVisualShape(engine.GEOM_SPHERE, radius=1e-3, physicsClientId=client)
    return _create(client, shape, (x, y, height + _RAISED - 0.5 * _REACH), speck)


def _create(client: int, shape: int, position: Sequence[float], look: int = -1) -> int:
    body: int = engine.createMultiBody(0.0, shape, look, position, useMaximalCoordinates=1, physicsClientId=client)
    return body
