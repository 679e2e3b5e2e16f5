"""Signals that are areas of the ground, such as beliefs of agents about the map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import BOX_COLUMNS
from symaware_cli.views.chunk import Chunk
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Lines
from symaware_cli.views.scene.signals import lighter, tables_of
from symaware_cli.views.views import GroupView

Array = NDArray[np.float64]

#: Offset below a planar world, between the regions and the bodies, so that both coincide in a view in perspective [m].
_BELOW = (-0.35, -0.3)


class Shade(NamedTuple):
    """Areas that are drawn alike.

    Attributes:
        name: Its part of the path.
        least: The least value of their column.
        below: What their value is below.
        transparency: How transparent they are.
        is_light: Whether they have a lighter colour.
        height: Their offset below a planar world [m].
    """

    name: str
    least: float
    below: float
    transparency: float
    is_light: bool
    height: float


#: The shades of areas, by the column that determines them: free or occupied, or a probability in classes.
_SHADES = {
    "occupied": (
        Shade("free", -np.inf, 0.5, 0.8, True, _BELOW[0]),
        Shade("occupied", 0.5, np.inf, 0.25, False, _BELOW[1]),
    ),
    "level": (
        Shade("below-0.05", 0.0, 0.05, 0.9, False, _BELOW[1]),
        Shade("below-0.2", 0.05, 0.2, 0.75, False, _BELOW[1]),
        Shade("below-0.5", 0.2, 0.5, 0.5, False, _BELOW[1]),
        Shade("above", 0.5, np.inf, 0.25, False, _BELOW[1]),
    ),
}


#: In the scene itself, the areas of more agents would cover each other.
_MOST = 3


class Areas(Drawing):
    """Draws signals that are areas: in the tabs of agents in focus, and of a few agents in the scene as well."""

    order: ClassVar = 125

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the areas from each instant at which they were recorded until the next."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("areas"):
                tables: dict[int, list[tuple[int, Array]]] = {}
                for time, message in chunk.entries.get(topic, ()):
                    for row, table in tables_of(message):
                        tables.setdefault(row, []).append((time, table))
                for row, said in sorted(tables.items()):
                    for path in self._paths(group_view, name, row):
                        column = _column(group_view, name)
                        yield from (_mark(group_view, name, row, said, each, path) for each in _SHADES[column])

    def _paths(self, group_view: GroupView, name: str, row: int) -> Iterator[str]:
        """Yield the paths under which the areas of an agent are drawn."""
        agent = group_view.agents[row]
        if agent in self.detail.focus:
            yield f"as/{agent}/{name}"
        if len(group_view.agents) <= _MOST and row in self.shown_rows(group_view):
            yield f"awareness/{group_view.name}/{name}/{agent}"

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the meaning of the areas of each signal."""
        for name, meaning in self.run_view.described("areas").items():
            yield "light and dark areas on the ground", f"{name}: {meaning}"


def _column(group_view: GroupView, name: str) -> str:
    """Return the column of a signal that determines the shades of its areas."""
    names = group_view.signals[name].column_names
    return next(each for each in _SHADES if each in names)


def _mark(
    group_view: GroupView, name: str, row: int, said: Sequence[tuple[int, Array]], shade: Shade, path: str
) -> Lines:
    """Return the areas of one agent and shade by instant [ns]: lines as wide as the narrowest of them."""
    names = group_view.signals[name].column_names
    places, of = [names.index(each) for each in BOX_COLUMNS], names.index(_column(group_view, name))
    tables = [table[(table[:, of] >= shade.least) & (table[:, of] < shade.below)][:, places] for _, table in said]
    every = np.concatenate(tables)
    sides = np.stack([every[:, 1] - every[:, 0], every[:, 3] - every[:, 2]])
    side = float(sides.min(initial=np.inf)) if len(every) else 1.0
    points, counts = [np.empty((0, 2, 2))], []
    for table in tables:
        found = _strips(table, side)
        points.append(found)
        counts.append(len(found))
    joined = np.concatenate(points)
    heights = np.full((*joined.shape[:2], 1), shade.height)
    colour = group_view.colours[row]
    return Lines(
        path=f"{path}/{shade.name}",
        layer=f"{name}/{group_view.name}",
        times=np.array([time for time, _ in said], np.int64),
        counts=counts,
        points=np.concatenate([joined, heights], axis=2).reshape(-1, 3),
        lengths=np.full(len(joined), 2),
        colours=lighter(colour) if shade.is_light else colour,
        transparency=shade.transparency,
        names=[f"{group_view.agents[row]} {name}"],
        who=np.zeros(len(joined), np.intp),
        thickness=side,
    )


def _strips(boxes: Array, side: float) -> Array:
    """Return the centre lines of strips of a width that cover boxes; shape (m, 2, 2)."""
    low, high = boxes[:, [0, 2]], boxes[:, [1, 3]]
    # Along the longer side, so that the strips are few.
    lying = (high - low)[:, 0] >= (high - low)[:, 1]
    across = np.where(lying, (high - low)[:, 1], (high - low)[:, 0])
    number = np.maximum(1, np.round(across / side)).astype(np.intp)
    box = np.repeat(np.arange(len(boxes)), number)
    within = np.arange(len(box)) - np.repeat(np.cumsum(number) - number, number)
    offset = (within + 0.5) * (across / number)[box]
    starts, ends = low[box].copy(), high[box].copy()
    flat = lying[box]
    for axis, some in ((1, flat), (0, ~flat)):
        starts[some, axis] = ends[some, axis] = low[box][some, axis] + offset[some]
    # Lines of a thickness have round or square ends of half of it beyond their ends.
    for axis, some in ((0, flat), (1, ~flat)):
        starts[some, axis] += 0.5 * side
        ends[some, axis] -= 0.5 * side
    return np.stack([starts, ends], axis=1)
