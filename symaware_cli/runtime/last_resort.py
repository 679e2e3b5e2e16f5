"""The last resort against a component that lets a time-out pass without an answer, such as a solver that hangs."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from symaware_cli.recording.recorder import Recorder

#: Wall time that is given to it after the time-out [s].
_GRACE = 5.0

_LAST_WORDS = "symaware: the time is over, and a component does not answer; the log ends without an outcome\n"


@contextmanager
def last_resort(timeout: float | None, recorder: Recorder | None) -> Iterator[None]:
    """End the process some time after a time-out, with what was recorded kept, unless the run has ended by then.

    An exception ends Python code only, and only when that is in the interpreter.

    Args:
        timeout: Wall time from now on after which the run was to end [s]; None for never.
        recorder: Whose log is to be kept.
    """
    if timeout is None:
        yield
        return
    timer = threading.Timer(timeout + _GRACE, _give_up, (recorder,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _give_up(recorder: Recorder | None) -> None:
    if recorder:
        recorder.writer.abort()
    sys.stderr.write(_LAST_WORDS)
    sys.stderr.flush()
    os._exit(1)
