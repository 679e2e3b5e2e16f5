"""What Foxglove is shown of a group of agents, message by message: bodies, trails, awareness and curves."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from numpy.typing import NDArray

from symaware_cli.awareness.signal import Drawn
from symaware_cli.core import Signal
from symaware_cli.recording import logged_events, wire
from symaware_cli.recording.index import ChannelInfo
from symaware_cli.viewing.drawing.goals import crosses, known_ways
from symaware_cli.viewing.drawing.intents import covariance_columns, ellipsoids, position_columns, sample_columns
from symaware_cli.viewing.drawing.points import places
from symaware_cli.viewing.foxglove import entities
from symaware_cli.viewing.foxglove.entities import Layer, colour, entity
from symaware_cli.viewing.foxglove.frames import transforms_of
from symaware_cli.viewing.foxglove.output import Columns, Output
from symaware_cli.viewing.palette import GOAL, tinted
from symaware_cli.viewing.views import GroupView, in_space

Array = NDArray[np.float64]
Take = Callable[[int, Any], Any]

#: How often a trail has a point, and how many; those of a crowd are shorter [ns].
_TRAIL = (200_000_000, 50)
_TRAIL_OF_MANY = (300_000_000, 10)
#: What of a part or a signal stands in the scene.
_LAYERED: tuple[Drawn, ...] = ("path", "ellipse", "points")
#: Half the size of a dot [m], and how it stands.
_DOT, _UPRIGHT = np.full(3, 0.06), np.array([0.0, 0.0, 0.0, 1.0])
#: In how many steps bodies become redder with risk, so that a small change needs no message.
_TINTS = 20


class _Held:
    """The values of all rows; those that a message leaves out keep theirs."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._values: Array | None = None

    def update(self, rows: NDArray[np.uint32] | None, values: Array) -> Array:
        """Take over the values (m, columns) of some rows, and return those of all."""
        if self._values is None or self._values.shape[1] < values.shape[1]:
            wider = np.full((self._count, values.shape[1]), np.nan)
            if self._values is not None:
                wider[:, : self._values.shape[1]] = self._values
            self._values = wider
        self._values[slice(len(values)) if rows is None else rows, : values.shape[1]] = values
        return self._values


def _layer(name: str) -> str:
    """What the drawings of a part or a signal are called."""
    return {"intent": "intents", "uncertainty": "uncertainties"}.get(name, name)


