"""Exports a run as a bag of ROS 2, with the messages that robots with ROS would have recorded.

Reasons: docs/decisions/0093-bags.md
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.bags import ros_messages as ros
from symaware_cli.bags.ros_names import topic_names
from symaware_cli.geometry import Shape, rotated
from symaware_cli.log import Log, LogError, LogMessage, sensor_channels
from symaware_cli.views import (
    Chunk,
    ChunkReader,
    Exported,
    ExportFormat,
    GroupView,
    ObstacleView,
    Progress,
    RunView,
    Selection,
    outlines,
    postures_of,
    prism_surface,
    run_view_of,
)

Array = NDArray[np.float64]
Said = tuple[int, str, str, Any]
"""Time [ns], topic, type and content of a message."""

#: The colour of bodies of the environment, and the size of a body without a shape [m].
_GREY, _POINT = (128, 128, 128), 0.2
#: Topics whose last message is delivered to late subscribers (transient local).
_LATCHED = ("/tf_static", "/markers")
#: Last parts of topics that are not for scans.
_OTHERS = ("odom", "plan")
_ADD, _DELETE = 0, 2


class RosbagFolder(ExportFormat):
    """A bag of ROS 2 (MCAP): clock, transforms, odometry, scans, intended paths and markers as standard messages."""

    requires: ClassVar = {"rosbags": ros.INSTALL}

    def write(self, log: Log, place: Path, selection: Selection, on_progress: Progress) -> Exported:
        """Write the bag: a folder with `metadata.yaml` and one MCAP file."""
        bag = _Bag(log, selection)
        with _Writer(place) as writer:
            for said in bag.beginning():
                writer.write(*said)
            for chunk, own in bag.chunks():
                try:
                    found = [*bag.frames(chunk), *own]
                except (ValueError, IndexError, AttributeError) as error:
                    raise LogError(f"{log.path} is inconsistent up to {chunk.end} ns: {error}") from error
                for said in sorted(found, key=lambda each: each[0]):
                    writer.write(*said)
                if on_progress:
                    on_progress(chunk.end)
        size = sum(file.stat().st_size for file in place.iterdir())
        topics = dict(sorted(writer.counts.items()))
        facts = {"topics": topics, "frames": bag.names, "uneven_scans": bag.uneven_scans, "size": size}
        return Exported([(topic, count, None) for topic, count in topics.items()], ("topic", "messages"), size, facts)


class _Writer:
    """Writes messages to the files of a bag."""

    def __init__(self, place: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        self._place = place
        # The writer names the file after a folder that it creates, and writes this name into the file.
        self._inner = place / "run"
        self._writer = Writer(self._inner, version=9, storage_plugin=StoragePlugin.MCAP)
        self._connections: dict[str, Any] = {}
        self.counts: dict[str, int] = {}

    def write(self, time: int, topic: str, kind: str, content: Any) -> None:
        """Write a message at a time [ns]."""
        if topic not in self._connections:
            profiles = [_quality(topic in _LATCHED)]
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=ros.typestore(), offered_qos_profiles=profiles
            )
            self.counts[topic] = 0
        self._writer.write(self._connections[topic], time, ros.typestore().serialize_cdr(content, kind))
        self.counts[topic] += 1

    def __enter__(self) -> _Writer:
        self._writer.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)
        if error[0] is None:
            for file in self._inner.iterdir():
                file.rename(self._place / file.name)
            self._inner.rmdir()


def _quality(is_latched: bool) -> Any:
    from rosbags import interfaces

    forever = interfaces.QosTime(9223372036, 854775807)
    return interfaces.Qos(
        history=interfaces.QosHistory.KEEP_LAST,
        depth=10,
        reliability=interfaces.QosReliability.RELIABLE,
        durability=interfaces.QosDurability.TRANSIENT_LOCAL if is_latched else interfaces.QosDurability.VOLATILE,
        deadline=forever,
        lifespan=forever,
        liveliness=interfaces.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


class _Bag:
    """The conversion of a log to the messages of a bag.

    Attributes:
        names: The frame of each agent and entity, which is also the part of topics that names it.
        uneven_scans: The number of scans with unevenly spaced rays, which have no message in ROS.
    """

    def __init__(self, log: Log, selection: Selection) -> None:
        self._log, self._selection = log, selection
        self._view: RunView = run_view_of(log)
        self.names = topic_names([*self._view.agents, *self._view.obstacle_views])
        self.uneven_scans = 0
        self._bodies: list[GroupView | ObstacleView] = [
            *self._view.group_views.values(),
            *(each for each in self._view.obstacle_views.values() if each.moves),
        ]
        groups = self._view.group_views.values()
        self._counts = {
            f"/{root}/{view.name}/{kind}": len(view.agents)
            for view in groups
            for root in ("world", "agents")
            for kind in ("state", "pose", "control")
        }
        #: The group, the sensor or None, and the columns of the position, of each topic that is not about bodies.
        self._scans = {
            topic: (view, sensor)
            for view in groups
            for sensor, topic in sensor_channels.sensors(log.topics, view.name, sensor_channels.SCAN).items()
            if selection.has_field("scan")
        }
        self._intents = {
            topic: (view, places)
            for view in groups
            if (topic := f"/agents/{view.name}/intent") in log.topics and selection.has_field("intent")
            if (places := self._position_places(topic, view))
        }

    @property
    def _has_truth(self) -> bool:
        return self._selection.has_field("world")

    @cached_property
    def _markers(self) -> dict[str, list[Any]]:
        """The markers of each body."""
        found: dict[str, list[Any]] = {}
        for view in self._view.group_views.values():
            for id, tint in zip(view.agents, view.colours.tolist(), strict=True):
                found[id] = list(_markers(self.names[id], view.shape, tint, self._view.is_spatial))
        for name, obstacle in self._view.obstacle_views.items():
            found[name] = list(_markers(self.names[name], obstacle.shape, _GREY, self._view.is_spatial))
        return found

    def beginning(self) -> Iterator[Said]:
        """Yield messages that do not depend on time: the frames of bodies at rest, and the markers of all bodies."""
        if not self._has_truth:
            return
        start = self._selection.start or 0
        still = [each for each in self._view.obstacle_views.values() if not each.moves]
        frames = [
            (self.names[each.name], each.position.tolist(), each.orientations(np.array(each.heading)).tolist())
            for each in still
            if self._selection.has_agent(each.name)
        ]
        if frames:
            yield start, "/tf_static", "tf2_msgs/msg/TFMessage", ros.transforms(start, frames)
        there = [
            body
            for body in self._markers
            if self._selection.has_agent(body)
            and any(begin <= start for begin, _ in self._log.presence.get(body, ((0, None),)))
        ]
        if there:
            yield self._marked(start, there, _ADD)

    def _marked(self, time: int, bodies: Sequence[str], action: int) -> Said:
        markers = [each for body in bodies for each in self._markers[body]]
        kind = "visualization_msgs/msg/MarkerArray"
        definition = ros.typestore().types["visualization_msgs/msg/Marker"]
        made = [definition(**{**vars(each), "action": action}) for each in markers]
        return time, "/markers", kind, ros.message(kind, markers=made)

    def chunks(self) -> Iterator[tuple[Chunk, list[Said]]]:
        """Yield the intervals of the log, each with the messages that are converted one by one."""
        own: list[Said] = []
        last = -1

        def noted(messages: Iterator[LogMessage]) -> Iterator[LogMessage]:
            nonlocal last
            for message in messages:
                if message.time > last:
                    last = message.time
                    clock = ros.message("rosgraph_msgs/msg/Clock", clock=ros.stamp(last))
                    own.append((last, "/clock", "rosgraph_msgs/msg/Clock", clock))
                try:
                    own.extend(self._single(message))
                except (ValueError, IndexError, AttributeError) as error:
                    raise LogError(f"the messages on {message.channel.topic} do not fit together: {error}") from error
                yield message

        reader = ChunkReader(self._counts, self._view.place)
        asked = [topic for topic in self._log.channels if topic != "/timing"]
        messages = self._log.messages(asked, self._selection.start, self._selection.end)
        for chunk in reader.chunks(noted(messages)):
            # A message of the next instant may have been read already.
            due = [said for said in own if said[0] <= chunk.end]
            own[:] = [said for said in own if said[0] > chunk.end]
            yield chunk, due

    def _single(self, message: LogMessage) -> Iterator[Said]:
        topic, time = message.channel.topic, message.time
        if topic in self._scans:
            view, sensor = self._scans[topic]
            for scan in sensor_channels.scans(time, message.decode(), sensor, view.agents):
                if self._selection.has_agent(scan.agent):
                    yield from self._scan(scan)
        elif topic in self._intents:
            view, places = self._intents[topic]
            content = message.decode()
            rows = range(len(view.agents)) if content.rows is None else content.rows.tolist()
            for place, row in enumerate(rows):
                if self._selection.has_agent(view.agents[row]):
                    yield self._path(time, view, row, places, *content.at(place))
        elif topic == "/events" and self._has_truth:
            event = message.decode()
            body = event.source.removeprefix("agents.")
            if event.name in ("added", "removed") and body in self._markers and self._selection.has_agent(body):
                yield self._marked(time, [body], _ADD if event.name == "added" else _DELETE)

    def _scan(self, scan: sensor_channels.LoggedScan) -> Iterator[Said]:
        angles = scan.angles
        if not len(angles) or not np.allclose(angles, np.linspace(angles[0], angles[-1], len(angles))):
            self.uneven_scans += 1
            return
        sensor = topic_names([scan.sensor])[scan.sensor]
        frame = f"{self.names[scan.agent]}/{f'{sensor}_scan' if sensor in _OTHERS else sensor}"
        x, y, z, heading = scan.pose.tolist()
        turned = (0.0, 0.0, float(np.sin(0.5 * heading)), float(np.cos(0.5 * heading)))
        moved = ros.transforms(scan.measured, [(frame, (x, y, z), turned)])
        yield scan.time, "/tf", "tf2_msgs/msg/TFMessage", moved
        content = ros.laser_scan(scan.measured, frame, angles, scan.distances, scan.range)
        yield scan.time, f"/{frame}", "sensor_msgs/msg/LaserScan", content

    def _position_places(self, topic: str, view: GroupView) -> tuple[int, ...] | None:
        """Return the columns of an intent that are the position; None if there are none."""
        columns = [name for name, _ in self._view.quantities.get(topic, ())]
        wanted = [view.state[place][0] for place in view.position]
        return tuple(columns.index(name) for name in wanted) if set(wanted) <= set(columns) else None

    def _path(
        self, time: int, view: GroupView, row: int, places: Sequence[int], times: NDArray[np.int64], values: Array
    ) -> Said:
        points = values[:, list(places)]
        points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])), constant_values=view.height)
        known = zip(times.tolist(), points.tolist(), strict=False)
        content = ros.path(time, [(at, ros.pose(point)) for at, point in known])
        return time, f"/{self.names[view.agents[row]]}/plan", "nav_msgs/msg/Path", content

    def frames(self, chunk: Chunk) -> Iterator[Said]:
        """Yield the transforms and the odometry of an interval."""
        for body in self._bodies if self._has_truth else ():
            topic = body.state_topic if isinstance(body, GroupView) else f"/world/{body.name}/state"
            shown = chunk.frames.get(topic) or chunk.frames.get(f"/world/{body.name}/pose")
            if shown is None or not len(shown.times):
                continue
            positions, orientations = postures_of(body, shown.times, chunk)
            names = body.agents if isinstance(body, GroupView) else (body.name,)
            chosen = np.array([self._selection.has_agent(name) for name in names])
            known = np.isfinite(positions).all(axis=2) & np.isfinite(orientations).all(axis=2) & chosen
            motion = _Motion(body, chunk, shown.times, orientations) if isinstance(body, GroupView) else None
            for instant, time in enumerate(shown.times.tolist()):
                rows = np.flatnonzero(known[instant]).tolist()
                at, turned = positions[instant].tolist(), orientations[instant].tolist()
                frames = [(self.names[names[row]], at[row], turned[row]) for row in rows]
                if frames:
                    yield time, "/tf", "tf2_msgs/msg/TFMessage", ros.transforms(time, frames)
                if motion is None:
                    continue
                for row in rows:
                    frame = self.names[names[row]]
                    where = ros.pose(at[row], turned[row])
                    said = ros.odometry(time, frame, where, motion.linear(instant, row), motion.angular(instant, row))
                    yield time, f"/{frame}/odom", "nav_msgs/msg/Odometry", said


class _Motion:
    """The velocities of the agents of a group along the axes of their bodies, where the log has them."""

    def __init__(self, view: GroupView, chunk: Chunk, times: NDArray[np.int64], orientations: Array) -> None:
        states = chunk.frames[view.state_topic].at(times) if view.state_topic in chunk.frames else None
        applied = chunk.frames.get(f"/world/{view.name}/control")
        inputs = None if applied is None else applied.at(times)
        self._columns: dict[str, Array] = {}
        for quantities, values in ((view.control_input, inputs), (view.state, states)):
            if values is not None and values.shape[2] == len(quantities):
                self._columns |= {name: values[..., place] for place, (name, _) in enumerate(quantities)}
        axes = [view.state[place][0] for place in view.position]
        self._velocities: Array | None = None
        if all(f"velocity_{axis}" in self._columns for axis in axes):
            world = np.stack([self._columns[f"velocity_{axis}"] for axis in axes], axis=2)
            world = np.pad(world, ((0, 0), (0, 0), (0, 3 - len(axes))))
            inverse = orientations * np.array([-1.0, -1.0, -1.0, 1.0])
            self._velocities = rotated(inverse, world)

    def linear(self, instant: int, row: int) -> tuple[float, ...] | None:
        """Return the linear velocity [m/s]; None if the log does not have it."""
        if self._velocities is not None:
            return _known(self._velocities[instant, row].tolist())
        if "speed" in self._columns:
            climb = self._columns.get("climb_rate")
            return _known((self._columns["speed"][instant, row], 0.0, 0.0 if climb is None else climb[instant, row]))
        return None

    def angular(self, instant: int, row: int) -> tuple[float, ...] | None:
        """Return the angular velocity [rad/s]; None if the log does not have it."""
        rates = [self._columns.get(f"rate_{axis}") for axis in "xyz"]
        if all(rate is not None for rate in rates):
            return _known([rate[instant, row] for rate in rates if rate is not None])
        if "turn_rate" in self._columns:
            return _known((0.0, 0.0, self._columns["turn_rate"][instant, row]))
        return None


def _known(values: Sequence[float]) -> tuple[float, ...] | None:
    return tuple(float(value) for value in values) if np.isfinite(values).all() else None


def _markers(frame: str, shape: Shape | None, tint: Sequence[int], is_spatial: bool) -> Iterator[Any]:
    """Yield the markers of a body: a ball, a cylinder, a box, or a prism for each piece of its outline."""
    radius, shade = shape.radius if shape else 0.5 * _POINT, ros.colour(tint)
    if shape is None or (shape.circle and is_spatial):
        yield ros.marker(frame, 0, "SPHERE", scale=ros.vector([2.0 * radius] * 3), color=shade)
    elif shape.circle or shape.cylinder:
        height = shape.cylinder.height if shape.cylinder and is_spatial else radius
        yield ros.marker(frame, 0, "CYLINDER", scale=ros.vector((2.0 * radius, 2.0 * radius, height)), color=shade)
    elif shape.box:
        height = shape.box.height or 0.5 * min(shape.box.length, shape.box.width)
        scale = ros.vector((shape.box.length, shape.box.width, height))
        yield ros.marker(frame, 0, "CUBE", scale=scale, color=shade)
    else:
        for number, outline in enumerate(outlines(shape.pieces)):
            corners, triangles = prism_surface(outline, -0.5 * radius, 0.5 * radius)
            points = [ros.vector(corners[corner].tolist(), "Point") for corner in triangles.ravel().tolist()]
            yield ros.marker(frame, number, "TRIANGLE_LIST", points=points, color=shade)
