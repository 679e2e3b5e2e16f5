"""Records the scans of lidars and the images of cameras, and reads them back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import png
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.world import Frame, Reading, Scan, record

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup
    from symaware_cli.log.writer import LogWriter, Message

Array = NDArray[np.float64]

NOTHING = 65535
"""Maximum recorded depth [mm], which also stands for no object."""

SCAN, IMAGE = "scan", "image"
"""Names of the kinds of readings in topics: ``/agents/<group>/scan/<sensor>``."""

#: For each kind of reading: its name in topics, and its message type.
_TOPICS: dict[type, tuple[str, str]] = {Scan: (SCAN, "Scan"), Frame: (IMAGE, "Image")}


def sensors(topics: Iterable[str], group: str, word: str) -> dict[str, str]:
    """Return the topics of one kind of reading of a group, by the name of the sensor, in order."""
    root = f"/agents/{group}/{word}/"
    return {topic.removeprefix(root): topic for topic in topics if topic.startswith(root)}


class SensorChannels:
    """The channels of the sensors of a group, opened with the first reading."""

    def __init__(self, writer: LogWriter, group: AgentGroup) -> None:
        """Initialise it without channels.

        Args:
            writer: The log.
            group: The group.
        """
        self._writer = writer
        self._group = group
        self._channels: dict[str, int] = {}
        self._last: dict[str, Reading] = {}

    def record(self, own: Sequence[int] | None, messages: list[Message]) -> int:
        """Record the new readings of the given rows, None for all, and return their number of rows."""
        updates = 0
        if own is not None and not own:
            return 0
        for name, reading in self._group.awareness.readings.items():
            if reading is self._last.get(name):
                continue
            self._last[name] = reading
            if name not in self._channels:
                self._channels[name] = self._open(name, reading)
            messages += ((self._channels[name], content) for content in _contents(reading, own))
            updates += len(self._group if own is None else own)
        return updates

    def _open(self, name: str, reading: Reading) -> int:
        word, message = _TOPICS[type(reading)]
        return self._writer.channel(f"/agents/{self._group.name}/{word}/{name}", message, {})


def _contents(reading: Reading, own: Sequence[int] | None) -> Iterator[bytes]:
    """Yield the messages of a reading, for some rows or all."""
    chosen: Any = slice(None) if own is None else own
    match reading:
        case Scan():
            record = v1.Scan(
                rows=own,
                measured=reading.time,
                range=reading.range,
                angles=reading.angles.tolist(),
                distances=reading.distances[chosen].ravel().tolist(),
                poses=reading.poses[chosen].ravel().tolist(),
            )
            yield record.SerializeToString(deterministic=True)
        case Frame():
            yield from _images(reading, own)


def _images(frame: Frame, own: Sequence[int] | None) -> Iterator[bytes]:
    for row, seen in enumerate(frame.images):
        if seen is None or (own is not None and row not in own):
            continue
        millimetres = np.where(seen.depth * 1e3 < NOTHING, np.rint(np.minimum(seen.depth * 1e3, NOTHING)), NOTHING)
        pictures = (
            (v1.Image.COLOUR, seen.colour),
            (v1.Image.DEPTH, millimetres.astype(np.uint16)),
            (v1.Image.SEGMENTS, seen.segments),
        )
        for kind, picture in pictures:
            record = v1.Image(
                row=row,
                measured=frame.time,
                kind=kind,
                data=png.encode(picture),
                field_of_view=frame.field_of_view,
                position=frame.positions[row].tolist(),
                target=frame.targets[row].tolist(),
            )
            yield record.SerializeToString(deterministic=True)


@record
class LoggedReading:
    """The reading of a sensor of one agent.

    Attributes:
        time: When it became available, simulated ns.
        measured: When it was measured, simulated ns.
        agent: The id of the agent.
        sensor: The component that measured it.
    """

    time: int
    measured: int
    agent: str
    sensor: str


@record
class LoggedScan(LoggedReading):
    """The scan of a lidar of one agent.

    Attributes:
        range: The maximum range, m.
        angles: The directions of the rays, counter-clockwise from the heading, rad; shape (k,).
        distances: m; infinite where nothing is within range, NaN where the measurement was missed; shape (k,).
        pose: The true pose of the sensor: x, y, z, m, and heading, rad; shape (4,).
    """

    range: float
    angles: Array
    distances: Array
    pose: Array

    @property
    def points(self) -> Array:
        """The points at which rays hit an object; shape (m, 3) [m]."""
        return hits(self.angles, self.distances, self.pose)


@record
class LoggedImage(LoggedReading):
    """An image of a camera.

    Attributes:
        kind: `COLOUR`, `DEPTH` or `SEGMENTS`.
        data: The image as PNG.
        field_of_view: Vertical field of view, rad.
        position: The position of the camera [m].
        target: A point at the centre of the image [m].
    """

    kind: str
    data: bytes
    field_of_view: float
    position: tuple[float, ...]
    target: tuple[float, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, in pixels.

        Raises:
            ValueError: It is not a PNG.
        """
        return png.size(self.data)

    @property
    def pixels(self) -> NDArray[Any]:
        """The image as an array.

        Colours are (height, width, 3) of uint8; depths (height, width) in m, infinite where there is no object;
        segments (height, width) of uint16.
        """
        decoded = png.decode(self.data)
        if self.kind != "DEPTH":
            return decoded
        return np.where(decoded == NOTHING, np.inf, decoded / 1e3)


def hits(angles: Array, distances: Array, pose: Array) -> Array:
    """Return the points at which rays hit an object.

    Args:
        angles: (k,) [rad].
        distances: (k,) [m].
        pose: (4,) x, y, z [m] and heading [rad].

    Returns:
        (m, 3) [m].
    """
    met = np.isfinite(distances)
    bearings, far = pose[3] + angles[met], distances[met]
    return np.stack(
        [pose[0] + far * np.cos(bearings), pose[1] + far * np.sin(bearings), np.full(len(far), pose[2])], axis=1
    )


def scans(time: int, message: Any, sensor: str, agents: Sequence[str]) -> Sequence[LoggedScan]:
    """Create the entries of a generated `Scan`, one for each row.

    Raises:
        ValueError: Its columns are inconsistent, or refer to a row that the group does not have.
    """
    rows = list(message.rows) or list(range(len(agents)))
    if max(rows, default=0) >= len(agents):
        raise ValueError(f"a scan of row {max(rows)} of a group of {len(agents)}")
    angles = np.array(message.angles)
    distances = np.array(message.distances, float).reshape(len(rows), len(angles))
    poses = np.array(message.poses).reshape(len(rows), 4)
    return [
        LoggedScan(time, message.measured, agents[row], sensor, message.range, angles, own, pose)
        for row, own, pose in zip(rows, distances, poses, strict=True)
    ]


def images(time: int, message: Any, sensor: str, agents: Sequence[str]) -> Sequence[LoggedImage]:
    """Create the entry of a generated `Image`.

    Raises:
        ValueError: It refers to a row that the group does not have.
    """
    if message.row >= len(agents):
        raise ValueError(f"an image of row {message.row} of a group of {len(agents)}")
    entry = LoggedImage(
        time=time,
        measured=message.measured,
        agent=agents[message.row],
        sensor=sensor,
        kind=v1.Image.Kind.Name(message.kind),
        data=message.data,
        field_of_view=message.field_of_view,
        position=tuple(message.position),
        target=tuple(message.target),
    )
    return [entry]
