"""Exceptions of plugins in one line: what happened, and where in their code."""

from __future__ import annotations

import os
import traceback


def describe(error: BaseException) -> str:
    """Describe an exception in one line."""
    try:
        text = " ".join(str(error).split())
    except BaseException:  # `__str__` of a plugin's exception may raise, too
        text = ""
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def code_position(error: BaseException, beyond: str = "") -> str:
    """Return the position of an error in a plugin's code, as `` (module.py, line 3)``; empty if unknown.

    Args:
        error: The error.
        beyond: The file of the code that called the plugin, which is not its code.
    """
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and "importlib" not in frame.filename and frame.filename != beyond
    ]
    if not frames or isinstance(error, SyntaxError):
        return ""
    return f" ({frames[-1].filename.replace(os.sep, '/').rpartition('/')[2]}, line {frames[-1].lineno})"
