"""Where everybody that a plot is about was."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Shape
from symaware_cli.recording.error import LogError, UnknownNameError
from symaware_cli.recording.reader import Log
from symaware_cli.recording.series import Series
from symaware_cli.viewing.palette import DISTINCT, agent_colours, hexadecimal
from symaware_cli.viewing.plotting.request import Window
from symaware_cli.viewing.views import GroupView, ObstacleView, RunView

Array = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True)
class LineStyle:
    """How whatever belongs to one agent is drawn.

    Attributes:
        name: Whose it is.
        colour: As ``#rrggbb``.
        dashed: Whether its lines are, as its colour is somebody else's already.
    """

    name: str
    colour: str
    dashed: bool = False


@dataclass(frozen=True)
class Chosen:
    """The agents that a plot is about.

    Attributes:
        rows: The rows of each group, ascending; groups of which nobody is chosen are left out.
        lines: How each agent is drawn, group by group.
        group_view: The group that each of them belongs to.
    """

    rows: Mapping[str, NDArray[np.intp]]
    lines: tuple[LineStyle, ...]
    group_view: tuple[GroupView, ...]

    @property
    def agents(self) -> tuple[str, ...]:
        """Their ids."""
        return tuple(line.name for line in self.lines)

    @property
    def many(self) -> bool:
        """Whether they are too many to tell one from another."""
        return len(self.lines) > DISTINCT

    @property
    def groups(self) -> tuple[LineStyle, ...]:
        """How each group is drawn where its agents are too many."""
        found = {group_view.name: line.colour for line, group_view in zip(self.lines, self.group_view, strict=True)}
        return tuple(LineStyle(name, colour) for name, colour in found.items())

    @property
    def groupwise(self) -> Iterator[tuple[str, NDArray[np.intp], tuple[LineStyle, ...]]]:
        """Each group with the rows that are chosen, and how their agents are drawn."""
        first = 0
        for name, rows in self.rows.items():
            yield name, rows, self.lines[first : first + len(rows)]
            first += len(rows)

    @classmethod
    def of(cls, run_view: RunView, names: Sequence[str] = ()) -> Chosen:
        """Choose agents, groups, or everybody if there are no names.

        Raises:
            UnknownNameError: There is no such agent or group.
        """
        wanted = set()
        for name in names:
            if name in run_view.group_views:
                wanted |= set(run_view.group_views[name].agents)
            elif name in run_view.place:
                wanted.add(name)
            else:
                known = [*run_view.group_views, *run_view.place]
                listed = f"; there are {', '.join(run_view.group_views)}" if run_view.group_views else ""
                raise UnknownNameError(f"there is no agent or group {name!r}{listed}", name, known)
        rows = {}
        for group_view in run_view.group_views.values():
            found = [row for row, agent in enumerate(group_view.agents) if not names or agent in wanted]
            if found:
                rows[group_view.name] = np.array(found, np.intp)
        colours = [run_view.group_views[name].colours[some] for name, some in rows.items()]
        count = sum(len(some) for some in rows.values())
        if count <= DISTINCT < run_view.agent_count:
            # A few out of many: they are told apart, though the replay does not do so.
            colours = agent_colours([len(some) for some in rows.values()])
        lines: list[LineStyle] = []
        group_views: list[GroupView] = []
        for (name, some), colour in zip(rows.items(), colours, strict=True):
            for row, each in zip(some.tolist(), colour, strict=True):
                hue = hexadecimal(each)
                dashed = count <= DISTINCT and hue in {line.colour for line in lines}
                lines.append(LineStyle(run_view.group_views[name].agents[row], hue, dashed))
                group_views.append(run_view.group_views[name])
        return cls(rows, tuple(lines), tuple(group_views))


@dataclass(frozen=True)
class Motion:
    """Where the chosen agents were, all at the same instants.

    Attributes:
        times: (k,) simulated time [ns].
        positions: (k, n, 3) [m]; NaN before it is known.
        headings: (k, n) [rad]; 0 for those that have none.
        shapes: Of each agent; None for points.
        believed: Groups whose true states were not recorded: what they believed stands in for these.
    """

    times: Times
    positions: Array
    headings: Array
    shapes: tuple[Shape | None, ...]
    believed: tuple[str, ...]

    def index(self, time: int) -> int:
        """The last instant that is no later than a time [ns]; the first where there is none."""
        return max(0, int(np.searchsorted(self.times, time, side="right")) - 1)


@dataclass(frozen=True)
class Obstacles:
    """Where the entities of the environment were, at the instants of a `Motion`.

    Attributes:
        obstacle_views: Who.
        positions: (k, m, 3) [m].
        headings: (k, m) [rad].
    """

    obstacle_views: tuple[ObstacleView, ...]
    positions: Array
    headings: Array

    def moves(self, number: int) -> bool:
        """Whether one of them changes its place."""
        return bool(np.ptp(self.positions[:, number], axis=0).any() or np.ptp(self.headings[:, number]))


def motion(log: Log, run_view: RunView, chosen: Chosen, window: Window) -> Motion | None:
    """Read where the chosen agents were; None where the log does not tell.

    Raises:
        LogError: The log cannot be read, or not understood.
    """
    fields = {
        name: "world" if run_view.group_views[name].whereabouts.startswith("/world/") else "state"
        for name in chosen.rows
    }
    recorded = {
        name: series_of(log, name, field, run_view.group_views[name].whereabouts) for name, field in fields.items()
    }
    believed = tuple(name for name, field in fields.items() if field == "state" and recorded[name] is not None)
    times = instants([series.times for series in recorded.values() if series is not None], window)
    if not len(times):
        return None
    positions, headings, shapes = [], [], []
    for name, rows in chosen.rows.items():
        group_view, series = run_view.group_views[name], recorded[name]
        states = np.full((len(times), len(rows), len(group_view.state)), np.nan)
        if series is not None:
            states = held(series.times, series.values, times)[:, rows]
        if states.shape[2] <= max(*group_view.position, group_view.heading or 0):
            raise LogError(f"the states of {name!r} in {log.path} have fewer elements than its model")
        positions.append(group_view.positions(states))
        heading = group_view.headings(states)
        headings.append(np.zeros(states.shape[:2]) if heading is None else heading)
        shapes += [group_view.shape] * len(rows)
    return Motion(times, np.concatenate(positions, axis=1), np.concatenate(headings, axis=1), tuple(shapes), believed)


def obstacles(log: Log, run_view: RunView, times: Times) -> Obstacles:
    """Read where the entities of the environment were at instants [ns]."""
    obstacle_views = tuple(run_view.obstacle_views.values())
    positions = np.zeros((len(times), len(obstacle_views), 3))
    headings = np.zeros((len(times), len(obstacle_views)))
    for number, obstacle_view in enumerate(obstacle_views):
        positions[:, number], headings[:, number] = obstacle_view.position, obstacle_view.heading
        series = series_of(log, obstacle_view.name, "world", f"/world/{obstacle_view.name}/state")
        if series is not None:
            poses = held(series.times, series.values, times)[:, 0]
            known = ~np.isnan(poses[:, 0])
            for axis, column in enumerate(("x", "y", "z")):
                if column in series.columns:
                    positions[known, number, axis] = poses[known, series.columns.index(column)]
            if "heading" in series.columns:
                headings[known, number] = poses[known, series.columns.index("heading")]
    return Obstacles(obstacle_views, positions, headings)


def series_of(log: Log, name: str, field: str, topic: str) -> Series | None:
    """A series whose values are (k, n, columns) even for one agent; None where nothing was recorded."""
    if topic not in log.topics:
        return None
    series = log.series(name, field)
    if not len(series.times):
        return None
    values = series.values if series.values.ndim == 3 else series.values[:, None, :]
    return Series(series.times, values, series.columns, series.units)


def instants(times: Sequence[Times], window: Window) -> Times:
    """All instants of several series that lie in a window, ascending [ns]."""
    union = np.unique(np.concatenate([np.empty(0, np.int64), *times]))
    return union[(union >= window.start) & (union <= window.end)]


def held(times: Times, values: Array, at: Times) -> Array:
    """Values (k, ...) that were set at times (k,), as they stand at others (m,): (m, ...), NaN before the first."""
    index = np.searchsorted(times, at, side="right") - 1
    stood = values[np.maximum(index, 0)]
    stood[index < 0] = np.nan
    return stood
