"""Curves over time: risks, separation, and all that the agents in focus are aware of."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Part
from symaware_cli.geometry.bodies import Bodies
from symaware_cli.geometry.proximity import Proximity
from symaware_cli.viewing.chunk import Chunk
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.palette import AGENTS, CONTACT, RISK
from symaware_cli.viewing.rerun_output import RerunOutput
from symaware_cli.viewing.views import GroupView, RunView

Array = NDArray[np.float64]

_QUANTILES = (("median", 0.5), ("90 %", 0.9), ("maximum", 1.0))
_SHADES = (AGENTS[3], AGENTS[2], RISK)
_NEVER = np.empty(0, np.int64)


class Risks(Drawing):
    """The risk of each agent, or its quantiles over a group."""

    def begin(self) -> None:
        """Name the curves."""
        for group_view in self.run_view.group_views.values():
            if self.detail.curves:
                self.output.series(
                    f"curves/risk/{group_view.name}", group_view.agents, group_view.colours, keep="greatest"
                )
            else:
                names = [f"{group_view.name}: {name}" for name, _ in _QUANTILES]
                self.output.series(f"curves/risk/{group_view.name}", names, _SHADES, keep="greatest")

    def draw(self, chunk: Chunk) -> None:
        """Draw the risks."""
        for group_view in self.run_view.group_views.values():
            strips = chunk.strips.get(f"/agents/{group_view.name}/risk")
            if strips is None or not strips.values.shape[1]:
                continue
            risks = strips.firsts[..., 0]
            if not self.detail.curves:
                risks = _quantiles(risks, [share for _, share in _QUANTILES])
            self.output.scalars(f"curves/risk/{group_view.name}", strips.times, risks)


class Separation(Drawing):
    """The least distance between the outlines of any two agents, and 0, where bodies touch."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        super().__init__(run_view, detail, output)
        group_views = run_view.group_views.values()
        shapes = [group_view.shape for group_view in group_views]
        counts = [len(group_view.agents) for group_view in group_views]
        self._bodies = Bodies([shape.pieces[0] if shape else None for shape in shapes], counts)

    def begin(self) -> None:
        """Name the curves."""
        name = "least between two outlines [m]"
        self.output.series("curves/separation/smallest", [name], [AGENTS[3]], keep="least")
        self.output.series("curves/separation/bound", ["touching"], [CONTACT], 1.0)

    def draw(self, chunk: Chunk) -> None:
        """Draw the distance."""
        if self.run_view.agent_count < 2:
            return
        found = {
            name: chunk.frames.get(group_view.whereabouts) for name, group_view in self.run_view.group_views.items()
        }
        times = np.unique(np.concatenate([frames.times for frames in found.values() if frames] or [_NEVER]))
        if not len(times):
            return
        shape = (len(times), self.run_view.agent_count)
        places, headings = np.full((*shape, 3), np.nan), np.zeros(shape)
        first = 0
        for name, group_view in self.run_view.group_views.items():
            some, frames = slice(first, first + len(group_view.agents)), found[name]
            first = some.stop
            if frames:
                states = frames.at(times)
                places[:, some] = group_view.positions(states)
                turned = group_view.headings(states)
                headings[:, some] = 0.0 if turned is None else turned
        smallest = np.array([self._smallest(*each) for each in zip(places, headings, strict=True)])
        self.output.scalars("curves/separation/smallest", times, smallest[:, None])
        self.output.scalars("curves/separation/bound", times, np.zeros((len(times), 1)))

    def _smallest(self, places: Array, headings: Array) -> float:
        """The least separation at an instant of those who are there; infinite where there are no two."""
        present = np.flatnonzero(np.isfinite(places).all(axis=1))
        bodies = self._bodies if len(present) == len(places) else self._bodies.some(present)
        found = bodies.nearest(places[present], headings[present], Proximity())
        return np.inf if found is None else found.gap


