"""Interfaces of recorders of runs, such as the recorder of logs.

Reasons: docs/decisions/0073-rooms.md
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from symaware_cli.world import UserError

if TYPE_CHECKING:
    from symaware_cli.core import Event, EventBus
    from symaware_cli.specification import SpecificationMonitor

#: How well a pace is kept: see `symaware_cli.log.writer.LogWriter.add_timing`.
PaceFigures = tuple[float, int, int, float]


class RecordingError(UserError):
    """A file of a run cannot be written. The message is a sentence for users that names the file."""


class SpecificationRecording(Protocol):
    """Records the states of specifications."""

    def record(self, monitor: SpecificationMonitor, now: int) -> None:
        """Record the changes of a specification; times are in nanoseconds."""


class RunRecording(Protocol):
    """Records a run.

    Attributes:
        updates: Number of rows of awareness, control and knowledge recorded so far.
        pace: Returns figures of how well the pace is kept; None without a pace.
    """

    updates: int
    pace: Callable[[], PaceFigures] | None

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def size(self) -> int:
        """Its size so far [bytes]."""

    def record(self, now: int, steps: int) -> None:
        """Record the changes; the time is in nanoseconds.

        Raises:
            RecordingError: The file cannot be written.
        """

    def follow(
        self,
        events: EventBus,
        shielded: Callable[[Callable[[Event], Any]], Callable[[Event], None]],
        elsewhere: object | None = None,
    ) -> None:
        """Record the events of a run; see `symaware_cli.log.recorder.Recorder.follow`."""

    def specifications(self, monitors: Iterable[SpecificationMonitor]) -> SpecificationRecording:
        """Return the recorder of specifications."""

    def finish(self, now: int, steps: int, outcome: Mapping[str, Any]) -> None:
        """Finish the file.

        Raises:
            RecordingError: It cannot be written.
        """

    def abort(self) -> None:
        """Close the file without an outcome, from any thread: the process is about to end."""
