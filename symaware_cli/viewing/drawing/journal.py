"""What happened: events and messages as lines of a log, arrows between agents, flashes where bodies touch, modes."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording import journal
from symaware_cli.viewing.cast import Cast
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.excerpt import Excerpt
from symaware_cli.viewing.outline import circle
from symaware_cli.viewing.palette import CONTACT
from symaware_cli.viewing.stage import Stage

Array = NDArray[np.float64]

#: How long a message is to be seen [ns].
_ARROW = 300_000_000
#: When a flash has which size, after its beginning [ns] and in radii of the bodies.
_FLASH = ((0, 2.4), (80_000_000, 2.0), (160_000_000, 1.6), (240_000_000, 1.3))


class Events(Drawing):
    """The events as a log, and as the modes that agents are in."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        #: Agents that change more than once what they were last told of: for these a mode tells something.
        self.modes: dict[str, set[str]] = {}

    def draw(self, excerpt: Excerpt) -> None:
        """Write the events."""
        events = [journal.event(time, message) for time, message in excerpt.entries.get("/events", ())]
        if not events:
            return
        self.stage.texts(
            "log/events",
            [event.time for event in events],
            [f"{event.time / 1e9:8.2f} s  {event.name}  {event.source}  {event.text}".rstrip() for event in events],
            [_LEVELS.get(event.level, "INFO") for event in events],
        )
        focus = {f"agents.{agent}": agent for agent in self.detail.focus}
        told: dict[str, list[tuple[int, str]]] = {}
        for event in events:
            agent = focus.get(event.source.rpartition(".")[0])
            if agent:
                told.setdefault(agent, []).append((event.time, event.name))
        for agent, changes in told.items():
            self.modes.setdefault(agent, set()).update(name for _, name in changes)
            self.stage.modes(f"modes/{agent}", [time for time, _ in changes], [name for _, name in changes])


class Knowledge(Drawing):
    """What agents know that is a mode: words and yes or no, over time."""

    def __init__(self, cast: Cast, detail: Detail, stage: Stage) -> None:
        super().__init__(cast, detail, stage)
        self._known: dict[tuple[str, str], str] = {}

    def draw(self, excerpt: Excerpt) -> None:
        """Write down what changed."""
        for troupe in self.cast.troupes.values():
            for time, message in excerpt.entries.get(f"/agents/{troupe.name}/knowledge", ()):
                for row, value in zip(message.rows or range(len(message.values)), message.values, strict=True):
                    if troupe.agents[row] in self.detail.focus:
                        self._look(troupe.agents[row], time, json.loads(value))

    def _look(self, agent: str, time: int, knowledge: dict[str, Any]) -> None:
        for name, value in knowledge.items():
            if isinstance(value, str | bool) and self._known.get((agent, name)) != str(value):
                self._known[agent, name] = str(value)
                self.stage.modes(f"modes/{agent}/{name}", [time], [str(value)])


class Messages(Drawing):
    """Messages between agents: lines of a log, and for a moment an arrow from the sender to the receiver."""

    def __init__(
        self, cast: Cast, detail: Detail, stage: Stage, place_of: Callable[[str, int, Excerpt], Array | None]
    ) -> None:
        """Remember whom to ask for places.

        Args:
            cast: Who takes part.
            detail: How much to show.
            stage: Where to draw.
            place_of: Where somebody is at an instant [ns] of an excerpt, (3,) [m]; None if unknown.
        """
        super().__init__(cast, detail, stage)
        self._place_of = place_of
        self._shown: list[tuple[int, Array, Array]] = []

    def begin(self) -> None:
        """Put up how arrows look."""
        import rerun as rr

        look = rr.Arrows3D.from_fields(radii=rr.Radius.ui_points([1.0]), colors=[(250, 220, 120)])
        self.stage.static("world/messages", look)

    def draw(self, excerpt: Excerpt) -> None:
        """Write and draw the messages."""
        entries = [journal.communication(time, message) for time, message in excerpt.entries.get("/messages", ())]
        if entries:
            self.stage.texts(
                "log/messages",
                [entry.time for entry in entries],
                [_line(entry) for entry in entries],
                ["WARN" if entry.stage == "DROPPED" else "DEBUG" for entry in entries],
            )
        shown = list(self._shown)
        for entry in entries:
            if entry.stage == "DELIVERED":
                ends = [self._place_of(who, entry.time, excerpt) for who in (entry.sender, entry.receiver)]
                if ends[0] is not None and ends[1] is not None:
                    shown.append((entry.time, ends[0], ends[1] - ends[0]))
        changes = sorted({time + later for time, _, _ in shown for later in (0, _ARROW)})
        changes = [change for change in changes if excerpt.start <= change <= excerpt.end]
        arrows = [[arrow for arrow in shown if arrow[0] <= change < arrow[0] + _ARROW] for change in changes]
        flat = [arrow for present in arrows for arrow in present]
        if changes:
            origins = np.array([origin for _, origin, _ in flat]).reshape(-1, 3)
            vectors = np.array([vector for _, _, vector in flat]).reshape(-1, 3)
            counts = [len(present) for present in arrows]
            self.stage.arrows("world/messages", np.array(changes, np.int64), origins, vectors, counts)
        self._shown = [arrow for arrow in shown if arrow[0] + _ARROW > excerpt.end]


