"""The live view of a run: a separate process that follows the log, so that it cannot affect the run."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path


class LiveView:
    """A viewer that shows a log while it is written.

    Attributes:
        path: Where to record the run.
    """

    def __init__(self, log: Path | None, connect: str | None) -> None:
        """Start the view.

        Args:
            log: The path of the log; None for a temporary log that is kept only as long as the view.
            connect: The URL of a running viewer; None to start one.

        Raises:
            LogError: There is no viewer.
        """
        from symaware_cli.views.viewer import require

        require()
        folder = None if log else tempfile.mkdtemp()
        self.path = log or Path(str(folder)) / "live.mcap"
        # The log of an earlier run, which is replaced anyway, must not be followed.
        self.path.unlink(missing_ok=True)
        command = [sys.executable, "-m", "symaware_cli", "replay", str(self.path), "--follow"]
        # Its output is suppressed. It has its own session, because Ctrl-C is meant for the run.
        self._process = subprocess.Popen(
            [*command, "--connect", connect] if connect else command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._end = weakref.finalize(self, _end, self._process, folder)

    def wait(self) -> None:
        """Wait until the viewer is closed."""
        if self.path.exists():
            self._process.wait()

    def close(self) -> None:
        """Close the view; it also ends with this process."""
        self._end()


def _end(process: subprocess.Popen[bytes], folder: str | None) -> None:
    if process.poll() is None:
        process.terminate()
        process.wait()
    if folder:
        shutil.rmtree(folder, ignore_errors=True)
