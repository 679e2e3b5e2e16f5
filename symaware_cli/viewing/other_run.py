"""Draws a second run into a replay: grey bodies and trails, from the instant on at which the two differ."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from symaware_cli.recording.error import LogError
from symaware_cli.recording.log_comparison import first_difference
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.detail import Detail
from symaware_cli.viewing.palette import SCENERY
from symaware_cli.viewing.rerun.output import RerunOutput
from symaware_cli.viewing.scene.bodies import Agents
from symaware_cli.viewing.scene.marks import Bodies, Mark
from symaware_cli.viewing.scene.scene import Scene
from symaware_cli.viewing.scene.trails import Trails
from symaware_cli.viewing.views import RunView, run_view_of


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
        """A description of what is shown of it, for users."""
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
        if self.since is None:
            return
        scene = Scene(self.run_view, replace(detail, labels=False, focus=()), (Agents, Trails))
        begin = max(self.since, start or 0)
        for chunk in scene.chunk_reader().chunks(self.log.messages(self._topics, start=begin, end=end)):
            for mark in scene.marks(chunk):
                output.show(_greyed(mark))
            output.flush()

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