class GroupMessages:
    """Draws a group of agents for Foxglove.

    Attributes:
        takers: What draws the messages of each topic that it wants to be told of.
    """

    def __init__(
        self,
        group_view: GroupView,
        channels: Mapping[str, ChannelInfo],
        output: Output,
        start: int,
        *,
        crowd: bool,
        places: dict[str, Array],
    ) -> None:
        self._group_view, self._channels, self._output, self._places = group_view, channels, output, places
        self._agents = f"/agents/{group_view.name}"
        self._held: dict[str, _Held] = {}
        self._columns: dict[str, Columns] = {}
        self._tints: NDArray[np.intp] = np.full(len(group_view.agents), -1)
        self._believed: Array | None = None
        self._goals: dict[str, SceneEntity] = {}
        self._ahead: dict[str, dict[str, SceneEntity]] = {}
        #: Where everybody is, as far as is known; and by signal the last table of each row.
        self._where: Array | None = None
        self._tables: dict[str, dict[int, Array]] = {}
        self._trail_step, length = _TRAIL_OF_MANY if crowd else _TRAIL
        self._trail: deque[Array] = deque(maxlen=length)
        self._trail_due = 0
        layers = ["bodies", "labels", "trails", "goals"]
        layers += [_layer(name) for how in _LAYERED for name, _ in group_view.drawn(how)]
        self._layers = {kind: Layer(output, f"/{kind}/{group_view.name}") for kind in layers}
        self._show_bodies(start, np.zeros(len(group_view.agents)))
        # The names of a crowd would hide it.
        rows = range(0 if crowd else len(group_view.agents))
        self._layers["labels"].show(start, [entities.label(group_view, row, start) for row in rows])
        self.takers: dict[str, Take] = {
            f"/world/{group_view.name}/state": self._world,
            f"/world/{group_view.name}/pose": self._pose,
            f"{self._agents}/control": partial(self._numbers, f"{self._agents}/control"),
            f"/world/{group_view.name}/control": partial(self._numbers, f"/world/{group_view.name}/control"),
            f"{self._agents}/knowledge": self._knowledge,
        }
        self.takers |= {
            group_view.topic(name): self._taker(name, signal) for name, signal in group_view.signals.items()
        }

    def _taker(self, name: str, signal: Signal) -> Take:
        """What draws a part of awareness, or a signal."""
        topic = self._group_view.topic(name)
        if name in ("state", "risk"):
            return self._state if name == "state" else self._risk
        match signal.kind, signal.drawn:
            case "table", _:
                return partial(self._points, name)
            case "vector", "points":
                return partial(self._point, name)
            case "vector", _:
                return partial(self._numbers, topic)
            case _, "path":
                return partial(self._path, name)
            case _, "ellipse":
                return partial(self._spread, name)
        return partial(self._firsts, topic)

    def _point(self, name: str, time: int, message: wire.Rows) -> None:
        self._numbers(self._group_view.topic(name), time, message)
        self._show_points(name, time, zip(self._rows(message.rows), message.values[:, None], strict=False))

    def _points(self, name: str, time: int, message: wire.TableRows) -> None:
        """Show a table that is drawn as points; Foxglove has nothing for others."""
        if self._group_view.signals[name].drawn == "points":
            self._show_points(name, time, zip(self._rows(message.rows), message, strict=False))

    def _show_points(self, name: str, time: int, tables: Iterable[tuple[int, Array]]) -> None:
        group_view, where = self._group_view, self._where
        if where is None:
            return
        known, names = self._tables.setdefault(name, {}), group_view.signals[name].column_names
        known.update(tables)
        positions, headings = group_view.positions(where), group_view.headings(where)
        shown = []
        for row, table in sorted(known.items()):
            heading = 0.0 if headings is None else float(headings[row])
            made, shade = entity(f"{group_view.agents[row]} {name}", time), colour(group_view.colours[row], 0.8)
            made.spheres.extend(
                entities.ellipsoid(place, _DOT, _UPRIGHT, shade)
                for place in places(names, table, positions[row], heading)
            )
            shown.append(made)
        self._layers[name].show(time, shown)

    def _numbers(self, topic: str, time: int, message: wire.Rows) -> None:
        self._plot(topic, time, self._update(topic, message.rows, message.values))

    def _world(self, time: int, message: wire.Rows) -> None:
        topic = f"/world/{self._group_view.name}/state"
        values = self._update(topic, message.rows, message.values)
        self._plot(topic, time, values)
        self._move(time, values)

    def _pose(self, time: int, message: wire.Rows) -> None:
        topic = f"/world/{self._group_view.name}/pose"
        values = self._update(topic, message.rows, message.values)
        transforms = transforms_of(time, self._group_view.agents, values[:, :3], values[:, 3:])
        self._output.write(f"/tf/{self._group_view.name}", time, transforms)

    def _state(self, time: int, message: wire.Rows) -> None:
        topic = f"{self._agents}/state"
        self._believed = self._update(topic, message.rows, message.values)
        self._plot(topic, time, self._believed)
        if f"/world/{self._group_view.name}/state" not in self._channels:
            # The truth was not recorded.
            self._move(time, self._believed)

    def _risk(self, time: int, message: wire.SeriesRows) -> None:
        values = self._firsts(f"{self._agents}/risk", time, message)
        if values.shape[1]:
            self._show_bodies(time, values[:, 0])

    def _path(self, field: str, time: int, message: wire.SeriesRows) -> None:
        group_view = self._group_view
        names = [name for name, _ in self._quantities(group_view.topic(field), message.values.shape[1])]
        columns = position_columns(group_view, names)
        if columns is None and message.values.shape[1] == len(group_view.position):
            columns = list(range(len(group_view.position)))
        if columns is None:
            return
        ways = replace(message, values=in_space(message.values[:, columns]))
        sound = bool(np.isfinite(ways.values).all())
        ahead = self._ahead.setdefault(field, {})
        for row, (_, points) in zip(self._rows(message.rows), ways, strict=False):
            id = group_view.agents[row]
            ahead.pop(id, None)
            if len(points) > 1 and (sound or np.isfinite(points).all()):
                ahead[id] = entity(id, time)
                ahead[id].lines.append(entities.line(points, colour(group_view.colours[row], 0.7), 2.0))
        self._layers[_layer(field)].show(time, ahead.values())

    def _spread(self, field: str, time: int, message: wire.SeriesRows) -> None:
        group_view, topic = self._group_view, self._group_view.topic(field)
        values = self._firsts(topic, time, message)
        names = [name for name, _ in self._quantities(topic, message.values.shape[1])]
        covariance, samples = covariance_columns(group_view, names), sample_columns(group_view, names)
        shown: list[SceneEntity] = []
        if covariance is not None and self._believed is not None:
            centres = group_view.positions(self._believed)
            half_sizes, quaternions = ellipsoids(values[:, covariance])
            for row in np.flatnonzero(np.isfinite(centres).all(axis=1) & (half_sizes[:, 0] > 0.0)).tolist():
                shade = colour(group_view.colours[row], 0.3)
                made = entity(group_view.agents[row], time)
                made.spheres.append(entities.ellipsoid(centres[row], half_sizes[row], quaternions[row], shade))
                shown.append(made)
        if samples is not None:
            for row, (_, points) in zip(self._rows(message.rows), message, strict=False):
                made = entity(f"{group_view.agents[row]} samples", time)
                strips = in_space(points[:, samples].swapaxes(0, 1))
                shade = colour(group_view.colours[row], 0.4)
                made.lines.extend(entities.line(strip, shade, 1.0) for strip in strips if np.isfinite(strip).all())
                shown.append(made)
        self._layers[_layer(field)].show(time, shown)

    def _knowledge(self, time: int, message: Any) -> None:
        group_view = self._group_view
        size = 0.8 * group_view.radius or 0.2
        for entry in logged_events.knowledge(time, message, group_view.agents):
            made = entity(entry.agent, time)
            for way in known_ways(entry.values, len(group_view.position)):
                strokes = crosses(way, size)
                made.lines.append(entities.line(np.concatenate(strokes), colour(GOAL), 2.0, pairs=True))
                if len(way) > 1:
                    made.lines.append(entities.line(way, colour(GOAL, 0.5), 1.0))
            self._goals[entry.agent] = made
        self._layers["goals"].show(time, [made for made in self._goals.values() if made.lines])

    def _move(self, time: int, states: Array) -> None:
        """Move the bodies to where they are, and draw on the trails."""
        group_view = self._group_view
        positions = group_view.positions(states)
        self._places[group_view.name], self._where = positions, states
        if f"/world/{group_view.name}/pose" not in self._channels:
            transforms = transforms_of(time, group_view.agents, positions, group_view.orientations(states))
            self._output.write(f"/tf/{group_view.name}", time, transforms)
        if time >= self._trail_due:
            self._trail_due = time + self._trail_step
            self._trail.append(positions)
            trails = np.stack(self._trail, axis=1)
            self._layers["trails"].show(time, self._trails(time, trails) if len(self._trail) > 1 else ())

    def _trails(self, time: int, trails: Array) -> Sequence[SceneEntity]:
        shown = []
        for row, points in enumerate(trails):
            known = points[np.isfinite(points).all(axis=1)]
            made = entity(self._group_view.agents[row], time)
            made.lines.append(entities.line(known, colour(self._group_view.colours[row], 0.5), 1.5))
            shown.append(made)
        return shown

    def _show_bodies(self, time: int, risk: Array) -> None:
        """Draw the bodies anew if the risk of any has visibly changed."""
        tints = np.round(_TINTS * np.clip(np.nan_to_num(risk, posinf=1.0), 0.0, 1.0)).astype(np.intp)
        if np.array_equal(tints, self._tints):
            return
        self._tints = tints
        group_view = self._group_view
        colours = tinted(group_view.colours, tints / _TINTS)
        rows = range(len(group_view.agents))
        self._layers["bodies"].show(time, [entities.body(group_view, row, colours[row], time) for row in rows])

    def _firsts(self, topic: str, time: int, message: wire.SeriesRows) -> Array:
        """Plot the first point of each series, NaN where there is none; (n, columns)."""
        rows = self._rows(message.rows)
        firsts = np.full((len(rows), message.values.shape[1]), np.nan)
        for place, (_, values) in zip(range(len(rows)), message, strict=False):
            firsts[place] = values[0] if len(values) else np.nan
        values = self._update(topic, None if message.rows is None else message.rows, firsts)
        self._plot(topic, time, values)
        return values

    def _rows(self, rows: NDArray[np.uint32] | None) -> Sequence[int]:
        return range(len(self._group_view.agents)) if rows is None else rows.tolist()

    def _update(self, topic: str, rows: NDArray[np.uint32] | None, values: Array) -> Array:
        if topic not in self._held:
            self._held[topic] = _Held(len(self._group_view.agents))
        return self._held[topic].update(rows, values)

    def _plot(self, topic: str, time: int, values: Array, quantities: Sequence[tuple[str, str]] | None = None) -> None:
        if topic not in self._columns:
            columns = self._quantities(topic, values.shape[1]) if quantities is None else quantities
            self._columns[topic] = Columns(self._output, topic, columns, self._group_view.agents)
        self._columns[topic].write(time, values)

    def _quantities(self, topic: str, width: int) -> Sequence[tuple[str, str]]:
        """Name and unit of each column, as the log announces them."""
        metadata = self._channels[topic].metadata
        names, units = (metadata.get(key, "").split(",") for key in ("columns", "units"))
        if len(names) == len(units) == width and all(names):
            return list(zip(names, units, strict=True))
        return [(f"value_{place}", "") for place in range(width)]
