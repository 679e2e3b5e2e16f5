"""Builds the content of a plot: the panels for a request, from the marks of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import MEASUREMENT
from symaware_cli.core import PARTS, seconds
from symaware_cli.entry_points import Listing
from symaware_cli.log import FIELDS, Log, LogError, UnknownNameError
from symaware_cli.views.detail import Detail
from symaware_cli.views.palette import DISTINCT, SCENERY, agent_colours, hexadecimal
from symaware_cli.views.plotting import curves, separation
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.line_styles import Chosen, LineStyle
from symaware_cli.views.plotting.mode_timeline import mode_timeline, strips_of
from symaware_cli.views.plotting.motion import Motion, Obstacles, motion_of, obstacles_of
from symaware_cli.views.plotting.offer_timeline import offer_timeline
from symaware_cli.views.plotting.panels import Content, Distances, Panel, Trajectories
from symaware_cli.views.plotting.paper_preset import GREY_SAFE
from symaware_cli.views.plotting.request import PlotRequest, SeriesName, Window
from symaware_cli.views.scene.contacts import contact_time
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Bodies, Crosses, Curves, Lines, Mark, Modes, Numbers, Points, Solid, joined
from symaware_cli.views.scene.scene import Scene, installed_drawings
from symaware_cli.views.views import RunView, run_view_of


def choose(run_view: RunView, names: Sequence[str] = (), hues: Sequence[str] = ()) -> Chosen:
    """Choose agents and groups by name, or all agents if no names are given.

    Args:
        run_view: The run.
        names: The names.
        hues: The colours of agents, in order, as ``#rrggbb``; empty for those of a replay.

    Raises:
        UnknownNameError: An agent or group does not exist.
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
    rows = {
        name: [row for row, agent in enumerate(group_view.agents) if not names or agent in wanted]
        for name, group_view in run_view.group_views.items()
    }
    rows = {name: some for name, some in rows.items() if some}
    colours = [run_view.group_views[name].colours[some] for name, some in rows.items()]
    count = sum(len(some) for some in rows.values())
    if count <= DISTINCT < run_view.agent_count:
        # With few chosen agents, each has its own colour, unlike in a replay.
        colours = agent_colours([len(some) for some in rows.values()])
    taken: set[str] = set()
    members: dict[str, list[LineStyle]] = {}
    number = 0
    for (name, some), colour in zip(rows.items(), colours, strict=True):
        for row, each in zip(some, colour, strict=True):
            hue = hues[number % len(hues)] if hues and count <= DISTINCT else hexadecimal(each)
            number += 1
            style = LineStyle(run_view.group_views[name].agents[row], hue, count <= DISTINCT and hue in taken)
            members.setdefault(name, []).append(style)
            taken.add(hue)
    return Chosen({name: tuple(lines) for name, lines in members.items()})


Array = NDArray[np.float64]

#: Maximum number of panels of a plot, and above which optional panels are omitted.
_MOST_PANELS, _MOST_UNASKED = 16, 8

#: With more agents than this, each has a curve instead of stacked shares.
_MOST_SHARES = 4

#: Fields that change gradually; others, such as inputs and readings, are constant until the next value.
_GRADUAL = ("state", "world", "intent", "uncertainty")


def gather(log: Log, request: PlotRequest) -> Content:
    """Read the content of a plot from a log.

    Raises:
        LogError: There is nothing to plot, or the log lacks requested data.
    """
    run_view = run_view_of(log)
    drawings = installed_drawings("plot")
    own = [drawing.panel for drawing in drawings if drawing.panel]
    signals = [name for group_view in run_view.group_views.values() for name in group_view.signals]
    request.require_known([*signals, *own])
    # A panel of a drawing is shown only on request, so that a plot does not depend on installed plugins.
    wanted = {drawing: each for drawing, each in drawings.items() if not drawing.panel or drawing.panel in request.show}
    gathering = _Gathering(log, run_view, request, wanted)
    panels = gathering.panels()
    if not panels:
        raise LogError(f"{log.path} holds nothing to plot")
    if len(panels) > _MOST_PANELS:
        raise LogError(f"the plot would have {len(panels)} panels, more than {_MOST_PANELS}; name the columns to show")
    return Content(
        name=run_view.name,
        seed=run_view.seed,
        agent_count=run_view.agent_count,
        chosen=gathering.chosen,
        window=gathering.window,
        panels=tuple(panels),
        moment=request.at is not None,
    )


