"""Recorded motions: the poses of a body over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.bags.bag import Bag
from symaware_cli.bags.bag_error import BagError
from symaware_cli.bags.recorded_messages import TimeSource, check_topic, decoded, require_rosbags, time_of
from symaware_cli.geometry import LARGEST, ScriptedPath, yaws
from symaware_cli.log import LogError, open_log

MOST_POSES = 100_000
"""The greatest number of poses of a body."""

POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
"""The types of messages with the pose of one body."""

_TRANSFORMS = "tf2_msgs/msg/TFMessage"

Pose = tuple[Sequence[float], Sequence[float]]
"""Position [m] and orientation, x, y, z, w."""


@dataclass(frozen=True)
class RecordedMotion:
    """The poses of a body.

    Attributes:
        times: The times of the poses, ascending [ns]; shape (k,).
        positions: The positions [m]; shape (k, 3).
        headings: The headings, without jumps by a full turn [rad]; shape (k,).
    """

    times: NDArray[np.int64]
    positions: NDArray[np.float64]
    headings: NDArray[np.float64]

    def path(self, origin: int, start: float, in_space: bool) -> ScriptedPath:
        """Return the motion as a path.

        Args:
            origin: The time of the recording [ns] that becomes `start`.
            start: The simulated time of `origin` [s].
            in_space: Whether positions have three coordinates.
        """
        return ScriptedPath(
            times=tuple(start + (time - origin) / 1e9 for time in self.times.tolist()),
            positions=tuple(map(tuple, self.positions[:, : 3 if in_space else 2].tolist())),
            headings=tuple(self.headings.tolist()),
        )


def motion_on_topic(bag: Bag, topic: str, source: TimeSource) -> RecordedMotion:
    """Return the motion that the messages on a topic describe.

    Raises:
        BagError: The messages describe no motion, or are damaged.
    """
    kind = check_topic(bag, topic, POSES)
    frames: dict[str, None] = {}

    def poses() -> Iterator[tuple[int, Pose]]:
        for received, content in decoded(bag, topic, kind):
            frames[content.header.frame_id] = None
            yield time_of(received, content.header, source), pose_in(content)

    motion = _motion(poses(), f"`{topic}`", source)
    if len(frames) > 1:
        raise BagError(f"the poses on `{topic}` are in several frames: {', '.join(frames)}")
    return motion


def pose_in(content: Any) -> Pose:
    """Return the pose in a message of one of the types `POSES`."""
    if hasattr(content, "transform"):
        at, turned = content.transform.translation, content.transform.rotation
    else:
        where = content.pose
        while not hasattr(where, "position"):
            where = where.pose
        at, turned = where.position, where.orientation
    return (at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w)


def motion_of_frame(bag: Bag, frame: str, source: TimeSource) -> RecordedMotion:
    """Return the motion of a frame from the transforms on ``/tf``.

    Raises:
        BagError: There is no such frame, or it is relative to a frame that moves as well.
    """
    check_topic(bag, "/tf", (_TRANSFORMS,))
    parents: dict[str, dict[str, None]] = {}

    def poses() -> Iterator[tuple[int, Pose]]:
        for received, content in decoded(bag, "/tf", _TRANSFORMS):
            for each in content.transforms:
                parents.setdefault(each.child_frame_id, {})[each.header.frame_id] = None
                if each.child_frame_id == frame:
                    yield time_of(received, each.header, source), pose_in(each)

    found = list(poses())
    if frame not in parents:
        raise BagError(f"no frame `{frame}` is on /tf; there are {', '.join(sorted(parents)[:20]) or 'none'}")
    for parent in parents[frame]:
        if parent in parents:
            raise BagError(f"the frame `{frame}` is relative to `{parent}`, which moves as well")
    if len(parents[frame]) > 1:
        raise BagError(f"the frame `{frame}` is relative to several: {', '.join(parents[frame])}")
    return _motion(iter(found), f"the frame `{frame}`", source)


def motion_in_log(path: Path, name: str) -> RecordedMotion:
    """Return the true motion of an agent or an entity in a log of SymAware.

    Raises:
        BagError: The log does not contain the motion.
    """
    try:
        log = open_log(path)
        damage = log.verify()
        log.require_manifest()
        if damage is not None and damage.lost:
            raise BagError(str(damage))
        series = log.series(name, "world")
    except LogError as error:
        raise BagError(str(error)) from error
    columns = series.columns
    if not {"x", "y"} <= set(columns):
        raise BagError(f"the state of `{name}` has no x and y")
    wanted: dict[str, NDArray[np.float64]] = {
        each: series.values[:, columns.index(each)] for each in ("x", "y", "z", "heading", "yaw") if each in columns
    }
    nothing = np.zeros(len(series.times))
    places = np.stack([wanted.get(axis, nothing) for axis in "xyz"], axis=1)
    headings = np.unwrap(wanted.get("heading", wanted.get("yaw", nothing)))
    return _checked(series.times, places, headings, f"`{name}`", "received")


def _motion(poses: Iterator[tuple[int, Pose]], who: str, source: TimeSource) -> RecordedMotion:
    require_rosbags()
    found: list[tuple[int, Pose]] = []
    for each in poses:
        found.append(each)
        if len(found) > MOST_POSES:
            raise BagError(f"{who} has more than {MOST_POSES:,} poses")
    if not found:
        raise BagError(f"{who} has no messages")
    times = np.array([time for time, _ in found], np.int64)
    positions = np.array([position for _, (position, _) in found], float)
    turned = np.array([orientation for _, (_, orientation) in found], float)
    lengths = np.sqrt((turned * turned).sum(axis=1))
    wrong = np.flatnonzero(~(np.abs(lengths - 1.0) < 1e-2))
    if len(wrong):
        raise BagError(f"{who} has an orientation at {times[wrong[0]]} ns that is no unit quaternion")
    headings = np.unwrap(yaws(turned / lengths[:, None]))
    return _checked(times, positions, headings, who, source)


def _checked(
    times: NDArray[np.int64],
    positions: NDArray[np.float64],
    headings: NDArray[np.float64],
    who: str,
    source: TimeSource,
) -> RecordedMotion:
    """Return a motion with ascending times; among several poses at one time, the last is used."""
    wrong = np.flatnonzero(~(np.abs(positions) <= LARGEST).all(axis=1) | ~np.isfinite(headings))
    if len(wrong):
        raise BagError(f"{who} has a pose at {times[wrong[0]]} ns that is not finite")
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        raise BagError(f"the times of {who} go back, from {times[back[0]]} to {times[back[0] + 1]} ns")
    last = np.append(np.diff(times) > 0, True)
    if last.sum() < 2:
        hint = (
            "; its messages have no stamps: `clock: received` takes the times of recording" if not times.any() else ""
        )
        raise BagError(f"{who} has a pose at one time only, and a motion needs two{hint if source == 'stamp' else ''}")
    return RecordedMotion(times[last], positions[last], headings[last])
