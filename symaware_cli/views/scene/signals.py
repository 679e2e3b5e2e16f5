"""Signals that components declare, drawn as points, boxes, bars beside the agents, or arrows between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import BOX_COLUMNS
from symaware_cli.log import wire
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.palette import AGENTS
from symaware_cli.views.scene.arrows import POINTS, arrows
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Lines, Points
from symaware_cli.views.views import GroupView, RunView

Array = NDArray[np.float64]

#: Size of points, in the scene and in the tab of the agent [pixels].
_POINT, _NEAR_POINT = 3.0, 4.0


class SignalPoints(Drawing):
    """Draws the points of all agents in the scene, unless there are many, and in each agent's tab."""

    order: ClassVar = 120

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        #: For each topic, the last table of each row.
        self._known: dict[str, list[Array]] = {}

    def marks(self, chunk: Chunk) -> Iterator[Points]:
        """Yield the points of each instant, which are shown until the next."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("points"):
                found = list(self._found(group_view, name, topic, chunk))
                if found and self.detail.awareness:
                    layer = f"{name}/{group_view.name}"
                    yield self._mark(f"awareness/{group_view.name}/{name}", layer, found, group_view, _POINT)
                for agent in self.detail.focus:
                    own = [dots for dots in found if group_view.agents[dots[1]] == agent]
                    if own:
                        yield self._mark(f"as/{agent}/{name}", "", own, group_view, _NEAR_POINT)

    def _mark(
        self, path: str, layer: str, found: Sequence[tuple[int, int, Array]], group_view: GroupView, size: float
    ) -> Points:
        """Return a mark of the points of some agents: time [ns], row and points (m, 3) [m]."""
        flat = np.array([1.0, 1.0, float(self.run_view.is_spatial)])
        moments, which = np.unique([time for time, _, _ in found], return_inverse=True)
        sizes = np.array([len(points) for _, _, points in found])
        rows = np.repeat([row for _, row, _ in found], sizes)
        return Points(
            path=path,
            layer=layer,
            times=moments,
            counts=np.bincount(which, weights=sizes, minlength=len(moments)).astype(np.int64),
            positions=flat * np.concatenate([points for _, _, points in found]),
            colours=lighter(group_view.colours[rows]),
            size=size,
            names=[f"{agent} {path.rpartition('/')[2]}" for agent in group_view.agents],
            who=rows,
        )

    def _found(self, group_view: GroupView, name: str, topic: str, chunk: Chunk) -> Iterator[tuple[int, int, Array]]:
        """Yield the points of every agent at each instant at which any were recorded."""
        known = self._known.setdefault(topic, [np.empty((0, 0))] * len(group_view.agents))
        names, state_frames = group_view.signals[name].column_names, chunk.frames.get(group_view.state_topic)
        for time, tables in self._said(topic, chunk):
            for row, table in tables:
                known[row] = table
            now = np.array([time])
            states = np.full((len(known), len(group_view.state)), np.nan)
            if state_frames is not None:
                states = state_frames.at(now)[0]
            positions, headings = group_view.positions(states), group_view.headings(states)
            for row, table in enumerate(known):
                heading = 0.0 if headings is None else float(headings[row])
                yield time, row, places(names, table, positions[row], heading) if len(table) else np.empty((0, 3))

    def _said(self, topic: str, chunk: Chunk) -> Iterator[tuple[int, Iterable[tuple[int, Array]]]]:
        """Yield the tables recorded at each instant, with their rows."""
        frames = chunk.frames.get(topic)
        if frames is not None:
            for time, values in zip(frames.times.tolist(), frames.values, strict=True):
                yield time, ((row, each[None]) for row, each in enumerate(values))
        for time, message in chunk.entries.get(topic, ()):
            yield time, tables_of(message)


def tables_of(message: object) -> Iterable[tuple[int, Array]]:
    """Return the row and the table of each agent in a message; empty for messages of other types."""
    if not isinstance(message, wire.TableRows):
        return ()
    rows = range(len(message.lengths)) if message.rows is None else message.rows.tolist()
    return zip(rows, message, strict=False)


def places(names: Sequence[str], table: Array, position: Array, heading: float) -> Array:
    """Return the positions of points in the world.

    Args:
        names: Names of the columns: `x`, `y` and optionally `z`; or `distance`, `bearing` and optionally `elevation`.
        table: (m, columns) [m] or [rad].
        position: Position of the body; (3,) [m].
        heading: Its heading [rad].

    Returns:
        (k, 3) [m], those that are finite.
    """

    def column(name: str, default: float) -> Array:
        return table[:, names.index(name)] if name in names else np.full(len(table), default)

    if "x" in names and "y" in names:
        found = np.stack([column("x", 0.0), column("y", 0.0), column("z", position[2])], axis=1)
    else:
        distance, bearing, elevation = column("distance", np.nan), column("bearing", 0.0), column("elevation", 0.0)
        level = distance * np.cos(elevation)
        ahead = heading + bearing
        found = position + np.stack(
            [level * np.cos(ahead), level * np.sin(ahead), distance * np.sin(elevation)], axis=1
        )
    known: Array = found[np.isfinite(found).all(axis=1)]
    return known


def lighter(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Lighten colours (..., 3), so that points stand out from bodies and walls."""
    return colours // 4 * 3 + 63


