"""Sessions of replaying a log: into a file, a viewer on the screen, a browser, or a picture."""

from __future__ import annotations

import tempfile
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.recording.error import LogError, OutputError, reason
from symaware_cli.recording.output import whole_file
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.blueprint import blueprint
from symaware_cli.viewing.detail import Detail, detail_of
from symaware_cli.viewing.replay import Replay, content_of
from symaware_cli.viewing.rerun.output import RerunOutput
from symaware_cli.viewing.views import RunView, run_view_of

if TYPE_CHECKING:
    import rerun as rr
    from rerun.experimental import View

#: What a file of Rerun's begins with, blueprint and all, is smaller than this [bytes].
_ROOM = 1 << 20

Progress = Callable[[int], None] | None


@dataclass(frozen=True)
class ReplaySession:
    """What of a log is to be shown, and how closely.

    Attributes:
        log: The log.
        run_view: Who takes part in it.
        detail: How much to show.
        start: The first instant [ns]; None for the beginning.
        end: The first instant not shown any more [ns]; None for the end.
    """

    log: Log
    run_view: RunView
    detail: Detail
    start: int | None = None
    end: int | None = None

    @property
    def words(self) -> str:
        """What is shown, for people."""
        return self.detail.words

    def save(self, path: Path, on_progress: Progress = None) -> None:
        """Write an .rrd file, blueprint inside.

        Raises:
            LogError: It cannot be written; nothing is left of it.
        """
        with whole_file(path, self.log.path) as partial:
            self._write(partial, path, on_progress)

    def send(self, url: str, on_progress: Progress = None) -> rr.RecordingStream:
        """Send everything to a viewer; the recording must be kept for as long as the viewer is to have it.

        Raises:
            ViewerError: The viewer cannot be reached, or not any more.
        """
        recording = self._recording()
        with _connection(url):
            recording.connect_grpc(url, default_blueprint=self._blueprint())
            self._draw(recording, on_progress)
        return recording

    def follow(self, url: str, wanted: Callable[[], bool]) -> rr.RecordingStream:
        """Send everything to a viewer while the log is still being written.

        Args:
            url: Of the viewer.
            wanted: Whether to go on; asked whenever there is nothing new.

        Raises:
            LogError: The log is damaged.
            ViewerError: The viewer cannot be reached, or not any more.
        """
        from symaware_cli.viewing.following import FollowingAbandoned, follow

        recording = self._recording()
        with suppress(FollowingAbandoned), _connection(url):
            recording.connect_grpc(url, default_blueprint=self._blueprint())
            follow(self.log.path, self._replay(recording), wanted)
        return recording

    def picture(self, path: Path, moment: int | None, size: str, on_progress: Progress = None) -> list[View]:
        """Write a PNG of what the viewer shows at an instant [ns], and return the views with what they report.

        Raises:
            LogError: It cannot be written.
            ViewerError: The viewer failed.
        """
        from symaware_cli.viewing import viewer

        shown = self._middle() if moment is None else moment
        with tempfile.TemporaryDirectory() as folder, whole_file(path, self.log.path) as partial:
            recording = Path(folder) / "picture.rrd"
            self._write(recording, recording, on_progress)
            png, views = viewer.picture(recording, shown, size)
            partial.write_bytes(png)
        return views

    def _write(self, partial: Path, path: Path, on_progress: Progress) -> None:
        # Rerun does not say why it cannot write, and waits for ever where there is no room for its first words.
        partial.write_bytes(bytes(_ROOM))
        recording = self._recording()
        try:
            recording.save(partial, default_blueprint=self._blueprint())
            self._draw(recording, on_progress)
            recording.flush()
            recording.disconnect()
        except RuntimeError as error:
            raise OutputError(f"cannot write {path}: {_why(partial) or error}") from error

    def _draw(self, recording: rr.RecordingStream, on_progress: Progress) -> None:
        # What was measured and what was believed of others is renewed all the time; what happened before is over.
        held = [topic for topic in self.log.topics if topic.count("/") == 3 and not topic.endswith("/awareness")]
        self._replay(recording).draw(
            self.log.messages(start=self.start, end=self.end),
            on_progress,
            start=self.start or 0,
            earlier=self.log.messages([*held, "/contacts", "/events"], end=self.start or 0),
        )

    def _replay(self, recording: rr.RecordingStream) -> Replay:
        return Replay(self.run_view, self.detail, RerunOutput(recording))

    def _recording(self) -> rr.RecordingStream:
        import rerun as rr

        # Rerun keeps one blueprint for each application.
        name = self.run_view.name
        recording = rr.RecordingStream(f"symaware {name}", recording_id=f"{name}-{uuid.uuid4()}")
        recording.send_recording_name(f"{name}, seed {self.run_view.seed}")
        return recording

    def _blueprint(self) -> Any:
        return blueprint(self.run_view, self.detail, content_of(self.log, self.run_view, self.start, self.end))

    def _middle(self) -> int:
        first = self.log.start_time or 0 if self.start is None else self.start
        last = self.log.end_time or 0 if self.end is None else self.end
        return (first + last) // 2


def replay_session(
    log: Log, agents: Sequence[str] = (), start: int | None = None, end: int | None = None
) -> ReplaySession:
    """Choose what of a log to show.

    Args:
        log: One of ours.
        agents: Whom to look at closely; empty for as many as fit.
        start: The first instant [ns].
        end: The first instant not to be shown any more [ns].

    Raises:
        LogError: It is not one of ours, has no such agents, or has nothing in that stretch.
    """
    run_view = run_view_of(log)
    detail = detail_of(run_view, agents)
    if next(log.messages(start=start, end=end), None) is None:
        where = "" if start is None and end is None else " in that stretch"
        lost = f"; {log.damage}" if log.damage and log.damage.lost else ""
        raise LogError(f"{log.path} has nothing to show{where}{lost}")
    return ReplaySession(log, run_view, detail, start, end)


@contextmanager
def _connection(url: str) -> Iterator[None]:
    """Say in our words that a viewer cannot be reached, or not any more."""
    from symaware_cli.viewing.viewer import ViewerError, require_reachable

    require_reachable(url)
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise ViewerError(f"the viewer at {url} cannot be reached: {error}") from error


def _why(path: Path) -> str | None:
    """Why nothing more can be written to a file; None if it can."""
    try:
        with open(path, "ab") as file:
            file.write(bytes(1 << 16))
    except OSError as error:
        return reason(error)
    return None
