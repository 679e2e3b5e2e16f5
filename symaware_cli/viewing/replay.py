"""A replay: everything that a log tells, drawn chunk by chunk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from symaware_cli.recording.reader import Log, LogMessage
from symaware_cli.viewing.blueprint import ReplayContent
from symaware_cli.viewing.chunk import Chunk, ChunkReader
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.rerun.output import RerunOutput
from symaware_cli.viewing.scene.bars import legend
from symaware_cli.viewing.scene.scene import CURVES, SCENE, Scene
from symaware_cli.viewing.views import RunView, in_space

Array = NDArray[np.float64]

#: How many places of a log are looked at to find where everything is.
_SOUNDINGS = 9


class Replay:
    """Draws a run for Rerun."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput) -> None:
        """Put up what explains it.

        Args:
            run_view: Who takes part.
            detail: How much to show.
            output: Where to draw.
        """
        self._run_view, self._detail, self._output = run_view, detail, output
        self._scene = Scene(run_view, detail, (*SCENE, *CURVES))
        self._explain()

    def chunk_reader(self) -> ChunkReader:
        """What puts messages together to chunks for this replay."""
        return self._scene.chunk_reader()

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
        chunk_reader = self.chunk_reader()
        for message in earlier:
            if message.channel.topic == "/events":
                chunk_reader.note(start, message.decode())  # what happened is over
            else:
                chunk_reader.take(message.channel.topic, start, message.decode())
        for chunk in chunk_reader.chunks(messages):
            self.draw_chunk(chunk)
            if on_progress:
                on_progress(chunk.end)

    def draw_chunk(self, chunk: Chunk) -> None:
        """Draw a stretch of the log; in the order of time."""
        for mark in self._scene.marks(chunk):
            self._output.show(mark)
        self._output.flush()

    def _explain(self) -> None:
        run_view = self._run_view
        believed = [
            name
            for name, group_view in run_view.group_views.items()
            if not group_view.whereabouts.startswith("/world/")
        ]
        bodies = "where agents truly are" + (f" ({', '.join(believed)}: believe to be)" if believed else "")
        shared = "".join(
            f"| bars beside them | {part}, from left to right: {said} |\n" for part, said in legend(run_view)
        )
        text = f"""# {run_view.name}

Seed {run_view.seed}. Time is simulated time.

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
        self._output.document("about", text)


def content_of(log: Log, run_view: RunView, start: int | None = None, end: int | None = None) -> ReplayContent:
    """Find out what a log has, and where everything is, from a few looks at it.

    Args:
        log: One of ours.
        run_view: Who takes part in it.
        start: The first instant to be shown [ns].
        end: The first instant not to be shown any more [ns].
    """
    topics = frozenset(topic for topic, channel in log.topics.items() if channel.count)
    first = start if start is not None else log.start_time or 0
    last = min(end, log.end_time or 0) if end is not None else log.end_time or 0
    corners = [corner for obstacle_view in run_view.obstacle_views.values() for corner in obstacle_view.corners]
    group_views = {group_view.whereabouts: group_view for group_view in run_view.group_views.values()}
    for moment in np.linspace(first, last, _SOUNDINGS).astype(np.int64).tolist():
        for message in _sounding(log, group_views, moment, last):
            group_view = group_views[message.channel.topic]
            states = message.decode().values
            places = in_space(group_view.positions(states[np.isfinite(states).all(axis=1)]))
            if len(places):
                margin = group_view.radius + 0.5
                corners += [places.min(axis=0) - margin, places.max(axis=0) + margin]
    known = [corner for corner in corners if np.isfinite(corner).all()] or [np.full(3, -5.0), np.full(3, 5.0)]
    return ReplayContent(np.min(known, axis=0), np.max(known, axis=0), topics)


def _sounding(log: Log, topics: Collection[str], moment: int, last: int) -> list[LogMessage]:
    """The first message on each topic from a moment on, as far as it comes soon."""
    found: dict[str, LogMessage] = {}
    for message in islice(log.messages(topics, start=moment), 3 * len(topics)):
        if message.time <= last:
            found.setdefault(message.channel.topic, message)
        if len(found) == len(topics):
            break
    return list(found.values())
