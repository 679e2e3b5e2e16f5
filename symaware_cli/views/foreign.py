"""Replays of MCAP files that other programs wrote, as far as Rerun supports their messages."""

from __future__ import annotations

import tempfile
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from symaware_cli.log import Log, LogError, recover, whole_file

if TYPE_CHECKING:
    import rerun as rr
    from rerun.experimental import View

#: The errors that Rerun raises.
_TROUBLE = (RuntimeError, ValueError, OSError)


@dataclass(frozen=True)
class ForeignReplaySession:
    """A replay of an MCAP file that SymAware did not write.

    Attributes:
        log: The log.
        words: A description of the view, for users.
    """

    log: Log
    words: str = "not written by SymAware: what Rerun knows of it by itself (foxglove.*, ROS 2 and protobuf messages)"

    def save(self, path: Path, on_progress: Callable[[int], None] | None = None) -> None:
        """Write an .rrd file.

        Raises:
            LogError: The file cannot be written, or Rerun cannot read the log.
        """
        del on_progress  # Rerun does not report progress.
        with whole_file(path, self.log.path) as partial, tempfile.TemporaryDirectory() as folder:
            try:
                self._convert(self.log.path, partial)
            except _TROUBLE:
                # Rerun needs the summary, which other writers may omit: make a copy with a complete one.
                whole = Path(folder) / self.log.path.name
                recover(self.log, whole)
                try:
                    self._convert(whole, partial)
                except _TROUBLE as error:
                    raise LogError(f"Rerun cannot read {self.log.path}: {error}") from error

    def _convert(self, source: Path, target: Path) -> None:
        from rerun.chunk import McapReader

        McapReader(str(source)).stream().write_rrd(
            str(target), application_id=f"symaware {self.log.path.name}", recording_id=str(uuid.uuid4())
        )

    def send(self, url: str, on_progress: Callable[[int], None] | None = None) -> rr.RecordingStream:
        """Send everything to a viewer; the recording must be kept as long as the viewer needs it."""
        import rerun as rr

        recording = rr.RecordingStream(f"symaware {self.log.path.name}", recording_id=str(uuid.uuid4()))
        recording.connect_grpc(url)
        recording.log_file_from_path(self.log.path)
        recording.flush()
        return recording

    def follow(self, url: str, wanted: Callable[[], bool]) -> rr.RecordingStream:
        """Raise an error: foreign logs cannot be followed.

        Raises:
            LogError: Always.
        """
        raise LogError(f"{self.log.path} was not written by SymAware; --follow cannot show it")

    def picture(
        self, path: Path, moment: int | None, size: str, on_progress: Callable[[int], None] | None = None
    ) -> list[View]:
        """Write a PNG of the view at an instant.

        Raises:
            LogError: The file cannot be written, or Rerun cannot read the log.
            ViewerError: The viewer failed.
        """
        from symaware_cli.views import viewer

        # Its times may be times of day, so the instant is relative to its beginning.
        instant = None if moment is None else (self.log.start_time or 0) + moment
        with tempfile.TemporaryDirectory() as folder, whole_file(path, self.log.path) as partial:
            recording = Path(folder) / "picture.rrd"
            self.save(recording, on_progress)
            png, views = viewer.picture(recording, instant, size, "message_log_time")
            partial.write_bytes(png)
        return views
