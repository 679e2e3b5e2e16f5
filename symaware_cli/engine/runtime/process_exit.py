"""Ends of the process: components are kept from `os._exit`, and a run that hangs is ended with its log saved."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from symaware_cli.engine.runtime.recording import RunRecording

_exit = os._exit

#: Wall time that a run has to finish its log after a second signal [s].
PATIENCE = 1.0

#: Wall time that a component has to return after a time-out [s].
_GRACE = 5.0


class ExitError(BaseException):
    """A component called `os._exit`; not an `Exception`, so that the component does not swallow it."""

    def __init__(self, status: int) -> None:
        super().__init__(f"os._exit({status}) would end the process, and its log without an outcome")


#: The number of active runs, their process, and the lock of both.
_runs, _owner, _lock = 0, 0, threading.Lock()


class ExitsRefused:
    """A context in which `os._exit` is a function that raises, so that the run fails and names the component at fault.

    Exits by native code, or by a function imported before (``from os import _exit``), are not prevented. Child
    processes end as usual: those of `multiprocessing` call this very function. Runs may overlap, in one thread or in
    several.
    """

    def __enter__(self) -> None:
        _count(1)

    def __exit__(self, *error: object) -> None:
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


def end_process(status: int, words: str, recorder: RunRecording | None = None) -> NoReturn:
    """End the process at once, from any thread; the records written so far are kept.

    Args:
        status: The exit status.
        words: The reason, for standard error.
        recorder: The recorder of the log, if there is one.
    """
    if recorder:
        # The thread that is writing may never return, so closing has a time limit.
        closing = threading.Thread(target=recorder.abort, daemon=True)
        closing.start()
        closing.join(PATIENCE)
    sys.stderr.write(f"symaware: {words}\n")
    sys.stderr.flush()
    _exit(status)


def deadline(timeout: float | None, recorder: RunRecording | None) -> AbstractContextManager[None]:
    """End the process some time after a time-out if the run has not ended by then; the log is kept.

    An exception cannot end native code: a solver may hang.

    Args:
        timeout: Wall time from now after which the run should end [s]; None for no limit.
        recorder: The recorder of the log, if there is one.
    """
    return nullcontext() if timeout is None else _deadline(timeout, recorder)


@contextmanager
def _deadline(timeout: float, recorder: RunRecording | None) -> Iterator[None]:
    words = "the time is over, and a component does not answer; the log ends without an outcome"
    timer = threading.Timer(timeout + _GRACE, end_process, (1, words, recorder))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
