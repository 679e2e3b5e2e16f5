"""Bodies of agents at their true poses, tinted by risk."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.chunk import Chunk
from symaware_cli.views.detail import FEW, MANY, Detail
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Bodies, Lines
from symaware_cli.views.scene.risk import tinted_by_risk
from symaware_cli.views.views import GroupView, RunView

Array = NDArray[np.float64]

#: Minimum height of rings above the ground, so that they are visible [m].
_ABOVE = 5e-3


class Agents(Drawing):
    """Draws every agent as its shape, or as a ring if its figure is drawn."""

    outputs: ClassVar = frozenset({"replay", "beside", "foxglove", "plot"})
    order: ClassVar = 50

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._shown: set[str] = set()

    def marks(self, chunk: Chunk) -> Iterator[Bodies]:
        """Yield a mark for each group with known positions."""
        for group_view in self.run_view.group_views.values():
            frames = chunk.frames.get(group_view.state_topic)
            times = frames.times if frames else np.empty(0, np.int64)
            if group_view.name not in self._shown:
                self._shown.add(group_view.name)
                if not len(times) or times[0] > chunk.start:
                    # A body with a size but without a position would be drawn at the origin.
                    nowhere = np.full((1, len(group_view.agents), 7), np.nan)
                    yield self._mark(group_view, np.array([chunk.start]), nowhere[..., :3], nowhere[..., 3:], chunk)
            if len(times):
                yield self._mark(group_view, times, *self.postures(group_view, times, chunk), chunk)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks of bodies, and their meaning."""
        group_views = self.run_view.group_views.items()
        believed = [name for name, group_view in group_views if not group_view.state_topic.startswith("/world/")]
        said = f" ({', '.join(believed)}: believed)" if believed else ""
        yield "bodies", f"true positions of agents{said}; redder with risk"

    def _mark(
        self, group_view: GroupView, times: NDArray[np.int64], positions: Array, orientations: Array, chunk: Chunk
    ) -> Bodies:
        figure, ground = group_view.figure, self.run_view.ground
        return Bodies(
            path=f"world/agents/{group_view.name}",
            layer=f"bodies/{group_view.name}",
            times=times,
            names=group_view.agents,
            positions=positions,
            orientations=orientations,
            colours=tinted_by_risk(group_view, times, chunk),
            shape=group_view.shape,
            labels=self._labels(group_view),
            label_colours=group_view.colours,
            nosed=group_view.heading is not None and bool(group_view.radius) and self.detail.awareness,
            ring=(figure.middle, group_view.extent) if figure else None,
            floor=-np.inf if ground is None else ground + _ABOVE,
            extent=group_view.extent,
            spatial=self.run_view.is_spatial,
        )

    def _labels(self, group_view: GroupView) -> dict[int, str]:
        """Return the labels by row: ids, without the name of the group if there is only one group."""
        prefix = f"{group_view.name}." if len(self.run_view.group_views) == 1 else ""
        return {
            row: id.removeprefix(prefix)
            for row, id in enumerate(group_view.agents)
            if self.detail.labels or id in self.detail.focus
        }


#: Minimum interval between two points of a trail [ns], and with many agents.
_STEP, _CROWD_STEP = 100_000_000, 300_000_000


class Trails(Drawing):
    """Draws a line segment for each instant, which is shown for some time."""

    outputs: ClassVar = frozenset({"replay", "beside", "foxglove"})
    order: ClassVar = 60

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        super().__init__(run_view, detail)
        self._last: dict[str, tuple[int, NDArray[np.float64]]] = {}

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the segments between the instants."""
        step = _STEP if self.run_view.agent_count <= MANY else _CROWD_STEP
        for group_view in self.run_view.group_views.values():
            frames = chunk.frames.get(group_view.state_topic)
            if not frames:
                continue
            last = self._last.get(group_view.name)
            chosen = _spaced(frames.times, step, last[0] if last else None)
            if not len(chosen):
                continue
            times, places = frames.times[chosen], group_view.positions(frames.values[chosen])
            starts = np.concatenate([places[:1] if last is None else last[1][None], places[:-1]])
            self._last[group_view.name] = int(times[-1]), places[-1]
            count = len(group_view.agents)
            yield Lines(
                path=f"world/agents/{group_view.name}/trail",
                layer=f"trails/{group_view.name}",
                times=times,
                counts=[count] * len(times),
                points=np.stack([starts, places], axis=2).reshape(-1, 3),
                lengths=np.full(count * len(times), 2),
                colours=np.tile(group_view.colours, (len(times), 1)),
                transparency=0.45 if self.run_view.agent_count <= FEW else 0.65,
                names=group_view.agents,
                who=np.tile(np.arange(count), len(times)),
                width=1.5 if self.detail.awareness else 1.0,
                lasting=self.detail.trail,
            )

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "lines behind", "past positions"


def _spaced(times: NDArray[np.int64], step: int, last: int | None) -> NDArray[np.intp]:
    """Return the indices of times that are at least a step apart."""
    chosen = []
    for place, time in enumerate(times.tolist()):
        if last is None or time - last >= step:
            chosen.append(place)
            last = time
    return np.array(chosen, np.intp)
