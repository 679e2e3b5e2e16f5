"""Intents of agents: intended paths that fade with time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk, SeriesFrames
from symaware_cli.viewing.scene.marks import Lines
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import GroupView, in_space

Array = NDArray[np.float64]

#: Layers of parts of awareness, where they differ from the name of the part.
LAYERS = {"intent": "intents", "uncertainty": "uncertainties"}


class Intents(Drawing):
    """Draws the intended paths of agents."""

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the lines of each group."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("path"):
                series, rows = chunk.strips.get(topic), self.shown_rows(group_view)
                if series is not None and rows:
                    path, layer = f"awareness/{group_view.name}/{name}", f"{LAYERS.get(name, name)}/{group_view.name}"
                    yield from ways(path, layer, group_view, name, series, rows)


def ways(
    path: str,
    layer: str,
    group_view: GroupView,
    name: str,
    series: SeriesFrames,
    rows: Sequence[int],
    width: float = 1.5,
) -> Iterator[Lines]:
    """Yield fading lines through the positions in the series of a group; nothing if these are not positions.

    Args:
        path: The path of the mark.
        layer: Its layer.
        group_view: The group.
        name: The name of the part of awareness or signal.
        series: Its values.
        rows: The rows to draw.
        width: Width of the lines [pixels].
    """
    columns = path_columns(group_view, name, series.values.shape[1])
    if columns is None:
        return
    which, lengths, points = pieces(series, rows, columns)
    long = lengths > 1
    yield Lines(
        path=path,
        layer=layer,
        times=series.times,
        counts=long.reshape(len(series.times), len(rows)).sum(axis=1),
        points=in_space(points[np.repeat(long, lengths)], group_view.height),
        lengths=lengths[long],
        colours=group_view.colours[which[long]],
        names=group_view.agents,
        who=which[long],
        width=width,
        fades=True,
    )


def pieces(
    series: SeriesFrames, rows: Sequence[int], columns: Sequence[int]
) -> tuple[NDArray[np.intp], NDArray[np.int64], Array]:
    """Extract the series of some rows and columns, instant by instant.

    Returns:
        For each series the row (m,) and the length (m,); and their points (sum of lengths, columns).
    """
    chosen = np.asarray(rows, np.intp)
    lengths = series.lengths[:, chosen]
    which = np.broadcast_to(chosen, lengths.shape).ravel()
    if len(chosen) == series.lengths.shape[1]:
        return which, lengths.ravel(), series.values[:, list(columns)]
    mine = np.zeros(series.lengths.shape, bool)
    mine[:, chosen] = True
    points = series.values[np.repeat(mine.ravel(), series.lengths.ravel())]
    return which, lengths.ravel(), points[:, list(columns)]


def position_columns(group_view: GroupView, names: Sequence[str]) -> list[int] | None:
    """Return the indices of the position among named columns; None if any is missing."""
    wanted = [group_view.state[index][0] for index in group_view.position]
    return [names.index(name) for name in wanted] if all(name in names for name in wanted) else None


def path_columns(group_view: GroupView, name: str, columns: int) -> list[int] | None:
    """Return the indices of the position in the columns of a path; unnamed columns are states, or positions."""
    named = position_columns(group_view, group_view.signals[name].column_names)
    if named:
        return named
    if columns == len(group_view.state):
        return list(group_view.position)
    return list(range(columns)) if columns == len(group_view.position) else None
