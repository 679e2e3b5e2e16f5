"""The panels of a plot: trajectories, separation, offers and curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import seconds
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.line_styles import Chosen
from symaware_cli.views.plotting.mode_timeline import ModeTimeline
from symaware_cli.views.plotting.motion import Motion, Obstacles
from symaware_cli.views.plotting.offer_timeline import OfferTimeline
from symaware_cli.views.plotting.request import Window
from symaware_cli.views.plotting.separation import LeastSeparation
from symaware_cli.views.scene.marks import Solid

Array = NDArray[np.float64]

#: Maximum number of points of all paths; with more, instants are omitted.
_POINTS = 120_000


@dataclass(frozen=True)
class Trajectories:
    """Paths and bodies from above.

    Attributes:
        motion: The motion of the chosen agents.
        chosen: The styles of the agents, in the same order.
        obstacles: The motion of the obstacles.
        goals: The goals of each agent (m, 2) [m], with its waypoints if they are few.
        waypoints: The other waypoints of each agent (m, 2) [m].
        intents: The intended path of each agent at the instant shown (m, 2) [m].
        contacts: (m, 2) the points where contacts began [m]; NaN where unknown.
        regions: Areas of the ground.
        time: The instant at which bodies are shown [ns].
        spatial: Whether bodies move in space.
        believed: Groups whose true states were not recorded, so that their beliefs are shown.
        compared: The motion of the same agents in another run, if two are compared.
        departures: The positions at which agents first deviate from that run (1, 2) [m].
    """

    motion: Motion
    chosen: Chosen
    obstacles: Obstacles
    goals: Mapping[str, Array]
    waypoints: Mapping[str, Array]
    intents: Mapping[str, Array]
    contacts: Array
    regions: Sequence[Solid]
    time: int
    spatial: bool
    believed: tuple[str, ...]
    compared: Motion | None = None
    departures: Mapping[str, Array] = field(default_factory=dict)

    name = "trajectories"

    @cached_property
    def at(self) -> int:
        """The index of the instant at which bodies are shown."""
        return self.motion.index(self.time)

    @cached_property
    def steps(self) -> NDArray[np.intp]:
        """The indices of the instants through which paths are drawn."""
        last = len(self.motion.times) - 1
        stride = max(1, -(-(last + 1) * len(self.chosen.lines) // _POINTS))
        return np.unique(np.append(np.arange(0, last + 1, stride), last))

    def facts(self) -> dict[str, Any]:
        """Return counts as plain data."""
        return {
            "panel": self.name,
            "agents": len(self.chosen.lines),
            "obstacles": len(self.obstacles.names),
            "goals": len(self.goals),
            "contacts": len(self.contacts),
        }

    def notes(self) -> list[str]:
        """Return notes on replaced and omitted data, as sentences."""
        notes = []
        if self.believed:
            who = ", ".join(self.believed)
            notes.append(f"The states of {who} are believed, as the true ones were not recorded.")
        if len(self.steps) < len(self.motion.times):
            notes.append(f"Paths are drawn through {len(self.steps):,} of {len(self.motion.times):,} instants.")
        return notes


@dataclass(frozen=True)
class Distances:
    """The separation of bodies.

    Attributes:
        agents: The separation between two agents; None if there is only one.
        obstacles: The separation between an agent and an obstacle; None if there are no obstacles.
        names: The names of the agents and of the obstacles, by index.
        sampled: The time between two records, if the world made steps in between [s]; None if each step was recorded.
    """

    agents: LeastSeparation | None
    obstacles: LeastSeparation | None
    names: tuple[Sequence[str], Sequence[str]]
    sampled: float | None = None

    name = "separation"

    def who(self, separation: LeastSeparation) -> tuple[str, str]:
        """Return the names of the two bodies with the least separation."""
        one, other = separation.pair[separation.lowest].tolist()
        return self.names[0][one], self.names[separation is self.obstacles][other]

    @cached_property
    def closest(self) -> LeastSeparation:
        """The least of both separations: between agents, or from obstacles."""
        found = [each for each in (self.agents, self.obstacles) if each is not None]
        return min(found, key=lambda each: float(each.least[each.lowest]))

    def facts(self) -> dict[str, Any]:
        """Return the least separations as plain data."""
        facts = {"panel": self.name, "agents": self._least(self.agents), "obstacles": self._least(self.obstacles)}
        return facts if self.sampled is None else {**facts, "recorded_every": self.sampled}

    def _least(self, separation: LeastSeparation | None) -> dict[str, Any] | None:
        if separation is None:
            return None
        index = separation.lowest
        least = {
            "minimum": float(separation.least[index]),
            "time": seconds(int(separation.times[index])),
            "who": self.who(separation),
        }
        if separation is self.agents:
            least["between_centres"] = float(separation.centres[index])
        return {**least, "instants": len(separation.times)}

    def notes(self) -> list[str]:
        """Return notes on omitted data, as sentences."""
        every = max(each.every for each in (self.agents, self.obstacles) if each)
        notes = [f"Separation is evaluated in 1 of {every} instants."] if every > 1 else []
        if self.sampled is not None:
            notes.append(f"Recorded only every {self.sampled:g} s: in between, bodies may have been closer.")
        return notes


Panel: TypeAlias = Trajectories | Distances | OfferTimeline | ModeTimeline | PlottedCurves


@dataclass(frozen=True)
class Content:
    """The content of a plot.

    Attributes:
        name: The scenario's name.
        seed: The seed of the run.
        agent_count: Number of agents of the run.
        chosen: The chosen agents.
        window: The interval of time.
        panels: The panels, in order.
        moment: Whether bodies are shown at a requested time.
        since: An instant to mark in the panels over time [ns]; None for none.
    """

    name: str
    seed: int
    agent_count: int
    chosen: Chosen
    window: Window
    panels: tuple[Panel, ...]
    moment: bool
    since: int | None = None

    def facts(self) -> dict[str, Any]:
        """Return figures about all panels as plain data."""
        return {
            "name": self.name,
            "seed": self.seed,
            "agents": len(self.chosen.lines),
            "start": seconds(self.window.start),
            "end": seconds(self.window.end),
            "panels": [panel.facts() for panel in self.panels],
            "notes": self.notes,
        }

    @property
    def notes(self) -> list[str]:
        """Notes on replaced and omitted data, as sentences."""
        return [note for panel in self.panels if isinstance(panel, Trajectories | Distances) for note in panel.notes()]
