"""Replays in Rerun: drawing a log chunk by chunk, to a file, a viewer, a browser, or a picture."""

from __future__ import annotations

import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.entry_points import Listing
from symaware_cli.log import Log, LogError, LogMessage, OutputError, first_difference, reason, whole_file
from symaware_cli.views.blueprint import ReplayContent, blueprint, content_of, content_with, scale_bar, scene_view
from symaware_cli.views.chunk import Chunk, ChunkReader
from symaware_cli.views.detail import Detail, detail_of
from symaware_cli.views.palette import DARK, SCENERY, ReplayTheme
from symaware_cli.views.rerun.output import RerunOutput
from symaware_cli.views.scene.drawing import Drawing
from symaware_cli.views.scene.marks import Bodies, Mark
from symaware_cli.views.scene.scene import Scene, installed_drawings, scene_of
from symaware_cli.views.views import RunView, run_view_of

if TYPE_CHECKING:
    import rerun as rr
    from rerun.experimental import View


@dataclass(frozen=True)
class OtherRun:
    """A run to show beside another one.

    Attributes:
        log: Its log.
        run_view: The run in the log.
        since: The first instant at which the logs differ [ns]; None if they do not.
    """

    log: Log
    run_view: RunView
    since: int | None

    @property
    def words(self) -> str:
        """A description of the recording and the shown part of it, for users."""
        if self.since is None:
            return f"{self.log.path.name} has the same messages"
        return f"in grey: {self.log.path.name}, different from {self.since / 1e9:.9g} s on"

    def draw(self, detail: Detail, output: RerunOutput, start: int | None, end: int | None) -> None:
        """Draw its bodies and trails, from the instant on at which the logs differ.

        Args:
            detail: The level of detail of the replay.
            output: The output to draw on.
            start: The first instant to show [ns].
            end: The instant at which to stop, exclusive [ns].
        """
        for marks in self.marks(detail, start, end):
            for mark in marks:
                output.show(mark)
            output.flush(whole=False)
        output.flush()

    def marks(self, detail: Detail, start: int | None, end: int | None) -> Iterator[list[Mark]]:
        """Yield the marks of its bodies and trails, in grey, chunk by chunk; see `draw`."""
        if self.since is None:
            return
        scene = scene_of(self.run_view, replace(detail, labels=False, focus=()), "beside")
        begin = max(self.since, start or 0)
        for chunk in scene.chunk_reader().chunks(self.log.messages(self._topics, start=begin, end=end)):
            found: list[Mark] = []
            scene.draw(chunk, lambda mark: found.append(_greyed(mark)))  # noqa: B023 # called before the next chunk
            yield found

    @property
    def _topics(self) -> list[str]:
        groups = self.run_view.group_views.values()
        return [topic for group in groups for topic in (group.state_topic, f"/world/{group.name}/pose")]


def other_run(log: Log, other: Log) -> OtherRun:
    """Prepare to show a run beside the one of another log.

    Args:
        log: The log that is replayed.
        other: The log to show beside it.

    Raises:
        LogError: It was not written by SymAware.
    """
    if other.foreign:
        raise LogError(f"{other.path} was not written by SymAware, so it cannot be shown beside {log.path}")
    first = first_difference(log, other)
    return OtherRun(other, run_view_of(other), None if first is None else first.time or 0)


def _greyed(mark: Mark) -> Mark:
    """Return a mark of the second run: in grey, and under a path of its own."""
    moved = replace(mark, path=mark.path.replace("world/", "other/", 1))
    if not isinstance(moved, Bodies):
        return replace(moved, colours=np.array(SCENERY, np.uint8))  # type: ignore[arg-type] # trails have colours
    # In the plane it lies below the bodies of the first run, which hide it where both are at the same place.
    below = np.array([0.0, 0.0, 0.0 if moved.spatial else -2.0 * moved.extent])
    colours = np.broadcast_to(np.array(SCENERY, np.uint8), moved.colours.shape)
    return replace(moved, colours=colours, positions=moved.positions + below, nosed=False)


#: Maximum size of the beginning of a Rerun file, including the blueprint [bytes].
_ROOM = 1 << 20

Progress = Callable[[int], None] | None


