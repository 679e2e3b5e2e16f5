"""Exceptions of plugins in one line: the error, and its position in their code."""

from __future__ import annotations

import os
import re
import sys
import traceback

#: The place of a frame in the text of a traceback.
_FILE = re.compile(r'^(\s*File ")([^"\n]+)(", line \d+)', re.MULTILINE)

#: Folders outside of the search path from which modules were imported.
_FOLDERS: list[str] = []


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


def name_files_from(folder: str) -> None:
    """Let tracebacks name the files of a folder by their paths in it, though it is not on the search path."""
    if folder not in _FOLDERS:
        _FOLDERS.append(folder)


def trace(error: BaseException) -> str:
    """Return the traceback of an exception.

    Files have the paths by which imports find them, such as ``numpy/linalg/_linalg.py``: the text is part of logs,
    which are the same wherever packages are installed.
    """
    text = "".join(traceback.format_exception(error))
    return _FILE.sub(lambda found: f"{found[1]}{_shortened(found[2])}{found[3]}", text)


def _shortened(file: str) -> str:
    if not os.path.isabs(file):  # such as <string>, or what a worker process has shortened
        return file
    for folder in (*_FOLDERS, *sorted((each or os.curdir for each in sys.path), key=len, reverse=True)):
        start = os.path.join(os.path.abspath(folder), "")
        if file.startswith(start):
            return file.removeprefix(start).replace(os.sep, "/")
    return os.path.basename(file)
