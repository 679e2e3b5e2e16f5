"""The reader of a log."""

from __future__ import annotations

import os

from symaware_cli.recording.log_message import LogMessage
from symaware_cli.recording.log_series import LogSeries
from symaware_cli.recording.names import FIELDS

__all__ = ["FIELDS", "Log", "LogMessage", "open_log"]


class Log(LogSeries):
    """A log, opened by `open_log`.

    Attributes:
        foreign: Whether somebody else's software wrote it: it has no manifest, and its messages are not ours.
        manifest: Who took part; empty if the log is foreign, or broke off before it, or it is damaged.
    """


def open_log(path: str | os.PathLike[str]) -> Log:
    """Open a log.

    A log that was cut off or damaged is read as far as that is possible; `Log.damage` tells what is missing. The MCAP
    of other software opens, too, with `Log.foreign` set: its channels and messages can be listed.

    Args:
        path: The file.

    Returns:
        The log.

    Raises:
        LogError: There is nothing to read: no such file, no permission, not an MCAP, or of a newer format.
    """
    return Log(path)
