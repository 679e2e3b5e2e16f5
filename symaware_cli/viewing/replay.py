"""Draws a replay in Rerun, chunk by chunk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness.signal import Drawn
from symaware_cli.recording.reader import Log, LogMessage
from symaware_cli.viewing.blueprint import ReplayContent
from symaware_cli.viewing.chunk import Chunk, ChunkReader
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.outline import outlines
from symaware_cli.viewing.rerun.output import RerunOutput
from symaware_cli.viewing.scene import bars
from symaware_cli.viewing.scene.regions_drawing import region_pieces
from symaware_cli.viewing.scene.scene import CURVES, SCENE, Scene
from symaware_cli.viewing.views import RunView, in_space

Array = NDArray[np.float64]

#: Number of instants at which positions are read to determine the extent of a log.
_SAMPLES = 9


class Replay:
    """Draws a run for Rerun."""

    def __init__(self, run_view: RunView, detail: Detail, output: RerunOutput, beside: str = "") -> None:
        """Write the explanation of the replay.

        Args:
            run_view: The run to draw.
            detail: The level of detail.
            output: The output to draw on.
            beside: A description of a second run that is shown beside it; empty for none.
        """
        self._run_view, self._detail, self._output = run_view, detail, output
        self._scene = Scene(run_view, detail, (*SCENE, *CURVES))
        self._explain(beside)

    def chunk_reader(self) -> ChunkReader:
        """Create a reader that groups messages into chunks for this replay."""
        return self._scene.chunk_reader()

    def draw(
        self,
        messages: Iterable[LogMessage],
        on_progress: Callable[[int], None] | None = None,
        *,
        start: int = 0,
        earlier: Iterable[LogMessage] = (),
    ) -> None:
        """Draw messages, ordered by time.

        Args:
            messages: Messages of a SymAware log.
            on_progress: Called at intervals with simulated time [ns].
            start: The time at which they begin [ns].
            earlier: The preceding messages; their last values are valid at the start.
        """
        chunk_reader = self.chunk_reader()
        for message in earlier:
            if message.channel.topic == "/events":
                chunk_reader.note(start, message.decode())  # only removals still matter
            else:
                chunk_reader.take(message.channel.topic, start, message.decode())
        for chunk in chunk_reader.chunks(messages):
            self.draw_chunk(chunk)
            if on_progress:
                on_progress(chunk.end)

    def draw_chunk(self, chunk: Chunk) -> None:
        """Draw a chunk of the log; chunks must be ordered by time."""
        for mark in self._scene.marks(chunk):
            self._output.show(mark)
        self._output.flush()

    def _explain(self, beside: str) -> None:
        run_view = self._run_view
        believed = [
            name
            for name, group_view in run_view.group_views.items()
            if not group_view.state_topic.startswith("/world/")
        ]
        bodies = "true positions of agents" + (f" ({', '.join(believed)}: believed)" if believed else "")
        kinds = [
            f"| bars beside agents | {name}, from left to right: {meaning} |" for name, meaning in bars.legend(run_view)
        ]
        words: dict[Drawn, str] = {"links": "arrows between agents", "boxes": "outlines on the ground"}
        for how, drawn in words.items():
            kinds += [f"| {drawn} | {name}: {meaning} |" for name, meaning in run_view.described(how).items()]
        if run_view.windows:
            kinds.append("| areas | filled while a specification about them counts; dashed before, faint after |")
        if beside:
            kinds.append(f"| another run | {beside} |")
        shared = "".join(f"{kind}\n" for kind in kinds)
        text = f"""# {run_view.name}

Seed {run_view.seed}. Time is simulated time.

**Shown:** {self._detail.words}.

| | |
|---|---|
| bodies | {bodies}; redder with risk |
| lines behind | past positions |
| fading lines ahead | intents |
| ellipses | uncertainty of the position, 95 % |
| thin fans | samples of the future |
{shared}| crosses | goals and waypoints |
| red rings | contacts |
| fine points | ends of lidar rays, and points found by other sensors |
| yellow arrows | messages at delivery |
| red lines that end at a cross | lost messages |
| yellow dots | agents that received a spreading message |

In the tab of an agent, rings are its beliefs of others' positions, fainter with age; ellipses are their uncertainty, 95
%.
"""
        self._output.document("about", text)


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
    known = [corner for corner in corners if np.isfinite(corner).all()] or [np.full(3, -5.0), np.full(3, 5.0)]
    low, high = np.min(known, axis=0), np.max(known, axis=0)
    # A region far larger than the run would make everything in it too small to see.
    reach = float(np.max(high - low))
    shown = [np.clip(corner, low[:2] - reach, high[:2] + reach) for corner in _region_corners(run_view)]
    known += [np.append(corner, low[2]) for corner in shown]
    return ReplayContent(np.min(known, axis=0), np.max(known, axis=0), topics)


def content_with(content: ReplayContent, other: ReplayContent) -> ReplayContent:
    """Extend the extent of a log to that of another one shown beside it."""
    return replace(content, low=np.minimum(content.low, other.low), high=np.maximum(content.high, other.high))


def _region_corners(run_view: RunView) -> Iterator[Array]:
    """Yield two corners of the box around each piece of the regions that do not move; (2,) each [m]."""
    for region in run_view.regions.values():
        for outline in outlines(region_pieces(region, run_view.regions)) if region.around is None else ():
            yield outline.min(axis=0)
            yield outline.max(axis=0)


def _sample(log: Log, topics: Collection[str], moment: int, last: int) -> list[LogMessage]:
    """Return the first message on each topic soon after an instant, if there is one."""
    found: dict[str, LogMessage] = {}
    for message in islice(log.messages(topics, start=moment), 3 * len(topics)):
        if message.time <= last:
            found.setdefault(message.channel.topic, message)
        if len(found) == len(topics):
            break
    return list(found.values())
