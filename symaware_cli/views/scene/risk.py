"""Risk: the tint of bodies, and curves for each agent or quantiles of a group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from symaware_cli.views.chunk import Chunk
from symaware_cli.views.palette import AGENTS, RISK, tinted
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Curves
from symaware_cli.views.views import GroupView

Array = NDArray[np.float64]

_QUANTILES = (("median", 0.5), ("90 %", 0.9), ("maximum", 1.0))
_SHADES = (AGENTS[3], AGENTS[2], RISK)


class RiskCurves(Drawing):
    """Draws the risk of each agent over time, or its quantiles over a group."""

    outputs: ClassVar = frozenset({"replay"})
    order: ClassVar = 240

    def marks(self, chunk: Chunk) -> Iterator[Curves]:
        """Yield a mark for each group."""
        for group_view in self.run_view.group_views.values():
            series = chunk.strips.get(_topic(group_view))
            if series is None or not series.values.shape[1]:
                continue
            risks, names, colours = series.firsts.values[..., 0], group_view.agents, group_view.colours
            if not self.detail.curves:
                risks = _quantiles(risks, [share for _, share in _QUANTILES])
                names = tuple(f"{group_view.name}: {name}" for name, _ in _QUANTILES)
                colours = np.array(_SHADES, np.uint8)
            path = f"curves/risk/{group_view.name}"
            yield Curves(
                path=path,
                times=series.times,
                values=risks,
                names=names,
                colours=colours,
                keep="greatest",
                stepwise=True,
            )


def tinted_by_risk(group_view: GroupView, times: NDArray[np.int64], chunk: Chunk) -> NDArray[np.uint8]:
    """Return the colours of agents at some instants of a chunk, redder with risk; (len(times), n, 3)."""
    series = chunk.strips.get(_topic(group_view))
    if series is None or not series.before.shape[1]:
        return tinted(group_view.colours, np.zeros((len(times), len(group_view.agents))))
    return tinted(group_view.colours, series.firsts.at(times)[..., 0])


def _topic(group_view: GroupView) -> str:
    return f"/agents/{group_view.name}/risk"


def _quantiles(values: Array, shares: Sequence[float]) -> Array:
    """Return quantiles of the known values at each of k instants, interpolated; (k, n) to (k, shares), NaN without any.

    Like `numpy.nanquantile`, but vectorised over the instants.
    """
    ordered = np.sort(values, axis=1)
    last = np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0)[:, None]
    places = last * np.array(shares)
    lower = np.floor(places).astype(np.intp)
    upper = np.minimum(lower + 1, last)
    low, high = np.take_along_axis(ordered, lower, axis=1), np.take_along_axis(ordered, upper, axis=1)
    quantiles: Array = low + (places - lower) * (high - low)
    return quantiles
