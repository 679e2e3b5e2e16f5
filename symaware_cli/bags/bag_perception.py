"""A recorded topic as a sensor of agents.

Reasons: docs/decisions/0093-bags.md
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from symaware_cli.assets import AssetFolders
from symaware_cli.awareness import MEASUREMENT
from symaware_cli.bags.bag import Bag
from symaware_cli.bags.bag_error import BagError
from symaware_cli.bags.recorded_messages import TimeSource, check_topic, decoded, time_of
from symaware_cli.bags.recorded_motion import POSES, pose_in
from symaware_cli.core import AgentGroup, Quantity, Scan, Signal, WorldError
from symaware_cli.engine import Sensor, SensorParameters
from symaware_cli.geometry import AssetPath, Number, yaws
from symaware_cli.world import Parameters as PluginParameters
from symaware_cli.world import nanoseconds

Kind = Literal["scan", "imu", "pose"]

#: The types of messages of each kind of reading.
_TYPES: Mapping[Kind, tuple[str, ...]] = {
    "scan": ("sensor_msgs/msg/LaserScan",),
    "imu": ("sensor_msgs/msg/Imu",),
    "pose": POSES,
}
#: The columns of each kind of reading that is no scan.
_QUANTITIES: Mapping[Kind, tuple[Quantity, ...]] = {
    "imu": (
        *(Quantity(f"acceleration_{axis}", "m/s^2") for axis in "xyz"),
        *(Quantity(f"rate_{axis}", "rad/s") for axis in "xyz"),
    ),
    "pose": (*(Quantity(axis, "m") for axis in "xyz"), Quantity("heading", "rad")),
}
_MOST_MESSAGES = 1_000_000


class RecordedTopic(PluginParameters):
    """A topic of a bag."""

    file: AssetPath = Field(description="A bag of ROS 2 as one .mcap or .db3 file, below the scenario's folder.")
    topic: str = Field(description="The topic, such as `/scan`.")
    start: Number = Field(0.0, description="The simulated time of the first message of the bag [s].")
    clock: TimeSource = Field(
        "stamp", description="Times to use: the stamps of the messages, or the times of recording."
    )

    @field_validator("file")
    @classmethod
    def _is_a_file(cls, file: str) -> str:
        if not file.lower().endswith((".mcap", ".db3")):
            raise ValueError("it is one .mcap or .db3 file")
        return file


class BagPerception(Sensor):
    """Plays a topic of a bag back to the agents of its group: scans, poses, or inertial measurements.

    At each turn it publishes the latest message up to then, if it is new; intervals between messages are those of the
    recording. Before the first message there is no reading, and after the last message there is no new one. All agents
    of the group get the same readings, since the recording does not react to their motion.

    Scans are stored among the readings of the group's awareness under the name of the component, like those of
    `perception.lidar`; a distance beyond the range of the sensor is infinite, and one below it is missing. Poses and
    inertial measurements are a signal, like those of `perception.imu`.
    """

    uncaptured: ClassVar = ("_times", "_messages")

    _times: list[int]
    _messages: list[Any]

    class Parameters(SensorParameters):
        """The recording, and the kind of its readings."""

        bag: RecordedTopic = Field(description="The recording, and the topic in it.")
        reading: Kind = Field(
            "scan", description="Kind of readings: scans (LaserScan), imu (Imu), or poses (Odometry, PoseStamped, ...)."
        )

    def __init__(self, parameters: Any) -> None:
        """Declare the signal, which depends on the kind of readings."""
        super().__init__(parameters)
        if parameters.reading in _QUANTITIES:
            quantities = _QUANTITIES[parameters.reading]
            signal = Signal(MEASUREMENT, "vector", quantities, description="as recorded")
            self.signals = (signal,)  # type: ignore[misc] # an attribute of the class in sensors, of the instance here

    def check(self, group: AgentGroup) -> None:
        """Read the topic."""
        self._times, self._messages = [], []
        named, reading = self.parameters.bag, self.parameters.reading
        if not (group.folder / named.file).is_file():
            return  # reported at the name of the file
        try:
            bag = Bag(named.file, AssetFolders(group.folder))
            kind = check_topic(bag, named.topic, _TYPES[reading])
            convert = {"scan": _scan, "imu": _imu, "pose": _pose}[reading]
            for received, content in decoded(bag, named.topic, kind):
                at = time_of(received, content.header, named.clock) - bag.start + nanoseconds(named.start)
                if self._times and at < self._times[-1]:
                    raise BagError(f"the times on `{named.topic}` go back at {received} ns")
                if len(self._times) == _MOST_MESSAGES:
                    raise BagError(f"there are more than {_MOST_MESSAGES:,} messages on `{named.topic}`")
                self._times.append(at)
                self._messages.append(convert(content))
        except (BagError, WorldError) as error:
            raise ValueError(f"the bag `{named.file}` cannot be used: {error}") from error

    def initialise_component(self, group: AgentGroup) -> None:
        """Start before the first message."""
        super().initialise_component(group)
        #: The number of messages up to the last published one.
        self._played = 0

    def measure(self, present: None) -> Any:
        """Return the latest message as a reading of all agents; None if it is not new."""
        played = bisect_right(self._times, self.now)
        if played == self._played:
            return None
        count, found = len(self._group), self._messages[played - 1]
        if self.parameters.reading != "scan":
            return played, self.with_dropouts(np.tile(found, (count, 1)))
        angles, distances, far = found
        several = np.tile(distances, (count, 1))
        if self.parameters.dropout:
            several[self.random.uniform(len(angles), "dropout") < self.parameters.dropout] = np.nan
        poses = np.zeros((count, 4))
        positions = self.environment.snapshot().positions[self._start : self._start + count]
        poses[:, : positions.shape[1]], poses[:, 3] = positions, self._headings()
        for array in (several, poses):
            array.flags.writeable = False
        return played, Scan(self._times[played - 1], angles, several, far, poses)

    def _publish(self, found: Any) -> None:
        if found is not None:
            self._played, reading = found
            super()._publish(reading)


def _scan(content: Any) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return angles [rad], distances [m] and the greatest distance [m] of a LaserScan (REP 117)."""
    distances = np.array(content.ranges, float)
    with np.errstate(invalid="ignore"):
        distances[distances > content.range_max] = np.inf
        distances[distances < content.range_min] = np.nan
    angles = content.angle_min + content.angle_increment * np.arange(len(distances))
    if not np.isfinite(angles).all() or not np.isfinite(content.range_max) or content.range_max <= 0.0:
        raise BagError("a scan has angles or a range that are not finite")
    angles.flags.writeable = False
    return angles, distances, float(content.range_max)


def _imu(content: Any) -> NDArray[np.float64]:
    """Return the specific force and the angular rates of an Imu."""
    force, rate = content.linear_acceleration, content.angular_velocity
    return _finite([force.x, force.y, force.z, rate.x, rate.y, rate.z])


def _pose(content: Any) -> NDArray[np.float64]:
    """Return the position and the heading of a pose."""
    position, orientation = pose_in(content)
    return _finite([*position, *yaws(np.array([orientation], float)).tolist()])


def _finite(values: list[float]) -> NDArray[np.float64]:
    if not np.isfinite(values).all():
        raise BagError("a message has numbers that are not finite")
    return np.array(values)
