"""Messages of ROS 2 Jazzy, with the definitions that the package `rosbags` ships."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

INSTALL = "pip install 'symaware-cli[ros]'"
"""The command that installs the modules for bags."""

WORLD = "world"
"""The frame that positions refer to."""

_SECOND = 1_000_000_000


@cache
def typestore() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def message(kind: str, **fields: Any) -> Any:
    """Create a message, such as one of the kind ``nav_msgs/msg/Path``."""
    return typestore().types[kind](**fields)


def stamp(time: int) -> Any:
    """Return a time [ns]."""
    return message("builtin_interfaces/msg/Time", sec=time // _SECOND, nanosec=time % _SECOND)


def header(time: int, frame: str = WORLD) -> Any:
    """Return the header of a message at a time [ns]."""
    return message("std_msgs/msg/Header", stamp=stamp(time), frame_id=frame)


def vector(values: Iterable[float], kind: str = "Vector3") -> Any:
    """Return a vector or a point of three coordinates."""
    x, y, z = values
    return message(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def quaternion(values: Iterable[float]) -> Any:
    """Return a quaternion x, y, z, w."""
    x, y, z, w = values
    return message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def pose(position: Sequence[float] = (0.0, 0.0, 0.0), orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
    """Return a pose."""
    return message("geometry_msgs/msg/Pose", position=vector(position, "Point"), orientation=quaternion(orientation))


def transforms(time: int, frames: Iterable[tuple[str, Sequence[float], Sequence[float]]]) -> Any:
    """Return the transforms of frames in the world at a time [ns]: name, position and orientation of each."""
    made = [
        message(
            "geometry_msgs/msg/TransformStamped",
            header=header(time),
            child_frame_id=name,
            transform=message(
                "geometry_msgs/msg/Transform", translation=vector(position), rotation=quaternion(orientation)
            ),
        )
        for name, position, orientation in frames
    ]
    return message("tf2_msgs/msg/TFMessage", transforms=made)


def odometry(time: int, frame: str, where: Any, linear: Sequence[float] | None, angular: Sequence[float] | None) -> Any:
    """Return an odometry message.

    Args:
        time: The time of the message [ns].
        frame: The frame of the body.
        where: The pose of the body in the world.
        linear: The velocity along the axes of the body [m/s]; None if unknown.
        angular: The angular velocity about these axes [rad/s]; None if unknown.
    """
    unknown: NDArray[np.float64] = np.zeros(36)
    unknown[[0, 7, 14]] = 0.0 if linear else -1.0
    unknown[[21, 28, 35]] = 0.0 if angular else -1.0
    twist = message(
        "geometry_msgs/msg/Twist",
        linear=vector(linear or (0.0, 0.0, 0.0)),
        angular=vector(angular or (0.0, 0.0, 0.0)),
    )
    return message(
        "nav_msgs/msg/Odometry",
        header=header(time),
        child_frame_id=frame,
        pose=message("geometry_msgs/msg/PoseWithCovariance", pose=where, covariance=np.zeros(36)),
        twist=message("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )


def laser_scan(measured: int, frame: str, angles: NDArray[np.float64], ranges: NDArray[np.float64], far: float) -> Any:
    """Return a scan with evenly spaced angles [rad] and ranges up to `far` [m], measured at a time [ns]."""
    step = float(angles[1] - angles[0]) if len(angles) > 1 else 0.0
    return message(
        "sensor_msgs/msg/LaserScan",
        header=header(measured, frame),
        angle_min=float(angles[0]),
        angle_max=float(angles[-1]),
        angle_increment=step,
        time_increment=0.0,
        scan_time=0.0,
        range_min=0.0,
        range_max=float(far),
        ranges=ranges.astype(np.float32),
        intensities=np.empty(0, np.float32),
    )


def path(time: int, points: Iterable[tuple[int, Any]]) -> Any:
    """Return a path at a time [ns]: the time [ns] and the pose of each point."""
    poses = [message("geometry_msgs/msg/PoseStamped", header=header(at), pose=where) for at, where in points]
    return message("nav_msgs/msg/Path", header=header(time), poses=poses)


def marker(frame: str, number: int, kind: str, **fields: Any) -> Any:
    """Return a marker of the given kind, attached to a frame.

    Args:
        frame: The frame.
        number: The number of the marker among those of this frame.
        kind: The kind of marker, such as ``CUBE``.
        fields: The fields to set: `scale`, `color`, `points`, `action`.
    """
    definition = typestore().types["visualization_msgs/msg/Marker"]
    # At time 0, RViz and Foxglove use the latest transform.
    nothing: dict[str, Any] = {
        "header": header(0, frame),
        "ns": frame,
        "id": number,
        "type": getattr(definition, kind),
        "action": 0,
        "pose": pose(),
        "scale": vector((1.0, 1.0, 1.0)),
        "color": colour((0, 0, 0)),
        "lifetime": message("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        "frame_locked": True,
        "points": [],
        "colors": [],
        "texture_resource": "",
        "texture": message(
            "sensor_msgs/msg/CompressedImage", header=header(0, ""), format="", data=np.empty(0, np.uint8)
        ),
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": message("visualization_msgs/msg/MeshFile", filename="", data=np.empty(0, np.uint8)),
        "mesh_use_embedded_materials": False,
    }
    return definition(**{**nothing, **fields})


def colour(parts: Iterable[int]) -> Any:
    """Return an opaque colour of red, green and blue from 0 to 255."""
    r, g, b = (part / 255.0 for part in parts)
    return message("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=1.0)
