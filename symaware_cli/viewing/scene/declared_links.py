"""Links that components declare, such as whom an agent leads, as arrows between agents."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.arrows import POINTS, arrows
from symaware_cli.viewing.scene.marks import Lines
from symaware_cli.viewing.scene.points import tables_of
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]

#: Length of a head, and gap between an arrow and a body, relative to the length of the link.
_HEAD, _GAP = 0.1, 0.04
#: The longest head [m], for bodies that are points, and in multiples of the extent of a body.
_LONGEST, _LARGE = 0.2, 1.5
_TRANSPARENCY = 0.35


class DeclaredLinks(Drawing):
    """Draws signals that are links as arrows from each agent to the others, for agents whose awareness is shown."""

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
