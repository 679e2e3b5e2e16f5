"""The log reader: `open_log` and `Log`."""

from __future__ import annotations

import os

from symaware_cli.recording.log_message import LogMessage
from symaware_cli.recording.log_series import LogSeries
from symaware_cli.recording.names import FIELDS

__all__ = ["FIELDS", "Log", "LogMessage", "open_log"]


class Log(LogSeries):
    """A log, opened by `open_log`.

    Attributes:
        foreign: Whether another program wrote it; it then has no manifest and no SymAware messages.
        manifest: The manifest; empty if the log is foreign, or if the manifest is missing or damaged.
    """


def open_log(path: str | os.PathLike[str]) -> Log:
    """Open a log.

    A log that was cut off or damaged is read as far as possible; `Log.damage` describes what is missing. MCAP files of
    other programs can be opened as well, with `Log.foreign` set: their channels and messages can be listed.

    Args:
        path: The file.

    Returns:
        The log.

    Raises:
        LogError: The file cannot be read: it is missing, not permitted, not an MCAP file, or of a newer format.
    """
    return Log(path)
