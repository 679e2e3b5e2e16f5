"""Ctrl-C and its relatives: they end a run between two records, never within one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

from symaware_cli.core import Event


class Interrupted(BaseException):
    """Somebody asked the run to end; not an `Exception`, so that no component swallows it."""

    def __init__(self, signal_number: int) -> None:
        super().__init__(signal.Signals(signal_number).name)


class Interruption:
    """Turns SIGINT and SIGTERM into `Interrupted` while a run lasts.

    Where nothing may be left half done, `shield` holds the signal back and `unshield` delivers it. A second signal
    quits at once, so that a run can always be got rid of.
    """

    def __init__(self) -> None:
        self._shielded = False
        self._pending: int | None = None
        self._count = 0
        self._previous: dict[int, signal.Handlers | object] = {}

    def __enter__(self) -> Interruption:
        # Only the main thread may handle signals; elsewhere whoever runs us decides.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._count += 1
        if self._count > 3:
            # Whatever we raised was caught by somebody who catches everything.
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        if self._count > 2:
            raise KeyboardInterrupt
        # Also where it is raised at once: a component that swallows it is interrupted after its turn.
        self._pending = number
        if not self._shielded:
            raise Interrupted(number) if self._count == 1 else KeyboardInterrupt

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

    def shield(self) -> None:
        """Hold signals back."""
        self._shielded = True

    def unshield(self) -> None:
        """Let signals through again, first the one that was held back.

        Raises:
            Interrupted: A signal came in the meantime.
        """
        self._shielded = False
        if self._pending is not None:
            number, self._pending = self._pending, None
            raise Interrupted(number)
