"""Sensor readings: scans of lidars and images of cameras of a group at an instant, as immutable values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.world.records import record

Array = NDArray[np.float64]


@record
class Scan:
    """Distances along horizontal rays around each agent.

    Attributes:
        time: The instant that was measured, in nanoseconds.
        angles: Directions of the rays, counter-clockwise from the heading [rad]; shape (k,).
        distances: Distances along the rays [m]; infinite if nothing is within range, NaN if the sensor missed it; shape
            (n, k).
        range: The greatest distance that is measured [m].
        poses: The true poses of the sensors, x, y, z [m] and heading [rad], for the log; shape (n, 4).
        mount: Where the sensor sits on the body: forwards, leftwards, upwards of its position [m].
    """

    time: int
    angles: Array
    distances: Array
    range: float
    poses: Array
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)


@record
class Image:
    """An image of a camera.

    Attributes:
        colour: Red, green and blue; shape (height, width, 3).
        depth: Distance from the plane of the camera [m], infinite for no body; shape (height, width).
        segments: The body in each pixel: 0 for none, else one plus its index among the agents in the roster's order,
            the entities by name, and the ground; shape (height, width).
    """

    colour: NDArray[np.uint8]
    depth: Array
    segments: NDArray[np.uint16]


@record
class Frame:
    """The images of the cameras of a group.

    Attributes:
        time: The instant of the images, in nanoseconds.
        images: The image of each agent; None if the camera missed it.
        field_of_view: The angle from the lower to the upper edge [rad].
        positions: The positions of the cameras [m]; shape (n, 3).
        targets: A point at the centre of each image [m]; shape (n, 3).
    """

    time: int
    images: Sequence[Image | None]
    field_of_view: float
    positions: Array
    targets: Array


Reading = Scan | Frame