#: The fields of panels with other names than theirs.
_FIELD_OF = {"control": "applied_control"}


class _Gathering:
    """Builds the panels of a request from the marks of a scene, which is drawn from the required topics."""

    def __init__(
        self, log: Log, run_view: RunView, request: PlotRequest, drawings: Mapping[type[Drawing], Listing]
    ) -> None:
        self._log = log
        self._run_view = run_view
        self._request = request
        self.chosen = choose(run_view, request.agents, GREY_SAFE if request.preset else ())
        self.window = Window.of(log, request)
        self._own_panels = [drawing.panel for drawing in drawings if drawing.panel]
        self._names = request.show or (() if request.series else (*_DEFAULT, *self._further))
        self._series = [(name, self._lines(name)) for name in dict.fromkeys(request.series)]
        self._scene = Scene(self._flat(), self._detail(), drawings)
        topics = [topic for name in self._names for topic in self._topics(name)]
        topics += self._scene.topics(["", *self._names] if "trajectories" in self._names else self._names)
        topics += [log.series_topic(self._owner(name), name.field) for name, _ in self._series]
        self._marks = self._read(topics)

    def panels(self) -> list[Panel]:
        """Build the requested panels, or by default those for which the log has data."""
        asked, found = self._request.show, list[Panel]()
        for name in self._names:
            panels = self._named(name)
            if asked and not panels:
                why = _REASONS.get(name, "no component wrote it, or it was not recorded")
                raise LogError(f"{self._log.path} has nothing to show for {name!r}: {why}")
            if asked or name in _DEFAULT or len(found) + len(panels) <= _MOST_UNASKED:
                found += panels
        return found + self._by_name()

    @property
    def _further(self) -> Sequence[str]:
        """The parts of awareness and signals of plugins that are drawn as curves or bars."""
        views = self._run_view.group_views.values()
        signals = {name: each for group_view in views for name, each in group_view.signals.items()}
        built_in = {*(part.name for part in PARTS)}
        return [
            name
            for name, signal in signals.items()
            if name not in built_in and signal.name != MEASUREMENT and signal.drawn in ("curve", "bars")
        ]

    # ---- from the log to marks

    def _topics(self, name: str) -> Iterable[str]:
        """Return the topics that the panels of a name require."""
        views = [self._run_view.group_views[group] for group in self.chosen.members]
        places = [view.state_topic for view in views]
        places += [f"/world/{obstacle}/state" for obstacle in self._run_view.obstacle_views]
        match name:
            case "trajectories":
                paths = [topic for view in views for _, topic in view.drawn("path")] if self._shows_intents else []
                around = [each.around for each in self._run_view.regions.values() if each.around is not None]
                views += [self._run_view.group_views[self._run_view.place[agent][0]] for agent in around]
                knowledge = [f"/agents/{view.name}/knowledge" for view in views]
                return [*places, *(view.state_topic for view in views), *knowledge, "/contacts", *paths]
            case "contacts":
                return ["/contacts"]
            case "separation" | "speed" | "altitude":
                return places
            case "offers":
                return []
            case "specifications" | "verdicts":
                return [f"/specifications/{each}" for each in self._run_view.specifications]
            case "modes":
                return ["/events", *(f"/agents/{view.name}/knowledge" for view in views)]
            case own if own in self._own_panels:
                return []
            case field:
                having = (group for group in self.chosen.members if self._has(group, field))
                return [self._log.series_topic(group, _FIELD_OF.get(field, field)) for group in having]

    def _read(self, topics: Iterable[str]) -> Mapping[str, Sequence[Any]]:
        """Read the marks of the topics up to the end of the window, by path.

        Raises:
            LogError: The log cannot be read, or its messages are inconsistent.
        """
        recorded = {topic for topic in topics if topic in self._log.topics}
        if any("absent" in group for group in self._log.manifest["groups"].values()):
            recorded |= {"/events"} & self._log.topics.keys()
        found = dict[str, list[Mark]]()

        def take(mark: Mark) -> None:
            if len(mark.times):
                earlier = found.setdefault(mark.path, [])
                named = [tuple(each.names) for each in (*earlier[:1], mark) if isinstance(each, Curves)]
                if len({*named}) > 1:
                    raise ValueError(f"the curves at {mark.path} change their names")
                earlier.append(mark)

        messages = self._log.messages(recorded, end=self.window.end + 1) if recorded else ()
        for chunk in self._scene.chunk_reader().chunks(messages):
            try:
                self._scene.draw(chunk, take)
            except (ValueError, IndexError, AttributeError) as error:
                path, end = self._log.path, chunk.end
                raise LogError(f"the values in {path} up to {end} ns do not fit together: {error}") from error
        return found

    def _flat(self) -> RunView:
        """Return the views of a plot, which shows bodies and obstacles as outlines, even if their figures are known."""
        return replace(
            self._run_view,
            group_views={name: replace(view, figure=None) for name, view in self._run_view.group_views.items()},
            obstacle_views={name: replace(view, figure=None) for name, view in self._run_view.obstacle_views.items()},
        )

    def _detail(self) -> Detail:
        named = [("", self.chosen.lines), *self._series]
        focus = tuple(dict.fromkeys(line.name for _, lines in named for line in lines))
        return Detail(focus=focus, labels=False, awareness=True, curves=True, trail=0.0, single=False, words="")

    # ---- from marks to panels

    def _named(self, name: str) -> Sequence[Panel]:
        """Build the panels of a name; none if the log has no data for it."""
        motion, shown = self._motion, self.chosen.lines
        match name:
            case "trajectories":
                return [self._trajectories(motion)] if motion else []
            case "separation":
                return self._separation(motion) if motion else []
            case "contacts":
                return self._contacts()
            case "specifications":
                return self._specifications()
            case "verdicts":
                return self._modes("verdicts", "verdicts of specifications")
            case "modes":
                return self._modes("modes", "modes: the last event, and what is known")
            case "offers":
                timeline = offer_timeline(self._log.events(), self._run_view, self.chosen, self.window)
                return [timeline] if timeline else []
            case "speed" | "altitude":
                space = [line for line in shown if self._is_spatial(line.name)]
                found = motion and (curves.speed(motion, shown) if name == "speed" else curves.altitude(motion, space))
                return [found] if found else []
            case own if own in self._own_panels:
                return self._drawn(own)
            case field:
                recorded = self._shares(field) or self._recorded(field)
                return [strips_of(each, self.window) or each for each in recorded]

    @cached_property
    def _motion(self) -> Motion | None:
        bodies = [joined(marks) for marks in self._marks.values() if isinstance(marks[0], Bodies)]
        return motion_of(bodies, self.chosen.agents, self.window.start, self.window.end)

    @cached_property
    def _solids(self) -> Sequence[Solid]:
        return [joined(marks) for marks in self._marks.values() if isinstance(marks[0], Solid)]

    def _obstacles(self, motion: Motion) -> Obstacles:
        return obstacles_of([mark for mark in self._solids if mark.layer == "scenery"], motion.times)

    def _trajectories(self, motion: Motion) -> Trajectories:
        views, at = self._run_view.group_views, self.window.at
        marks = [mark for marks in self._marks.values() for mark in marks]
        goals: dict[str, list[Array]] = {}
        for name, position in _standing([mark for mark in marks if isinstance(mark, Crosses)], at):
            goals.setdefault(name, []).append(position)
        waypoints: dict[str, list[Array]] = {}
        dots = [mark for mark in marks if isinstance(mark, Points) and mark.layer.startswith("goals/")]
        for name, position in _standing(dots, at):
            waypoints.setdefault(name, []).append(position)
        intents: dict[str, Array] = {}
        for name, way in _standing([mark for mark in marks if isinstance(mark, Lines)], at):
            if name in self.chosen.agents:
                intents.setdefault(name, way)
        begun = [
            (name.split(" "), position)
            for mark in marks
            if isinstance(mark, Points) and mark.layer == "contacts"
            for time, name, position in zip(mark.times.tolist(), mark.names, mark.positions, strict=True)
            if time >= self.window.start
        ]
        shown = {*self.chosen.agents, *self._run_view.obstacle_views}
        return Trajectories(
            motion=motion,
            chosen=self.chosen,
            obstacles=self._obstacles(motion),
            goals={name: np.concatenate(points) for name, points in goals.items() if name in shown},
            waypoints={name: np.concatenate(points) for name, points in waypoints.items() if name in shown},
            intents=intents,
            contacts=np.array([position[:2] for pair, position in begun if {*pair} <= shown]).reshape(-1, 2),
            regions=[mark for mark in self._solids if mark.layer == "regions"],
            time=at,
            spatial=any(self._is_spatial(name) for name in self.chosen.agents),
            believed=tuple(
                group
                for group, lines in self.chosen.members.items()
                if not views[group].state_topic.startswith("/world/") and views[group].state_topic in self._log.topics
            ),
        )

    def _separation(self, motion: Motion) -> list[Distances]:
        obstacles = self._obstacles(motion)
        among, from_obstacles = separation.among(motion), separation.from_obstacles(motion, obstacles)
        if among is None and from_obstacles is None:
            return []
        return [Distances(among, from_obstacles, (motion.names, obstacles.names), self._sampled(motion))]

    def _sampled(self, motion: Motion) -> float | None:
        """Return the usual time between two records, if it is more than a step of the world [s]; otherwise None."""
        step = self._log.manifest.get("time_step")
        if len(motion.times) < 3 or not step:
            return None
        usual = int(np.median(np.diff(motion.times)))
        return seconds(usual) if usual > step else None

    def _specifications(self) -> list[PlottedCurves]:
        agents, found = {*self.chosen.agents}, []
        for name, rows in self._run_view.specifications.items():
            marks = self._marks.get(f"curves/specifications/{name}")
            if marks:
                mark: Curves = joined(marks)
                concerned = zip(mark.names, rows, strict=True)
                styles = curves.specification_styles(
                    [each for each in concerned if {*each[1]} <= agents], self.chosen.lines
                )
                shown = curves.marked(mark, f"specification {name}", styles, self.window)
                found.append(shown and replace(shown, stepwise=True, note="upper bound of robustness", named=True))
        return [each for each in found if each is not None]

    def _contacts(self) -> list[Panel]:
        """Build a panel of the contacts of the chosen agents: a strip for each pair, of many for the longest."""
        shown = {*self.chosen.agents, *self._run_view.obstacle_views}
        marks: list[tuple[str, Modes]] = []
        for path, parts in self._marks.items():
            pair = path.removeprefix("contacts/").split(" ")
            if path.startswith("contacts/") and isinstance(parts[0], Modes) and {*pair} <= shown:
                marks.append((" and ".join(pair), joined(parts)))
        marks.sort(key=lambda each: -contact_time(each[1], self.window.end))
        title = "contacts" if len(marks) <= _PAIRS else f"contacts: the longest {_PAIRS} of {len(marks)} pairs"
        timeline = mode_timeline("contacts", title, marks[:_PAIRS], self.window)
        return [timeline] if timeline else []

    def _modes(self, name: str, title: str) -> list[Panel]:
        """Build a panel of the modes at the paths that begin with the name."""
        marks: list[tuple[str, Modes]] = []
        for path, parts in self._marks.items():
            if path.startswith(f"{name}/") and isinstance(parts[0], Modes):
                mark: Modes = joined(parts)
                # Verdicts are shown even if they never change, modes of agents only if they do.
                if name == "verdicts" or len({*mark.modes}) > 1:
                    marks.append((path.removeprefix(f"{name}/"), mark))
        timeline = mode_timeline(name, title, marks, self.window)
        return [timeline] if timeline else []

    def _drawn(self, panel: str) -> list[PlottedCurves]:
        """Build a panel for each path of curves that a drawing draws for its own panel."""
        agents, found = {line.name: line for line in self.chosen.lines}, []
        for path, marks in self._marks.items():
            if path.startswith(f"curves/{panel}/") and isinstance(marks[0], Curves):
                mark = joined(marks)
                styles = curves.styles_of(mark, agents, self._run_view.place)
                name = f"{panel} {path.removeprefix(f'curves/{panel}/')}"
                found.append(curves.marked(mark, name, styles, self.window))
        return [each for each in found if each is not None]

    def _shares(self, field: str) -> list[PlottedCurves]:
        """Build a panel for each agent with a field drawn as bars, if agents are few and no number is negative."""
        if len(self.chosen.lines) > _MOST_SHARES:
            return []
        found = []
        for group, lines in self.chosen.members.items():
            signal, mark = self._run_view.group_views[group].signals.get(field), self._numbers(group, field)
            if mark is not None and signal is not None and signal.drawn == "bars":
                found += curves.shares(mark, field, [line.name for line in lines], self.window)
        return [] if any((each.values < 0).any() for each in found) else found

    def _recorded(self, field: str) -> list[PlottedCurves]:
        """Build a panel for each column of a field, with the agents that have it."""
        found = curves.together(
            [each for group, lines in self.chosen.members.items() for each in self._columns(group, field, lines)]
        )
        if field in (part.name for part in PARTS):
            return found
        # A column of a control input may have the name of the speed, and one of a part of awareness may have any name.
        return [replace(each, name=f"{field} {each.name}".replace(f"{field} {field}", field)) for each in found]

    def _by_name(self) -> list[PlottedCurves]:
        """Build panels of the series requested by name; those with the same column and unit share a panel.

        Raises:
            LogError: The log has no values of a series.
            UnknownNameError: A column does not exist.
        """
        found: list[tuple[str, PlottedCurves]] = []
        for name, lines in self._series:
            every = self._columns(self._owner(name), name.field, lines)
            if not every:
                raise LogError(f"{self._log.path} has no values of {name.owner}:{name.field}")
            names = [each.name for each in every]
            picked = [each for number, each in enumerate(every) if name.column in (None, each.name, str(number))]
            if not picked:
                message = f"{name.owner}:{name.field} has no column {name.column!r}; there are {', '.join(names)}"
                raise UnknownNameError(message, name.column or "", names)
            found += [(name.field, each) for each in (every if name.column is None else picked[:1])]
        return curves.together(_told_apart(found))

    def _columns(self, owner: str, field: str, lines: Sequence[LineStyle]) -> list[PlottedCurves]:
        mark = self._numbers(owner, field)
        return curves.columns(mark, lines, self.window, stepwise=field not in _GRADUAL) if mark else []

    def _numbers(self, owner: str, field: str) -> Numbers | None:
        """Return the table of a field of a group or entity; None if it was not recorded or does not exist."""
        marks = (
            self._marks.get(self._log.series_topic(owner, _FIELD_OF.get(field, field)).strip("/"))
            if self._has(owner, field)
            else None
        )
        return joined(marks) if marks else None

    # ---- series of the log

    @property
    def _shows_intents(self) -> bool:
        return self._request.at is not None and not self.chosen.many

    def _is_spatial(self, agent: str) -> bool:
        return len(self._run_view.group_views[self._run_view.place[agent][0]].position) == 3

    def _has(self, owner: str, field: str) -> bool:
        return _FIELD_OF.get(field, field) in FIELDS or field in self._log.signals(owner)

    def _owner(self, name: SeriesName) -> str:
        return self._run_view.place[name.owner][0] if name.owner in self._run_view.place else name.owner

    def _lines(self, name: SeriesName) -> tuple[LineStyle, ...]:
        """Return the styles of the curves of a series.

        Raises:
            LogError: The series belongs to a group without a chosen agent.
            UnknownNameError: The agent, group or entity does not exist.
        """
        owner, run_view = name.owner, self._run_view
        if owner in run_view.obstacle_views:
            return (LineStyle(owner, hexadecimal(SCENERY)),)
        if owner in run_view.group_views:
            if owner not in self.chosen.members:
                raise LogError(f"no agent of {owner!r} was chosen")
            return self.chosen.members[owner]
        if owner in run_view.place:
            # A requested agent is shown even if it was not chosen, in its own colour if it has one.
            single = [each.owner for each in self._request.series if each.owner in run_view.place]
            known = self.chosen if owner in self.chosen.agents and not self.chosen.many else choose(run_view, single)
            return (known.lines[known.agents.index(owner)],)
        message = f"there is no agent, group or entity {owner!r}; there are "
        message += ", ".join([*run_view.group_views, *run_view.obstacle_views])
        raise UnknownNameError(message, owner, [*run_view.group_views, *run_view.place, *run_view.obstacle_views])


