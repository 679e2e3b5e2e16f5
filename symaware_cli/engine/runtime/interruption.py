"""Interruption of a run by signals (Ctrl-C, SIGTERM) and limits of wall time, deferred until records are complete."""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]
import ctypes
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, ClassVar, NoReturn

from symaware_cli.core import Event
from symaware_cli.engine.runtime.process_exit import PATIENCE

#: Signals within this time count as one: some programs forward a signal that their process group received [s].
_REPEAT_INTERVAL = 0.1

#: The signals that end a run.
SIGNALS = int(signal.SIGINT), int(signal.SIGTERM)


class SignalHandlers:
    """The handlers of signals that were replaced, and are to be restored; in the main thread only."""

    def __init__(self) -> None:
        self._previous: dict[int, Any] = {}

    def install(self, number: int, handler: Callable[[int, FrameType | None], object]) -> None:
        """Let a function handle a signal, until `restore`."""
        # The function behind `signal.signal`, whose enumerations take 20 us; this may be done at every step.
        self._previous[number] = _signal.signal(number, handler)

    def restore(self) -> None:
        """Restore the earlier handlers."""
        while self._previous:
            number, handler = self._previous.popitem()
            # A handler that was not installed from Python cannot be restored.
            _signal.signal(number, _signal.SIG_DFL if handler is None else handler)


