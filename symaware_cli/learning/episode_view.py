"""Episodes in the Rerun viewer while they are made, in real time at most.

Each episode has a temporary log, which a separate process follows and sends to the viewer, as for `symaware run
--live`. So the viewer cannot affect an episode.

Reasons: docs/decisions/0103-windows-of-episodes.md
"""

from __future__ import annotations

import time
import weakref
from contextlib import ExitStack
from pathlib import Path

from symaware_cli.api import LiveView
from symaware_cli.views.viewer import Viewer, require, viewer


class EpisodeView:
    """Shows the episodes of an environment, each as a separate recording."""

    def __init__(self, connect: str | None = None) -> None:
        """Prepare; the viewer is started with the first episode.

        Args:
            connect: The URL of a running viewer; None to start one.

        Raises:
            LogError: Rerun is not installed, or has an unsupported version.
        """
        require()
        self._url = connect
        self._viewer: Viewer | None = None
        self._shown: list[LiveView] = []
        self._due = 0.0
        self._stack = ExitStack()
        self._end = weakref.finalize(self, self._stack.close)

    def begin(self) -> Path | None:
        """Return the path at which to record the next episode; None if the viewer was closed.

        Raises:
            ViewerError: The viewer does not start.
        """
        if self._url is None:
            self._viewer = self._stack.enter_context(viewer())
            self._url = self._viewer.url
        if self._viewer is not None and self._viewer.closed:
            return None
        # The end of the last episode may not have been sent yet.
        while len(self._shown) > 1:
            self._finish(self._shown.pop(0))
        self._shown.append(LiveView(None, self._url))
        self._due = time.monotonic()
        return self._shown[-1].path

    def wait(self, time_step: float) -> None:
        """Wait until a step is over in real time.

        Args:
            time_step: The time step of the world [s].
        """
        now = time.monotonic()
        self._due = max(self._due + time_step, now)
        time.sleep(self._due - now)

    def close(self) -> None:
        """Send the remaining messages, and end the viewer if it was started here."""
        while self._shown:
            self._finish(self._shown.pop())
        self._end()

    def _finish(self, shown: LiveView) -> None:
        if self._viewer is None or not self._viewer.closed:
            shown.wait()
        shown.close()
