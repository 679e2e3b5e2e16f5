"""Scans and images: what lidars and cameras of a group took at an instant, as plain values that nobody changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scan:
    """Distances along rays in a level plane around each agent.

    Attributes:
        time: The instant that was measured, in nanoseconds.
        angles: Where the rays point, counter-clockwise from the heading [rad]; shape (k,).
        distances: How far each ray goes until it meets something [m]; infinite where there is nothing within range,
            NaN where the sensor missed what there is; shape (n, k).
        range: The greatest distance that is measured [m].
        poses: Where the sensors truly stood, x, y, z [m] and heading [rad], for the log; shape (n, 4).
    """

    time: int
    angles: Array
    distances: Array
    range: float
    poses: Array


@dataclass(frozen=True, slots=True)
class Image:
    """What a camera saw.

    Attributes:
        colour: Red, green and blue; shape (height, width, 3).
        depth: Distance from the plane of the camera [m], infinite where there is nothing; shape (height, width).
        segments: What is seen: 0 for nothing, else one more than the place of the body among the agents in the order of
            the roster, the entities by name, and the ground; shape (height, width).
    """

    colour: NDArray[np.uint8]
    depth: Array
    segments: NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class Frame:
    """The images of the cameras of a group.

    Attributes:
        time: The instant that was seen, in nanoseconds.
        images: One for each agent; None where the camera lost it.
        field_of_view: The angle from the lower to the upper edge [rad].
        positions: Where the cameras were [m]; shape (n, 3).
        targets: A point in the middle of each image [m]; shape (n, 3).
    """

    time: int
    images: Sequence[Image | None]
    field_of_view: float
    positions: Array
    targets: Array


Reading = Scan | Frame
