"""The ends of the process itself: what a component must not bring about, and what a run resorts to."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from symaware_cli.recording.recorder import Recorder

_exit = os._exit

#: Wall time that a run is given to finish its log by whoever interrupts it again [s].
PATIENCE = 1.0

#: Wall time that a component is given after a time-out [s].
_GRACE = 5.0


class ExitError(BaseException):
    """Something called `os._exit`; not an `Exception`, so that the component does not swallow it."""

    def __init__(self, status: int) -> None:
        super().__init__(f"os._exit({status}) would end the process, and its log without an outcome")


#: How many runs are under way, in which process, and the lock that goes with the number.
_runs, _owner, _lock = 0, 0, threading.Lock()


@contextmanager
def exits_refused() -> Iterator[None]:
    """Make of `os._exit` an exception, so that a run fails and says whose fault that is.

    What native code does, or a function that was imported before (``from os import _exit``), is not kept from anything.
    Child processes end as ever: those of `multiprocessing` do so by this very function. Runs may overlap, in one thread
    or in several.
    """
    _count(1)
    try:
        yield
    finally:
        _count(-1)


def _count(more: int) -> None:
    global _runs, _owner
    with _lock:
        _runs += more
        if _runs == more:  # the first
            _owner = os.getpid()
            os._exit = _refuse
        elif not _runs:
            os._exit = _exit


def _refuse(status: int) -> NoReturn:
    if os.getpid() != _owner:
        _exit(status)
    raise ExitError(status)


def leave(status: int, words: str, recorder: Recorder | None = None) -> NoReturn:
    """End the process at once, from whatever thread; what was recorded is kept.

    Args:
        status: Its exit status.
        words: Why, for people.
        recorder: Whose log is to be kept.
    """
    if recorder:
        # Whoever is in the middle of writing may never come back.
        closing = threading.Thread(target=recorder.writer.abort, daemon=True)
        closing.start()
        closing.join(PATIENCE)
    sys.stderr.write(f"symaware: {words}\n")
    sys.stderr.flush()
    _exit(status)


@contextmanager
def deadline(timeout: float | None, recorder: Recorder | None) -> Iterator[None]:
    """End the process some time after a time-out, with what was recorded kept, unless the run has ended by then.

    An exception ends Python code only, and only when that is in the interpreter: a solver may hang.

    Args:
        timeout: Wall time from now on after which the run was to end [s]; None for never.
        recorder: Whose log is to be kept.
    """
    if timeout is None:
        yield
        return
    words = "the time is over, and a component does not answer; the log ends without an outcome"
    timer = threading.Timer(timeout + _GRACE, leave, (1, words, recorder))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
