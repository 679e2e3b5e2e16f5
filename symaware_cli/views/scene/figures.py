"""Figures: bodies of links, joints and meshes in spatial worlds, with their true poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import Detail
from symaware_cli.views.figure import Figure
from symaware_cli.views.palette import SCENERY, faded
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Figures
from symaware_cli.views.views import GroupView, ObstacleView, RunView

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: Default colours: of agents, and of entities at rest.
_PLAIN = (205, 205, 210)
_STILL = tuple(int(part) for part in faded(np.array(SCENERY, np.uint8), 0.3))


class Appearances(Drawing):
    """Draws groups and entities whose geometry is in the log.

    Each kind of body is drawn once, with an instance for each body. Entities without meshes have separate paths.
    """

    order: ClassVar = 30

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._begun = False
        users: dict[int, list[GroupView | ObstacleView]] = {}
        every: list[GroupView | ObstacleView] = [*run_view.group_views.values(), *run_view.obstacle_views.values()]
        figures = {each.figure.number: each.figure for each in every if each.figure}
        for each in every:
            if each.figure:
                users.setdefault(each.figure.number, []).append(each)
        #: Path, figure, and the groups and entities with that figure.
        self._shown: list[tuple[str, Figure, Sequence[GroupView | ObstacleView]]] = []
        for number, like in sorted(users.items()):
            figure = figures[number]
            if (len(like) > 1 and figure.surfaces) or any(isinstance(each, GroupView) for each in like):
                self._shown.append((f"world/figures/{figure.path}", figure, like))
            else:
                self._shown += [(f"world/scenery/{each.name}", figure, [each]) for each in like]

    def marks(self, chunk: Chunk) -> Iterator[Figures]:
        """Yield the poses of the figures, whenever one of them moves."""
        for path, figure, like in self._shown:
            moments = [self._moments(each, chunk) for each in like]
            times = np.unique(np.concatenate(moments))
            if not self._begun and chunk.start not in times[:1]:
                times = np.concatenate([[chunk.start], times])
            if not len(times):
                continue
            postures = [self.postures(each, times, chunk) for each in like]
            first = like[0]
            yield Figures(
                path=path,
                layer="scenery" if isinstance(first, ObstacleView) else f"models/{first.name}",
                times=times,
                figure=figure,
                surfaces=self.run_view.surfaces,
                colour=_PLAIN if isinstance(first, GroupView) else first.colour if first.moves else _STILL,
                owners=[(each.name, each.agents if isinstance(each, GroupView) else [each.name]) for each in like],
                positions=np.concatenate([positions for positions, _ in postures], axis=1),
                orientations=np.concatenate([orientations for _, orientations in postures], axis=1),
                joints=np.concatenate([self._joints(each, times, chunk) for each in like], axis=1),
            )
        self._begun = True

    def _moments(self, who: GroupView | ObstacleView, chunk: Chunk) -> Times:
        topics = [who.state_topic if isinstance(who, GroupView) else f"/world/{who.name}/state"]
        topics += [f"/world/{who.name}/{kind}" for kind in ("pose", "joints")]
        found = [chunk.frames[topic].times for topic in topics if topic in chunk.frames]
        return np.concatenate([np.empty(0, np.int64), *found])

    def _joints(self, who: GroupView | ObstacleView, times: Times, chunk: Chunk) -> Array:
        """Return joint positions at some instants; (k, n, joints), 0 where the log does not have them."""
        assert who.figure
        count = len(who.figure.articulation.joints)
        frames = chunk.frames.get(f"/world/{who.name}/joints")
        if frames and frames.before.shape[1] == count:
            return frames.at(times)
        return np.zeros((len(times), len(who.agents) if isinstance(who, GroupView) else 1, count))
