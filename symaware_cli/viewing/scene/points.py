"""Point signals of components, such as detections or planned viewpoints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import wire
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.marks import Points
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]

#: Size of points, in the scene and in the tab of the agent [pixels].
_POINT, _NEAR_POINT = 3.0, 4.0


class SignalPoints(Drawing):
    """Draws the points of all agents in the scene, unless there are many, and in each agent's tab."""

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