class Replay:
    """Draws a run for Rerun."""

    def __init__(self, run_view: RunView, scene: Scene, words: str, output: RerunOutput, beside: str = "") -> None:
        """Write the explanation of the replay.

        Args:
            run_view: The run to draw.
            scene: What draws it.
            words: A description of the level of detail.
            output: The output to draw on.
            beside: A description of a second run that is shown beside it; empty for none.
        """
        self._run_view, self._scene, self._output = run_view, scene, output
        self._explain(words, beside)

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
        for chunk in chunks_after(self.chunk_reader(), messages, start, earlier):
            self.draw_chunk(chunk, whole=False)
            if on_progress:
                on_progress(chunk.end)
        self._output.flush()

    def draw_chunk(self, chunk: Chunk, *, whole: bool = True) -> None:
        """Draw a chunk of the log; chunks must be ordered by time.

        Args:
            chunk: The chunk.
            whole: False if the next one follows at once, for which the last labels wait.
        """
        self._scene.draw(chunk, self._output.show)
        self._output.flush(whole=whole)

    def _explain(self, words: str, beside: str) -> None:
        run_view = self._run_view
        shown = [*self._scene.legend(), *([("another run", beside)] if beside else [])]
        rows = "".join(f"| {seen} | {meaning} |\n" for seen, meaning in shown)
        text = f"""# {run_view.name}

Seed {run_view.seed}. Time is simulated time.

**Shown:** {words}.

| | |
|---|---|
{rows}
In the tab of an agent, rings are its beliefs of others' positions, fainter with age; ellipses are their uncertainty, 95
%.
"""
        self._output.document("about", text)


def chunks_after(
    chunk_reader: ChunkReader, messages: Iterable[LogMessage], start: int, earlier: Iterable[LogMessage]
) -> Iterator[Chunk]:
    """Group messages into chunks, in which the last values before them are valid at the start [ns]."""
    for message in earlier:
        if message.channel.topic == "/events":
            chunk_reader.note(start, message.decode())  # only removals still matter
        else:
            chunk_reader.take(message.channel.topic, start, message.decode())
    yield from chunk_reader.chunks(messages)


@dataclass(frozen=True)
class ReplaySession:
    """The part of a log to show, and its level of detail.

    Attributes:
        log: The log.
        run_view: The run in the log.
        detail: The level of detail.
        start: The first instant [ns]; None for the beginning.
        end: The instant at which to stop, exclusive [ns]; None for the end.
        beside: A second run to show beside it.
        view: The name of the viewpoint of the scene; empty for the usual one.
        theme: The colours of the surroundings of agents.
    """

    log: Log
    run_view: RunView
    detail: Detail
    start: int | None = None
    end: int | None = None
    beside: OtherRun | None = None
    view: str = ""
    theme: ReplayTheme = DARK

    @property
    def words(self) -> str:
        """A description of the replay, for users."""
        return self.detail.words + (f"; {self.beside.words}" if self.beside else "")

    def save(self, path: Path, on_progress: Progress = None) -> None:
        """Write an .rrd file, including the blueprint.

        Raises:
            LogError: The file cannot be written; nothing is left behind.
        """
        with whole_file(path, self.log.path) as partial:
            self._write(partial, path, on_progress)

    def send(self, url: str, on_progress: Progress = None) -> rr.RecordingStream:
        """Send everything to a viewer; the recording must be kept as long as the viewer needs it.

        Raises:
            ViewerError: The viewer cannot be reached.
        """
        recording = self._recording()
        with _connection(url):
            recording.connect_grpc(url, default_blueprint=self._blueprint())
            self._draw(recording, on_progress)
        return recording

    def follow(self, url: str, wanted: Callable[[], bool]) -> rr.RecordingStream:
        """Send everything to a viewer while the log is still being written.

        Args:
            url: The URL of the viewer.
            wanted: Returns whether to continue; called whenever there are no new data.

        Raises:
            LogError: The log is damaged.
            ViewerError: The viewer cannot be reached.
        """
        from symaware_cli.views.following import FollowingAbandoned, follow

        recording = self._recording()
        with suppress(FollowingAbandoned), _connection(url):
            recording.connect_grpc(url, default_blueprint=self._blueprint())
            replay = self._replay(recording)
            follow(self.log.path, replay.chunk_reader(), replay.draw_chunk, wanted)
        return recording

    def picture(self, path: Path, moment: int | None, size: str, on_progress: Progress = None) -> list[View]:
        """Write a PNG of the view at an instant [ns], and return the views with their reports.

        Raises:
            LogError: The file cannot be written.
            ViewerError: The viewer failed.
        """
        from symaware_cli.views import viewer

        shown = self._middle() if moment is None else moment
        with tempfile.TemporaryDirectory() as folder, whole_file(path, self.log.path) as partial:
            recording = Path(folder) / "picture.rrd"
            self._write(recording, recording, on_progress)
            png, views = viewer.picture(recording, shown, size)
            partial.write_bytes(png)
        return views

    def _write(self, partial: Path, path: Path, on_progress: Progress) -> None:
        # Rerun does not report why it cannot write, and blocks if there is no space for the first bytes: reserve it.
        partial.write_bytes(bytes(_ROOM))
        recording = self._recording()
        try:
            recording.save(partial, default_blueprint=self._blueprint())
            self._draw(recording, on_progress)
            recording.flush()
            recording.disconnect()
        except RuntimeError as error:
            raise OutputError(f"cannot write {path}: {_why(partial) or error}") from error

    @property
    def span(self) -> tuple[int, int]:
        """The first and the last instant that are shown [ns]."""
        first, last = self.log.start_time or 0, self.log.end_time or 0
        start = first if self.start is None else max(first, self.start)
        return start, last if self.end is None else min(last, self.end - 1)

    @cached_property
    def content(self) -> ReplayContent:
        """The extent and the topics of the shown part of the log."""
        content = content_of(self.log, self.run_view, self.start, self.end)
        if self.beside is None:
            return content
        return content_with(content, content_of(self.beside.log, self.beside.run_view, self.start, self.end))

    def marks_by_chunk(self) -> Iterator[tuple[int, list[Mark]]]:
        """Yield all marks chunk by chunk, each time with the last instant of the chunk [ns]."""
        if self.beside is not None:
            for marks in self.beside.marks(self.detail, self.start, self.end):
                yield self.span[0] - 1, marks
        scene = Scene(self.run_view, self.detail, self._drawings)
        messages = self.log.messages(start=self.start, end=self.end)
        for chunk in chunks_after(scene.chunk_reader(), messages, self.start or 0, self._earlier()):
            found: list[Mark] = []
            scene.draw(chunk, found.append)
            yield chunk.end, found

    def _earlier(self) -> Iterable[LogMessage]:
        """Return the messages before the interval whose values may still be valid."""
        # Measurements and beliefs about others are renewed continuously; earlier ones are not needed.
        held = [topic for topic in self.log.topics if topic.count("/") == 3 and not topic.endswith("/awareness")]
        return self.log.messages([*held, "/contacts", "/events"], end=self.start or 0)

    def _draw(self, recording: rr.RecordingStream, on_progress: Progress) -> None:
        messages = self.log.messages(start=self.start, end=self.end)
        self._replay(recording).draw(messages, on_progress, start=self.start or 0, earlier=self._earlier())
        if self.beside is not None:
            self.beside.draw(self.detail, RerunOutput(recording, self.theme), self.start, self.end)

    def _replay(self, recording: rr.RecordingStream) -> Replay:
        beside = self.beside.words if self.beside else ""
        scene = Scene(self.run_view, self.detail, self._drawings)
        view = scene_view(self.run_view, self.content, self.view)
        output = RerunOutput(recording, self.theme, view)
        output.scale_bar("world/scale", *scale_bar(self.content, view))
        return Replay(self.run_view, scene, self.detail.words, output, beside)

    @cached_property
    def _drawings(self) -> Mapping[type[Drawing], Listing]:
        return installed_drawings("replay")

    def _recording(self) -> rr.RecordingStream:
        import rerun as rr

        # Rerun keeps one blueprint for each application.
        name = self.run_view.name
        recording = rr.RecordingStream(f"symaware {name}", recording_id=f"{name}-{uuid.uuid4()}")
        recording.send_recording_name(f"{name}, seed {self.run_view.seed}")
        return recording

    def _blueprint(self) -> Any:
        panels = [drawing.panel for drawing in self._drawings if drawing.panel]
        return blueprint(self.run_view, self.detail, self.content, panels, self.view, self.theme)

    def _middle(self) -> int:
        first = self.log.start_time or 0 if self.start is None else self.start
        last = self.log.end_time or 0 if self.end is None else self.end
        return (first + last) // 2


