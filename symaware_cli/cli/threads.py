"""Threads and processes of plugins that outlive the command, for which the interpreter would wait forever."""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

from symaware_cli.core import Component, GroupComponent

#: Wall time that threads have to end after the work is done [s].
_PATIENCE = 2.0


def do_not_wait(status: str | int | None) -> None:
    """Exit the process if threads or child processes continue some time after the work is done, and name them.

    Args:
        status: The exit status.
    """
    if _left() or _children():
        threading.Thread(
            target=_watch, args=(status if isinstance(status, int) else int(bool(status)),), daemon=True
        ).start()


def _left() -> list[threading.Thread]:
    """The threads that the interpreter waits for, except the main one."""
    main = threading.main_thread()
    return [each for each in threading.enumerate() if each is not main and each.is_alive() and not each.daemon]


def _children() -> list[Any]:
    """The child processes that `multiprocessing` waits for."""
    multiprocessing = sys.modules.get("multiprocessing")
    return [] if multiprocessing is None else [each for each in multiprocessing.active_children() if not each.daemon]


def _watch(status: int) -> None:
    time.sleep(_PATIENCE)
    threads = [f"`{thread.name}`{_origin(thread)}" for thread in _left()]
    children = _children()
    if not threads and not children:
        return
    if threads:
        sys.stderr.write(f"symaware: threads that go on after the end are not waited for: {', '.join(threads)}\n")
    if children:
        names = ", ".join(f"`{child.name}`" for child in children)
        sys.stderr.write(f"symaware: processes that go on after the end are ended: {names}\n")
        for child in children:
            child.kill()
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


def _origin(thread: threading.Thread) -> str:
    """The component that a thread belongs to, or else its current function."""
    frame = sys._current_frames().get(thread.ident or 0)
    place = ""
    while frame is not None:
        own = frame.f_locals.get("self")
        if isinstance(own, Component | GroupComponent):
            return f" of {own.path} ({own.use})"
        if frame.f_code.co_filename != threading.__file__:
            place = f" ({frame.f_code.co_name}, {Path(frame.f_code.co_filename).name}:{frame.f_lineno})"
        frame = frame.f_back
    return place
