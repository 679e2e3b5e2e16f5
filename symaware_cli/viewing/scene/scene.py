"""Drawings, each of which draws one kind of content of a log as marks; and scenes, which combine them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk, ChunkReader
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.scene.marks import Mark
from symaware_cli.viewing.views import GroupView, ObstacleView, RunView

Array = NDArray[np.float64]

#: Fields of the true state of a group.
_TRUTHS = ("state", "control", "pose", "joints")


class Drawing(ABC):
    """Draws one kind of content of a log as marks.

    Attributes:
        run_view: The run to draw.
        detail: The level of detail.
    """

    def __init__(self, run_view: RunView, detail: Detail) -> None:
        self.run_view = run_view
        self.detail = detail

    @abstractmethod
    def marks(self, chunk: Chunk) -> Iterable[Mark]:
        """Yield the marks of a chunk; called in the order of time."""

    def shown_rows(self, group_view: GroupView) -> list[int]:
        """Return the rows of the agents whose awareness is shown: all, or with many agents those in focus."""
        return [row for row, id in enumerate(group_view.agents) if self.detail.awareness or id in self.detail.focus]

    def places(self, who: str, times: NDArray[np.int64], chunk: Chunk) -> Array:
        """Return positions of an agent or entity at some instants of a chunk; (len(times), 3) [m], NaN if unknown."""
        if who in self.run_view.place:
            group, row = self.run_view.place[who]
            group_view = self.run_view.group_views[group]
            frames = chunk.frames.get(group_view.state_topic)
            known = None if frames is None else group_view.positions(frames.of(times, row))
        else:
            frames = chunk.frames.get(f"/world/{who}/state")
            known = None if frames is None else self.run_view.obstacle_views[who].positions(frames.of(times, 0))
        unknown = (
            self.run_view.obstacle_views[who].position if who in self.run_view.obstacle_views else np.full(3, np.nan)
        )
        if known is None:
            return np.broadcast_to(unknown, (len(times), 3))
        return np.where(np.isnan(known), unknown, known)

    def postures(self, who: GroupView | ObstacleView, times: NDArray[np.int64], chunk: Chunk) -> tuple[Array, Array]:
        """Return the poses of the bodies of a group, or of an entity, at some instants of a chunk.

        Returns:
            Positions (k, n, 3) [m] and quaternions x, y, z, w (k, n, 4); NaN for agents where unknown.
        """
        poses = chunk.frames.get(f"/world/{who.name}/pose")
        if poses is not None and poses.before.shape[1] == 7:
            values = poses.at(times)
            return values[..., :3], values[..., 3:]
        if isinstance(who, GroupView):
            frames = chunk.frames.get(who.state_topic)
            count = len(times), len(who.agents)
            states = np.full((*count, len(who.state)), np.nan) if frames is None else frames.at(times)
            return who.positions(states), who.orientations(states)
        frames = chunk.frames.get(f"/world/{who.name}/state")
        values = np.full((len(times), 1, 3), np.nan) if frames is None else frames.at(times)
        known = np.isfinite(values[..., -1:])
        headings = np.where(known[..., 0], values[..., -1], who.heading)
        return np.where(known, who.positions(values), who.position), who.orientations(headings)


class Scene:
    """Converts a log to marks, chunk by chunk."""

    def __init__(self, run_view: RunView, detail: Detail, drawings: Sequence[type[Drawing]]) -> None:
        """Create the drawings.

        Args:
            run_view: The run to draw.
            detail: The level of detail.
            drawings: The classes of drawings.
        """
        self._run_view = run_view
        self._drawings = [drawing(run_view, detail) for drawing in drawings]

    def chunk_reader(self) -> ChunkReader:
        """Create a reader that groups messages into chunks for this scene."""
        counts = {
            topic: len(group_view.agents)
            for group_view in self._run_view.group_views.values()
            for topic in (
                *(f"/world/{group_view.name}/{field}" for field in _TRUTHS),
                f"/agents/{group_view.name}/control",
                *map(group_view.topic, group_view.signals),
            )
        }
        return ChunkReader(counts, self._run_view.place)

    def marks(self, chunk: Chunk) -> Iterator[Mark]:
        """Yield the marks of a chunk; chunks must be ordered by time."""
        for drawing in self._drawings:
            yield from drawing.marks(chunk)