class Awareness(Drawing):
    """Control input, parts of awareness and signals of each agent in focus, with names and units."""

    def begin(self) -> None:
        """Nothing is named yet."""
        self._named: set[str] = set()

    def draw(self, chunk: Chunk) -> None:
        """Draw the curves of all who are in focus."""
        for agent in self.detail.focus:
            group, row = self.run_view.place[agent]
            group_view = self.run_view.group_views[group]
            topic = f"/world/{group}/control"
            applied = chunk.frames.get(topic)
            if applied is not None:
                self._curve(agent, group_view, "control", topic, applied.times, applied.values[:, row])
            for name, topic in plotted(group_view):
                frames, strips = chunk.frames.get(topic), chunk.strips.get(topic)
                if frames is not None:
                    times, values = frames.times, frames.values[:, row]
                elif strips is not None and strips.values.shape[1]:
                    times, values = strips.times, strips.firsts[:, row]
                else:
                    continue
                if isinstance(group_view.signals[name], Part):
                    self._curve(agent, group_view, name, topic, times, values)
                else:
                    self._by_unit(agent, topic, name, times, values)

    def _curve(
        self, agent: str, group_view: GroupView, field: str, topic: str, times: NDArray[np.int64], values: Array
    ) -> None:
        names, units = self._quantities(topic, field, values.shape[1])
        if field in group_view.signals and group_view.signals[field].drawn == "ellipse":
            names, units, values = _deviations(group_view, names, units, values)
        self._plot(f"curves/agents/{agent}/{field}", times, names, units, values)

    def _by_unit(self, agent: str, topic: str, field: str, times: NDArray[np.int64], values: Array) -> None:
        names, units = self._quantities(topic, field, values.shape[1])
        units = [unit for _, unit in _paired(names, units)]
        for path, columns in unit_paths(agent, topic, units).items():
            # Each path has a view of its own, whose name says the unit.
            self._plot(path, times, [names[column] for column in columns], [], values[:, columns])

    def _quantities(self, topic: str, field: str, width: int) -> tuple[list[str], list[str]]:
        """The names and units of columns, as far as the log announces them."""
        names, units = list(self.columns.get(topic, ())), list(self.units.get(topic, ()))
        return (names, units) if len(names) == width else ([f"{field} {number}" for number in range(width)], [])

    def _plot(
        self, path: str, times: NDArray[np.int64], names: Sequence[str], units: Sequence[str], values: Array
    ) -> None:
        if not names:
            return
        if path not in self._named:
            self._named.add(path)
            shown = [f"{name} [{unit}]" if unit not in ("", "1") else name for name, unit in _paired(names, units)]
            colours = [AGENTS[number % len(AGENTS)] for number in range(len(shown))]
            self.output.series(path, shown, colours, keep="greatest" if path.endswith("/risk") else "both")
        self.output.scalars(path, times, values)


def plotted(group_view: GroupView) -> list[tuple[str, str]]:
    """The parts and signals that an agent's tab has curves of, with their topics: all numbers but those of paths."""
    signals = group_view.signals.items()
    drawn = (name for name, signal in signals if signal.kind != "table" and signal.drawn not in (None, "path"))
    return [(name, group_view.topic(name)) for name in drawn]


def unit_paths(agent: str, topic: str, units: Sequence[str]) -> dict[str, list[int]]:
    """Where the numbers of a signal are drawn: a path for each unit, as 10 m/s^2 would hide 0.1 rad/s.

    Args:
        agent: Whose.
        topic: The signal's.
        units: Of its columns.

    Returns:
        By path, which columns.
    """
    apart, place = list(dict.fromkeys(units)), topic.split("/", 3)[3]
    return {
        f"curves/agents/{agent}/{place}/{number}": [column for column, each in enumerate(units) if each == unit]
        for number, unit in enumerate(apart)
    }


def _deviations(
    group_view: GroupView, names: list[str], units: list[str], values: Array
) -> tuple[list[str], list[str], Array]:
    """Standard deviations where covariances are given; nothing of samples, which are drawn as ways."""
    variances = [f"cov_{name}_{name}" for name, _ in group_view.state]
    if all(name in names for name in variances):
        chosen = [names.index(name) for name in variances]
        deviations = np.sqrt(np.maximum(values[:, chosen], 0.0))
        return (
            [f"deviation of {name}" for name, _ in group_view.state],
            [unit for _, unit in group_view.state],
            deviations,
        )
    if any(re.fullmatch(r".+\.\d+", name) for name in names):
        return [], [], values
    return names, units, values


def _quantiles(values: Array, shares: Sequence[float]) -> Array:
    """Quantiles of what is known at each of k instants, linear in between; (k, n) to (k, shares), NaN without any.

    As `numpy.nanquantile`, which goes from instant to instant, but for all of them at once.
    """
    ordered = np.sort(values, axis=1)
    last = np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0)[:, None]
    places = last * np.array(shares)
    lower = np.floor(places).astype(np.intp)
    upper = np.minimum(lower + 1, last)
    low, high = np.take_along_axis(ordered, lower, axis=1), np.take_along_axis(ordered, upper, axis=1)
    quantiles: Array = low + (places - lower) * (high - low)
    return quantiles


def _paired(names: Sequence[str], units: Sequence[str]) -> list[tuple[str, str]]:
    return list(zip(names, units if len(units) == len(names) else [""] * len(names), strict=True))
