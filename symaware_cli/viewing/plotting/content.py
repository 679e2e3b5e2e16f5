"""What a plot shows: the panels that a request and a log amount to, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.signal import MEASUREMENT
from symaware_cli.core import PARTS, seconds
from symaware_cli.recording.error import LogError
from symaware_cli.recording.logged_events import LoggedContact
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.plotting import separation as closeness
from symaware_cli.viewing.plotting.curves import PlottedCurves, altitude, named, recorded, speed
from symaware_cli.viewing.plotting.marks import goals, intents
from symaware_cli.viewing.plotting.motion import Chosen, Motion, Obstacles, motion, obstacles
from symaware_cli.viewing.plotting.request import PlotRequest, Window
from symaware_cli.viewing.plotting.separation import LeastSeparation
from symaware_cli.viewing.plotting.shares import Shares, shares
from symaware_cli.viewing.plotting.specification_bounds import specifications
from symaware_cli.viewing.scene.regions_drawing import region_outlines
from symaware_cli.viewing.views import RunView, run_view_of

Array = NDArray[np.float64]

#: More panels than anybody reads.
_MOST_PANELS = 16

#: No part of awareness that was not asked for makes it more panels than these.
_MOST_UNASKED = 8

#: So many points of paths are drawn; beyond, instants are left out.
_POINTS = 120_000


@dataclass(frozen=True)
class Trajectories:
    """The ways of the agents, from above.

    Attributes:
        motion: Where they were.
        chosen: Who they are.
        obstacles: What stood around or moved.
        goals: By agent, where it wanted to go (m, 2) [m].
        intents: By agent, where it meant to go at the moment that is shown (m, 2) [m].
        contacts: Those that began.
        regions: The outlines of regions that rest, by name, (m, 2) each [m].
        at: The instant of `motion` at which bodies are shown.
        steps: The instants at which paths are drawn.
    """

    motion: Motion
    chosen: Chosen
    obstacles: Obstacles
    goals: Mapping[str, Array]
    intents: Mapping[str, Array]
    contacts: tuple[LoggedContact, ...]
    regions: Mapping[str, list[Array]]
    at: int
    steps: NDArray[np.intp]

    name = "trajectories"

    def facts(self) -> dict[str, Any]:
        """Return what there is to say in numbers."""
        return {
            "panel": self.name,
            "agents": len(self.chosen.lines),
            "obstacles": len(self.obstacles.obstacle_views),
            "goals": len(self.goals),
            "contacts": len(self.contacts),
        }

    def notes(self) -> list[str]:
        """Return what was left out."""
        notes = []
        if self.motion.believed:
            who = ", ".join(self.motion.believed)
            notes.append(f"The states are what {who} believed, as the true ones were not recorded.")
        if len(self.steps) < len(self.motion.times):
            notes.append(f"Paths are drawn through {len(self.steps):,} of {len(self.motion.times):,} instants.")
        return notes


@dataclass(frozen=True)
class Distances:
    """How far bodies were apart.

    Attributes:
        agents: Of two agents; None if there is but one.
        obstacles: Of an agent and an obstacle; None if there are none.
        chosen: The agents.
        obstacle_views: The names of the obstacles.
        contacts: When contacts began [s].
        sampled: The time between two records, where the world made steps in between [s]; None if each was recorded.
    """

    agents: LeastSeparation | None
    obstacles: LeastSeparation | None
    chosen: Chosen
    obstacle_views: tuple[str, ...]
    contacts: tuple[float, ...]
    sampled: float | None = None

    name = "separation"

    def who(self, separation: LeastSeparation) -> tuple[str, str]:
        """Whose the least separation is."""
        one, other = separation.pair[separation.lowest].tolist()
        return self.chosen.agents[one], (self.chosen.agents if separation is self.agents else self.obstacle_views)[
            other
        ]

    @cached_property
    def closest(self) -> LeastSeparation:
        """The one of the two in which anybody came closest."""
        found = [each for each in (self.agents, self.obstacles) if each is not None]
        return min(found, key=lambda each: float(each.least[each.lowest]))

    def facts(self) -> dict[str, Any]:
        """Return what there is to say in numbers."""
        told = {"panel": self.name, "agents": self._least(self.agents), "obstacles": self._least(self.obstacles)}
        return told if self.sampled is None else {**told, "recorded_every": self.sampled}

    def _least(self, separation: LeastSeparation | None) -> dict[str, Any] | None:
        if separation is None:
            return None
        place = separation.lowest
        least = {
            "minimum": float(separation.least[place]),
            "time": seconds(int(separation.times[place])),
            "who": self.who(separation),
        }
        if separation is self.agents:
            least["between_centres"] = float(separation.centres[place])
        return {**least, "instants": len(separation.times)}

    def notes(self) -> list[str]:
        """Return what was left out."""
        every = max(each.every for each in (self.agents, self.obstacles) if each)
        notes = [f"Separation is looked at in 1 of {every} instants."] if every > 1 else []
        if self.sampled is not None:
            notes.append(f"Recorded every {self.sampled:g} s only: between these, bodies may have been closer.")
        return notes


Panel = Trajectories | Distances | PlottedCurves | Shares


@dataclass(frozen=True)
class Content:
    """Everything that a plot shows.

    Attributes:
        run_view: Who took part in the run.
        chosen: The agents that it is about.
        window: The stretch of time.
        panels: In the order in which they are drawn.
        moment: Whether bodies are shown at a time that was asked for.
    """

    run_view: RunView
    chosen: Chosen
    window: Window
    panels: tuple[Panel, ...]
    moment: bool

    def facts(self) -> dict[str, Any]:
        """Return what there is to say in numbers, as plain data."""
        return {
            "name": self.run_view.name,
            "seed": self.run_view.seed,
            "agents": len(self.chosen.lines),
            "start": seconds(self.window.start),
            "end": seconds(self.window.end),
            "panels": [panel.facts() for panel in self.panels],
            "notes": self.notes,
        }

    @property
    def notes(self) -> list[str]:
        """What was left out."""
        return [note for panel in self.panels if isinstance(panel, Trajectories | Distances) for note in panel.notes()]


def gather(log: Log, request: PlotRequest) -> Content:
    """Read from a log what a request asks for.

    Raises:
        LogError: There is nothing to plot, or not what was asked for.
    """
    run_view = run_view_of(log)
    request.require_known(name for group_view in run_view.group_views.values() for name in group_view.signals)
    chosen = Chosen.of(run_view, request.agents)
    window = Window.of(log, request)
    reading = _Reading(log, run_view, chosen, window, request)
    panels = list(reading.panels())
    panels += named(log, run_view, chosen, request.series, window) if request.series else []
    if not panels:
        raise LogError(f"{log.path} holds nothing to plot")
    if len(panels) > _MOST_PANELS:
        raise LogError(f"that makes {len(panels)} panels, and {_MOST_PANELS} fit; name the columns to be shown")
    return Content(run_view, chosen, window, tuple(panels), request.at is not None)


class _Reading:
    """Reads a log for one request, and nothing twice."""

    def __init__(self, log: Log, run_view: RunView, chosen: Chosen, window: Window, request: PlotRequest) -> None:
        self._log = log
        self._run_view = run_view
        self._chosen = chosen
        self._window = window
        self._request = request

    def panels(self) -> list[Panel]:
        """The panels that the request asks for by name, or those that suit the log if it asks for nothing."""
        asked = self._request.show
        if not asked and self._request.series:
            return []
        found: list[Panel] = []
        for name in asked or (*_DEFAULT, *self._further):
            panels = self._named(name)
            if asked and not panels:
                why = _REASONS.get(name, "no component wrote it, or it was not recorded")
                raise LogError(f"{self._log.path} has nothing to show for {name!r}: {why}")
            if asked or name in _DEFAULT or len(found) + len(panels) <= _MOST_UNASKED:
                found += panels
        return found

    @property
    def _further(self) -> Sequence[str]:
        """The parts of awareness and signals of plugins that are curves or bars."""
        signals = {
            name: each
            for group_view in self._run_view.group_views.values()
            for name, each in group_view.signals.items()
        }
        every = {*(part.name for part in PARTS)}
        return [
            name
            for name, signal in signals.items()
            if name not in every and signal.name != MEASUREMENT and signal.drawn in ("curve", "bars")
        ]

    def _named(self, name: str) -> Sequence[Panel]:
        """The panels of a name; none where the log has nothing for it."""
        match name:
            case "trajectories":
                return self._trajectories()
            case "separation":
                return self._separation()
            case "speed":
                curves = self._motion and speed(self._chosen, self._motion)
            case "specifications":
                return specifications(self._log, self._chosen, self._window)
            case "altitude":
                curves = self._motion and altitude(self._chosen, self._motion)
            case field:
                return shares(self._log, self._chosen, field, self._window) or recorded(
                    self._log, self._chosen, field, self._window
                )
        return [curves] if isinstance(curves, PlottedCurves) else []

    @cached_property
    def _motion(self) -> Motion | None:
        return motion(self._log, self._run_view, self._chosen, self._window)

    @cached_property
    def _obstacles(self) -> Obstacles | None:
        return None if self._motion is None else obstacles(self._log, self._run_view, self._motion.times)

    @cached_property
    def _contacts(self) -> tuple[LoggedContact, ...]:
        shown = {*self._chosen.agents, *self._run_view.obstacle_views}
        return tuple(
            contact
            for contact in self._log.contacts(self._window.start, self._window.end + 1)
            if contact.stage == "BEGIN" and {contact.a, contact.b} <= shown
        )

    def _trajectories(self) -> list[Trajectories]:
        if self._motion is None or self._obstacles is None:
            return []
        count, last = len(self._chosen.lines), len(self._motion.times) - 1
        stride = max(1, -(-(last + 1) * count // _POINTS))
        at = self._window.at
        moment = self._request.at is not None and not self._chosen.many
        return [
            Trajectories(
                motion=self._motion,
                chosen=self._chosen,
                obstacles=self._obstacles,
                goals=self._of_chosen(goals(self._log, self._run_view, at)),
                intents=self._of_chosen(intents(self._log, self._run_view, at)) if moment else {},
                contacts=self._contacts,
                regions={
                    name: region_outlines(region, self._run_view.regions)
                    for name, region in self._run_view.regions.items()
                    if region.around is None
                },
                at=self._motion.index(at),
                steps=np.unique(np.append(np.arange(0, last + 1, stride), last)),
            )
        ]

    def _of_chosen(self, found: Mapping[str, Array]) -> dict[str, Array]:
        """Those of the agents that the plot is about."""
        chosen = {*self._chosen.agents}
        return {agent: points for agent, points in found.items() if agent in chosen}

    def _separation(self) -> list[Distances]:
        if self._motion is None or self._obstacles is None:
            return []
        agents = closeness.among(self._motion)
        from_obstacles = closeness.from_obstacles(self._motion, self._obstacles)
        if agents is None and from_obstacles is None:
            return []
        times = tuple(seconds(contact.time) for contact in self._contacts)
        obstacle_views = tuple(self._run_view.obstacle_views)
        return [Distances(agents, from_obstacles, self._chosen, obstacle_views, times, self._sampled(self._motion))]

    def _sampled(self, motion: Motion) -> float | None:
        """The usual time between two records where that is more than a step of the world [s]; None elsewhere."""
        step = self._log.manifest.get("time_step")
        if len(motion.times) < 3 or not step:
            return None
        usual = int(np.median(np.diff(motion.times)))
        return seconds(usual) if usual > step else None


#: What is shown of every log that has it.
_DEFAULT = ("trajectories", "separation", "specifications", "risk", "speed", "altitude")

_REASONS = {
    "specifications": "its scenario has none of these agents, or leaves out their intervals",
    "trajectories": "no states were recorded",
    "separation": "it takes two agents, or an agent and an obstacle, whose states were recorded",
    "risk": "no component told a risk, or it was not recorded",
    "speed": "it takes states at two instants at least",
    "altitude": "nobody moves in space",
    "control": "the control input that was applied was not recorded (--series NAME:control_requested)",
}
