"""Lines in Rerun, which supports neither transparency nor a colour gradient along a line."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.views.palette import Colour, faded
from symaware_cli.views.rerun.columns import ColumnReceiver, flat, packed, shades
from symaware_cli.views.scene.marks import Colours, Crosses, Lines, Times

Array = NDArray[np.float64]

#: Maximum number of pieces of a fading line.
_PIECES = 12
#: Share of the background in the first and the last piece of a fading line.
_FADED = (0.05, 0.8)
_STROKES = np.array([[[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]], [[-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]])


def show_lines(output: ColumnReceiver, mark: Lines) -> None:
    """Show lines."""
    import rerun as rr

    if output.is_new(mark.path):
        radii = [mark.thickness] if mark.thickness else rr.Radius.ui_points([mark.width])
        output.static(mark.path, rr.LineStrips3D.from_fields(radii=radii))
    lengths, counts = np.asarray(mark.lengths, np.int64), np.asarray(mark.counts, np.int64)
    colours = shades(mark.colours, mark.transparency, len(lengths), output.theme)
    if not mark.fades:
        send_strips(output, mark.path, mark.times, mark.points, lengths, counts, colours)
        return
    points, pieces, colours = _fading(mark.points, lengths, colours, output.theme.background)
    ends = np.cumsum(counts)
    each = np.array([pieces[end - count : end].sum() for count, end in zip(counts, ends, strict=True)], np.int64)
    send_strips(output, mark.path, mark.times, points, np.full(len(colours), 2), each, colours)


def show_crosses(output: ColumnReceiver, mark: Crosses) -> None:
    """Show crosses as two lines each."""
    import rerun as rr

    if output.is_new(mark.path):
        output.static(mark.path, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([mark.width])))
    count = len(mark.positions)
    points = mark.positions[:, None, None] + mark.size * _STROKES
    colours = np.repeat(shades(mark.colours, mark.transparency, count, output.theme), 2, axis=0)
    counts = 2 * np.asarray(mark.counts, np.int64)
    send_strips(output, mark.path, mark.times, points.reshape(-1, 3), np.full(2 * count, 2), counts, colours)


def send_strips(
    output: ColumnReceiver,
    path: str,
    times: Times,
    points: Array,
    lengths: ArrayLike,
    counts: ArrayLike,
    colours: Colours,
) -> None:
    """Send lines through points.

    Args:
        output: Where to show them.
        path: The Rerun entity.
        times: (k,) [ns].
        points: (sum of lengths, 3) [m].
        lengths: (m,) number of points of each line.
        counts: (k,) number of lines of each instant.
        colours: (m, 3).
    """
    import pyarrow
    import rerun as rr

    kind = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    offsets = pyarrow.array(np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32))
    triples = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(flat(points).ravel()), type=kind.value_type)
    lines = pyarrow.ListArray.from_arrays(offsets, triples, type=kind)
    output.send(path, times, rr.LineStrips3D.columns(strips=lines, colors=packed(colours)), counts)


def _fading(
    points: Array, lengths: NDArray[np.int64], colours: Colours, background: Colour
) -> tuple[Array, NDArray[np.int64], Colours]:
    """Split lines into straight pieces, each fainter than the one before.

    Returns:
        Both ends of each piece, (2 p, 3); the number of pieces of each line (m,); and the colours of the pieces, (p,
        3).
    """
    kinds = np.unique(lengths)
    if len(kinds) == 1:
        length = int(kinds[0])
        pieces, shaded = _alike(points.reshape(-1, length, 3), colours, background)
        return pieces.reshape(-1, 3), np.full(len(lengths), pieces.shape[1]), shaded.reshape(-1, 3)
    counts = np.minimum(lengths, _PIECES + 1) - 1
    starts, firsts = np.cumsum(lengths) - lengths, np.cumsum(counts) - counts
    ends, shaded = np.empty((int(counts.sum()), 2, 3)), np.empty((int(counts.sum()), 3), np.uint8)
    for length in kinds.tolist():
        mine = np.flatnonzero(lengths == length)
        where = firsts[mine, None] + np.arange(min(length, _PIECES + 1) - 1)
        ends[where], shaded[where] = _alike(points[starts[mine, None] + np.arange(length)], colours[mine], background)
    return ends.reshape(-1, 3), counts, shaded


def _alike(points: Array, colours: Colours, background: Colour) -> tuple[Array, Colours]:
    """Return the pieces (m, p, 2, 3) of lines (m, length, 3), and their colours (m, p, 3)."""
    length = points.shape[1]
    chosen = points[:, np.linspace(0, length - 1, min(length, _PIECES + 1)).round().astype(np.intp)]
    shares = np.linspace(*_FADED, chosen.shape[1] - 1)
    return np.stack([chosen[:, :-1], chosen[:, 1:]], axis=2), faded(colours[:, None], shares, background)
