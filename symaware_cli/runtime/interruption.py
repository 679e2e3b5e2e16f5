"""Ctrl-C, its relatives and limits of wall time: they end a run between two records, never within one."""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]
import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection
from types import FrameType, TracebackType
from typing import Any, ClassVar, NoReturn

from symaware_cli.core import Event
from symaware_cli.runtime.process_exit import PATIENCE

#: Signals that follow each other within this are one: some programs pass on what their process group has got [s].
_TWICE = 0.1

#: What ends a run.
_SIGNALS = int(signal.SIGINT), int(signal.SIGTERM)


class Interrupted(BaseException):
    """Somebody or something asked the run to end; not an `Exception`, so that no component swallows it.

    Attributes:
        number: The signal that did; None for what is no signal.
    """

    def __init__(self, cause: str, number: int | None = None) -> None:
        super().__init__(cause)
        self.number = number


class OverdueError(BaseException):
    """A turn takes more wall time than it may; not an `Exception`, so that the component does not swallow it."""

    def __init__(self, limit: float) -> None:
        super().__init__(f"it did not come back within {limit:g} s of wall time")


class Interruption:
    """Turns SIGINT and SIGTERM into `Interrupted` while a run lasts, and the end of its wall time.

    Where nothing may be left half done, `shield` holds the signal back and `unshield` delivers it. Who interrupts a
    second time gives the run a second to finish its log; then the process ends. Where native code keeps the interpreter
    from hearing of a Ctrl-C at all, the operating system ends the process at the next one. A process that is not the
    run's own is not ended: there, a second signal is delivered wherever the run is, and the next one is not held back.

    The context may be entered again and again. In other threads than the main one no signals are handled, and turns
    have no limit.
    """

    #: It belongs to the process.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self,
        timeout: float | None = None,
        turn_limit: float | None = None,
        give_up: Callable[[], object] | None = None,
    ) -> None:
        """Prepare; entering the context begins.

        Args:
            timeout: Wall time after which the run is interrupted [s].
            turn_limit: Wall time after which what was let through with one `unshield` is ended by `OverdueError` [s].
            give_up: Ends the process; called, from another thread, if the run does not end after a second signal. None
                if the process is not to be ended.
        """
        self._shielded = False
        self._pending: Interrupted | None = None
        self._count = 0
        self._first = 0.0
        self._give_up = give_up
        self._patience: threading.Timer | None = None
        self._expiry: threading.Timer | None = None
        self._previous: dict[int, Any] = {}
        self._timeout = timeout
        self._turn_limit = turn_limit
        self._deadline: float | None = None
        #: Counts what is let through, for the alarm to see whether it still is the same.
        self._serial = 0
        self._watched = True
        self._seen = (0, 0.0)

    def __enter__(self) -> Interruption:
        # Only the main thread may handle signals; elsewhere whoever runs us decides.
        if threading.current_thread() is threading.main_thread():
            # What `signal.signal` itself calls: its enumerations take 20 us, and this may happen with every step.
            for number in _SIGNALS:
                self._previous[number] = _signal.signal(number, self._handle)
            if self._give_up:
                _hear_once(signal.SIGINT)
            if self._timeout is not None or self._turn_limit is not None:
                self._set_alarm()
        elif self._timeout is not None:
            self._expiry = threading.Timer(self._timeout, self._expire)
            self._expiry.daemon = True
            self._expiry.start()
        return self

    def _set_alarm(self) -> None:
        now = time.monotonic()
        self._seen = (-1, now)
        intervals = [] if self._turn_limit is None else [self._turn_limit / 4]
        if self._timeout is not None:
            self._deadline = now + self._timeout
            intervals.append(max(self._timeout, 1e-3))
        self._previous[signal.SIGALRM] = _signal.signal(signal.SIGALRM, self._on_alarm)
        signal.setitimer(signal.ITIMER_REAL, min(intervals), min([*intervals, 1.0]))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for timer in (self._patience, self._expiry):
            if timer:
                timer.cancel()
        self._give_back()

    def _give_back(self) -> None:
        """Let signals be handled as before."""
        if signal.SIGALRM in self._previous:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        while self._previous:
            number, handler = self._previous.popitem()
            # What was not installed from Python cannot be put back.
            _signal.signal(number, _signal.SIG_DFL if handler is None else handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        self._count += 1
        if self._count == 1:
            self._first = now
        elif self._patience is None and now - self._first > _TWICE:
            self._insist()
        if number == signal.SIGINT and self._give_up and self._patience is None:
            signal.signal(number, self._handle)
            _hear_once(number)
        # Also where it is raised at once: a component that swallows it is interrupted after its turn.
        self._pending = Interrupted(signal.Signals(number).name, number)
        if not self._shielded:
            self._raise(self._pending)

    def _raise(self, interrupted: Interrupted) -> NoReturn:
        """Deliver a signal, and hold back others until the next `unshield`: who ends the run is not to be disturbed."""
        self._shielded = True
        raise interrupted

    def _insist(self) -> None:
        """Somebody interrupts again: the run has a little time to end, and none if that happens once more."""
        if self._give_up is None:
            self._give_back()
            self._raise(Interrupted("a second signal", signal.SIGINT))
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.SIG_DFL)
        self._patience = threading.Timer(PATIENCE, self._give_up)
        self._patience.daemon = True
        self._patience.start()

    def _on_alarm(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self._deadline is not None and now >= self._deadline:
            self._expire()
            if self._pending and not self._shielded:
                self._raise(self._pending)
        if self._turn_limit is None:
            return
        serial, since = self._seen
        if self._shielded or not self._watched or serial != self._serial:
            self._seen = (self._serial, now)
        elif now - since >= self._turn_limit:
            self._seen = (self._serial, now)
            raise OverdueError(self._turn_limit)

    def _expire(self) -> None:
        self._deadline = None
        self._pending = Interrupted(f"the time-out of {self._timeout:g} s")

    def shielded(self, call: Callable[[Event], Any]) -> Callable[[Event], None]:
        """Make a subscriber that holds signals back while it works, and delivers them afterwards."""

        def work(event: Event) -> None:
            before, self._shielded = self._shielded, True
            try:
                call(event)
            finally:
                if not before:
                    self.unshield()

        return work

    @property
    def held(self) -> int | None:
        """The signal that is held back, if there is one."""
        return self._pending.number if self._pending else None

    def shield(self) -> None:
        """Hold signals back."""
        self._shielded = True

    def unshield(self, watched: bool = True) -> None:
        """Let signals through again, first the one that was held back.

        Args:
            watched: Whether the limit of a turn holds until the next `shield`.

        Raises:
            Interrupted: A signal came in the meantime.
        """
        self._shielded = False
        self._watched = watched
        self._serial += 1
        if self._pending is not None:
            pending, self._pending = self._pending, None
            self._raise(pending)


def _hear_once(number: int) -> None:
    """Let the system's own handler take the next signal after one that the interpreter has not heard of yet.

    Handlers of Python run between two of its instructions, so a process is deaf while native code does not return. With
    SA_RESETHAND the kernel restores the default, which is the end of the process, when it delivers a signal; the
    interpreter sets its handler again once it comes to that.
    """
    if not sys.platform.startswith("linux"):
        return
    # struct sigaction of Linux's C libraries: the handler, a mask of 128 bytes, the flags.
    action = (ctypes.c_char * 512)()
    flags = ctypes.c_int.from_buffer(action, ctypes.sizeof(ctypes.c_void_p) + 128)
    sigaction = ctypes.CDLL(None).sigaction
    if sigaction(number, None, action) == 0:
        flags.value = ctypes.c_int(flags.value | _SA_RESETHAND).value
        sigaction(number, action, None)


_SA_RESETHAND = 0x80000000
