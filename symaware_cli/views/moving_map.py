"""The motion of a run as plain data, which ``moving_map.js`` draws as an animated map in a page of HTML."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.log import Log, LogError
from symaware_cli.views.outline import outlines
from symaware_cli.views.palette import hexadecimal
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.panels import Trajectories
from symaware_cli.views.plotting.plane import extent
from symaware_cli.views.plotting.request import PlotRequest

Array = NDArray[np.float64]

#: The most poses of agents in a page; with more, instants are left out. A pose takes about 17 bytes.
_POSES = 24_000

#: How long a trail is [s].
_TRAIL = 4.0

#: How far regions are shown beyond what moves, relative to its extent.
_REACH = 0.5

#: The most contacts that are marked.
_MARKS = 400


def moving_map(log: Log) -> dict[str, Any]:
    """Return what ``moving_map.js`` draws.

    Args:
        log: The log of the run.

    Raises:
        LogError: The log has no motion to show.
    """
    (panel,) = gather(log, PlotRequest(show=("trajectories",))).panels
    if not isinstance(panel, Trajectories):
        raise LogError(f"{log.path} has no trajectories")
    motion = panel.motion
    count, agents = motion.positions.shape[:2]
    stride = max(1, -(-count * agents // _POSES))
    chosen = np.unique(np.append(np.arange(0, count, stride), count - 1))
    low, high = _with_regions(panel, *extent(panel))
    # A thousandth of the picture, at most a millimetre: smaller than a pixel.
    digits = max(0, min(6, 3 - int(np.floor(np.log10(float((high - low).max()))))))
    lines = {line.name: line.colour for line in panel.chosen.lines}
    marks = list(_marks(log, panel))
    return {
        "times": _rounded(motion.times[chosen] / 1e9, 4),
        "box": _rounded(np.concatenate([low, high]), digits + 1),
        "trail": _TRAIL,
        "first": 0,
        "agents": [
            {
                "name": name,
                "colour": lines.get(name, "#456"),
                "outlines": [_corners(each) for each in outlines(shape.pieces)] if shape is not None else [],
                "reach": round(float(shape.radius), 4) if shape is not None else 0.0,
                "nosed": bool(motion.nosed[number]),
                "goals": [_rounded(goal[:2], digits) for goal in panel.goals.get(name, ())],
                "waypoints": [_rounded(point[:2], digits) for point in panel.waypoints.get(name, ())],
                "x": _rounded(motion.positions[chosen, number, 0], digits),
                "y": _rounded(motion.positions[chosen, number, 1], digits),
                "heading": _rounded(motion.headings[chosen, number], 2),
            }
            for number, (name, shape) in enumerate(zip(motion.names, motion.shapes, strict=True))
        ],
        "solids": [*_regions(panel, digits), *_obstacles(panel, chosen, digits)],
        "marks": marks,
    }


def _with_regions(panel: Trajectories, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the corners of the map so that no region in it is cut off, (2,) each [m].

    A region that lies elsewhere, or is much larger than the trajectories, such as an arena, does not count.
    """
    inner_low, inner_high, reach = low, high, _REACH * float((high - low).max())
    for area in panel.regions:
        for outline in area.outlines:
            corners = np.asarray(outline, float)[:, :2] + area.positions[0, :2]
            if not len(corners) or not np.isfinite(corners).all():
                continue
            least, most = corners.min(axis=0), corners.max(axis=0)
            touches = bool((least <= inner_high).all() and (most >= inner_low).all())
            if touches and (least >= inner_low - reach).all() and (most <= inner_high + reach).all():
                low, high = np.minimum(low, least), np.maximum(high, most)
    return low, high


def _regions(panel: Trajectories, digits: int) -> Iterator[dict[str, Any]]:
    for area in panel.regions:
        # The page writes the name at the position: the middle of what is drawn.
        drawn = [np.asarray(each, float)[:, :2] for each in area.outlines]
        corners = np.concatenate([np.zeros((0, 2)), *drawn])
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0 if len(corners) else np.zeros(2)
        yield {
            "name": area.label or area.name,
            "colour": hexadecimal(area.colour),
            "region": True,
            "outlines": [_corners(each - middle) for each in drawn],
            "x": _rounded(area.positions[:1, 0] + middle[0], digits),
            "y": _rounded(area.positions[:1, 1] + middle[1], digits),
            "heading": [0.0],
        }


def _obstacles(panel: Trajectories, chosen: NDArray[np.intp], digits: int) -> Iterator[dict[str, Any]]:
    obstacles = panel.obstacles
    for number, name in enumerate(obstacles.names):
        at = chosen if obstacles.moves(number) else chosen[:1]
        yield {
            "name": name,
            "colour": obstacles.colours[number],
            "region": False,
            "outlines": [_corners(each) for each in outlines(obstacles.pieces[number])],
            "x": _rounded(obstacles.positions[at, number, 0], digits),
            "y": _rounded(obstacles.positions[at, number, 1], digits),
            "heading": _rounded(obstacles.headings[at, number], 3),
        }


def _marks(log: Log, panel: Trajectories) -> Iterator[dict[str, Any]]:
    """Instants to look at: violations first, then contacts, with the place where there is one."""
    names = panel.motion.names
    for outcome in log.outcomes:
        if outcome.verdict == "violated" and outcome.time is not None:
            place = _place(panel, outcome.agents[0], outcome.time) if outcome.agents else None
            yield _mark(outcome.time, f"{outcome.name} violated", place)
    left = _MARKS
    for contact in log.contacts():
        if contact.stage == "begin" and left and {contact.a, contact.b} & {*names}:
            left -= 1
            who = contact.a if contact.a in names else contact.b
            time = contact.time / 1e9
            yield _mark(time, f"{contact.a} meets {contact.b}", contact.point[:2] or _place(panel, who, time))


def _mark(time: float, text: str, place: Any) -> dict[str, Any]:
    x, y = (None, None) if place is None else (float(f"{float(each):.6g}") for each in place[:2])
    return {"time": time, "text": f"{time:.2f} s: {text}", "x": x, "y": y}


def _place(panel: Trajectories, name: str, time: float) -> Any:
    motion = panel.motion
    if name not in motion.names:
        return None
    place = motion.positions[motion.index(round(time * 1e9)), motion.names.index(name)]
    return place if np.isfinite(place[:2]).all() else None


def _corners(points: Array) -> list[list[float | None]]:
    return [_rounded(point, 4) for point in points[:, :2]]


def _rounded(values: Array, digits: int) -> list[float | None]:
    """Numbers as short as they may be; None where there is none."""
    return [round(value, digits) if np.isfinite(value) else None for value in np.asarray(values, float).tolist()]