class Contacts(Drawing):
    """A ring that flashes where two bodies begin to touch, and stays while they do."""

    def __init__(
        self, cast: Cast, detail: Detail, stage: Stage, place_of: Callable[[str, int, Excerpt], Array | None]
    ) -> None:
        """Remember whom to ask for places.

        Args:
            cast: Who takes part.
            detail: How much to show.
            stage: Where to draw.
            place_of: Where somebody is at an instant [ns] of an excerpt, (3,) [m]; None if unknown.
        """
        super().__init__(cast, detail, stage)
        self._place_of = place_of
        #: Centre, size of the bodies and beginning of each pair that touches.
        self._touching: dict[tuple[str, str], tuple[Array, float, int]] = {}

    def begin(self) -> None:
        """Put up how rings look."""
        import rerun as rr

        look = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points([2.5]), colors=[CONTACT])
        self.stage.static("world/contacts", look)

    def draw(self, excerpt: Excerpt) -> None:
        """Draw the rings."""
        entries = [journal.contact(time, message) for time, message in excerpt.entries.get("/contacts", ())]
        moments = {entry.time for entry in entries}
        begun = [*(since for _, _, since in self._touching.values())]
        begun += [entry.time for entry in entries if entry.stage == "BEGIN"]
        moments |= {since + later for since in begun for later, _ in _FLASH}
        pending = iter(sorted(entries, key=lambda entry: entry.time))
        upcoming = next(pending, None)
        times, rings, counts = [], [], []
        for moment in sorted(moment for moment in moments if excerpt.start <= moment <= excerpt.end):
            while upcoming is not None and upcoming.time <= moment:
                self._note(upcoming, excerpt)
                upcoming = next(pending, None)
            times.append(moment)
            counts.append(len(self._touching))
            rings += [_ring(centre, size, moment - since) for centre, size, since in self._touching.values()]
        if times:
            points = np.concatenate(rings) if rings else np.empty((0, 3))
            self.stage.strips("world/contacts", np.array(times), points, [len(ring) for ring in rings], counts)

    def _note(self, contact: journal.LoggedContact, excerpt: Excerpt) -> None:
        pair = contact.a, contact.b
        if contact.stage != "BEGIN":
            self._touching.pop(pair, None)
            return
        ends = [place for who in pair if (place := self._place_of(who, contact.time, excerpt)) is not None]
        centre = np.array((*contact.point, 0.0, 0.0)[:3]) if contact.point else np.mean(ends, axis=0) if ends else None
        if centre is not None:
            self._touching[pair] = centre, self._size(pair), contact.time

    def _size(self, pair: Sequence[str]) -> float:
        radii = [self.cast.troupes[self.cast.place[who][0]].radius for who in pair if who in self.cast.place]
        return min(radii, default=0.0) or 0.2


_LEVELS = {"DEBUG": "DEBUG", "INFO": "INFO", "WARNING": "WARN", "ERROR": "ERROR"}


def _line(entry: journal.Communication) -> str:
    late = f" after {(entry.time - entry.sent_time) / 1e9:g} s" if entry.time > entry.sent_time else ""
    why = f" ({entry.reason})" if entry.reason else ""
    says = f"  {json.dumps(entry.payload)}" if entry.payload is not None else ""
    time = f"{entry.time / 1e9:8.2f} s"
    return f"{time}  {entry.stage.lower()}{late}{why}  {entry.sender} -> {entry.receiver}  {entry.kind}{says}"[:300]


def _ring(centre: Array, size: float, age: int) -> Array:
    factor = next((factor for later, factor in reversed(_FLASH) if age >= later), 1.0)
    ring = circle(factor * size)
    flat: Array = centre + np.column_stack([ring, np.full(len(ring), 1.2 * size)])
    return flat