def _standing(marks: Sequence[Crosses | Points | Lines], at: int) -> Iterable[tuple[str, Array]]:
    """Yield the name and the points (m, 2) of each cross, dot or line that is shown at an instant [ns]."""
    up = {mark.path: mark for mark in marks if mark.times[0] <= at}
    for mark in up.values():
        instant = int(np.searchsorted(mark.times, at, side="right")) - 1
        counts = np.asarray(mark.counts)
        first = int(counts[:instant].sum())
        lengths = np.asarray(mark.lengths) if isinstance(mark, Lines) else np.ones(int(counts.sum()), np.intp)
        points = mark.points if isinstance(mark, Lines) else mark.positions
        ends = np.cumsum(lengths)
        for item in range(first, first + int(counts[instant])):
            if mark.who is not None:
                yield mark.names[mark.who[item]], points[ends[item] - lengths[item] : ends[item], :2]


def _told_apart(parts: Sequence[tuple[str, PlottedCurves]]) -> list[PlottedCurves]:
    """Distinguish curves of several fields that share a panel: by name, and by dashes for every second field."""
    told = []
    for field, curve in parts:
        fields = list(
            dict.fromkeys(other for other, each in parts if (each.name, each.unit) == (curve.name, curve.unit))
        )
        if len(fields) > 1:
            dashed = fields.index(field) % 2 == 1
            lines = tuple(LineStyle(f"{line.name} {field}", line.colour, dashed) for line in curve.lines)
            curve = replace(curve, lines=lines)
        told.append(curve)
    return told


#: The default panels.
_DEFAULT = (
    "trajectories",
    "separation",
    "contacts",
    "verdicts",
    "specifications",
    "offers",
    "risk",
    "speed",
    "altitude",
)

#: The maximum number of pairs with a strip of their contacts.
_PAIRS = 8

_REASONS = {
    "contacts": "there were no contacts of these agents",
    "specifications": "its scenario has none for these agents, or their robustness has no finite upper bound",
    "verdicts": "its scenario has no specifications, or more than fit",
    "modes": "nothing that happened to these agents changes",
    "offers": "its scenario offers no specifications, or none was offered by then",
    "trajectories": "no states were recorded",
    "separation": "it requires two agents, or an agent and an obstacle, with recorded states",
    "risk": "no component computed a risk, or it was not recorded",
    "speed": "it requires states at two instants at least",
    "altitude": "no agent moves in space",
    "control": "the applied control input was not recorded (--series NAME:requested_control)",
}
