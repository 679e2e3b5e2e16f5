"""Sends columns of values to a Rerun recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.scene.marks import Colours, Times

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]

TIMELINE = "time"
"""The name of the timeline of simulated time."""


class Columns:
    """Sends columns to a recording; below, k is a number of instants.

    Attributes:
        recording: The recording.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self.recording = recording
        # Simulated time is the only timeline.
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)
        self._begun: set[str] = set()

    def static(self, path: str, *archetypes: rr.AsComponents) -> None:
        """Log archetypes that are valid at all times."""
        for archetype in archetypes:
            self.recording.log(path, archetype, static=True, strict=True)

    def is_new(self, path: str) -> bool:
        """Whether this is the first call for a path, so that its static components must be logged."""
        new = path not in self._begun
        self._begun.add(path)
        return new

    def send(self, path: str, times: Times, columns: Any, counts: ArrayLike | None = None) -> None:
        """Send values at (k,) times [ns].

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            columns: The columns of a Rerun archetype.
            counts: (k,) number of values of each instant; None for one each.
        """
        import rerun as rr

        if not len(times):
            return
        index = rr.TimeColumn(TIMELINE, duration=times.astype("timedelta64[ns]"))
        parts = columns if counts is None else columns.partition(counts)
        self.recording.send_columns(path, [index], parts, strict=True)

    def strips(
        self, path: str, times: Times, points: Array, lengths: ArrayLike, counts: ArrayLike, colours: Colours
    ) -> None:
        """Send lines through points.

        Args:
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
        self.send(path, times, rr.LineStrips3D.columns(strips=lines, colors=packed(colours)), counts)


def flat(points: Array) -> NDArray[np.float32]:
    """Reshape points (..., 3) to (m, 3)."""
    return np.ascontiguousarray(points, np.float32).reshape(-1, 3)


def turns(orientations: Array) -> NDArray[np.float32]:
    """Reshape quaternions (..., 4) to (m, 4)."""
    return np.ascontiguousarray(orientations, np.float32).reshape(-1, 4)


def each(points: Array) -> list[int]:
    """Return the number of points of each of k instants; (k, n, 3)."""
    return [points.shape[1]] * len(points)


def shades(colours: ArrayLike, transparency: ArrayLike, count: int) -> Colours:
    """Return colours (count, 3), mixed with the background in place of transparency, which Rerun does not support."""
    own = np.broadcast_to(np.asarray(colours, np.uint8), (count, 3))
    share = np.asarray(transparency, float)
    return faded(own, share) if share.any() else own


def packed(colours: Colours) -> NDArray[np.uint32]:
    """Convert colours (..., 3) to 0xRRGGBBAA, (m,)."""
    red, green, blue = np.moveaxis(colours.reshape(-1, 3).astype(np.uint32), -1, 0)
    return (red << 24 | green << 16 | blue << 8 | 0xFF).astype(np.uint32)
