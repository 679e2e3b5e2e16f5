"""Draws the panel of trajectories: the plane from above, paths that darken with time, and bodies at an instant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.textpath import TextPath
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from symaware_cli.core import Shape
from symaware_cli.geometry import Pieces, yaws
from symaware_cli.views.outline import Piece, outlines, placed
from symaware_cli.views.palette import CONTACT, GOAL, MOVABLE, SCENERY, hexadecimal
from symaware_cli.views.plotting.line_styles import LineStyle
from symaware_cli.views.plotting.panels import Trajectories
from symaware_cli.views.plotting.region_labels import LabelledRegion, label_places
from symaware_cli.views.plotting.time import DASHES, INK
from symaware_cli.views.scale_bar import round_interval
from symaware_cli.views.scene.marks import ACTIVE, PAST, TO_COME

Array = NDArray[np.float64]

#: The styles of areas: dashed outlines before their time, faint ones after it.
_PHASES: Mapping[int, Mapping[str, Any]] = {
    TO_COME: {"alpha": 0.7, "linewidth": 0.8, "linestyle": (0, (3, 3))},
    ACTIVE: {"alpha": 0.18, "linewidth": 0.8},
    PAST: {"alpha": 0.25, "linewidth": 0.5},
}

#: Number of shades of a path.
_STROKES = 12

#: Margin around the agents in which obstacles are shown, relative to the extent of the paths.
_AROUND = 0.5

#: Number of agents above which paths get thinner.
_CROWD = 20

#: The space for the label of an area, relative to the extent of its letters.
_ROOM = np.array([1.2, 1.6])

#: Contacts within this part of the extent of a panel share a ring.
_TOGETHER = 0.02

#: Number of points above which paths are rasterised even in vector formats, whose files would be too large otherwise.
_PIXELS = 20_000


def draw_trajectories(axes: Axes, content: Trajectories, moment: bool) -> tuple[list[Line2D | Patch], list[str]]:
    """Draw the plane.

    Args:
        axes: The axes to draw on.
        content: The content of the panel.
        moment: Whether the bodies are shown at a requested time.

    Returns:
        The entries of the legend, and the sentences of the caption.
    """
    low, high = extent(content)
    handles = draw_surroundings(axes, content, low, high)
    said = _draw_paths(axes, content)
    handles += _draw_compared(axes, content)
    handles += draw_goals(axes, content)
    handles += _draw_bodies(axes, content, float((high - low).max()))
    handles += _draw_contacts(axes, content)
    at = content.motion.times[content.at] / 1e9
    view = " from above" if content.spatial else ""
    axes.set_title(f"trajectories{view}, bodies at {at:.6g} s", loc="left")
    if moment:
        said += ["Dotted: later positions."] * (content.at < len(content.motion.times) - 1)
        said += ["Broad bands: intents."] * bool(content.intents)
    return handles, said


def draw_surroundings(axes: Axes, content: Trajectories, low: Array, high: Array) -> list[Line2D | Patch]:
    """Draw the regions and the obstacles of an area, and its axes.

    Args:
        axes: The axes to draw on.
        content: The content of the panel.
        low: The corner of the area with the least coordinates (2,) [m].
        high: The opposite corner.

    Returns:
        The entries of the legend.
    """
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]", aspect="equal", anchor="N")
    axes.grid(False)
    wide, tall = (high - low).tolist()
    for axis, span in ((axes.xaxis, wide), (axes.yaxis, tall)):
        # The same tick interval on both axes, unless one of them would have hardly any ticks.
        axis.set_major_locator(MultipleLocator(min(round_interval(max(wide, tall)), round_interval(span, 4))))
    _draw_regions(axes, content, low, high)
    return _draw_obstacles(axes, content)


def extent(content: Trajectories, further: Array | None = None) -> tuple[Array, Array]:
    """Return the corners of the area shown, (2,) each [m]: paths, goals, regions, and the obstacles near the paths.

    Args:
        content: The content of the panel.
        further: Further points (m, 2) [m]; NaN where unknown.
    """
    radius = max((shape.radius for shape in content.motion.shapes if shape), default=0.0)
    positions = content.motion.positions[..., :2].reshape(-1, 2)
    others = () if content.compared is None else (content.compared.positions[..., :2].reshape(-1, 2),)
    positions = np.concatenate([positions, *others, *(() if further is None else (further,))])
    known = (*content.goals.values(), *content.waypoints.values())
    points = np.concatenate([positions[~np.isnan(positions[:, 0])], *known])
    low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
    room = max(_AROUND * float((high - low).max()), 1e-3)
    for number in range(len(content.obstacles.names)):
        for step in {0, content.at}:
            for piece in _obstacle(content, number, step):
                box = piece.get_path().get_extents(piece.get_patch_transform())
                low = np.minimum(low, np.maximum(box.min, points.min(axis=0) - room))
                high = np.maximum(high, np.minimum(box.max, points.max(axis=0) + room))
    # A region far larger than the run would make everything in it too small to see.
    reach = max(float((high - low).max()), 1e-3)
    west, east = low - reach, high + reach
    for mark in content.regions:
        index = max(0, int(np.searchsorted(mark.times, content.time, "right")) - 1)
        heading = float(yaws(mark.orientations[index : index + 1])[0])
        for outline in mark.outlines:
            corners = placed(outline, mark.positions[index], heading)[:, :2]
            if np.isfinite(corners).all():
                low = np.minimum(low, np.maximum(corners.min(axis=0), west))
                high = np.maximum(high, np.minimum(corners.max(axis=0), east))
    margin = 0.04 * float((high - low).max()) or 1.0
    # A straight path still needs a panel with some height.
    thin = np.maximum(0.12 * float((high - low).max()) - (high - low), 0.0) / 2
    return low - margin - thin, high + margin + thin


def _outlined(pieces: Sequence[Piece]) -> list[tuple[Array, float]]:
    """Return the corners of each piece, or centre and radius of a round one [m]."""
    return [
        (np.array(core), radius) if len(core) == 1 else (outline, 0.0)
        for (core, radius), outline in zip(pieces, outlines(pieces), strict=True)
    ]


def _body(pieces: Iterable[tuple[Array, float]], position: Array, heading: float) -> list[Circle | Polygon]:
    """Return placed pieces from above; round ones as circles, which stay round at any size."""
    there = [(placed(corners, position, heading)[:, :2], radius) for corners, radius in pieces]
    return [Circle(tuple(corners[0]), radius) if radius else Polygon(corners) for corners, radius in there]


def _obstacle(content: Trajectories, number: int, step: int) -> list[Circle | Polygon]:
    """Return the pieces of an obstacle at its pose at an instant."""
    obstacles = content.obstacles
    pieces = _outlined(obstacles.pieces[number])
    return _body(pieces, obstacles.positions[step, number], obstacles.headings[step, number])


def _draw_regions(axes: Axes, content: Trajectories, low: Array, high: Array) -> None:
    """Draw areas with their labels, clipped to the panel."""
    size = FontProperties(size="x-small")
    axes.apply_aspect()  # the approximate size of the panel, before its surroundings are drawn
    metres = float((high - low)[0]) / axes.get_window_extent().width * axes.figure.dpi / 72.0
    regions, labels = [], []
    for mark in content.regions:
        colour, index = hexadecimal(mark.colour), max(0, int(np.searchsorted(mark.times, content.time, "right")) - 1)
        position, heading = mark.positions[index], float(yaws(mark.orientations[index : index + 1])[0])
        phase = ACTIVE if mark.phases is None else int(mark.phases[index])
        for piece in _body(_outlined(mark.pieces), position, heading):
            piece.set(facecolor=colour if phase == ACTIVE else "none", edgecolor=colour, zorder=0, **_PHASES[phase])
            axes.add_patch(piece)
        if phase == PAST or not mark.label:
            continue
        words = TextPath((0.0, 0.0), mark.label, prop=size).get_extents()
        room = np.array([words.width, words.height]) * metres * _ROOM
        ((x, y, _),) = placed(np.array([mark.label_at]), position, heading)
        # The label of an area with a time window is at its upper edge, since agents go to its middle.
        preferred = np.array([x, y - (0.0 if mark.phases is None else 0.6 * room[1])])
        outlined = [placed(outline, position, heading)[:, :2] for outline in mark.outlines]
        regions.append(LabelledRegion(outlined, room, preferred))
        labels.append((mark.label, colour))
    bodies = content.motion.positions[content.at, :, :2]
    avoided = np.concatenate([bodies[np.isfinite(bodies).all(axis=1)], *content.goals.values()])
    for (label, colour), place in zip(labels, label_places(regions, low, high, avoided), strict=True):
        if place is not None:
            style: dict[str, Any] = {"color": colour, "fontproperties": size, "ha": "center", "va": "center"}
            # Labels are above the paths, whose lines would cross the letters.
            back = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6}
            axes.text(float(place[0]), float(place[1]), label, clip_on=True, zorder=4.3, bbox=back, **style)


def _draw_obstacles(axes: Axes, content: Trajectories) -> list[Line2D | Patch]:
    obstacles, colour, moved = content.obstacles, hexadecimal(SCENERY), False
    for number, own in enumerate(obstacles.colours):
        here = _obstacle(content, number, content.at)
        axes.add_collection(
            PatchCollection(here, facecolors=_faded(own, 0.45), edgecolors="none", zorder=1), autolim=False
        )
        if obstacles.moves(number):
            moved = True
            way = obstacles.positions[:, number, :2]
            axes.plot(way[:, 0], way[:, 1], color=own, linewidth=1.0, linestyle=":", zorder=1)
    handles: list[Line2D | Patch] = []
    fixed = [number for number in range(len(obstacles.names)) if not obstacles.movable[number]]
    if fixed:
        handles.append(Patch(facecolor=_faded(colour, 0.45), label="obstacle"))
    if len(fixed) < len(obstacles.names):
        handles.append(Patch(facecolor=_faded(hexadecimal(MOVABLE), 0.45), label="movable body"))
    if moved:
        what = "a movable body" if any(obstacles.movable) else "an obstacle"
        handles.append(Line2D([], [], color=colour, linewidth=1.0, linestyle=":", label=f"path of {what}"))
    return handles


def _draw_paths(axes: Axes, content: Trajectories) -> list[str]:
    """Draw the paths, which get darker with time, with dots at regular times where visible."""
    lines, positions = content.chosen.lines, content.motion.positions
    steps, ahead = content.steps[content.steps <= content.at], content.steps[content.steps >= content.at]
    bounds = np.linspace(0, max(len(steps) - 1, 0), _STROKES + 1).round().astype(int)
    strokes: list[Array] = []
    shades: list[tuple[float, float, float]] = []
    styles: list[object] = []
    # A loop over shades, so that later parts of all paths are drawn above earlier parts.
    for number, (first, last) in enumerate(pairwise(bounds)):
        for agent, line in enumerate(lines):
            points = _known(positions[steps[first : last + 1], agent])
            if len(points) > 1:
                strokes.append(points)
                shades.append(_faded(line.colour, 0.8 * (1 - number / (_STROKES - 1))))
                styles.append(DASHES if line.dashed else "solid")
    crowd = min(1.0, (_CROWD / len(lines)) ** 0.4)
    axes.add_collection(
        LineCollection(
            strokes,
            colors=shades,
            linestyles=styles or "solid",
            linewidths=1.7 * crowd,
            alpha=max(crowd, 0.5),
            zorder=3,
            rasterized=sum(map(len, strokes)) > _PIXELS,
        ),
        autolim=False,
    )
    colours = [line.colour for line in lines]
    ways = [_known(positions[ahead, agent]) for agent in range(len(lines))]
    axes.add_collection(
        LineCollection(ways, colors=colours, linewidths=0.8 * crowd, linestyles=":", zorder=2), autolim=False
    )
    for line in lines:
        if line.name in content.intents:
            way = content.intents[line.name]
            axes.plot(*way.T, color=line.colour, linewidth=6.0, alpha=0.25, solid_capstyle="butt", zorder=2)
    if content.chosen.many:
        return ["Paths grow darker with time."]
    interval = round_interval(float(np.ptp(content.motion.times)) / 1e9)
    _draw_dots(axes, content, steps, interval)
    return [f"Paths grow darker with time, with a dot every {interval:g} s."]


def _draw_compared(axes: Axes, content: Trajectories) -> list[Line2D | Patch]:
    """Draw the paths of another run dashed, with their ends and the points of departure."""
    compared = content.compared
    if compared is None:
        return []
    for line in content.chosen.lines:
        if line.name not in compared.names:
            continue
        way = _known(compared.positions[:, compared.names.index(line.name)])
        if len(way):
            axes.plot(*way.T, color=line.colour, linewidth=1.4, linestyle=DASHES, zorder=3.5)
            axes.plot(*way[-1:].T, zorder=5.5, markerfacecolor="white", **_mark("s", line.colour, 5.5))
    for colour, where in _by_colour(content.chosen.lines, content.departures).items():
        axes.plot(*where.T, zorder=5.6, markerfacecolor="white", **_mark("D", colour, 6.0))
    return [
        Line2D([], [], label="second run", color=INK, linewidth=1.4, linestyle=DASHES),
        Line2D([], [], label="its end", markerfacecolor="white", **_mark("s", INK, 5.5)),
        *(
            [Line2D([], [], label="where they part", markerfacecolor="white", **_mark("D", INK, 6.0))]
            * bool(content.departures)
        ),
    ]


def _draw_dots(axes: Axes, content: Trajectories, steps: NDArray[np.intp], interval: float) -> None:
    times = content.motion.times[steps] / 1e9
    marks = np.arange(np.ceil(times[0] / interval - 1e-9), np.floor(times[-1] / interval + 1e-9) + 1) * interval
    for agent, line in enumerate(content.chosen.lines):
        way = content.motion.positions[steps, agent]
        dots = [np.interp(marks, times, way[:, axis]) for axis in range(2)]
        axes.plot(*dots, linestyle="none", marker="o", markersize=3.2, color=line.colour, zorder=4)


def _known(positions: Array) -> Array:
    """Return the known positions from above; (m, 2)."""
    points: Array = positions[~np.isnan(positions[:, 0]), :2]
    return points


def draw_goals(axes: Axes, content: Trajectories, above: bool = False) -> list[Line2D | Patch]:
    """Draw the goals and waypoints below the paths, or above them, and return the entry of the legend."""
    if not content.goals:
        return []
    many = content.chosen.many
    for colour, points in _by_colour(content.chosen.lines, content.goals).items():
        mark = _mark("+", hexadecimal(GOAL) if many else colour, 3.0 if many else 12.0)
        axes.plot(*points.T, zorder=4.2 if above else 2.5, **mark)
    for colour, points in _by_colour(content.chosen.lines, content.waypoints).items():
        axes.plot(*points.T, zorder=2.4, alpha=0.6, **_mark(".", hexadecimal(GOAL) if many else colour, 2.0))
    ink, dotted = hexadecimal(GOAL) if many else INK, bool(content.waypoints)
    label = "waypoint" if not dotted and all(len(points) > 1 for points in content.goals.values()) else "goal"
    handles: list[Line2D | Patch] = [Line2D([], [], label=label, **_mark("+", ink, 8.0))]
    return handles + [Line2D([], [], label="waypoint", alpha=0.6, **_mark(".", ink, 4.0))] * dotted


def _draw_bodies(axes: Axes, content: Trajectories, span: float) -> list[Line2D | Patch]:
    """Draw the initial positions, and the bodies at the instant shown, large enough to be visible."""
    motion, chosen, at = content.motion, content.chosen, content.at
    kinds = {shape: (_outlined(shape.pieces), _inner_radius(shape)) for shape in dict.fromkeys(motion.shapes) if shape}
    starts: dict[str, Array] = {}
    points: dict[str, Array] = {}
    bodies: list[Circle | Polygon] = []
    colours: list[str] = []
    edges: list[float] = []
    noses: list[Array] = []
    for agent, (line, shape) in enumerate(zip(chosen.lines, motion.shapes, strict=True)):
        way = _known(motion.positions[: at + 1, agent])
        if not len(way):
            continue
        starts[line.name] = way[:1]
        is_small = shape is None or kinds[shape][1] < 0.004 * span
        if is_small:
            points[line.name] = way[-1:]
        if shape is not None:
            pieces, inner = kinds[shape]
            position, heading = motion.positions[at, agent], float(motion.headings[at, agent])
            bodies += _body(pieces, position, heading)
            colours += [line.colour] * len(pieces)
            # The edge would cover what is small.
            edges += [0.0 if is_small else 0.2 if chosen.many else 0.8] * len(pieces)
            if motion.nosed[agent] and inner > 0.01 * span:
                noses.append(placed(_NOSE * inner, position, heading)[:, :2])
    for colour, where in _by_colour(chosen.lines, starts).items():
        mark = _mark("o", colour, 1.5 if chosen.many else 5.5)
        axes.plot(*where.T, zorder=4.5, markerfacecolor="white", **mark)
    for colour, where in _by_colour(chosen.lines, points).items():
        axes.plot(*where.T, zorder=5, **_mark("o", colour, 2.0 if chosen.many else 7.0))
    axes.add_collection(
        PatchCollection(bodies, facecolors=colours, edgecolors="white", linewidths=edges, zorder=5), autolim=False
    )
    axes.add_collection(PolyCollection(noses, facecolors="white", edgecolors="none", zorder=6), autolim=False)
    return [
        Line2D([], [], label="start", markerfacecolor="white", **_mark("o", INK, 5.5)),
        Line2D([], [], label="body", **_mark("o", INK, 7.0)),
    ]


def _by_colour(lines: Iterable[LineStyle], points: Mapping[str, Array]) -> dict[str, Array]:
    """Group the points (m, 2) of agents by colour."""
    found: dict[str, list[Array]] = {}
    for line in lines:
        if line.name in points:
            found.setdefault(line.colour, []).append(points[line.name])
    return {colour: np.concatenate(parts) for colour, parts in found.items()}


def _inner_radius(shape: Shape) -> float:
    """Return the radius of the largest circle around the position inside the shape; negative if it is outside [m]."""
    pieces = Pieces.of(shape.pieces)
    offsets = pieces.offsets.min(axis=1)
    return float((np.where(np.isinf(offsets), 0.0, offsets) + pieces.rounding).max())


def _draw_contacts(axes: Axes, content: Trajectories) -> list[Line2D | Patch]:
    """Draw a ring for each place of contacts, with their number if there are several."""
    points = content.contacts[np.isfinite(content.contacts).all(axis=1)]
    if not len(points):
        return []
    colour = hexadecimal(CONTACT)
    reach = _TOGETHER * float(max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())))
    places = _clusters(points, reach)
    for place, count in places:
        axes.plot(*place, zorder=7, markerfacecolor="none", **_mark("o", colour, 6.0 + 2.0 * np.log2(count)))
        if count > 1:
            size = 0.75 * float(mpl.rcParams["font.size"])
            given: dict[str, Any] = {"fontsize": size, "color": colour, "zorder": 7.1, "clip_on": True}
            axes.annotate(f"{count}", place, (4 + np.log2(count), 3), textcoords="offset points", **given)
    label = f"contacts ({len(content.contacts)})" + (
        "; where several: their number" if len(places) < len(points) else ""
    )
    return [Line2D([], [], label=label, markerfacecolor="none", **_mark("o", colour, 6.0))]


def _clusters(points: Array, reach: float) -> list[tuple[tuple[float, float], int]]:
    """Group points (m, 2) that are within reach of the first of a group [m]: the centre and the size of each group."""
    groups: list[list[Array]] = []
    for point in points:
        near = next((group for group in groups if float(np.hypot(*(group[0] - point))) <= reach), None)
        if near is None:
            groups.append([point])
        else:
            near.append(point)
    middles = [np.mean(group, axis=0).tolist() for group in groups]
    return [((x, y), len(group)) for (x, y), group in zip(middles, groups, strict=True)]


def _mark(marker: str, colour: str, size: float) -> dict[str, Any]:
    """Return the properties of a line that consists only of markers."""
    edge = min(1.4, size / 4.0)
    return {"marker": marker, "color": colour, "linestyle": "none", "markersize": size, "markeredgewidth": edge}


#: An arrowhead that shows the heading of a body of radius 1.
_NOSE: Array = np.array([[0.7, 0.0], [-0.4, 0.42], [-0.15, 0.0], [-0.4, -0.42]])


def _faded(colour: str, share: float) -> tuple[float, float, float]:
    """Mix a colour with white."""
    red, green, blue = (part + (1.0 - part) * share for part in to_rgb(colour))
    return red, green, blue
