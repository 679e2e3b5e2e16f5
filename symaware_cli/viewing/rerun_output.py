"""Output to Rerun: puts arrays into a Rerun recording, whole columns at a time.

Logging row by row costs Rerun some 100 us a row, a column less than half a microsecond (benchmarks/RESULTS.md), so
nothing here is ever called for a single row.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Colours = NDArray[np.uint8]

TIMELINE = "time"
"""The name of the timeline: simulated time."""


class RerunOutput:
    """Draws into a Rerun recording; in what follows k is a number of instants and n one of things.

    Attributes:
        recording: Where everything goes.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        import rerun

        self.recording = recording
        self._rr = rerun
        # Simulated time is the only time there is.
        recording.set_log_time_enabled(False)
        recording.set_log_tick_enabled(False)

    def static(self, path: str, *archetypes: rr.AsComponents) -> None:
        """Put something up for all times."""
        for archetype in archetypes:
            self.recording.log(path, archetype, static=True, strict=True)

    def points(self, path: str, times: Times, positions: Array, colours: Colours | None = None) -> None:
        """Draw points.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            positions: (k, n, 3) [m].
            colours: (k, n, 3).
        """
        columns = self._rr.Points3D.columns(positions=_flat(positions), colors=_packed(colours))
        self._send(path, times, columns.partition(_each(positions)))

    def boxes(self, path: str, times: Times, centres: Array, orientations: Array, colours: Colours) -> None:
        """Draw boxes, whose half sizes are put up as static.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            centres: (k, n, 3) [m].
            orientations: (k, n, 4) quaternions x, y, z, w.
            colours: (k, n, 3).
        """
        columns = self._rr.Boxes3D.columns(
            centers=_flat(centres),
            quaternions=orientations.reshape(-1, 4).astype(np.float32),
            colors=_packed(colours),
        )
        self._send(path, times, columns.partition(_each(centres)))

    def arrows(self, path: str, times: Times, origins: Array, vectors: Array, counts: ArrayLike) -> None:
        """Draw arrows.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            origins: (m, 3) [m].
            vectors: (m, 3) [m].
            counts: (k,) how many of the m belong to each instant.
        """
        columns = self._rr.Arrows3D.columns(origins=_flat(origins), vectors=_flat(vectors))
        self._send(path, times, columns.partition(counts))

    def strips(
        self,
        path: str,
        times: Times,
        points: Array,
        lengths: ArrayLike,
        counts: ArrayLike,
        colours: Colours | None = None,
    ) -> None:
        """Draw lines through points.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            points: (sum of lengths, 3) [m].
            lengths: (m,) points of each line.
            counts: (k,) how many of the m lines belong to each instant.
            colours: (m, 3).
        """
        import pyarrow

        kind = self._rr.components.LineStrip3DBatch._ARROW_DATATYPE
        offsets = pyarrow.array(np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32))
        flat = pyarrow.array(_flat(points).ravel())
        triples = pyarrow.FixedSizeListArray.from_arrays(flat, type=kind.value_type)
        lines = pyarrow.ListArray.from_arrays(offsets, triples, type=kind)
        columns = self._rr.LineStrips3D.columns(strips=lines, colors=_packed(colours))
        self._send(path, times, columns.partition(counts))

    def segments(self, path: str, times: Times, ends: Array, colours: Colours) -> None:
        """Draw straight pieces of line.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            ends: (k, m, 2, 3) [m].
            colours: (m, 3) or (k, m, 3).
        """
        count = ends.shape[0] * ends.shape[1]
        shades = np.broadcast_to(colours, (*ends.shape[:2], 3)).reshape(-1, 3)
        self.strips(path, times, ends.reshape(-1, 3), np.full(count, 2), _each(ends), shades)

    def ellipsoids(
        self,
        path: str,
        times: Times,
        centres: Array,
        half_sizes: Array,
        quaternions: Array,
        counts: ArrayLike,
        colours: Colours,
    ) -> None:
        """Draw ellipsoids as outlines.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            centres: (m, 3) [m].
            half_sizes: (m, 3) [m].
            quaternions: (m, 4) x, y, z, w.
            counts: (k,) how many of the m belong to each instant.
            colours: (m, 3).
        """
        columns = self._rr.Ellipsoids3D.columns(
            centers=_flat(centres),
            half_sizes=_flat(half_sizes),
            quaternions=quaternions.astype(np.float32),
            colors=_packed(colours),
        )
        self._send(path, times, columns.partition(counts))

    def rings(self, path: str, times: Times, centres: Array, radii: Array, counts: ArrayLike, colours: Colours) -> None:
        """Draw level circles, whose other features are put up as static: cylinders, by their length high.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            centres: (m, 3) [m].
            radii: (m,) [m].
            counts: (k,) how many of the m belong to each instant.
            colours: (m, 3).
        """
        columns = self._rr.Cylinders3D.columns(
            centers=_flat(centres), radii=radii.astype(np.float32), colors=_packed(colours)
        )
        self._send(path, times, columns.partition(counts))

    def poses(self, path: str, times: Times, positions: Array, headings: Array | None = None) -> None:
        """Move what is put up at a path.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            positions: (k, 3) [m].
            headings: (k,) [rad]; None if it does not turn.
        """
        quaternions = None if headings is None else turned(headings)
        columns = self._rr.Transform3D.columns(translation=_flat(positions), quaternion=quaternions)
        self._send(path, times, columns)

    def instances(
        self, path: str, times: Times, positions: Array, orientations: Array, scale: ArrayLike | None = None
    ) -> None:
        """Draw what is put up at a path in several places.

        Args:
            path: The Rerun entity.
            times: (k,) [ns].
            positions: (k, n, 3) [m].
            orientations: (k, n, 4) quaternions x, y, z, w.
            scale: (3,) by how much it is enlarged along each axis; None for nothing.
        """
        # With each instant: Rerun takes no scales that are static where places are not.
        scales = None if scale is None else np.broadcast_to(np.asarray(scale, np.float32), positions.shape)
        columns = self._rr.InstancePoses3D.columns(
            translations=_flat(positions),
            quaternions=orientations.reshape(-1, 4).astype(np.float32),
            scales=None if scales is None else scales.reshape(-1, 3),
        )
        self._send(path, times, columns.partition(_each(positions)))

    def scalars(self, path: str, times: Times, values: Array) -> None:
        """Plot numbers over time; values (k, m), of which the m series were named by `series`.

        What is infinite leaves a gap: no axis reaches so far.
        """
        shown = np.where(np.isfinite(values), values, np.nan)
        columns = self._rr.Scalars.columns(scalars=shown.ravel())
        self._send(path, times, columns.partition([values.shape[1]] * len(values)))

    def series(
        self,
        path: str,
        names: Sequence[str],
        colours: ArrayLike | None = None,
        width: float = 1.5,
        keep: Literal["greatest", "least", "both"] = "both",
    ) -> None:
        """Name the m series of `scalars`, and give them colours (m, 3).

        Where more instants than pixels are to be drawn, extremes are kept: those that ``keep`` says. A mean would hide
        that a risk was 1 for a moment.
        """
        policy = self._rr.components.AggregationPolicy
        kept = {"greatest": policy.Max, "least": policy.Min, "both": policy.MinMax}[keep]
        lines = self._rr.SeriesLines(
            names=list(names), colors=colours, widths=[width] * len(names), aggregation_policy=kept
        )
        self.static(path, lines)

    def texts(self, path: str, times: ArrayLike, texts: Sequence[str], levels: Sequence[str]) -> None:
        """Write lines of a log, each with its time [ns] and level."""
        columns = self._rr.TextLog.columns(text=list(texts), level=list(levels))
        self._send(path, np.asarray(times, np.int64), columns)

    def modes(self, path: str, times: ArrayLike, modes: Sequence[str]) -> None:
        """Say from which time [ns] on something is in which mode."""
        self._send(path, np.asarray(times, np.int64), self._rr.StateChange.columns(state=list(modes)))

    def flush(self) -> None:
        """Wait until everything has left this process.

        Raises:
            RuntimeError: It could not be written or sent.
        """
        self.recording.flush()

    def _send(self, path: str, times: Times, columns: Any) -> None:
        if not len(times):
            return
        index = self._rr.TimeColumn(TIMELINE, duration=times.astype("timedelta64[ns]"))
        self.recording.send_columns(path, [index], columns, strict=True)


def turned(headings: ArrayLike) -> NDArray[np.float32]:
    """The quaternions (..., 4), x, y, z, w, of headings (...) [rad] about the vertical axis."""
    half = 0.5 * np.asarray(headings, float)
    zero = np.zeros_like(half)
    return np.stack([zero, zero, np.sin(half), np.cos(half)], axis=-1).astype(np.float32)


def _flat(points: Array) -> NDArray[np.float32]:
    """Points (..., 3) as (m, 3)."""
    return np.ascontiguousarray(points, np.float32).reshape(-1, 3)


def _each(points: Array) -> list[int]:
    """As many for each of k instants; (k, n, 3)."""
    return [points.shape[1]] * len(points)


def _packed(colours: Colours | None) -> NDArray[np.uint32] | None:
    """Colours (..., 3) as 0xRRGGBBAA, (m,)."""
    if colours is None:
        return None
    red, green, blue = np.moveaxis(colours.reshape(-1, 3).astype(np.uint32), -1, 0)
    return (red << 24 | green << 16 | blue << 8 | 0xFF).astype(np.uint32)