#: How far outlines are drawn within their boxes, relative to the shorter side, so that neighbours do not overlap.
_INSET = 0.05
#: The corners of an outline, and of the cross that is drawn with it, as shares of the sides along x and y.
_OUTLINE = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], float)
_CROSS = np.array([(0, 0), (1, 1), (1, 0), (0, 1)], float)
_WIDTH = 2.5
#: Offset below a planar world, just above the regions, so that both coincide in a view in perspective [m].
_BELOW = -0.4


class Boxes(Drawing):
    """Draws signals that are boxes, for agents whose awareness is shown."""

    order: ClassVar = 130

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the outlines from each instant at which they were recorded until the next."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("boxes"):
                for row in self.shown_rows(group_view):
                    said = [
                        (time, table)
                        for time, message in chunk.entries.get(topic, ())
                        for of, table in tables_of(message)
                        if of == row
                    ]
                    if said:
                        yield _mark(group_view, name, row, said)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the meaning of the boxes of each signal."""
        for name, meaning in self.run_view.described("boxes").items():
            yield "outlines on the ground", f"{name}: {meaning}"


def _mark(group_view: GroupView, name: str, row: int, said: Sequence[tuple[int, Array]]) -> Lines:
    """Return the outlines and crosses of the boxes of one agent, by instant [ns]."""
    names = group_view.signals[name].column_names
    places = [names.index(each) for each in BOX_COLUMNS]
    crossed = names.index("crossed") if "crossed" in names else None
    lines: list[Array] = []
    counts = []
    for _, table in said:
        before = len(lines)
        for entry in table:
            low, high = entry[places].reshape(2, 2).T
            edge = _INSET * float((high - low).min())
            low, high = low + edge, high - edge
            lines.append(low + _OUTLINE * (high - low))
            if crossed is not None and entry[crossed] != 0.0:
                stroke = low + _CROSS * (high - low)
                lines += [stroke[:2], stroke[2:]]
        counts.append(len(lines) - before)
    points = np.concatenate([np.empty((0, 2)), *lines])
    return Lines(
        path=f"awareness/{group_view.name}/{name}/{group_view.agents[row]}",
        layer=f"{name}/{group_view.name}",
        times=np.array([time for time, _ in said], np.int64),
        counts=counts,
        points=np.column_stack([points, np.full(len(points), _BELOW)]),
        lengths=np.array([len(each) for each in lines], np.int64),
        colours=lighter(group_view.colours[row]),
        names=[f"{group_view.agents[row]} {name}"],
        who=np.zeros(len(lines), np.intp),
        width=_WIDTH,
    )


#: Minimum height of a bar of 1 [m], for small bodies and points.
_LEAST = 0.8
#: Distance of the bars from the centre of a body, height of a bar of 1, distance between bars, and thickness, in
#: multiples of the extent of the body.
_AWAY, _HEIGHT, _APART, _THICK = 1.5, 2.0, 0.45, 0.17


class Bars(Drawing):
    """Draws parts of awareness and signals as bars, for agents whose awareness is shown."""

    order: ClassVar = 110

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield a mark for each part or signal of a group."""
        for group_view in self.run_view.group_views.values():
            rows, places = self.shown_rows(group_view), chunk.frames.get(group_view.state_topic)
            for number, (name, topic) in enumerate(group_view.drawn("bars")):
                series = chunk.strips.get(topic)
                # The values of a vector, or the first values of a series.
                shares = chunk.frames.get(topic) if series is None else series.firsts
                if shares is None or places is None or not rows:
                    continue
                times = np.union1d(places.times, shares.times)
                positions = group_view.positions(places.at(times))[:, rows]
                bars = self._bars(group_view, number, positions, shares.at(times)[:, rows])
                count, columns = bars.shape[1:3]
                colours = np.array([AGENTS[column % len(AGENTS)] for column in range(columns)], np.uint8)
                yield Lines(
                    path=f"awareness/{group_view.name}/{name}",
                    layer=f"{name}/{group_view.name}",
                    times=times,
                    counts=[count * columns] * len(times),
                    points=bars.reshape(-1, 3),
                    lengths=np.full(len(times) * count * columns, 2),
                    colours=np.tile(colours, (len(times) * count, 1)),
                    thickness=_THICK * _size(group_view),
                    names=group_view.agents,
                    who=np.tile(np.repeat(rows, columns), len(times)),
                )

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the meaning of the bars of each part of awareness and signal."""
        shown = {
            name: group_view.signals[name]
            for group_view in self.run_view.group_views.values()
            for name, _ in group_view.drawn("bars")
        }
        for name, signal in shown.items():
            meaning = ", ".join(signal.column_names) or signal.description
            yield "bars beside agents", f"{name}, from left to right: {meaning}"

    def _bars(self, group_view: GroupView, number: int, positions: Array, shares: Array) -> Array:
        """Return both ends of each bar, (k, n, columns, 2, 3) [m]."""
        size, columns = _size(group_view), shares.shape[2]
        across = np.array([1.0, 0.0, 0.0])
        up = np.array([0.0, 0.0, 1.0] if self.run_view.is_spatial else [0.0, 1.0, 0.0])
        # Each further part is to the right of the previous one.
        aside = (_AWAY + _APART * (np.arange(columns) + number * (columns + 1))) * size
        feet = positions[:, :, None] - 0.5 * _HEIGHT * size * up + aside[:, None] * across
        tops = feet + _HEIGHT * size * np.clip(shares, 0.0, 1.0)[..., None] * up
        return np.stack([feet, tops], axis=3)


def _size(group_view: GroupView) -> float:
    """Return the unit of length of the bars of a group [m]."""
    return max(group_view.extent, _LEAST / _HEIGHT)


#: Length of a head, and gap between an arrow and a body, relative to the length of the link.
_HEAD, _GAP = 0.1, 0.04
#: The longest head [m], for bodies that are points, and in multiples of the extent of a body.
_LONGEST, _LARGE = 0.2, 1.5
_TRANSPARENCY = 0.35


class DeclaredLinks(Drawing):
    """Draws signals that are links as arrows from each agent to the others, for agents whose awareness is shown."""

    order: ClassVar = 100

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        #: For each topic and row, the names of those that the agent is linked to.
        self._known: dict[tuple[str, int], list[str]] = {}

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the arrows, which move with the agents at their ends."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("links"):
                for row in self.shown_rows(group_view):
                    yield from self._arrows(group_view, name, topic, row, chunk)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the meaning of the arrows of each signal."""
        for name, meaning in self.run_view.described("links").items():
            yield "arrows between agents", f"{name}: {meaning}"

    def _arrows(self, group_view: GroupView, name: str, topic: str, row: int, chunk: Chunk) -> Iterator[Lines]:
        """Yield the arrows of one agent, by the instants at which they were recorded."""
        column = group_view.signals[name].column_names.index("agent")
        said = [
            (time, [self._name(index) for index in table[:, column]])
            for time, message in chunk.entries.get(topic, ())
            for of, table in tables_of(message)
            if of == row
        ]
        frames = chunk.frames.get(group_view.state_topic)
        moments = np.empty(0, np.int64) if frames is None else frames.times
        known = self._known.get((topic, row), [])
        bounds = [chunk.start, *(time for time, _ in said), chunk.end + 1]
        for (first, last), others in zip(pairwise(bounds), [known, *(each for _, each in said)], strict=True):
            times = moments[(moments >= first) & (moments < last)]
            if others != known and not len(times):
                times = np.array([first], np.int64)
            if len(times) and (others or known):
                yield self._mark(group_view, name, row, others, times, chunk)
            known = others
        self._known[topic, row] = known

    def _mark(
        self, group_view: GroupView, name: str, row: int, others: list[str], times: NDArray[np.int64], chunk: Chunk
    ) -> Lines:
        agent, count = group_view.agents[row], len(others)
        origins = np.repeat(self.places(agent, times, chunk), count, axis=0)
        ends = np.empty((len(times), count, 3))
        for number, other in enumerate(others):
            ends[:, number] = self.places(other, times, chunk)
        targets = ends.reshape(-1, 3)
        ways = np.linalg.norm(targets - origins, axis=1)
        known = ways > 0.0  # neither unknown nor the same
        origins, targets, ways = origins[known], targets[known], ways[known]
        room = np.minimum(_GAP + group_view.extent / ways, 0.3)
        heads = np.minimum(_HEAD * ways, max(_LONGEST, _LARGE * group_view.extent))
        return Lines(
            path=f"world/links/{name}/{agent}",
            layer=f"{name}/{group_view.name}",
            times=times,
            counts=known.reshape(len(times), count).sum(axis=1),
            points=arrows(origins, targets, room, 1.0 - room, heads, 0.0).reshape(-1, 3),
            lengths=np.full(len(ways), POINTS),
            colours=group_view.colours[row],
            transparency=_TRANSPARENCY,
            names=[f"{agent} {other}" for other in others],
            who=np.tile(np.arange(count), len(times))[known],
            width=2.0,
        )

    def _name(self, index: float) -> str:
        return self.run_view.roster[int(index)]
