"""Awareness of agents of themselves: intents that fade, uncertainties as ellipses, tubes and samples; not `risk`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.chunk import Chunk, SeriesFrames
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Ellipsoids, Lines
from symaware_cli.views.views import GroupView, in_space

Array = NDArray[np.float64]

#: Layers of parts of awareness, where they differ from the name of the part.
LAYERS = {"intent": "intents", "uncertainty": "uncertainties"}


class Intents(Drawing):
    """Draws the intended paths of agents."""

    outputs: ClassVar = frozenset({"replay", "foxglove", "plot"})
    order: ClassVar = 70

    def marks(self, chunk: Chunk) -> Iterator[Lines]:
        """Yield the lines of each group."""
        for group_view in self.run_view.group_views.values():
            for name, topic in group_view.drawn("path"):
                series, rows = chunk.strips.get(topic), self.shown_rows(group_view)
                if series is not None and rows:
                    path, layer = f"awareness/{group_view.name}/{name}", f"{LAYERS.get(name, name)}/{group_view.name}"
                    yield from ways(path, layer, group_view, name, series, rows)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "fading lines ahead", "intents"


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


#: Number of standard deviations of an ellipse or ellipsoid that contains 95 % of a normal distribution: the root of the
#: 95 % quantile of the chi-square distribution with 2 or 3 degrees of freedom.
DEVIATIONS = {2: 2.4477, 3: 2.7955}

#: Transparency of the first and the last ellipse of a tube.
_NEAREST, _FAINTEST = 0.4, 0.9


class Uncertainties(Drawing):
    """Draws the uncertainty of agents about their own positions, now and along their intents, and samples of it."""

    order: ClassVar = 80

    def marks(self, chunk: Chunk) -> Iterator[Ellipsoids | Lines]:
        """Yield ellipses and samples of the agents that are shown."""
        for group_view in self.run_view.group_views.values():
            believed, rows = chunk.frames.get(f"/agents/{group_view.name}/state"), self.shown_rows(group_view)
            for name, topic in group_view.drawn("ellipse"):
                series, names = chunk.strips.get(topic), group_view.signals[name].column_names
                if series is None or not rows:
                    continue
                path, layer = f"awareness/{group_view.name}/{name}", f"{LAYERS.get(name, name)}/{group_view.name}"
                covariance, samples = covariance_columns(group_view, names), sample_columns(group_view, names)
                if covariance is not None and believed is not None:
                    centres = group_view.positions(believed.at(series.times))[:, rows].reshape(-1, 3)
                    matrices = series.firsts.values[:, rows][..., covariance].reshape(-1, *covariance.shape)
                    half_sizes, orientations = ellipsoids(matrices)
                    which = np.tile(rows, len(series.times))
                    yield Ellipsoids(
                        path=path,
                        layer=layer,
                        times=series.times,
                        counts=[len(rows)] * len(series.times),
                        centres=centres,
                        half_sizes=half_sizes,
                        orientations=orientations,
                        colours=group_view.colours[which],
                        transparency=0.15,
                        names=group_view.agents,
                        who=which,
                    )
                intents = chunk.strips.get(group_view.topic("intent")) if "intent" in group_view.signals else None
                focus = [row for row in rows if group_view.agents[row] in self.detail.focus]
                if covariance is not None and intents is not None and focus:
                    yield from _tubes(f"{path}/tube", layer, group_view, (series, intents), focus, covariance)
                if samples is not None:
                    yield _fans(f"{path}/samples", layer, group_view, series, rows, samples)

    def legend(self) -> Iterator[tuple[str, str]]:
        """Yield the marks that are seen, and their meaning."""
        yield "ellipses", "uncertainty of the position, 95 %"
        yield "thin fans", "samples of the future"


def _tubes(
    path: str,
    layer: str,
    group_view: GroupView,
    both: tuple[SeriesFrames, SeriesFrames],
    rows: Sequence[int],
    covariance: NDArray[np.intp],
) -> Iterator[Ellipsoids]:
    """Yield fading ellipses along the intents, where an uncertainty and an intent have as many points.

    Args:
        path: The path of the mark.
        layer: Its layer.
        group_view: The group.
        both: The uncertainties and the intents.
        rows: The rows to draw.
        covariance: The columns of the covariance of the position; shape (d, d).
    """
    positions = path_columns(group_view, "intent", both[1].values.shape[1])
    if positions is None:
        return
    which, lengths, matrices = pieces(both[0], rows, covariance.ravel().tolist())
    _, intended, points = pieces(both[1], rows, positions)
    shape = len(both[0].times), len(rows)
    _, here, there = np.intersect1d(both[0].times, both[1].times, return_indices=True)
    uncertain, known = np.zeros(shape, bool), np.zeros((len(both[1].times), len(rows)), bool)
    counts = lengths.reshape(shape)[here]
    uncertain[here] = known[there] = (counts == intended.reshape(known.shape)[there]) & (counts > 1)
    kept = lengths[uncertain.ravel()]
    # The first ellipse is where the agent is.
    place = np.arange(kept.sum()) - np.repeat(np.cumsum(kept) - kept, kept)
    ahead = place > 0
    who = np.repeat(which[uncertain.ravel()], kept)[ahead]
    half_sizes, orientations = ellipsoids(
        matrices[np.repeat(uncertain.ravel(), lengths)][ahead].reshape(-1, *covariance.shape)
    )
    yield Ellipsoids(
        path=path,
        layer=layer,
        times=both[0].times,
        counts=np.where(uncertain, lengths.reshape(shape) - 1, 0).sum(axis=1),
        centres=in_space(points[np.repeat(known.ravel(), intended)][ahead], group_view.height),
        half_sizes=half_sizes,
        orientations=orientations,
        colours=group_view.colours[who],
        transparency=_FAINTEST + (_NEAREST - _FAINTEST) * (1.0 - place / np.repeat(kept, kept))[ahead],
        names=group_view.agents,
        who=who,
    )


def _fans(
    path: str,
    layer: str,
    group_view: GroupView,
    series: SeriesFrames,
    rows: Sequence[int],
    columns: NDArray[np.intp],
) -> Lines:
    """Return lines through all samples; columns (samples, d)."""
    which, lengths, points = pieces(series, rows, columns.ravel().tolist())
    samples, dimension = columns.shape
    long = lengths > 1
    points = points[np.repeat(long, lengths)].reshape(-1, samples, dimension)
    # Sorted by sample within each series, in which the samples of a point are adjacent.
    owner = np.repeat(np.arange(long.sum()), lengths[long])
    order = np.lexsort((np.tile(np.arange(samples), len(points)), np.repeat(owner, samples)))
    return Lines(
        path=path,
        layer=layer,
        times=series.times,
        counts=samples * long.reshape(len(series.times), len(rows)).sum(axis=1),
        points=in_space(points.reshape(-1, dimension)[order], group_view.height),
        lengths=np.repeat(lengths[long], samples),
        colours=np.repeat(group_view.colours[which[long]], samples, axis=0),
        transparency=0.5,
        width=0.75,
        names=[f"{agent} samples" for agent in group_view.agents],
        who=np.repeat(which[long], samples),
    )


def ellipsoids(covariances: Array) -> tuple[Array, Array]:
    """Compute the ellipses or ellipsoids that contain 95 % of normal distributions.

    Args:
        covariances: (m, d, d) of positions in the plane or in space [m^2].

    Returns:
        Half sizes (m, 3) [m] and quaternions (m, 4), x, y, z, w; planar ones are flat. Where a covariance is unknown
        (NaN), the half sizes are 0.
    """
    dimension = covariances.shape[-1]
    known = np.asarray(np.isfinite(covariances).all(axis=(-1, -2)))
    sound = np.where(known[:, None, None], covariances, 0.0)
    half_sizes, quaternions = np.zeros((len(sound), 3)), np.zeros((len(sound), 4))
    if dimension == 2:
        # In closed form, about ten times as fast as the general case.
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

    # Eigenvectors may form a reflection instead of a rotation.
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    return half_sizes, Rotation.from_matrix(axes).as_quat()


def covariance_columns(group_view: GroupView, names: Sequence[str]) -> NDArray[np.intp] | None:
    """Return the column indices of the covariance of the position, (d, d)."""
    elements = [group_view.state[index][0] for index in group_view.position]
    wanted = [[f"cov_{one}_{other}" for other in elements] for one in elements]
    if not all(name in names for row in wanted for name in row):
        return None
    return np.array([[names.index(name) for name in row] for row in wanted])


def sample_columns(group_view: GroupView, names: Sequence[str]) -> NDArray[np.intp] | None:
    """Return the column indices of the positions of numbered samples, (samples, d)."""
    elements = [group_view.state[index][0] for index in group_view.position]
    numbers = sorted({int(found[1]) for name in names if (found := re.fullmatch(r".+\.(\d+)", name))})
    samples = [[f"{element}.{number}" for element in elements] for number in numbers]
    whole = [sample for sample in samples if all(name in names for name in sample)]
    return np.array([[names.index(name) for name in sample] for sample in whole]) if whole else None
