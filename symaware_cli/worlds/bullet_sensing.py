"""Ray casting and camera images in the spatial world, by PyBullet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symaware_cli.core import Image
from symaware_cli.geometry import Array, Indices, Mask
from symaware_cli.worlds.bullet import engine
from symaware_cli.worlds.colours import body_colour

#: The most rays that PyBullet casts at once.
_BATCH = engine.MAX_RAY_INTERSECTION_BATCH_SIZE - 1

#: How often a ray that hits the body it comes from is continued from there.
_OWN_PARTS = 64

#: [m] How far behind that surface it continues; from inside, the surface of a convex part is not hit.
_STEP = 1e-4

#: [m] The near and far planes of a camera.
NEAR, FAR = 0.02, 100.0

#: [m] Bodies that reach farther cannot be rendered: the renderer would not terminate.
_UTMOST = 1e7
#: [m] The engine's bounding box of an infinite plane reaches this far.
_PLANE = 1e29

#: The engine's colour of bodies without one.
_PLAIN = (1.0, 1.0, 1.0, 1.0)


def cast_rays(
    client: int, owner: Mapping[int, int], senders: Indices, origins: Array, directions: Array, reach: float
) -> Array:
    """Cast rays, each of which passes through the body that sends it.

    Args:
        client: PyBullet's client.
        owner: The index of the agent or entity that each of PyBullet's bodies belongs to.
        senders: The index of the agent that casts each ray, as in `owner`; shape (m,).
        origins: Origins [m]; shape (m, 3).
        directions: Unit vectors; shape (m, 3).
        reach: The greatest distance [m].

    Returns:
        Distances [m], infinite if nothing is hit; shape (m,).
    """
    distances = np.full(len(senders), np.inf)
    gone = np.zeros(len(senders))
    ends = origins + reach * directions
    waiting = np.arange(len(senders))
    for _ in range(_OWN_PARTS):
        starts = origins[waiting] + gone[waiting, None] * directions[waiting]
        bodies, shares = _hits(client, starts, ends[waiting])
        reached = gone[waiting] + shares * (reach - gone[waiting])
        own = np.array([owner.get(body, -2) for body in bodies], np.intp) == senders[waiting]
        found = np.array(bodies) >= 0
        distances[waiting[found & ~own]] = reached[found & ~own]
        gone[waiting] = reached + _STEP
        waiting = waiting[own & (gone[waiting] < reach)]
        if not len(waiting):
            break
    return distances


def is_clear(client: int, owner: Mapping[int, int], obstacles: range, starts: Array, ends: Array) -> Mask:
    """Return which lines of sight are not blocked by an obstacle; they pass through all other bodies.

    Args:
        client: PyBullet's client.
        owner: The index of the agent or entity that each of PyBullet's bodies belongs to.
        obstacles: The indices of the obstacles.
        starts: Starts of the lines [m]; shape (m, 3).
        ends: Ends of the lines [m]; shape (m, 3).

    Returns:
        Shape (m,).
    """
    free = np.ones(len(starts), bool)
    along = ends - starts
    length = np.sqrt((along * along).sum(axis=1))
    towards = along / np.maximum(length, _STEP)[:, None]
    gone = np.zeros(len(starts))
    waiting = np.arange(len(starts))
    while len(waiting):
        bodies, shares = _hits(client, starts[waiting] + gone[waiting, None] * towards[waiting], ends[waiting])
        gone[waiting] += shares * (length[waiting] - gone[waiting]) + _STEP
        blocked = np.array([owner.get(body, -1) in obstacles for body in bodies], bool)
        free[waiting[blocked]] = False
        waiting = waiting[~blocked & (np.array(bodies) >= 0) & (gone[waiting] < length[waiting])]
    return free


def _hits(client: int, starts: Array, ends: Array) -> tuple[list[int], Array]:
    """Return the first body that each ray hits, -1 for none, and the fraction of its length, for (m, 3) each."""
    hits: list[tuple[int, float]] = []
    for first in range(0, len(starts), _BATCH):
        some = slice(first, first + _BATCH)
        # One thread: keeps the answers in the order of the rays, and a scan is too short for more.
        batch = engine.rayTestBatch(starts[some].tolist(), ends[some].tolist(), numThreads=1, physicsClientId=client)
        hits += [(hit[0], hit[2]) for hit in batch]
    return [body for body, _ in hits], np.array([share for _, share in hits])


def colour(client: int, owner: Mapping[int, int], agents: int) -> None:
    """Colour bodies that have no colour: agents in distinct bright hues, entities in grey.

    Args:
        client: PyBullet's client.
        owner: The index of the agent or entity that each of PyBullet's bodies belongs to.
        agents: The number of agents; they have the first indices.
    """
    for body, index in owner.items():
        looks = engine.getVisualShapeData(body, physicsClientId=client)
        if engine.getNumJoints(body, client) or any(tuple(look[7]) != _PLAIN for look in looks):
            continue  # from a file, with colours of its own
        engine.changeVisualShape(body, -1, rgbaColor=[*body_colour(index, agents), 1.0], physicsClientId=client)


def render(
    client: int,
    owner: Mapping[int, int],
    position: Sequence[float],
    target: Sequence[float],
    size: tuple[int, int],
    field_of_view: float,
) -> Image:
    """Render an image, with the world's z axis upwards; see `Environment.camera_image`.

    Depth follows from the depth buffer of OpenGL, d in [0, 1]: far near / (far - (far - near) d).

    Raises:
        ValueError: A body or the camera is too far away.
    """
    ends = [abs(each) for body in owner for corner in engine.getAABB(body, -1, client) for each in corner]
    reach = max(*map(abs, position), *(each for each in ends if each < _PLANE))
    if not reach <= _UTMOST:
        raise ValueError(f"bodies or the camera are as far away as {reach:.3g} m; images are limited to {_UTMOST:g} m")
    width, height = size
    straight = abs(position[0] - target[0]) + abs(position[1] - target[1]) < 1e-9
    view = engine.computeViewMatrix(position, target, (1.0, 0.0, 0.0) if straight else (0.0, 0.0, 1.0))
    projection = engine.computeProjectionMatrixFOV(np.degrees(field_of_view), width / height, NEAR, FAR)
    _, _, colour, depth, bodies = engine.getCameraImage(
        width, height, view, projection, renderer=engine.ER_TINY_RENDERER, physicsClientId=client
    )
    depth = np.asarray(depth, float).reshape(height, width)
    bodies = np.asarray(bodies, np.intp).reshape(height, width)
    number = np.zeros(max(owner, default=0) + 2, np.uint16)
    for body, index in owner.items():
        number[body + 1] = index + 1
    segments = number[np.clip(bodies, -1, len(number) - 2) + 1]
    return Image(
        np.asarray(colour, np.uint8).reshape(height, width, 4)[..., :3].copy(),
        np.where(bodies < 0, np.inf, FAR * NEAR / (FAR - (FAR - NEAR) * depth)),
        segments,
    )
