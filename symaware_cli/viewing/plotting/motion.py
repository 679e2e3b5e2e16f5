"""Where everybody that a plot is about was, and where they were going."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import Shape
from symaware_cli.recording.error import LogError, UnknownNameError
from symaware_cli.recording.reader import Log
from symaware_cli.recording.series import Series
from symaware_cli.viewing.cast import Cast, Prop, Troupe
from symaware_cli.viewing.palette import DISTINCT, agent_colours, hexadecimal
from symaware_cli.viewing.plotting.request import Window

Array = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True)
class Line:
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
        troupe: The group that each of them belongs to.
    """

    rows: Mapping[str, NDArray[np.intp]]
    lines: tuple[Line, ...]
    troupe: tuple[Troupe, ...]

    @property
    def agents(self) -> tuple[str, ...]:
        """Their ids."""
        return tuple(line.name for line in self.lines)

    @property
    def many(self) -> bool:
        """Whether they are too many to tell one from another."""
        return len(self.lines) > DISTINCT

    @property
    def groups(self) -> tuple[Line, ...]:
        """How each group is drawn where its agents are too many."""
        found = {troupe.name: line.colour for line, troupe in zip(self.lines, self.troupe, strict=True)}
        return tuple(Line(name, colour) for name, colour in found.items())

    @property
    def groupwise(self) -> Iterator[tuple[str, NDArray[np.intp], tuple[Line, ...]]]:
        """Each group with the rows that are chosen, and how their agents are drawn."""
        first = 0
        for name, rows in self.rows.items():
            yield name, rows, self.lines[first : first + len(rows)]
            first += len(rows)

    @classmethod
    def of(cls, cast: Cast, names: Sequence[str] = ()) -> Chosen:
        """Choose agents, groups, or everybody if there are no names.

        Raises:
            UnknownNameError: There is no such agent or group.
        """
        wanted = set()
        for name in names:
            if name in cast.troupes:
                wanted |= set(cast.troupes[name].agents)
            elif name in cast.place:
                wanted.add(name)
            else:
                known = [*cast.troupes, *cast.place]
                listed = f"; there are {', '.join(cast.troupes)}" if cast.troupes else ""
                raise UnknownNameError(f"there is no agent or group {name!r}{listed}", name, known)
        rows = {}
        for troupe in cast.troupes.values():
            found = [row for row, agent in enumerate(troupe.agents) if not names or agent in wanted]
            if found:
                rows[troupe.name] = np.array(found, np.intp)
        colours = [cast.troupes[name].colours[some] for name, some in rows.items()]
        count = sum(len(some) for some in rows.values())
        if count <= DISTINCT < cast.agent_count:
            # A few out of many: they are told apart, though the replay does not do so.
            colours = agent_colours([len(some) for some in rows.values()])
        lines: list[Line] = []
        troupes: list[Troupe] = []
        for (name, some), colour in zip(rows.items(), colours, strict=True):
            for row, each in zip(some.tolist(), colour, strict=True):
                hue = hexadecimal(each)
                dashed = count <= DISTINCT and hue in {line.colour for line in lines}
                lines.append(Line(cast.troupes[name].agents[row], hue, dashed))
                troupes.append(cast.troupes[name])
        return cls(rows, tuple(lines), tuple(troupes))


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
        props: Who.
        positions: (k, m, 3) [m].
        headings: (k, m) [rad].
    """

    props: tuple[Prop, ...]
    positions: Array
    headings: Array

    def moves(self, number: int) -> bool:
        """Whether one of them changes its place."""
        return bool(np.ptp(self.positions[:, number], axis=0).any() or np.ptp(self.headings[:, number]))


def motion(log: Log, cast: Cast, chosen: Chosen, window: Window) -> Motion | None:
    """Read where the chosen agents were; None where the log does not tell.

    Raises:
        LogError: The log cannot be read, or not understood.
    """
    fields = {
        name: "world" if cast.troupes[name].whereabouts.startswith("/world/") else "state" for name in chosen.rows
    }
    recorded = {name: series_of(log, name, field, cast.troupes[name].whereabouts) for name, field in fields.items()}
    believed = tuple(name for name, field in fields.items() if field == "state" and recorded[name] is not None)
    times = instants([series.times for series in recorded.values() if series is not None], window)
    if not len(times):
        return None
    positions, headings, shapes = [], [], []
    for name, rows in chosen.rows.items():
        troupe, series = cast.troupes[name], recorded[name]
        states = np.full((len(times), len(rows), len(troupe.state)), np.nan)
        if series is not None:
            states = held(series.times, series.values, times)[:, rows]
        if states.shape[2] <= max(*troupe.position, troupe.heading or 0):
            raise LogError(f"the states of {name!r} in {log.path} have fewer elements than its model")
        positions.append(troupe.positions(states))
        heading = troupe.headings(states)
        headings.append(np.zeros(states.shape[:2]) if heading is None else heading)
        shapes += [troupe.shape] * len(rows)
    return Motion(times, np.concatenate(positions, axis=1), np.concatenate(headings, axis=1), tuple(shapes), believed)


def obstacles(log: Log, cast: Cast, times: Times) -> Obstacles:
    """Read where the entities of the environment were at instants [ns]."""
    props = tuple(cast.props.values())
    positions = np.zeros((len(times), len(props), 3))
    headings = np.zeros((len(times), len(props)))
    for number, prop in enumerate(props):
        positions[:, number], headings[:, number] = prop.position, prop.heading
        series = series_of(log, prop.name, "world", f"/world/{prop.name}/state")
        if series is not None:
            poses = held(series.times, series.values, times)[:, 0]
            known = ~np.isnan(poses[:, 0])
            for axis, column in enumerate(("x", "y", "z")):
                if column in series.columns:
                    positions[known, number, axis] = poses[known, series.columns.index(column)]
            if "heading" in series.columns:
                headings[known, number] = poses[known, series.columns.index("heading")]
    return Obstacles(props, positions, headings)


def goals(log: Log, chosen: Chosen, until: int) -> dict[str, Array]:
    """Read where agents wanted to go, as far as they knew ``goal`` or ``waypoints`` at a time.

    Args:
        log: The log.
        chosen: Whose goals.
        until: Simulated time [ns].

    Returns:
        By agent (m, 2) positions from above [m].
    """
    found: dict[str, Array] = {}
    troupes = dict(zip(chosen.agents, chosen.troupe, strict=True))
    for name in chosen.rows:
        if f"/agents/{name}/knowledge" not in log.topics:
            continue
        for entry in log.knowledge(name):
            if entry.time <= until and entry.agent in troupes:
                found.pop(entry.agent, None)
                points = _destinations(entry.values, troupes[entry.agent])
                found.update({} if points is None else {entry.agent: points})
    return found


def intents(log: Log, chosen: Chosen, at: int) -> dict[str, Array]:
    """Read where agents meant to go at a time, as far as their intents are positions.

    Args:
        log: The log.
        chosen: Whose intents.
        at: Simulated time [ns].

    Returns:
        By agent (m, 2) positions from above, the earliest first [m].
    """
    found: dict[str, Array] = {}
    for name in chosen.rows:
        topic = f"/agents/{name}/intent"
        troupe = next(troupe for troupe in chosen.troupe if troupe.name == name)
        if topic not in log.topics or log.topics[topic].metadata.get("columns", "").split(",")[:2] != ["x", "y"]:
            continue
        for message in log.messages(topic, end=at + 1):
            content = message.decode()
            rows = range(len(troupe.agents)) if content.rows is None else content.rows.tolist()
            for row, (_, values) in zip(rows, content, strict=False):
                found[troupe.agents[row]] = values[:, :2]
    return {agent: values for agent, values in found.items() if agent in chosen.agents and len(values)}


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


def _destinations(knowledge: Mapping[str, Any], troupe: Troupe) -> Array | None:
    """The positions that a knowledge database names as destinations, from above; None if it names none."""
    try:
        array = np.array(knowledge.get("waypoints", knowledge.get("goal")), float, ndmin=2)
    except (ValueError, TypeError):
        # Whoever writes a component may know something else by that name.
        return None
    if array.ndim != 2 or array.shape[1] < 2 or not np.isfinite(array).all():
        return None
    where = list(troupe.position[:2]) if array.shape[1] == len(troupe.state) else [0, 1]
    return array[:, where]