def replay_session(
    log: Log,
    agents: Sequence[str] = (),
    start: int | None = None,
    end: int | None = None,
    against: Log | None = None,
    view: str = "",
    theme: ReplayTheme = DARK,
) -> ReplaySession:
    """Create a replay session of a log.

    Args:
        log: A SymAware log.
        agents: The agents that have a tab; empty for as many as fit.
        start: The first instant [ns].
        end: The instant at which to stop, exclusive [ns].
        against: The log of a second run, to show beside it; None for none.
        view: The name of the viewpoint of the scene; empty for the usual one.
        theme: The colours of the surroundings of agents.

    Raises:
        LogError: A log is foreign, has no such agents, or has no messages in the interval.
    """
    run_view = run_view_of(log)
    detail = detail_of(run_view, agents)
    if next(log.messages(start=start, end=end), None) is None:
        where = "" if start is None and end is None else " in that interval"
        lost = f"; {log.damage}" if log.damage and log.damage.lost else ""
        raise LogError(f"{log.path} has nothing to show{where}{lost}")
    beside = None if against is None else other_run(log, against)
    return ReplaySession(log, run_view, detail, start, end, beside, view, theme)


@contextmanager
def _connection(url: str) -> Iterator[None]:
    """Convert errors of the connection to a viewer."""
    from symaware_cli.views.viewer import ViewerError, require_reachable

    require_reachable(url)
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise ViewerError(f"the viewer at {url} cannot be reached: {error}") from error


def _why(path: Path) -> str | None:
    """Return why a file cannot be extended; None if it can."""
    try:
        with open(path, "ab") as file:
            file.write(bytes(1 << 16))
    except OSError as error:
        return reason(error)
    return None
