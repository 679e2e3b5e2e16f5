"""Messages of ROS 2 Jazzy in the JSON of a rosbridge: the clock, transforms, odometry and scans."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.bags import ros_messages as ros
from symaware_ros.rosbridge import Published

CLOCK, TRANSFORMS = "rosgraph_msgs/msg/Clock", "tf2_msgs/msg/TFMessage"
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"


def as_json(message: Any) -> Any:
    """Return a message as plain values: mappings, lists, numbers and texts."""
    if is_dataclass(message):
        names = [each.name for each in fields(message) if not each.name.startswith("__")]
        return {name: as_json(getattr(message, name)) for name in names}
    if isinstance(message, np.ndarray | np.generic):
        return message.tolist()
    return [as_json(each) for each in message] if isinstance(message, list | tuple) else message


def clock(topic: str, time: int) -> Published:
    """Return the time [ns] as a message."""
    return Published(topic, CLOCK, {"clock": as_json(ros.stamp(time))})


def transforms(topic: str, time: int, frames: Iterable[tuple[str, str, Sequence[float], float]]) -> Published:
    """Return the poses of frames at a time [ns]: parent, name, position and heading of each."""
    several = list(frames)
    content = as_json(ros.transforms(time, [(name, at, turned(heading)) for _, name, at, heading in several]))
    for each, (parent, *_) in zip(content["transforms"], several, strict=True):
        each["header"]["frame_id"] = parent
    return Published(topic, TRANSFORMS, content)


def odometry(
    topic: str,
    time: int,
    frames: tuple[str, str],
    position: Sequence[float],
    heading: float,
    motion: Mapping[str, float],
) -> Published:
    """Return the pose and the velocity of a body.

    Args:
        topic: The topic.
        time: The time [ns].
        frames: The frame of the position, and that of the body.
        position: The position of the body, x, y, z [m].
        heading: The heading of the body [rad].
        motion: The known quantities of its velocity, by their names in models: ``speed``, ``turn_rate``,
            ``velocity_x``, ...
    """
    parent, body = frames
    linear, angular = _velocities(heading, motion)
    content = as_json(ros.odometry(time, body, ros.pose(position, turned(heading)), linear, angular))
    content["header"]["frame_id"] = parent
    return Published(topic, ODOMETRY, content)


def scan(
    topic: str, measured: int, frame: str, angles: NDArray[np.float64], distances: NDArray[np.float64], far: float
) -> Published:
    """Return distances along rays, which were measured at a time [ns].

    JSON has no numbers that are not finite. A ray without an object gets a distance beyond the range, and a missed one
    a negative distance: by the definition of the message, receivers discard both.
    """
    ranges = np.where(np.isnan(distances), -1.0, np.where(np.isinf(distances), far + 1.0, distances))
    return Published(topic, SCAN, as_json(ros.laser_scan(measured, frame, angles, ranges, far)))


def is_even(angles: NDArray[np.float64]) -> bool:
    """Whether rays are evenly spaced, as messages require."""
    return bool(len(angles)) and np.allclose(angles, np.linspace(angles[0], angles[-1], len(angles)))


def turned(heading: float) -> tuple[float, float, float, float]:
    """Return a heading [rad] as a quaternion x, y, z, w."""
    return 0.0, 0.0, float(np.sin(0.5 * heading)), float(np.cos(0.5 * heading))


def _velocities(
    heading: float, motion: Mapping[str, float]
) -> tuple[tuple[float, float, float] | None, tuple[float, float, float] | None]:
    """Return linear and angular velocity along the axes of the body; None for an unknown one."""
    angular = (0.0, 0.0, motion["turn_rate"]) if "turn_rate" in motion else None
    if "speed" in motion:
        return (motion["speed"], 0.0, motion.get("climb_rate", 0.0)), angular
    if "velocity_x" not in motion or "velocity_y" not in motion:
        return None, angular
    x, y, cosine, sine = motion["velocity_x"], motion["velocity_y"], float(np.cos(heading)), float(np.sin(heading))
    return (x * cosine + y * sine, y * cosine - x * sine, motion.get("velocity_z", 0.0)), angular
