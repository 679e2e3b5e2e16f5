"""What agents intend: the ways that they mean to go, fading with time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk, SeriesFrames
from symaware_cli.viewing.scene.base import Drawing
from symaware_cli.viewing.scene.marks import Lines
from symaware_cli.viewing.views import GroupView, in_space

Array = NDArray[np.float64]

#: What the drawings of parts are switched on and off by, where that is not their name.
LAYERS = {"intent": "intents", "uncertainty": "uncertainties"}


class Intents(Drawing):
    """The ways that agents mean to go."""

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """A line for each agent that is shown."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("path"):
                series, rows = chunk.strips.get(topic), self.shown_rows(group_view)
                if series is not None and rows:
                    path, layer = f"minds/{group_view.name}/{name}", f"{LAYERS.get(name, name)}/{group_view.name}"
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
    """Lines that fade, through the positions in some series of a group; none where these are no positions.

    Args:
        path: What the mark is called.
        layer: What it is switched on and off by.
        group_view: Whose they are.
        name: Which of their parts of awareness or signals.
        series: Its values.
        rows: Of whom.
        width: How thick lines are [pixels].
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
    """The series of some rows, instant by instant, of some columns.

    Returns:
        Of each series the row (m,) and the length (m,); and their points (sum of lengths, columns).
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
    """Where the elements of the position stand among named columns; None if any is missing."""
    wanted = [group_view.state[index][0] for index in group_view.position]
    return [names.index(name) for name in wanted] if all(name in names for name in wanted) else None


def path_columns(group_view: GroupView, name: str, columns: int) -> list[int] | None:
    """Where the position stands among the numbers of a path; where nobody names them they are states, or positions."""
    named = position_columns(group_view, group_view.signals[name].column_names)
    if named:
        return named
    if columns == len(group_view.state):
        return list(group_view.position)
    return list(range(columns)) if columns == len(group_view.position) else None
