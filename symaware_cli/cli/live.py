"""The live view of a run: a process of its own that follows the log, so that it can neither slow nor harm the run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def live_view(log: Path | None, connect: str | None) -> Iterator[Path]:
    """Show a log while it is written in the block; at its end wait until somebody closes the viewer.

    Args:
        log: Where the run is recorded; None if it is not to be kept.
        connect: A viewer that runs already; None to start one.

    Yields:
        Where to record the run.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = log or Path(folder) / "live.mcap"
        # Of an earlier run, which is replaced anyway; nobody shall follow that.
        path.unlink(missing_ok=True)
        command = [sys.executable, "-m", "symaware_cli", "replay", str(path), "--follow"]
        # Its output would get between the summary's lines; in a session of its own, as Ctrl-C is meant for the run.
        view = subprocess.Popen(
            [*command, "--connect", connect] if connect else command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            yield path
            if path.exists():
                view.wait()
        except KeyboardInterrupt:
            # The run is over; whoever presses Ctrl-C now is done with the view.
            return
        finally:
            if view.poll() is None:
                view.terminate()
                view.wait()
