"""Boxes that components declare, such as cells that are taken or closed, as outlines on the ground."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.signal import BOX_COLUMNS
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.scene.marks import Lines
from symaware_cli.viewing.scene.points import lighter, tables_of
from symaware_cli.viewing.scene.scene import Drawing
from symaware_cli.viewing.views import GroupView

Array = NDArray[np.float64]

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
