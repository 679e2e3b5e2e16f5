"""The result of a run: its figures and its log."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from symaware_cli.api.report import summary_report

if TYPE_CHECKING:
    import xarray

    from symaware_cli.api.live import LiveView
    from symaware_cli.engine import Run, RunSummary
    from symaware_cli.log import FrameLibrary, Log, Series
    from symaware_cli.log.logged_events import LoggedEvent
    from symaware_cli.views import Content, PlotRequest


class RunResult:
    """The result of a run.

    Attributes:
        summary: Its figures.
        log_path: The path of its log; None if it was not recorded.
        viewer: The viewer that shows it; None if none was requested.
    """

    def __init__(self, summary: RunSummary, viewer: LiveView | None = None) -> None:
        self.summary = summary
        self.log_path = Path(summary.log) if summary.log else None
        self.viewer = viewer

    @property
    def status(self) -> str:
        """``finished``, ``failed`` or ``interrupted``."""
        return self.summary.status

    @cached_property
    def log(self) -> Log:
        """The log, opened.

        Raises:
            LogError: The run was not recorded, or the log cannot be read.
        """
        from symaware_cli.log import LogError, open_log

        if self.log_path is None:
            raise LogError(f"the run of {self.summary.name} was not recorded")
        return open_log(self.log_path)

    def series(self, name: str, field: str) -> Series:
        """Return recorded values over time as arrays; see `Log.series`.

        Args:
            name: A group, an agent, or an entity of the environment.
            field: Such as ``world`` (the true state), ``state`` (the believed one), ``applied_control`` or ``risk``.

        Raises:
            LogError: There is no such name or field, or the run was not recorded.
        """
        return self.log.series(name, field)

    def frame(
        self,
        name: str,
        fields: str | Sequence[str] = (),
        *,
        to: FrameLibrary = "pandas",
        start: int | None = None,
        end: int | None = None,
    ) -> Any:
        """Return recorded values over time as a data frame; see `Log.frame`.

        Args:
            name: A group, an agent, or an entity of the environment.
            fields: One or several fields of `series`; by default the true and the believed state.
            to: The library: ``pandas``, ``polars`` or ``arrow``.
            start: The first simulated time, ns.
            end: The simulated time at which to stop, exclusive, ns.

        Raises:
            LogError: There is no such name or field, the library is not installed, or the run was not recorded.
        """
        return self.log.frame(name, fields, to=to, start=start, end=end)

    def to_xarray(
        self, name: str, fields: str | Sequence[str] = (), *, start: int | None = None, end: int | None = None
    ) -> xarray.Dataset:
        """Return recorded values as a dataset over agents, time and columns; see `Log.to_xarray`.

        Args:
            name: See `frame`.
            fields: See `frame`.
            start: See `frame`.
            end: See `frame`.

        Raises:
            LogError: There is no such name or field, xarray is not installed, or the run was not recorded.
        """
        return self.log.to_xarray(name, fields, start=start, end=end)

    @cached_property
    def events(self) -> Sequence[LoggedEvent]:
        """The events, in order of time.

        Raises:
            LogError: The run was not recorded.
        """
        return list(self.log.events())

    def plot(self, path: str | os.PathLike[str], request: PlotRequest | None = None) -> Content:
        """Draw a figure of the run to a file; see `symaware_cli.views.plotting.plot.plot`.

        Raises:
            LogError: There is nothing to plot, matplotlib is not installed, or the run was not recorded.
        """
        from symaware_cli.views import plot

        return plot(self.log, path, request)

    def __repr__(self) -> str:
        summary = self.summary
        log = f", log {summary.log}" if summary.log else ""
        return f"<RunResult {summary_report(summary).headline}, seed {summary.seed}{log}>"

    def __str__(self) -> str:
        return summary_report(self.summary).text

    def _repr_html_(self) -> str:
        return summary_report(self.summary).html


class RunFailedError(RuntimeError):
    """A run failed; its log is finished and contains the failure.

    The exception of the component or environment is the cause of this one.

    Attributes:
        run: The result until the failure.
        source: The dotted path of the part that failed, such as ``agents.robot.2.steer`` or ``environment``.
        plugin: The entry-point name of the plugin that failed.
        time: Simulated time [s].
        problem: The failure, described in one sentence.
    """

    def __init__(self, message: str, run: RunResult, source: str, plugin: str, time: float, problem: str) -> None:
        super().__init__(message)
        self.run = run
        self.source = source
        self.plugin = plugin
        self.time = time
        self.problem = problem


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM interrupted a run; its log is finished.

    Attributes:
        run: The result until the interruption.
    """

    def __init__(self, message: str, run: RunResult) -> None:
        super().__init__(message)
        self.run = run


def result_of(run: Run, viewer: LiveView | None = None, recorded: bool = True) -> RunResult:
    """Return the result of a run that reached its end or its time-out.

    Args:
        run: The run.
        viewer: The viewer that shows it.
        recorded: Whether its log, if there is one, is kept for the user.

    Raises:
        RunFailedError: It failed.
        RunInterrupted: A signal ended it.
    """
    summary = run.summary if recorded else replace(run.summary, log=None, log_size=None)
    result = RunResult(summary, viewer)
    failure = run.failure
    if failure is not None:
        raise RunFailedError(
            str(failure), result, failure.source, failure.plugin, failure.time / 1e9, failure.problem
        ) from failure.__cause__
    if run.signal is not None:
        raise RunInterrupted(f"{result.summary.name} was interrupted", result)
    return result
