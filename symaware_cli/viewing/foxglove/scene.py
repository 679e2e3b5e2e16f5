"""What Foxglove is shown of a log, message by message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log as LogLine
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from numpy.typing import NDArray

from symaware_cli.recording import logged_events
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.recording.sensor_channels import IMAGE, SCAN, sensors
from symaware_cli.viewing.detail import MANY
from symaware_cli.viewing.figure import Figure
from symaware_cli.viewing.foxglove import entities
from symaware_cli.viewing.foxglove.entities import Layer, colour, entity
from symaware_cli.viewing.foxglove.figures import Models
from symaware_cli.viewing.foxglove.frames import movers, transforms_of
from symaware_cli.viewing.foxglove.group import GroupMessages, Take
from symaware_cli.viewing.foxglove.output import Output
from symaware_cli.viewing.foxglove.sensors import Camera, Lidar
from symaware_cli.viewing.palette import CONTACT
from symaware_cli.viewing.views import RunView, in_space

Array = NDArray[np.float64]

#: How long a message between agents is to be seen [ns].
_ARROW = 300_000_000

_LEVELS = {
    "DEBUG": LogLine.DEBUG,
    "INFO": LogLine.INFO,
    "WARNING": LogLine.WARNING,
    "ERROR": LogLine.ERROR,
}


class FoxgloveScene:
    """Draws a run for Foxglove.

    Attributes:
        topics: The topics that it wants to be told of.
    """

    def __init__(self, run_view: RunView, channels: Mapping[str, ChannelInfo], output: Output, start: int) -> None:
        """Put up what holds for all times.

        Args:
            run_view: Who takes part.
            channels: What the log has.
            output: Where to draw.
            start: The first instant [ns].
        """
        self._run_view, self._channels, self._output = run_view, channels, output
        self._takers: dict[str, Take] = {}
        self._places: dict[str, Array] = {}
        self._put_up_scenery(start)
        for group_view in run_view.group_views.values():
            shown = GroupMessages(
                group_view, channels, output, start, crowd=run_view.agent_count > MANY, places=self._places
            )
            self._takers |= shown.takers
            models = self._models(group_view.name, group_view.agents, group_view.figure, start)
            Layer(output, f"/models/{group_view.name}").show(start, models)
            for sensor, topic in sensors(channels, group_view.name, SCAN).items():
                self._takers[topic] = Lidar(sensor, group_view.agents, output, spatial=run_view.is_spatial).take
            for sensor, topic in sensors(channels, group_view.name, IMAGE).items():
                self._takers[topic] = Camera(sensor, group_view.agents, output).take
        for obstacle_view in run_view.obstacle_views.values():
            self._takers |= {
                f"/world/{obstacle_view.name}/{kind}": take
                for kind, take in movers(obstacle_view, channels, output).items()
            }
        self._contacts = Layer(output, "/contacts")
        self._touching: dict[str, SceneEntity] = {}
        self._takers |= {"/events": self._event, "/contacts": self._contact}
        self._takers |= dict.fromkeys(logged_events.MESSAGES, self._message)
        self._takers = {topic: take for topic, take in self._takers.items() if topic in channels}

    @property
    def topics(self) -> Sequence[str]:
        """The topics that it wants to be told of."""
        return list(self._takers)

    def take(self, topic: str, time: int, content: Any) -> None:
        """Draw a message.

        Args:
            topic: One of `topics`.
            time: Simulated time [ns], ascending.
            content: What `LogMessage.decode` returned.

        Raises:
            ValueError: It does not fit the group.
        """
        self._takers[topic](time, content)

    def _put_up_scenery(self, start: int) -> None:
        obstacle_views = self._run_view.obstacle_views.values()
        spatial = self._run_view.is_spatial
        shown = [
            entities.scenery(obstacle_view, start, spatial=spatial)
            for obstacle_view in obstacle_views
            if obstacle_view.figure is None
        ]
        shown += [
            made
            for obstacle_view in obstacle_views
            for made in self._models(obstacle_view.name, [obstacle_view.name], obstacle_view.figure, start)
        ]
        Layer(self._output, "/scenery").show(start, shown)
        still = [obstacle_view for obstacle_view in obstacle_views if not obstacle_view.moves]
        if still:
            positions = np.stack([obstacle_view.position for obstacle_view in still])
            orientations = np.stack(
                [obstacle_view.orientations(np.array(obstacle_view.heading)) for obstacle_view in still]
            )
            names = [obstacle_view.name for obstacle_view in still]
            self._output.write("/tf_static", start, transforms_of(start, names, positions, orientations))

    def _models(self, name: str, bodies: Sequence[str], figure: Figure | None, start: int) -> Sequence[SceneEntity]:
        """What bodies of a group, or an entity, look like, if the log knows; from then on their joints move them."""
        if figure is None:
            return []
        models = Models(name, bodies, figure, self._run_view.surfaces, self._output, start)
        self._takers[f"/world/{name}/joints"] = models.take
        return models.made

    def _event(self, time: int, message: Any) -> None:
        event = logged_events.event(time, message)
        line = LogLine(
            timestamp=entities.timestamp(time),
            level=_LEVELS.get(event.level, LogLine.UNKNOWN),
            message=f"{event.name} {event.text}".rstrip(),
            name=event.source,
        )
        self._output.write("/events", time, line)

    def _message(self, time: int, message: Any) -> None:
        arrows = []
        for entry in logged_events.communications(time, message, self._run_view.roster):
            places = [place for who in (entry.sender, entry.receiver) if (place := self._place(who)) is not None]
            if entry.stage == "SENT" or len(places) < 2:
                continue
            arrow = entity(f"{entry.id} {entry.stage.lower()}", time, lifetime=_ARROW)
            shade = colour((230, 200, 60) if entry.stage == "DELIVERED" else (130, 130, 130))
            arrow.lines.append(entities.line(np.stack(places), shade, 2.0))
            arrows.append(arrow)
        if arrows:
            self._output.write("/messages", time, SceneUpdate(entities=arrows))

    def _contact(self, time: int, message: Any) -> None:
        contact = logged_events.contact(time, message)
        pair = f"{contact.a} {contact.b}"
        place = in_space(np.array([contact.point])) if contact.point else self._place(contact.a)
        if contact.stage == "END":
            self._touching.pop(pair, None)
        elif place is not None:
            self._touching[pair] = entity(pair, time)
            sizes = np.full(3, 0.15)
            ball = entities.ellipsoid(place.ravel(), sizes, np.array([0.0, 0.0, 0.0, 1.0]), colour(CONTACT, 0.8))
            self._touching[pair].spheres.append(ball)
        self._contacts.show(time, self._touching.values())

    def _place(self, who: str) -> Array | None:
        """Where somebody is now, (3,) [m]; None if that is not known."""
        if who in self._run_view.place:
            group, row = self._run_view.place[who]
            return self._places[group][row] if group in self._places else None
        return self._run_view.obstacle_views[who].position if who in self._run_view.obstacle_views else None
