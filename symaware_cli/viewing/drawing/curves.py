"""Curves over time: risks, separation, and all that the agents in focus are aware of."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording.sensing import MEASUREMENT, sensors
from symaware_cli.viewing.cast import Cast, Troupe
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt, Frames
from symaware_cli.viewing.palette import AGENTS, CONTACT, RISK
from symaware_cli.viewing.stage import Stage

Array = NDArray[np.float64]

_QUANTILES = (("median", 0.5), ("90 %", 0.9), ("maximum", 1.0))
_SHADES = (AGENTS[3], AGENTS[2], RISK)
_NEVER = np.empty(0, np.int64)
#: Beyond so many bodies a tree finds the nearest two faster than all distances do.
_TREE = 40


class Risks(Drawing):
    """The risk of each agent, or its quantiles over a group."""

    def begin(self) -> None:
        """Name the curves."""
        for troupe in self.cast.troupes.values():
            if self.detail.curves:
                self.stage.series(f"curves/risk/{troupe.name}", troupe.agents, troupe.colours)
            else:
                names = [f"{troupe.name}: {name}" for name, _ in _QUANTILES]
                self.stage.series(f"curves/risk/{troupe.name}", names, _SHADES)

    def draw(self, excerpt: Excerpt) -> None:
        """Draw the risks."""
        for troupe in self.cast.troupes.values():
            strips = excerpt.strips.get(f"/agents/{troupe.name}/risk")
            if strips is None or not strips.values.shape[1]:
                continue
            risks = strips.firsts[..., 0]
            if not self.detail.curves:
                risks = _quantiles(risks, [share for _, share in _QUANTILES])
            self.stage.scalars(f"curves/risk/{troupe.name}", strips.times, risks)


class Separation(Drawing):
    """The smallest distance between the centres of any two agents, and the distance at which the largest two touch."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        radii = sorted((troupe.radius for troupe in cast.troupes.values() for _ in troupe.agents), reverse=True)
        self._bound = sum(radii[:2]) if cast.agent_count > 1 else 0.0

    def begin(self) -> None:
        """Name the curves."""
        self.stage.series("curves/separation/smallest", ["smallest distance between agents [m]"], [AGENTS[3]])
        self.stage.series("curves/separation/bound", [f"touching below {self._bound:.4g} m"], [CONTACT], 1.0)

    def draw(self, excerpt: Excerpt) -> None:
        """Draw the distance."""
        if self.cast.agent_count < 2:
            return
        found = {name: excerpt.frames.get(troupe.whereabouts) for name, troupe in self.cast.troupes.items()}
        times = np.unique(np.concatenate([frames.times for frames in found.values() if frames] or [_NEVER]))
        if not len(times):
            return
        places = [self.cast.troupes[name].positions(frames.at(times)) for name, frames in found.items() if frames]
        smallest = _smallest(np.concatenate(places, axis=1))
        self.stage.scalars("curves/separation/smallest", times, smallest[:, None])
        if self._bound:
            self.stage.scalars("curves/separation/bound", times, np.full((len(times), 1), self._bound))


class Awareness(Drawing):
    """State, control input, uncertainty, risk and readings of each agent in focus, with names and units."""

    def begin(self) -> None:
        """Nothing is named yet."""
        self._named: set[str] = set()

    def draw(self, excerpt: Excerpt) -> None:
        """Draw the curves of all who are in focus."""
        for agent in self.detail.focus:
            group, row = self.cast.place[agent]
            troupe = self.cast.troupes[group]
            for field in ("state", "control"):
                frames = excerpt.frames.get(f"/agents/{group}/{field}")
                if frames is not None:
                    self._curve(agent, troupe, field, frames.times, frames.values[:, row])
            for field in ("uncertainty", "risk"):
                strips = excerpt.strips.get(f"/agents/{group}/{field}")
                if strips is not None and strips.values.shape[1]:
                    self._curve(agent, troupe, field, strips.times, strips.firsts[:, row])
            for sensor, topic in sensors(excerpt.frames, group, MEASUREMENT).items():
                self._readings(agent, topic, sensor, excerpt.frames[topic], row)

    def _curve(self, agent: str, troupe: Troupe, field: str, times: NDArray[np.int64], values: Array) -> None:
        names, units = self._quantities(f"/agents/{troupe.name}/{field}", field, values.shape[1])
        if field == "uncertainty":
            names, units, values = _deviations(troupe, names, units, values)
        self._plot(f"curves/agents/{agent}/{field}", times, names, units, values)

    def _readings(self, agent: str, topic: str, sensor: str, frames: Frames, row: int) -> None:
        names, units = self._quantities(topic, sensor, frames.values.shape[2])
        units = [unit for _, unit in _paired(names, units)]
        for path, columns in reading_paths(agent, sensor, units).items():
            # Each path has a view of its own, whose name says the unit.
            self._plot(path, frames.times, [names[column] for column in columns], [], frames.values[:, row, columns])

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
            self.stage.series(path, shown, [AGENTS[number % len(AGENTS)] for number in range(len(shown))])
        self.stage.scalars(path, times, values)


def reading_paths(agent: str, sensor: str, units: Sequence[str]) -> dict[str, list[int]]:
    """Where the readings of a sensor are drawn: a path for each unit, as 10 m/s^2 would hide 0.1 rad/s.

    Args:
        agent: Whose.
        sensor: Its name.
        units: Of its columns.

    Returns:
        By path, which columns.
    """
    apart = list(dict.fromkeys(units))
    return {
        f"curves/agents/{agent}/{MEASUREMENT}/{sensor}/{number}": [
            column for column, each in enumerate(units) if each == unit
        ]
        for number, unit in enumerate(apart)
    }


def _deviations(
    troupe: Troupe, names: list[str], units: list[str], values: Array
) -> tuple[list[str], list[str], Array]:
    """Standard deviations where covariances are given; nothing of samples, which are drawn as ways."""
    variances = [f"cov_{name}_{name}" for name, _ in troupe.state]
    if all(name in names for name in variances):
        chosen = [names.index(name) for name in variances]
        deviations = np.sqrt(np.maximum(values[:, chosen], 0.0))
        return [f"deviation of {name}" for name, _ in troupe.state], [unit for _, unit in troupe.state], deviations
    if any(re.fullmatch(r".+\.\d+", name) for name in names):
        return [], [], values
    return names, units, values


def _smallest(places: Array) -> Array:
    """The smallest distance between any two of n points at each of k instants; (k, n, 3) to (k,)."""
    count = places.shape[1]
    if count <= _TREE:
        first, second = np.triu_indices(count, 1)
        distances = np.linalg.norm(places[:, first] - places[:, second], axis=-1)
        nearest: Array = np.where(np.isnan(distances), np.inf, distances).min(axis=1)
        return nearest
    from scipy.spatial import cKDTree

    smallest = np.empty(len(places))
    for number, present in enumerate(places):
        known = present[np.isfinite(present).all(axis=1)]
        smallest[number] = np.asarray(cKDTree(known).query(known, k=2)[0])[:, 1].min() if len(known) > 1 else np.inf
    return smallest


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
