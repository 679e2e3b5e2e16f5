"""The layout of a replay in Rerun: its views and their contents, for the extent and the topics of a log.

Reasons: docs/decisions/0015-replay.md
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Part
from symaware_cli.log import Log, LogMessage, logged_events, read_json
from symaware_cli.views.detail import Detail
from symaware_cli.views.outline import outlines
from symaware_cli.views.palette import DARK, ReplayTheme
from symaware_cli.views.rerun.columns import TIMELINE
from symaware_cli.views.rerun.labels import SceneView
from symaware_cli.views.scale_bar import round_interval
from symaware_cli.views.scene.curves import plotted, unit_paths
from symaware_cli.views.scene.goals import known_ways
from symaware_cli.views.scene.scenery import region_pieces
from symaware_cli.views.video.viewpoint import VIEWPOINTS, Viewpoint
from symaware_cli.views.views import GroupView, RunView, in_space

if TYPE_CHECKING:
    import rerun.blueprint as rrb

Array = NDArray[np.float64]

#: Tangent of half the vertical field of view of Rerun's 3-D view.
_HALF_VIEW = 0.52
#: Aspect ratio of the main view in a window of usual size.
_ASPECT = 1.15
#: Height of the main view in a window of usual size [points].
_HEIGHT = 900.0
#: Part of the height of the main view by which it is higher than what it is fitted to.
_MARGIN = 0.12
#: Aspect ratio of the view in an agent's tab.
_NEAR_ASPECT = 1.9
#: Maximum distance shown around the agent in its tab [m].
_NEAR = 12.0
#: The same for agents with a figure, in multiples of their extent.
_CLOSE = 5.0
#: Maximum number of cameras with a view.
_CAMERAS = 4
#: Up to this number, views of curves are arranged in two columns, otherwise in three.
_CURVES = 4
#: Maximum number of curves with a legend; a larger legend would hide the curves.
_LEGEND = 6
#: Number of instants at which positions are read to determine the extent of a log.
_SAMPLES = 17
#: Maximum number of messages that are read to learn which views would be empty.
_READ = 20_000


@dataclass(frozen=True)
class ReplayContent:
    """The extent and the topics of a log, which determine its views.

    Attributes:
        low: Lower corner of the box around everything (3,) [m].
        high: Upper corner (3,) [m].
        topics: The topics with messages.
        bounded: The specifications whose robustness has a finite upper bound for some time, so that there is a curve.
        modes: Whether any agent has modes.
    """

    low: Array
    high: Array
    topics: frozenset[str]
    bounded: frozenset[str] = frozenset()
    modes: bool = True


def blueprint(
    run_view: RunView,
    detail: Detail,
    content: ReplayContent,
    panels: Sequence[str] = (),
    viewpoint: str = "",
    theme: ReplayTheme = DARK,
) -> rrb.Blueprint:
    """Create the layout of the views for a log.

    Args:
        run_view: The run to show.
        detail: The level of detail.
        content: The extent and the topics of the log.
        panels: The panels of drawings.
        viewpoint: The name of the viewpoint of the scene; empty for the usual one.
        theme: The colours of the surroundings of agents.
    """
    import rerun.blueprint as rrb

    seen = _viewpoint(run_view, viewpoint)
    shown = ["+ world/**", "+ awareness/**", "+ other/**"]
    scene = _spatial(run_view, detail, content, "Scene", shown, viewpoint=seen, theme=theme)
    tabs = [_agent(run_view, detail, content, agent, theme) for agent in detail.focus]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(scene, *tabs, active_tab=int(detail.single)),
            rrb.Vertical(
                *_overviews(run_view, detail, content, panels, theme),
                row_shares=[*_row_shares(run_view, content), *[3] * len(panels), 4],
            ),
            column_shares=[5, 3],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _spatial(
    run_view: RunView,
    detail: Detail,
    content: ReplayContent,
    name: str,
    contents: list[str],
    follow: str | None = None,
    viewpoint: Viewpoint | None = None,
    theme: ReplayTheme = DARK,
) -> rrb.Spatial3DView:
    """Create a view of the world: from a viewpoint, or following an agent; from above if planar, else at an angle."""
    import rerun.blueprint as rrb

    middle, size = 0.5 * (content.low + content.high), _size(content)
    if follow:
        group_view = run_view.group_views[run_view.place[follow][0]]
        # An agent with a figure is shown larger, so that its details are visible.
        reach = min(group_view.perception_range or np.inf, _CLOSE * group_view.extent if group_view.figure else _NEAR)
        # Twice the size, so that an agent at one side sees everything up to the other side.
        size = np.minimum(2.0 * size, 2.0 * reach)
    seen = viewpoint or _viewpoint(run_view)
    distance = _distance(size, _NEAR_ASPECT if follow else _ASPECT, seen)
    position, up = middle + distance * seen.towards, (0.0, 1.0, 0.0) if seen.name == "above" else (0.0, 0.0, 1.0)
    eye = rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=middle, eye_up=up)
    if follow:
        eye = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=position - middle,
            look_target=(0.0, 0.0, 0.0),
            eye_up=up,
            tracking_entity=f"as/{follow}/place",
        )
    spacing = 10.0 ** np.floor(np.log10(max(float(size.max()), 1e-3) / 4.0))
    grid = rrb.LineGrid3D(visible=True, spacing=spacing, color=(*theme.faint, 60))
    trails = [f"{root}/agents/{name}/trail" for root in ("world", "other") for name in run_view.group_views]
    overrides: dict[Any, Any] = {trail: _recent(detail.trail) for trail in trails}
    background = rrb.Background(color=theme.background, kind=rrb.BackgroundKind.SolidColor)
    return rrb.Spatial3DView(
        origin="/",
        name=name,
        contents=contents,
        eye_controls=eye,
        line_grid=grid,
        background=background,
        overrides=overrides,
    )


def scene_view(run_view: RunView, content: ReplayContent, viewpoint: str = "") -> SceneView:
    """Determine the fitted view of the scene, in which labels are placed.

    Args:
        run_view: The run to show.
        content: The extent of the log.
        viewpoint: The name of the viewpoint; empty for the usual one.
    """
    seen = _viewpoint(run_view, viewpoint)
    return SceneView(seen, 2.0 * _HALF_VIEW * _distance(_size(content), _ASPECT, seen) / _HEIGHT)


def scale_bar(content: ReplayContent, view: SceneView) -> tuple[Array, str]:
    """Choose a bar of a round length at the lower left corner of the view.

    Args:
        content: The extent of the log.
        view: The fitted view of the scene.

    Returns:
        Its ends (2, 3) [m], and its length in words.
    """
    length = round_interval(_HEIGHT * view.scale, 5)
    size, right, up = _size(content), np.array(view.viewpoint.right), np.array(view.viewpoint.up)
    if view.viewpoint.name == "angle":
        # Along the ground, in front of everything.
        right, start = np.array([1.0, 0.0, 0.0]), content.low - np.array([0.0, 0.03 * size[1], 0.0])
    else:
        middle = 0.5 * (content.low + content.high)
        below = 0.5 * (_HEIGHT * view.scale) * (1.0 - 0.6 * _MARGIN)
        start = middle - (0.5 * size @ np.abs(right)) * right - below * up
    return np.stack([start, start + length * right]), f"{length:g} m"


def _viewpoint(run_view: RunView, name: str = "") -> Viewpoint:
    return VIEWPOINTS[name or ("angle" if run_view.is_spatial else "above")]


def _size(content: ReplayContent) -> Array:
    """Return the extent (3,) to which the view is fitted [m]."""
    return np.maximum(content.high - content.low, 1.0)


def _distance(size: Array, aspect: float, seen: Viewpoint) -> float:
    """Return the distance of the camera at a viewpoint from a box (3,) that it sees whole [m]."""
    if seen.name == "above":
        return 0.5 * (1.0 + _MARGIN) * max(float(size[1]), float(size[0]) / aspect) / _HALF_VIEW
    direction = -seen.towards
    aside = np.cross(direction, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    above = np.cross(aside, direction)
    corners = 0.5 * size * [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    away = np.maximum(np.abs(corners @ above), np.abs(corners @ aside) / aspect) / _HALF_VIEW
    return 1.05 * float(np.max(away - corners @ direction))


def _agent(run_view: RunView, detail: Detail, content: ReplayContent, agent: str, theme: ReplayTheme) -> rrb.Vertical:
    """Create the tab of an agent: the world as the agent believes it to be, and its awareness as curves."""
    import rerun.blueprint as rrb

    group, _ = run_view.place[agent]
    group_view = run_view.group_views[group]
    bodies = [
        f"+ world/agents/{name}/{part}"
        for name in run_view.group_views
        for part in ("body", "heading", "label", "informed")
    ]
    contents = [
        *(f"+ world/{part}" for part in ("ground", "figures/**", "scenery/**")),
        f"+ world/agents/{group}/goal/**",
        *(f"+ awareness/{group}/{name}/**" for how in ("ellipse", "bars") for name, _ in group_view.drawn(how)),
        *bodies,
    ]
    contents += ["+ world/messages", "+ world/contacts", f"+ as/{agent}/**"]
    view = _spatial(run_view, detail, content, f"as {agent} believes", contents, follow=agent, theme=theme)
    told = [(name, topic) for name, topic in plotted(group_view) if topic in content.topics]
    fields = [name for name, _ in told if isinstance(group_view.signals[name], Part)]
    fields += ["control"] * (f"/world/{group}/control" in content.topics)
    curves = [_curves(f"{field} of {agent}", [f"+ curves/agents/{agent}/{field}"]) for field in fields]
    for field, topic in told:
        units = [unit for _, unit in run_view.quantities.get(topic, [("", "")])]
        for path, columns in unit_paths(agent, topic, units).items() if field not in fields else ():
            unit = units[columns[0]]
            name = f"{field} of {agent} [{unit}]" if unit not in ("", "1") else f"{field} of {agent}"
            curves.append(_curves(name, [f"+ {path}"]))
    across = 2 if len(curves) <= _CURVES else 3
    return rrb.Vertical(view, rrb.Grid(*curves, grid_columns=across), row_shares=[3, 2], name=agent)


def _overviews(
    run_view: RunView, detail: Detail, content: ReplayContent, panels: Sequence[str], theme: ReplayTheme
) -> Iterable[Any]:
    import rerun.blueprint as rrb

    cameras = _cameras(run_view, detail, content, theme)
    if cameras:
        yield rrb.Grid(*cameras, grid_columns=min(len(cameras), 2), name="Cameras")
    if _has_table(run_view):
        yield rrb.TextDocumentView(origin="specifications", name="Specifications")
    if run_view.specifications and not _has_table(run_view):
        yield rrb.StateTimelineView(origin="verdicts", name="Verdicts")
    for name in _specifications(run_view, content):
        yield _curves(f"{name}: upper bound of robustness", [f"+ curves/specifications/{name}/**"])
    if _has_risk(content):
        yield _curves("Risk", ["+ curves/risk/**"], legend=not detail.curves or run_view.agent_count <= _LEGEND)
    if run_view.agent_count > 1:
        yield _curves("Closest two agents [m]; they touch at 0", ["+ curves/separation/**"], legend=False)
    for panel in panels:
        yield _curves(panel.capitalize(), [f"+ curves/{panel}/**"])
    journals = [_log("Events", "log/events")]
    if not content.topics.isdisjoint(logged_events.MESSAGES):
        journals.append(_log("Messages", "log/messages"))
    modes = [rrb.StateTimelineView(origin="modes", name="Modes")] * content.modes
    about = rrb.TextDocumentView(origin="about", name="About")
    yield rrb.Tabs(*journals, *modes, about, active_tab=0)


def _cameras(run_view: RunView, detail: Detail, content: ReplayContent, theme: ReplayTheme) -> list[rrb.Spatial2DView]:
    """Create a view for each camera of the first few agents."""
    import rerun.blueprint as rrb

    sensors = [tuple(topic.split("/")[2::2]) for topic in sorted(content.topics) if "/image/" in topic]
    cameras = [
        (agent, sensor) for agent in detail.focus for group, sensor in sensors if run_view.place[agent][0] == group
    ]
    return [
        rrb.Spatial2DView(
            origin=f"cameras/{agent}/{sensor}/colour",
            name=f"{sensor} of {agent}",
            background=rrb.Background(color=theme.background, kind=rrb.BackgroundKind.SolidColor),
        )
        for agent, sensor in cameras[:_CAMERAS]
    ]


def _log(name: str, origin: str) -> rrb.TextLogView:
    import rerun.blueprint as rrb

    # The texts begin with their times, since Rerun's own column is too narrow.
    columns = rrb.TextLogColumns(
        timeline_columns=[rrb.encodings.TimelineColumn(TIMELINE, visible=False)], text_log_columns=["LogLevel", "Body"]
    )
    return rrb.TextLogView(origin=origin, name=name, columns=columns)


def _row_shares(run_view: RunView, content: ReplayContent) -> list[int]:
    """Return the relative heights of the overviews above the events."""
    cameras = [5] * any("/image/" in topic for topic in content.topics)
    table = [min(12, 3 + len(run_view.specifications) // 3)] * _has_table(run_view)
    table += [2 + len(run_view.specifications) // 3] * (bool(run_view.specifications) and not table)
    curves = len(_specifications(run_view, content)) + _has_risk(content) + (run_view.agent_count > 1)
    return cameras + table + [3] * curves


def _specifications(run_view: RunView, content: ReplayContent) -> list[str]:
    """Return the specifications that have a view of their curves: if they are few, those with one."""
    return [] if _has_table(run_view) else [name for name in run_view.specifications if name in content.bounded]


def _has_table(run_view: RunView) -> bool:
    """Return whether specifications are shown as a table: if they are many, or if it has to tell who holds which."""
    return len(run_view.specifications) > _CURVES or bool(run_view.offered)


def _has_risk(content: ReplayContent) -> bool:
    return any(topic.startswith("/agents/") and topic.endswith("/risk") for topic in content.topics)


def _curves(name: str, contents: list[str], *, legend: bool = True) -> rrb.TimeSeriesView:
    import rerun.blueprint as rrb

    # Bounds fall with time, and risks are rare, so that curves are seldom at the top on the right.
    shown = rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend)
    return rrb.TimeSeriesView(origin="/", name=name, contents=contents, plot_legend=shown)


def _recent(seconds: float) -> Any:
    """Return a visible time range from some time ago [s] until now."""
    import rerun.blueprint as rrb

    return rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def content_of(log: Log, run_view: RunView, start: int | None = None, end: int | None = None) -> ReplayContent:
    """Determine the topics and the spatial extent of a log, by reading a few instants.

    Args:
        log: A SymAware log.
        run_view: The run in the log.
        start: The first instant to show [ns].
        end: The instant at which to stop, exclusive [ns].
    """
    topics = frozenset(topic for topic, channel in log.topics.items() if channel.count)
    first = start if start is not None else log.start_time or 0
    last = min(end, log.end_time or 0) if end is not None else log.end_time or 0
    corners = [corner for obstacle_view in run_view.obstacle_views.values() for corner in obstacle_view.corners]
    group_views = {group_view.state_topic: group_view for group_view in run_view.group_views.values()}
    for moment in np.linspace(first, last, _SAMPLES).astype(np.int64).tolist():
        for message in _sample(log, group_views, moment, last):
            group_view = group_views[message.channel.topic]
            states = message.decode().values
            places = in_space(group_view.positions(states[np.isfinite(states).all(axis=1)]))
            if len(places):
                margin = group_view.radius + 0.5
                corners += [places.min(axis=0) - margin, places.max(axis=0) + margin]
    for group_view in run_view.group_views.values():
        goals = [way for known in _knowledge(log, group_view, last) for way in known_ways(known, group_view)]
        corners += [corner for way in goals if len(way) for corner in (way.min(axis=0) - 0.3, way.max(axis=0) + 0.3)]
    known = [corner for corner in corners if np.isfinite(corner).all()] or [np.full(3, -5.0), np.full(3, 5.0)]
    low, high = np.min(known, axis=0), np.max(known, axis=0)
    # A region far larger than the run would make everything in it too small to see.
    reach = float(np.max(high - low))
    shown = [np.clip(corner, low[:2] - reach, high[:2] + reach) for corner in _region_corners(run_view)]
    known += [np.append(corner, low[2]) for corner in shown]
    return ReplayContent(
        low=np.min(known, axis=0),
        high=np.max(known, axis=0),
        topics=topics,
        bounded=_bounded(log, run_view, start, end),
        modes=_has_modes(log, run_view, start, end),
    )


def _bounded(log: Log, run_view: RunView, start: int | None, end: int | None) -> frozenset[str]:
    """Return the specifications with finite bounds at two instants at least: others have no curve to show."""
    topics = {f"/specifications/{name}": name for name in run_view.specifications}
    instants: dict[str, set[int]] = {name: set() for name in topics.values()}
    for message in islice(log.messages({*topics} & log.topics.keys(), start=start, end=end), _READ):
        name = topics[message.channel.topic]
        if len(instants[name]) < 2 and np.isfinite(message.decode().upper).any():
            instants[name].add(message.time)
            if all(len(times) > 1 for times in instants.values()):
                break
    return frozenset(name for name, times in instants.items() if len(times) > 1)


def _has_modes(log: Log, run_view: RunView, start: int | None, end: int | None) -> bool:
    """Return whether an agent causes an event, or knows a text or a truth value."""
    topics = {"/events", *(f"/agents/{name}/knowledge" for name in run_view.group_views)} & log.topics.keys()
    for message in islice(log.messages(topics, start=start, end=end), _READ):
        content = message.decode()
        if message.channel.topic == "/events":
            if content.source.startswith("agents."):
                return True
        elif any(isinstance(known, str | bool) for value in content.values for known in read_json(value).values()):
            return True
    return False


def content_with(content: ReplayContent, other: ReplayContent) -> ReplayContent:
    """Extend the extent of a log to that of another one shown beside it."""
    return replace(content, low=np.minimum(content.low, other.low), high=np.maximum(content.high, other.high))


def _region_corners(run_view: RunView) -> Iterator[Array]:
    """Yield two corners of the box around each piece of the regions that do not move; (2,) each [m]."""
    for region in run_view.regions.values():
        for outline in outlines(region_pieces(region, run_view.regions)) if region.around is None else ():
            yield outline.min(axis=0)
            yield outline.max(axis=0)


def _knowledge(log: Log, group_view: GroupView, last: int) -> Iterator[Any]:
    """Yield the first recorded knowledge of the agents of a group."""
    topic = f"/agents/{group_view.name}/knowledge"
    for message in islice(log.messages({topic} & log.topics.keys(), end=last + 1), 1):
        yield from (read_json(value) for value in message.decode().values)


def _sample(log: Log, topics: Collection[str], moment: int, last: int) -> list[LogMessage]:
    """Return the first message on each topic soon after an instant, if there is one."""
    found: dict[str, LogMessage] = {}
    for message in islice(log.messages(topics, start=moment), 3 * len(topics)):
        if message.time <= last:
            found.setdefault(message.channel.topic, message)
        if len(found) == len(topics):
            break
    return list(found.values())
