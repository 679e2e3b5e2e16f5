"""Plots a log as one figure in a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from symaware_cli.recording.error import LogError
from symaware_cli.recording.output import whole_file
from symaware_cli.recording.reader import Log
from symaware_cli.viewing.plotting.content import gather
from symaware_cli.viewing.plotting.panels import Content
from symaware_cli.viewing.plotting.request import PlotRequest, check_output


def plot(log: Log, path: str | os.PathLike[str], request: PlotRequest | None = None) -> Content:
    """Draw a figure of a log into a file, which appears whole or not at all.

    The same log, request and versions give the same bytes.

    Args:
        log: The log.
        path: The file; its suffix, one of `FORMATS`, determines the format.
        request: The content of the figure; None for the default panels.

    Returns:
        The content that was drawn.

    Raises:
        LogError: There is nothing to plot, the log does not have what was requested, or matplotlib is not installed.
        OutputError: The file cannot be written.
    """
    path, request = Path(path), request or PlotRequest()
    check_output(path, request)
    with matplotlib_required():
        from symaware_cli.viewing.plotting.figure import draw
    content = gather(log, request)
    with whole_file(path, log.path) as partial:
        draw(content, request, partial)
    return content


@contextmanager
def matplotlib_required() -> Iterator[None]:
    """Say how to install matplotlib where it is missing.

    Raises:
        LogError: It is.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        raise LogError(
            "plots need the module `matplotlib`, which is not installed: pip install 'symaware-cli[plot]'"
        ) from error
