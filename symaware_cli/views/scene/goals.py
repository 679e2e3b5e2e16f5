"""Goals and waypoints of agents, from their knowledge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import read_json
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import FEW, Detail
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Crosses, Lines, Points
from symaware_cli.views.views import GroupView, RunView, in_space

Array = NDArray[np.float64]


#: Names of goals and waypoints in knowledge databases.
_NAMES = ("goal", "target", "waypoint", "waypoints")

#: Number of waypoints of a way above which all but the last are dots, as crosses would cover each other.
_CROSSES = 6

#: Size of such a dot [pixels].
_DOT = 2.0


class Goals(Drawing):
    """Draws goals as crosses, and waypoints as crosses joined by lines, in the colours of the agents.

    They are the knowledge entries ``goal``, ``target``, ``waypoint`` and ``waypoints``. Of many waypoints, as of a
    planned path, only the last is a cross, and the others are dots.
    """

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 40

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._known: dict[str, list[list[Array]]] = {
            group_view.name: [[] for _ in group_view.agents] for group_view in run_view.group_views.values()
        }
        #: Groups with dots.
        self._dotted: set[str] = set()

    def marks(self, chunk: Chunk) -> Iterator[Crosses | Points | Lines]:
        """Yield the goals, each time that any changed."""
        for group_view in self.run_view.group_views.values():
            told = chunk.entries.get(f"/agents/{group_view.name}/knowledge", ())
            for place, (time, message) in enumerate(told):
                rows = message.rows or range(len(message.values))
                for row, value in zip(rows, message.values, strict=True):
                    self._known[group_view.name][row] = known_ways(read_json(value), group_view)
                if place + 1 == len(told) or told[place + 1][0] > time:
                    yield from self._goals(group_view, time)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "crosses", "goals and waypoints; of many waypoints all but the last are dots"

    def _goals(self, group_view: GroupView, time: int) -> Iterator[Crosses | Points | Lines]:
        known = [(row, way) for row, ways in enumerate(self._known[group_view.name]) for way in ways if len(way)]
        if not known:
            return
        few = self.run_view.agent_count <= FEW
        rows, lengths = np.array([row for row, _ in known]), np.array([len(way) for _, way in known])
        points, of = np.concatenate([way for _, way in known]), np.repeat(rows, lengths)
        path, layer, times = f"world/agents/{group_view.name}/goal", f"goals/{group_view.name}", np.array([time])
        transparency = 0.35 if few else 0.7
        look: dict[str, Any] = {"transparency": transparency, "width": 1.5 if few else 0.75}
        dots = np.concatenate([(np.arange(size) < size - 1) & (size > _CROSSES) for size in lengths.tolist()])
        yield Crosses(
            path=path,
            layer=layer,
            times=times,
            counts=[(~dots).sum()],
            positions=points[~dots],
            size=0.8 * group_view.radius or 0.2,
            colours=group_view.colours[of[~dots]],
            names=group_view.agents,
            who=of[~dots],
            **look,
        )
        if dots.any() or group_view.name in self._dotted:
            self._dotted.add(group_view.name)
            yield Points(
                path=f"{path}/waypoints",
                layer=layer,
                times=times,
                counts=[dots.sum()],
                positions=points[dots],
                size=_DOT,
                colours=group_view.colours[of[dots]],
                names=group_view.agents,
                who=of[dots],
                transparency=transparency,
            )
        far = lengths > 1
        yield Lines(
            path=f"{path}/way",
            layer=layer,
            times=times,
            counts=[far.sum()],
            points=points[np.repeat(far, lengths)],
            lengths=lengths[far],
            colours=group_view.colours[rows[far]],
            names=[f"{agent} way" for agent in group_view.agents],
            who=rows[far],
            **look,
        )


def known_ways(knowledge: Any, group_view: GroupView) -> list[Array]:
    """Return the goals and waypoints in a knowledge database, each (m, 3); other values are ignored."""
    ways, dimension = [], len(group_view.position)
    for name in _NAMES:
        try:
            points = np.atleast_2d(np.array(knowledge.get(name, []), float))
        except (ValueError, TypeError, OverflowError):
            # A component may use the name for something else.
            continue
        if points.ndim == 2 and points.shape[1] >= dimension and np.isfinite(points).all():
            # A goal may be a whole state; its position is extracted.
            is_state = points.shape[1] == len(group_view.state)
            ways.append(in_space(points[:, list(group_view.position if is_state else range(dimension))]))
    return ways