@contextmanager
def signals_handled(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Let a function handle SIGINT and SIGTERM within the context; in other threads than the main one, do nothing."""
    handlers = SignalHandlers()
    try:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                handlers.install(number, handler)
        yield
    finally:
        handlers.restore()


class Interrupted(BaseException):
    """A signal or a time-out ends the run; not an `Exception`, so that components do not swallow it.

    Attributes:
        number: The signal; None for a time-out.
    """

    def __init__(self, cause: str, number: int | None = None) -> None:
        super().__init__(cause)
        self.number = number


class OverdueError(BaseException):
    """A turn exceeds its limit of wall time; not an `Exception`, so that the component does not swallow it."""

    def __init__(self, limit: float) -> None:
        super().__init__(f"it did not come back within {limit:g} s of wall time")


class Interruption:
    """Raises `Interrupted` on SIGINT, on SIGTERM and when the run's wall time is used up.

    `shield` defers signals while an operation must not be left incomplete; `unshield` delivers them. After a second
    signal the run has one second to finish its log; then the process ends. If native code keeps the interpreter from
    handling a Ctrl-C, the operating system ends the process at the next one. A process that does not belong to the run
    is not ended: there, a second signal is delivered at once, and further ones are not deferred.

    The context may be entered repeatedly. Outside the main thread no signals are handled, and turns have no limit.
    """

    #: Signal handlers belong to the process.
    uncaptured: ClassVar[Collection[str]] = "*"

    def __init__(
        self,
        timeout: float | None = None,
        turn_limit: float | None = None,
        exit_process: Callable[[], object] | None = None,
    ) -> None:
        """Prepare; handlers are installed when the context is entered.

        Args:
            timeout: Wall time after which the run is interrupted [s].
            turn_limit: Longest wall time between `unshield` and `shield`; after it, `OverdueError` is raised [s].
            exit_process: Ends the process; called from another thread if the run does not end after a second signal.
                None if the process must not be ended.
        """
        self._shielded = False
        self._pending: Interrupted | None = None
        self._count = 0
        self._first = 0.0
        self._exit_process = exit_process
        self._exit_timer: threading.Timer | None = None
        self._timeout_timer: threading.Timer | None = None
        self._handlers = SignalHandlers()
        self._is_alarm_set = False
        self._timeout = timeout
        self._turn_limit = turn_limit
        self._deadline: float | None = None
        #: Counts the calls of `unshield`, so that the alarm can tell whether the same turn is still running.
        self._serial = 0
        self._watched = True
        self._seen = (0, 0.0)

    def __enter__(self) -> Interruption:
        # Only the main thread can handle signals; in other threads the caller does.
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                self._handlers.install(number, self._handle)
            if self._exit_process:
                _reset_after_next(signal.SIGINT)
            if self._timeout is not None or self._turn_limit is not None:
                self._set_alarm()
        elif self._timeout is not None:
            self._timeout_timer = threading.Timer(self._timeout, self._expire)
            self._timeout_timer.daemon = True
            self._timeout_timer.start()
        return self

    def _set_alarm(self) -> None:
        now = time.monotonic()
        self._seen = (-1, now)
        intervals = [] if self._turn_limit is None else [self._turn_limit / 4]
        if self._timeout is not None:
            self._deadline = now + self._timeout
            intervals.append(max(self._timeout, 1e-3))
        self._handlers.install(signal.SIGALRM, self._on_alarm)
        self._is_alarm_set = True
        signal.setitimer(signal.ITIMER_REAL, min(intervals), min([*intervals, 1.0]))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for timer in (self._exit_timer, self._timeout_timer):
            if timer:
                timer.cancel()
        self._restore_handlers()

    def _restore_handlers(self) -> None:
        """Restore the earlier signal handlers."""
        if self._is_alarm_set:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            self._is_alarm_set = False
        self._handlers.restore()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        self._count += 1
        if self._count == 1:
            self._first = now
        elif self._exit_timer is None and now - self._first > _REPEAT_INTERVAL:
            self._on_second_signal()
        if number == signal.SIGINT and self._exit_process and self._exit_timer is None:
            signal.signal(number, self._handle)
            _reset_after_next(number)
        # Even if raised at once: a component that swallows the exception is interrupted after its turn.
        self._pending = Interrupted(signal.Signals(number).name, number)
        if not self._shielded:
            self._raise(self._pending)

    def _raise(self, interrupted: Interrupted) -> NoReturn:
        """Deliver a signal, and defer others until the next `unshield`, so that the run can end undisturbed."""
        self._shielded = True
        raise interrupted

    def _on_second_signal(self) -> None:
        """Give the run a short time to end; a third signal ends the process at once."""
        if self._exit_process is None:
            self._restore_handlers()
            self._raise(Interrupted("a second signal", signal.SIGINT))
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.SIG_DFL)
        self._exit_timer = threading.Timer(PATIENCE, self._exit_process)
        self._exit_timer.daemon = True
        self._exit_timer.start()

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
        """Wrap a subscriber so that signals are deferred while it runs."""

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
        """The deferred signal, if there is one."""
        return self._pending.number if self._pending else None

    def shield(self) -> None:
        """Defer signals."""
        self._shielded = True

    def unshield(self, watched: bool = True) -> None:
        """Stop deferring signals, and deliver a deferred one.

        Args:
            watched: Whether the time limit of a turn applies until the next `shield`.

        Raises:
            Interrupted: A signal was deferred.
        """
        self._shielded = False
        self._watched = watched
        self._serial += 1
        if self._pending is not None:
            pending, self._pending = self._pending, None
            self._raise(pending)


def _reset_after_next(number: int) -> None:
    """Reset a signal to its default action after the next delivery, until the interpreter has handled that signal.

    Python runs its handlers between two instructions of the interpreter, hence not before native code returns. With
    SA_RESETHAND the operating system restores the default action, the end of the process, when it delivers a signal;
    the interpreter installs the handler again when it handles the signal.
    """
    if not sys.platform.startswith("linux"):
        return
    # struct sigaction in the C libraries of Linux: the handler, a mask of 128 bytes, the flags.
    action = (ctypes.c_char * 512)()
    flags = ctypes.c_int.from_buffer(action, ctypes.sizeof(ctypes.c_void_p) + 128)
    sigaction = ctypes.CDLL(None).sigaction
    if sigaction(number, None, action) == 0:
        flags.value = ctypes.c_int(flags.value | _SA_RESETHAND).value
        sigaction(number, action, None)


_SA_RESETHAND = 0x80000000
