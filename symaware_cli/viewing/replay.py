"""A replay: everything that a log tells, drawn excerpt by excerpt."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording.reader import Log, LogMessage
from symaware_cli.viewing.blueprint import Content
from symaware_cli.viewing.cast import Cast, in_space
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.drawing.bars import Bars, legend
from symaware_cli.viewing.drawing.base import Drawing
from symaware_cli.viewing.drawing.bodies import Bodies, Trails
from symaware_cli.viewing.drawing.contacts import Contacts
from symaware_cli.viewing.drawing.curves import Awareness, Risks, Separation
from symaware_cli.viewing.drawing.figures import Figures
from symaware_cli.viewing.drawing.goals import Goals
from symaware_cli.viewing.drawing.informed import Informed
from symaware_cli.viewing.drawing.journal import Events, Knowledge
from symaware_cli.viewing.drawing.messages import Messages
from symaware_cli.viewing.drawing.minds import Intents, Uncertainties
from symaware_cli.viewing.drawing.others import Others
from symaware_cli.viewing.drawing.points import Points
from symaware_cli.viewing.drawing.scenery import Scenery
from symaware_cli.viewing.drawing.sensors import Images, Scans
from symaware_cli.viewing.excerpt import Excerpt, Gathering
from symaware_cli.viewing.stage import Stage

Array = NDArray[np.float64]

#: How many places of a log are looked at to find where everything is.
_SOUNDINGS = 9


class Replay:
    """Draws a run onto a stage."""

    def __init__(
        self,
        cast: Cast,
        detail: Detail,
        stage: Stage,
        columns: Mapping[str, Sequence[str]],
        units: Mapping[str, Sequence[str]],
    ) -> None:
        """Put up what holds for all times.

        Args:
            cast: Who takes part.
            detail: How much to show.
            stage: Where to draw.
            columns: The names of the columns of each topic.
            units: Their units.
        """
        self._cast, self._detail, self._stage = cast, detail, stage
        given = (cast, detail, stage)
        self._drawings: tuple[Drawing, ...] = (
            Scenery(*given),
            Figures(*given),
            Goals(*given),
            Bodies(*given),
            Trails(*given),
            Intents(*given),
            Uncertainties(*given),
            Others(*given),
            Bars(*given),
            Points(*given),
            Scans(*given),
            Images(*given),
            Messages(*given),
            Informed(*given),
            Contacts(*given),
            Events(*given),
            Knowledge(*given),
            Risks(*given),
            Separation(*given),
            Awareness(*given, columns, units),
        )
        for drawing in self._drawings:
            drawing.begin()
        self._explain()

    def gathering(self) -> Gathering:
        """What puts messages together to excerpts for this replay."""
        counts = {
            topic: len(troupe.agents)
            for troupe in self._cast.troupes.values()
            for topic in (
                *(f"/world/{troupe.name}/{field}" for field in _TRUTHS),
                f"/agents/{troupe.name}/control",
                *map(troupe.topic, troupe.signals),
            )
        }
        return Gathering(counts, self._cast.place)

    def draw(
        self,
        messages: Iterable[LogMessage],
        on_progress: Callable[[int], None] | None = None,
        *,
        start: int = 0,
        earlier: Iterable[LogMessage] = (),
    ) -> None:
        """Draw messages, which come in the order of time.

        Args:
            messages: Of a log of ours.
            on_progress: Called now and then with simulated time [ns].
            start: Where they begin [ns].
            earlier: Those before. What they say last holds at the start.
        """
        gathering = self.gathering()
        for message in earlier:
            if message.channel.topic == "/events":
                gathering.note(start, message.decode())  # what happened is over
            else:
                gathering.take(message.channel.topic, start, message.decode())
        for excerpt in gathering.excerpts(messages):
            self.draw_excerpt(excerpt)
            if on_progress:
                on_progress(excerpt.end)

    def draw_excerpt(self, excerpt: Excerpt) -> None:
        """Draw a stretch of the log; in the order of time."""
        for drawing in self._drawings:
            drawing.draw(excerpt)
        self._stage.flush()

    def _explain(self) -> None:
        import rerun as rr

        cast = self._cast
        believed = [name for name, troupe in cast.troupes.items() if not troupe.whereabouts.startswith("/world/")]
        bodies = "where agents truly are" + (f" ({', '.join(believed)}: believe to be)" if believed else "")
        shared = "".join(f"| bars beside them | {part}, from left to right: {said} |\n" for part, said in legend(cast))
        text = f"""# {cast.name}

Seed {cast.seed}. Time is simulated time.

**Shown:** {self._detail.words}.

| | |
|---|---|
| bodies | {bodies}; redder with risk |
| lines behind | where they came from |
| fading lines ahead | their intents |
| ellipses | 95 % of where they may be |
| thin fans | samples of what may happen |
{shared}| crosses | goals and waypoints |
| red rings | contacts |
| fine points | where the rays of lidars end, and what other sensors found |
| yellow arrows | messages as they arrive |
| red lines that break off at a cross | messages that were lost |
| yellow dots | who was told what goes around |

In the tab of an agent, rings stand where it believes others to be, fainter the older the belief; ellipses hold 95 %.
"""
        self._stage.static("about", rr.TextDocument(text, media_type="text/markdown"))


_TRUTHS = ("state", "control", "pose", "joints")


def content_of(log: Log, cast: Cast, start: int | None = None, end: int | None = None) -> Content:
    """Find out what a log has, and where everything is, from a few looks at it.

    Args:
        log: One of ours.
        cast: Who takes part in it.
        start: The first instant to be shown [ns].
        end: The first instant not to be shown any more [ns].
    """
    topics = frozenset(topic for topic, channel in log.topics.items() if channel.count)
    first = start if start is not None else log.start_time or 0
    last = min(end, log.end_time or 0) if end is not None else log.end_time or 0
    corners = [corner for prop in cast.props.values() for corner in prop.corners]
    troupes = {troupe.whereabouts: troupe for troupe in cast.troupes.values()}
    for moment in np.linspace(first, last, _SOUNDINGS).astype(np.int64).tolist():
        for message in _sounding(log, troupes, moment, last):
            troupe = troupes[message.channel.topic]
            states = message.decode().values
            places = in_space(troupe.positions(states[np.isfinite(states).all(axis=1)]))
            if len(places):
                margin = troupe.radius + 0.5
                corners += [places.min(axis=0) - margin, places.max(axis=0) + margin]
    known = [corner for corner in corners if np.isfinite(corner).all()] or [np.full(3, -5.0), np.full(3, 5.0)]
    return Content(np.min(known, axis=0), np.max(known, axis=0), topics, names_of(log, "units"))


def _sounding(log: Log, topics: Collection[str], moment: int, last: int) -> list[LogMessage]:
    """The first message on each topic from a moment on, as far as it comes soon."""
    found: dict[str, LogMessage] = {}
    for message in islice(log.messages(topics, start=moment), 3 * len(topics)):
        if message.time <= last:
            found.setdefault(message.channel.topic, message)
        if len(found) == len(topics):
            break
    return list(found.values())


def names_of(log: Log, key: str) -> dict[str, tuple[str, ...]]:
    """The ``columns`` or ``units`` of each topic."""
    return {
        topic: tuple(channel.metadata[key].split(","))
        for topic, channel in log.topics.items()
        if channel.metadata.get(key)
    }
