"""What agents intend, and how sure they are: paths ahead, ellipses of 95 %, fans of samples."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.viewing.chunk import Chunk, SeriesFrames
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.palette import faded
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.views import GroupView, in_space

Array = NDArray[np.float64]
Colours = NDArray[np.uint8]
Times = NDArray[np.int64]

#: How many deviations an ellipse or ellipsoid reaches that holds 95 % of a normal distribution: the root of the 95 %
#: quantile of the chi-square distribution with 2 or 3 degrees of freedom.
DEVIATIONS = {2: 2.4477, 3: 2.7955}

#: A fading line has so many pieces at most.
_PIECES = 12


class Intents(Drawing):
    """The ways that agents mean to go, fading with time."""

    def begin(self) -> None:
        """Put up how thick they are."""
        import rerun as rr

        width = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([1.5]))
        for group_view in self.run_view.group_views.values():
            for name, _ in group_view.drawn("path"):
                self.output.static(f"minds/{group_view.name}/{name}", width)

    def draw(self, chunk: Chunk) -> None:
        """Draw the intents of all who are shown."""
        for group_view in self.run_view.group_views.values():
            rows = [row for row, id in enumerate(group_view.agents) if self.detail.minds or id in self.detail.focus]
            for name, topic in group_view.drawn("path"):
                strips = chunk.strips.get(topic)
                if strips is not None:
                    columns = path_columns(group_view, name, strips.values.shape[1])
                    fading(self.output, f"minds/{group_view.name}/{name}", group_view, strips, rows, columns)


class Uncertainties(Drawing):
    """How far the truth may be from what agents believe of themselves, and what else they hold possible."""

    def begin(self) -> None:
        """Put up how thick the lines are."""
        import rerun as rr

        thin = rr.Radius.ui_points([0.75])
        for group_view in self.run_view.group_views.values():
            for name, _ in group_view.drawn("ellipse"):
                path = f"minds/{group_view.name}/{name}"
                self.output.static(path, rr.Ellipsoids3D.from_fields(line_radii=thin, fill_mode="majorwireframe"))
                self.output.static(f"{path}/samples", rr.LineStrips3D.from_fields(radii=thin))

    def draw(self, chunk: Chunk) -> None:
        """Draw the uncertainties of all who are shown."""
        for group_view in self.run_view.group_views.values():
            believed = chunk.frames.get(f"/agents/{group_view.name}/state")
            rows = [row for row, id in enumerate(group_view.agents) if self.detail.minds or id in self.detail.focus]
            for name, topic in group_view.drawn("ellipse"):
                path, strips = f"minds/{group_view.name}/{name}", chunk.strips.get(topic)
                names = group_view.signals[name].column_names
                if strips is None or not rows:
                    continue
                covariance, samples = covariance_columns(group_view, names), sample_columns(group_view, names)
                if covariance is not None and believed is not None:
                    centres = group_view.positions(believed.at(strips.times))[:, rows]
                    matrices = strips.firsts[:, rows][..., covariance]
                    self._draw_ellipses(path, group_view, strips.times, centres, matrices, rows)
                if samples is not None:
                    self._draw_samples(f"{path}/samples", group_view, strips, rows, samples)

    def _draw_ellipses(
        self, path: str, group_view: GroupView, times: Times, centres: Array, matrices: Array, rows: Sequence[int]
    ) -> None:
        half_sizes, quaternions = ellipsoids(matrices.reshape(-1, *matrices.shape[2:]))
        colours = np.broadcast_to(faded(group_view.colours[rows], 0.15), (*centres.shape[:2], 3))
        self.output.ellipsoids(
            path,
            times,
            centres.reshape(-1, 3),
            half_sizes,
            quaternions,
            [len(rows)] * len(times),
            colours.reshape(-1, 3),
        )

    def _draw_samples(
        self, path: str, group_view: GroupView, strips: SeriesFrames, rows: Sequence[int], columns: NDArray[np.intp]
    ) -> None:
        """Draw the ways of all samples; columns (samples, d)."""
        points: list[Array] = []
        lengths: list[int] = []
        counts: list[int] = []
        colours: list[Colours] = []
        ends = np.cumsum(strips.lengths.ravel()).reshape(strips.lengths.shape)
        for place in range(len(strips.times)):
            before = len(lengths)
            for row in rows:
                length = int(strips.lengths[place, row])
                series = strips.values[ends[place, row] - length : ends[place, row]]
                if length > 1:
                    ways = in_space(series[:, columns].swapaxes(0, 1), group_view.height)
                    points.append(ways.reshape(-1, 3))
                    lengths += [length] * len(ways)
                    colours.append(np.broadcast_to(faded(group_view.colours[row], 0.5), (len(ways), 3)))
            counts.append(len(lengths) - before)
        if points:
            self.output.strips(
                path,
                strips.times,
                np.concatenate(points),
                lengths,
                counts,
                np.concatenate(colours),
            )


def fading(
    output: RerunOutput,
    path: str,
    group_view: GroupView,
    strips: SeriesFrames,
    rows: Sequence[int],
    columns: Sequence[int] | None,
) -> None:
    """Draw the series of some rows as lines that fade with time.

    Args:
        output: Where to draw.
        path: The Rerun entity.
        group_view: Whose they are.
        strips: The series.
        rows: Of whom.
        columns: Which columns are the position; nothing is drawn without.
    """
    if columns is None or not rows:
        return
    length = int(strips.lengths.max(initial=0))
    if length < 2 or (strips.lengths != length).any():
        _fading_ragged(output, path, group_view, strips, rows, columns)
        return
    chosen = _pieces(length)
    shape = (len(strips.times), -1, length, strips.values.shape[1])
    of_all = (
        strips.values.reshape(shape)[:, rows] if len(rows) < strips.lengths.shape[1] else strips.values.reshape(shape)
    )
    points = in_space(of_all[:, :, chosen][..., list(columns)], group_view.height)
    ends = np.stack([points[:, :, :-1], points[:, :, 1:]], axis=3)
    shades = faded(group_view.colours[list(rows)][:, None], _shares(len(chosen) - 1))
    output.segments(path, strips.times, ends.reshape(len(ends), -1, 2, 3), shades.reshape(-1, 3))


def _fading_ragged(
    output: RerunOutput,
    path: str,
    group_view: GroupView,
    strips: SeriesFrames,
    rows: Sequence[int],
    columns: Sequence[int],
) -> None:
    """The same for series of which each has a length of its own."""
    points, colours, counts = [], [], []
    ends = np.cumsum(strips.lengths.ravel()).reshape(strips.lengths.shape)
    for place in range(len(strips.times)):
        count = 0
        for row in rows:
            length = int(strips.lengths[place, row])
            if length < 2:
                continue
            series = strips.values[ends[place, row] - length : ends[place, row]]
            line, fading_colours = fading_line(
                in_space(series[:, list(columns)], group_view.height), group_view.colours[row]
            )
            points.append(line)
            colours.append(fading_colours)
            count += len(fading_colours)
        counts.append(count)
    flat = np.concatenate(points) if points else np.empty((0, 3))
    shades = np.concatenate(colours) if colours else np.empty((0, 3), np.uint8)
    output.strips(path, strips.times, flat, np.full(sum(counts), 2), counts, shades)


def fading_line(points: Array, colour: Colours) -> tuple[Array, Colours]:
    """Cut a line into straight pieces that fade.

    Args:
        points: (k, 3), at least two.
        colour: That of its beginning.

    Returns:
        Both ends of each piece, (2 m, 3), and the colours of the pieces, (m, 3).
    """
    chosen = points[_pieces(len(points))]
    ends = np.stack([chosen[:-1], chosen[1:]], axis=1).reshape(-1, 3)
    return ends, faded(colour, _shares(len(chosen) - 1))


def ellipsoids(covariances: Array) -> tuple[Array, Array]:
    """The ellipses or ellipsoids that hold 95 % of normal distributions.

    Args:
        covariances: (m, d, d) of positions in the plane or in space [m^2].

    Returns:
        Half sizes (m, 3) [m] and quaternions (m, 4), x, y, z, w; those of a plane are flat. Where a covariance is not
        known (NaN), the half sizes are 0.
    """
    dimension = covariances.shape[-1]
    known = np.asarray(np.isfinite(covariances).all(axis=(-1, -2)))
    sound = np.where(known[:, None, None], covariances, 0.0)
    half_sizes, quaternions = np.zeros((len(sound), 3)), np.zeros((len(sound), 4))
    if dimension == 2:
        # In closed form, some ten times faster than for any dimension.
        (first, mixed), (_, second) = np.moveaxis(sound, 0, -1)
        middle, half = 0.5 * (first + second), 0.5 * (first - second)
        spread, turn = np.hypot(half, mixed), 0.5 * np.arctan2(mixed, half)
        variances = np.stack([middle + spread, middle - spread], axis=1)
        half_sizes[:, :2] = DEVIATIONS[2] * np.sqrt(np.maximum(variances, 0.0))
        quaternions[:, 2], quaternions[:, 3] = np.sin(0.5 * turn), np.cos(0.5 * turn)
        return half_sizes, quaternions
    variances, axes = np.linalg.eigh(0.5 * (sound + sound.swapaxes(-1, -2)))
    half_sizes[:] = DEVIATIONS[dimension] * np.sqrt(np.maximum(variances, 0.0))
    from scipy.spatial.transform import Rotation

    # Eigenvectors may make a mirror image; a rotation does not.
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    return half_sizes, Rotation.from_matrix(axes).as_quat()


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


def covariance_columns(group_view: GroupView, names: Sequence[str]) -> NDArray[np.intp] | None:
    """Where the covariance of the position stands, (d, d)."""
    elements = [group_view.state[index][0] for index in group_view.position]
    wanted = [[f"cov_{one}_{other}" for other in elements] for one in elements]
    if not all(name in names for row in wanted for name in row):
        return None
    return np.array([[names.index(name) for name in row] for row in wanted])


def sample_columns(group_view: GroupView, names: Sequence[str]) -> NDArray[np.intp] | None:
    """Where the positions of numbered samples stand, (samples, d)."""
    elements = [group_view.state[index][0] for index in group_view.position]
    numbers = sorted({int(found[1]) for name in names if (found := re.fullmatch(r".+\.(\d+)", name))})
    samples = [[f"{element}.{number}" for element in elements] for number in numbers]
    whole = [sample for sample in samples if all(name in names for name in sample)]
    return np.array([[names.index(name) for name in sample] for sample in whole]) if whole else None


def _pieces(length: int) -> NDArray[np.intp]:
    """Which points of a long line to keep."""
    return np.unique(np.linspace(0, length - 1, min(length, _PIECES + 1)).round().astype(np.intp))


def _shares(count: int) -> Array:
    """How much each piece of a fading line has of the background."""
    return np.linspace(0.05, 0.8, count)
