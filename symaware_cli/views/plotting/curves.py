"""Quantities over time for plots: a curve for each agent, or the shares of a whole."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import seconds
from symaware_cli.views.palette import AGENTS, DISTINCT, hexadecimal
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.motion import Motion, held, instants
from symaware_cli.views.plotting.request import Window
from symaware_cli.views.scene.marks import Curves, Numbers

Array = NDArray[np.float64]

#: The colours of curves without one.
_SHADES = np.array(AGENTS, np.uint8)

#: [ns] Speed is averaged over this time before and after, to reduce the noise of single steps.
_AROUND = 250_000_000


@dataclass(frozen=True)
class PlottedCurves:
    """The curves of a quantity over time.

    Attributes:
        name: The quantity.
        unit: The unit of the quantity; empty if unknown.
        times: (k,) simulated time [ns].
        values: (k, n); NaN where unknown.
        lines: (n,) the style of each curve.
        stepwise: Whether values are constant until the next one, like inputs.
        note: The derivation of the quantity, if it was not recorded directly.
        dots: Whether values are separate points, like the entries of a table; times may then repeat.
        level: The height of a reference line; None for none.
        stacked: Whether values are shares of a whole, such as probabilities, which are stacked.
        named: Whether the names are written at the curves, rather than in a legend.
    """

    name: str
    unit: str
    times: NDArray[np.int64]
    values: Array
    lines: tuple[LineStyle, ...]
    stepwise: bool = False
    note: str = ""
    dots: bool = False
    level: float | None = None
    stacked: bool = False
    named: bool = False

    @property
    def many(self) -> bool:
        """Whether there are too many curves to tell them apart."""
        return len(self.lines) > DISTINCT

    @property
    def infinities_count(self) -> bool:
        """Whether infinite values are extremes: a specification that can never be satisfied has the robustness -inf.

        In other quantities infinity stands for none, as for the distance to an obstacle that is not seen.
        """
        return self.named or self.name == "risk"

    def facts(self) -> dict[str, Any]:
        """Return the extremes, or mean and maximum of each share, as plain data."""
        if self.stacked:
            return {"panel": self.name, "shares": self._shares()}
        facts: dict[str, Any] = {"panel": self.name, "unit": self.unit, "curves": len(self.lines)}
        for name, found in (("minimum", self.extreme(-1)), ("maximum", self.extreme())):
            facts[name] = found and {"value": found[0], "time": found[1], "who": [found[2]]}
        return facts

    def _shares(self) -> dict[str, Any]:
        known = ~np.isnan(self.values).any(axis=1)
        values, times = self.values[known], self.times[known]
        return {
            line.name: {
                "mean": float(column.mean()),
                "maximum": float(column.max()),
                "time": seconds(int(times[column.argmax()])),
            }
            for line, column in zip(self.lines, values.T, strict=True)
        }

    def extreme(self, sign: int = 1) -> tuple[float, float, str] | None:
        """Return the greatest value (the least for -1), its first time [s] and its agent; None without values."""
        values = sign * (
            self.values if self.infinities_count else np.where(np.isfinite(self.values), self.values, np.nan)
        )
        if np.isnan(values).all():
            return None
        row, column = np.unravel_index(int(np.nanargmax(values)), values.shape)
        return float(self.values[row, column]), seconds(int(self.times[row])), self.lines[column].name


def speed(motion: Motion, lines: Sequence[LineStyle]) -> PlottedCurves | None:
    """Return the speed of each body, from positions before and after; None with fewer than two instants."""
    times = motion.times
    if len(times) < 2:
        return None
    before = np.maximum(np.searchsorted(times, times - _AROUND, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(times, times + _AROUND), len(times) - 1)
    travelled = np.linalg.norm(motion.positions[after] - motion.positions[before], axis=2)
    values = travelled / ((times[after] - times[before]) / 1e9)[:, None]
    # A body that was absent in between has not travelled that way.
    unknown = np.cumsum(~np.isfinite(motion.positions).all(axis=2), axis=0)
    values[unknown[after] > unknown[before]] = np.nan
    note = f"mean over {2 * seconds(_AROUND):g} s"
    return PlottedCurves("speed", "m/s", times, values, tuple(lines), note=note)


def altitude(motion: Motion, lines: Sequence[LineStyle]) -> PlottedCurves | None:
    """Return the third coordinate of the bodies that have a line; None if there are none."""
    if not lines:
        return None
    rows = [motion.names.index(line.name) for line in lines]
    return PlottedCurves("altitude", "m", motion.times, motion.positions[:, rows, 2], tuple(lines))


def marked(mark: Curves, name: str, styles: Mapping[str, LineStyle], window: Window) -> PlottedCurves | None:
    """Return the curves of a mark that have a style; None if they have no values in the window before its end."""
    rows = [number for number, name in enumerate(mark.names) if name in styles]
    some = (mark.times >= window.start) & (mark.times <= window.end)
    values = mark.values[some][:, rows]
    if not np.isfinite(values[mark.times[some] < window.end]).any():
        return None
    return PlottedCurves(
        name=name,
        unit="",
        # The last value holds until the end of the window.
        times=np.append(mark.times[some], window.end),
        values=np.concatenate([values, values[-1:]]),
        lines=tuple(styles[mark.names[row]] for row in rows),
        level=mark.level[1] if mark.level else None,
    )


def styles_of(mark: Curves, chosen: Mapping[str, LineStyle], agents: Container[str]) -> dict[str, LineStyle]:
    """Return the style of each curve of a mark: that of the agent of its name, or the colour of the mark.

    Args:
        mark: The curves. Those with the name of an agent that is not chosen have no style.
        chosen: The styles of the chosen agents.
        agents: The names of all agents.
    """
    own = np.broadcast_to(
        _SHADES[np.arange(len(mark.names)) % len(_SHADES)] if mark.colours is None else np.asarray(mark.colours),
        (len(mark.names), 3),
    )
    styles = {name: LineStyle(name, hexadecimal(colour)) for name, colour in zip(mark.names, own, strict=True)}
    return {name: chosen.get(name, style) for name, style in styles.items() if name in chosen or name not in agents}


def specification_styles(
    names: Sequence[tuple[str, Sequence[str]]], lines: Sequence[LineStyle]
) -> dict[str, LineStyle]:
    """Return the style of each curve of a specification: that of its agent, if it concerns only one.

    Args:
        names: The name of each curve, and the agents that it concerns.
        lines: The styles of agents.
    """
    known = {line.name: line for line in lines}
    return {
        name: known[agents[0]] if len(agents) == 1 else LineStyle(name, hexadecimal(AGENTS[number % len(AGENTS)]), True)
        for number, (name, agents) in enumerate(names)
    }


def columns(mark: Numbers, lines: Sequence[LineStyle], window: Window, *, stepwise: bool) -> list[PlottedCurves]:
    """Return a quantity for each column of a table, with a curve for each row that has a line; empty without values."""
    row_of = {name: row for row, name in enumerate(mark.names)}
    rows = [row_of[line.name] for line in lines]
    if mark.separate:
        some = (mark.times >= window.start) & (mark.times <= window.end)
        times, values = mark.times[some], mark.values[some][:, rows]
    else:
        times, values = _windowed(mark, window)
        values = values[:, rows]
    if not len(times):
        return []
    given: dict[str, Any] = {"stepwise": stepwise and not mark.separate, "dots": mark.separate}
    return [
        PlottedCurves(name, unit, times, values[:, :, number], tuple(lines), **given)
        for number, (name, unit) in enumerate(mark.columns)
    ]


def shares(mark: Numbers, part: str, agents: Sequence[str], window: Window) -> list[PlottedCurves]:
    """Return the shares of each agent that has values, with a curve for each column of a table."""
    times, values = _windowed(mark, window)
    colours = (hexadecimal(AGENTS[number % len(AGENTS)]) for number in range(len(mark.columns)))
    lines = tuple(LineStyle(name, colour) for (name, _), colour in zip(mark.columns, colours, strict=True))
    own = [(agent, values[:, mark.names.index(agent)]) for agent in agents]
    known = [(agent, each) for agent, each in own if not np.isnan(each).any(axis=1).all()]
    return [PlottedCurves(f"{part} of {agent}", "", times, each, lines, stacked=True) for agent, each in known]


def _windowed(mark: Numbers, window: Window) -> tuple[NDArray[np.int64], Array]:
    """Return the times and values in a window, beginning with the value valid at its start."""
    if not len(mark.times) or mark.times[0] > window.end:
        return np.empty(0, np.int64), np.empty((0, *mark.values.shape[1:]))
    edges = np.array([max(window.start, int(mark.times[0])), window.end], np.int64)
    times = instants([mark.times, edges], window.start, window.end)
    return times, held(mark.times, mark.values, times)


def together(parts: Sequence[PlottedCurves]) -> list[PlottedCurves]:
    """Join curves of several groups or fields: one result for each name and unit."""
    found: dict[tuple[str, str], list[PlottedCurves]] = {}
    for curves in parts:
        found.setdefault((curves.name, curves.unit), []).append(curves)
    return [_joined(curves) for curves in found.values()]


def _joined(parts: Sequence[PlottedCurves]) -> PlottedCurves:
    if len(parts) == 1:
        return parts[0]
    lines = tuple(line for curves in parts for line in curves.lines)
    if all(curves.dots for curves in parts):
        times = np.concatenate([curves.times for curves in parts])
        values, row, column = np.full((len(times), len(lines)), np.nan), 0, 0
        for curves in parts:
            height, width = curves.values.shape
            values[row : row + height, column : column + width] = curves.values
            row, column = row + height, column + width
        order = np.argsort(times, kind="stable")
        return replace(parts[0], times=times[order], values=values[order], lines=lines)
    times = np.unique(np.concatenate([curves.times for curves in parts]))
    joined = np.concatenate([held(curves.times, curves.values, times) for curves in parts], axis=1)
    return replace(parts[0], times=times, values=joined, lines=lines)
