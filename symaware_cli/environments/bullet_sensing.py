"""Sensing in the spatial world: rays and images, as PyBullet has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from colorsys import hsv_to_rgb

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Image
from symaware_cli.environments.bullet import engine

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

#: The most rays that PyBullet casts at once.
_BATCH = engine.MAX_RAY_INTERSECTION_BATCH_SIZE - 1

#: How often a ray that meets the body it comes from is sent on from there.
_OWN_PARTS = 64

#: [m] How far behind the surface of the own body it goes on; from inside a convex part, its own surface is not seen.
_STEP = 1e-4

#: [m] What is nearer to a camera than the first, or farther than the second, is not seen.
NEAR, FAR = 0.02, 100.0

#: [m] Nothing may reach beyond this where an image is made: the renderer would not end.
_UTMOST = 1e7
#: [m] A plane, which has no end, is said to have it there.
_PLANE = 1e29

#: Hues that differ by the golden section are spread evenly, however many there are.
_GOLDEN = 0.6180339887
_GREY = (0.6, 0.6, 0.63)
#: What is not said to look like anything.
_PLAIN = (1.0, 1.0, 1.0, 1.0)


def cast_rays(
    client: int, owner: Mapping[int, int], senders: Indices, origins: Array, directions: Array, reach: float
) -> Array:
    """Cast rays, each of which passes through the body that sends it.

    Args:
        client: PyBullet's client.
        owner: Whose each of PyBullet's bodies is.
        senders: Who sends each ray, as in `owner`; shape (m,).
        origins: Where they begin [m]; shape (m, 3).
        directions: Where they point, of length 1; shape (m, 3).
        reach: The greatest distance [m].

    Returns:
        Distances [m], infinite where there is nothing within reach; shape (m,).
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


def is_clear(client: int, owner: Mapping[int, int], obstacles: range, starts: Array, ends: Array) -> NDArray[np.bool_]:
    """Tell which lines meet no obstacle; everything else is passed through.

    Args:
        client: PyBullet's client.
        owner: Whose each of PyBullet's bodies is.
        obstacles: Who stands in the way.
        starts: Where lines begin [m]; shape (m, 3).
        ends: Where they end [m]; shape (m, 3).

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
    """The body that each ray meets first, -1 for none, and after which share of its way; (m, 3) each."""
    hits: list[tuple[int, float]] = []
    for first in range(0, len(starts), _BATCH):
        some = slice(first, first + _BATCH)
        # One thread: the order of rays is that of the answers, and a scan is too short for more.
        batch = engine.rayTestBatch(starts[some].tolist(), ends[some].tolist(), numThreads=1, physicsClientId=client)
        hits += [(hit[0], hit[2]) for hit in batch]
    return [body for body, _ in hits], np.array([share for _, share in hits])


def colour(client: int, owner: Mapping[int, int], agents: int) -> None:
    """Give what has no colours some: agents bright ones, of which no two neighbours look alike, and entities grey.

    Args:
        client: PyBullet's client.
        owner: Whose each of PyBullet's bodies is.
        agents: How many agents there are; they come first.
    """
    for body, index in owner.items():
        looks = engine.getVisualShapeData(body, physicsClientId=client)
        if engine.getNumJoints(body, client) or any(tuple(look[7]) != _PLAIN for look in looks):
            continue  # of a file, which says what it looks like
        colour = _GREY if index >= agents else hsv_to_rgb(index * _GOLDEN % 1.0, 0.7, 0.8)
        engine.changeVisualShape(body, -1, rgbaColor=[*colour, 1.0], physicsClientId=client)


def render(
    client: int,
    owner: Mapping[int, int],
    position: Sequence[float],
    target: Sequence[float],
    size: tuple[int, int],
    field_of_view: float,
) -> Image:
    """Make an image; see `Environment.camera_image`. Upwards in it is upwards in the world.

    Depth comes from that of OpenGL, d in [0, 1]: far near / (far - (far - near) d).

    Raises:
        ValueError: A body or the camera is too far away.
    """
    ends = [abs(each) for body in owner for corner in engine.getAABB(body, -1, client) for each in corner]
    reach = max(*map(abs, position), *(each for each in ends if each < _PLANE))
    if not reach <= _UTMOST:
        raise ValueError(f"there is no image of what reaches as far as {reach:.3g} m; {_UTMOST:g} m are possible")
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
