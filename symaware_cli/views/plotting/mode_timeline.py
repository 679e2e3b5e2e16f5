"""Modes over time as strips: verdicts of specifications, events of agents, and signals with few values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symaware_cli.core import seconds
from symaware_cli.views.palette import AGENTS, hexadecimal
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.request import Window
from symaware_cli.views.scene.marks import Modes

#: Maximum number of different values of a signal that is shown as strips, and of strips in a panel.
_MOST_VALUES, _MOST_STRIPS = 4, 24

#: Tints of modes without one: pale, so that names are legible on them.
_PALE = 0.45


@dataclass(frozen=True)
class ModePhase:
    """An interval in which a mode holds.

    Attributes:
        start: The beginning of the phase [ns].
        end: The end of the phase [ns].
        mode: The name of the mode.
    """

    start: int
    end: int
    mode: str


@dataclass(frozen=True)
class ModeStrip:
    """The modes of one subject over time.

    Attributes:
        name: The subject, such as an agent or a specification.
        phases: The phases, in order.
    """

    name: str
    phases: tuple[ModePhase, ...]


@dataclass(frozen=True)
class ModeTimeline:
    """Strips of modes over time, as a panel.

    Attributes:
        name: The name of the panel.
        title: The title of the panel.
        strips: The strips.
        tints: The colour of each mode, as ``#rrggbb``.
    """

    name: str
    title: str
    strips: tuple[ModeStrip, ...]
    tints: Mapping[str, str]

    many = False
    lines: tuple[LineStyle, ...] = ()

    def facts(self) -> dict[str, Any]:
        """Return the phases as plain data."""
        return {
            "panel": self.name,
            "modes": {
                strip.name: [
                    {"mode": phase.mode, "from": seconds(phase.start), "to": seconds(phase.end)}
                    for phase in strip.phases
                ]
                for strip in self.strips
            },
        }


def mode_timeline(name: str, title: str, marks: Sequence[tuple[str, Modes]], window: Window) -> ModeTimeline | None:
    """Return a panel of the modes of some marks, each with its name; None if there are none in the window."""
    strips = [strip for label, mark in marks if (strip := _strip(label, mark.times, mark.modes, window)) is not None]
    if not strips or len(strips) > _MOST_STRIPS:
        return None
    tints = {mode: hexadecimal(tint) for _, mark in marks for mode, tint in mark.tints.items()}
    return _tinted(ModeTimeline(name, title, tuple(strips), tints))


def strips_of(curves: PlottedCurves, window: Window) -> ModeTimeline | None:
    """Return curves as strips if they take few values, which are whole numbers; otherwise None."""
    known = curves.values[np.isfinite(curves.values)]
    values = np.unique(known)
    if not curves.stepwise or curves.unit not in ("", "1") or curves.many or not 1 < len(values) <= _MOST_VALUES:
        return None
    if (values != np.round(values)).any():
        return None
    strips = []
    for line, column in zip(curves.lines, curves.values.T, strict=True):
        some = np.isfinite(column)
        strip = _strip(line.name, curves.times[some], [f"{value:g}" for value in column[some].tolist()], window)
        strips += [strip] if strip is not None else []
    return _tinted(ModeTimeline(curves.name, curves.name, tuple(strips), {}))


def _strip(name: str, times: Sequence[int] | Any, modes: Sequence[str], window: Window) -> ModeStrip | None:
    """Return the strip of modes that begin at some times [ns]; None if none of them is in the window."""
    ends = [*np.asarray(times)[1:].tolist(), window.end]
    phases: list[ModePhase] = []
    for start, end, mode in zip(np.asarray(times).tolist(), ends, modes, strict=True):
        start, end = max(start, window.start), min(end, window.end)
        if end < start or (end == start and end < window.end):
            continue
        if phases and phases[-1].mode == mode:
            phases[-1] = replace(phases[-1], end=end)
        else:
            phases.append(ModePhase(start, end, mode))
    return ModeStrip(name, tuple(phases)) if phases else None


def _tinted(timeline: ModeTimeline) -> ModeTimeline:
    """Give each mode without a tint a distinct one."""
    modes = dict.fromkeys(phase.mode for strip in timeline.strips for phase in strip.phases)
    tints, own = dict(timeline.tints), [mode for mode in modes if mode not in timeline.tints]
    for number, mode in enumerate(own):
        pale = [round(part + (255 - part) * _PALE) for part in AGENTS[(number - 1) % len(AGENTS)]]
        # The first mode, which is usually the normal one, is grey.
        tints[mode] = "#d5d9df" if number == 0 else hexadecimal(pale)
    return replace(timeline, tints=tints)
