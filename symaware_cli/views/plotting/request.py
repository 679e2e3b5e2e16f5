"""Requests for plots: panels, series, agents, window and size, and their validation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from symaware_cli.core import nanoseconds, seconds
from symaware_cli.log import Log, LogError, UnknownNameError, require_writable_file
from symaware_cli.views.plotting.paper_preset import PaperPreset

#: The panels that can be requested by name, besides parts of awareness, in order.
PANELS = (
    "trajectories",
    "separation",
    "contacts",
    "verdicts",
    "specifications",
    "modes",
    "offers",
    "risk",
    "speed",
    "altitude",
    "control",
)

#: The output formats, by suffix.
FORMATS = (".png", ".svg", ".pdf", ".pgf")

#: Minimum and maximum size [inch].
_LEAST, _MOST = 1.5, 60.0

#: Maximum number of pixels, which limits file size and memory.
_PIXELS = 200_000_000


@dataclass(frozen=True)
class SeriesName:
    """A series of a log, by name.

    Attributes:
        owner: A group, an agent or an entity.
        field: One of the fields of `Log.series`, or a sensor.
        column: The name of a column, or its number; None for every column.
    """

    owner: str
    field: str
    column: str | None = None

    @classmethod
    def parse(cls, text: str) -> SeriesName:
        """Parse ``NAME:FIELD`` or ``NAME:FIELD:COLUMN``.

        Raises:
            LogError: The text does not have this form.
        """
        parts = text.split(":")
        if len(parts) not in (2, 3) or not all(parts):
            raise LogError(f"a series is NAME:FIELD or NAME:FIELD:COLUMN, such as robot.0:state:x, not {text!r}")
        return cls(*parts)

    def __str__(self) -> str:
        return ":".join(part for part in (self.owner, self.field, self.column) if part is not None)


@dataclass(frozen=True)
class PlotRequest:
    """A request for a plot.

    Attributes:
        show: Some of `PANELS` and of the parts of awareness in the log; empty for the default panels, unless there are
            `series`.
        series: Series to show; those of the same quantity share a panel.
        agents: Agents and groups to show; empty for all.
        start: The first simulated time [s]; None for the beginning.
        end: The last simulated time [s]; None for the end.
        at: The time at which bodies are shown [s]; None for the last time.
        title: The title; None for the scenario's name.
        size: Width and height [inch]; None for the natural size.
        dpi: Dots per inch.
        preset: Width, type and colours for a paper; None for the usual ones.
    """

    show: tuple[str, ...] = ()
    series: tuple[SeriesName, ...] = ()
    agents: tuple[str, ...] = ()
    start: float | None = None
    end: float | None = None
    at: float | None = None
    title: str | None = None
    size: tuple[float, float] | None = None
    dpi: int = 150
    preset: PaperPreset | None = None

    def require_known(self, parts: Iterable[str]) -> None:
        """Check that the requested panels exist.

        Args:
            parts: The names of the parts of awareness in the log.

        Raises:
            UnknownNameError: A panel does not exist.
        """
        known = list(dict.fromkeys([*PANELS, *parts]))
        for name in self.show:
            if name not in known:
                raise UnknownNameError(f"there is no panel {name!r}; there are {', '.join(known)}", name, known)


@dataclass(frozen=True)
class Window:
    """The interval of simulated time of a plot.

    Attributes:
        start: The first instant [ns].
        end: The last instant [ns].
        at: The instant at which bodies are shown [ns].
    """

    start: int
    end: int
    at: int

    @classmethod
    def of(cls, log: Log, request: PlotRequest) -> Window:
        """Determine the requested interval of a log.

        Raises:
            LogError: The log has no values in the interval.
        """
        first, last = log.start_time, log.end_time
        if first is None or last is None:
            why = f": {log.damage}" if log.damage else ""
            raise LogError(f"{log.path} holds no values to plot{why}")
        if request.start is not None and request.end is not None and request.start > request.end:
            raise LogError(f"there is no time from {request.start:g} to {request.end:g} s")
        start = first if request.start is None else max(first, nanoseconds(request.start))
        end = last if request.end is None else min(last, nanoseconds(request.end))
        if start > end:
            asked = (
                f"before {request.end:g} s"
                if request.start is None or start == first
                else f"from {request.start:g} s on"
            )
            span = f"{seconds(first):g} to {seconds(last):g} s"
            raise LogError(f"there is nothing to plot {asked}: {log.path} covers {span}")
        at = end if request.at is None else nanoseconds(request.at)
        if not start <= at <= end:
            raise LogError(
                f"{request.at:g} s lies outside of the plotted time, {seconds(start):g} to {seconds(end):g} s"
            )
        return cls(start, end, at)


def check_format(path: Path) -> None:
    """Check that a figure can be written in the format of the file's suffix.

    Raises:
        UnknownNameError: The suffix is not one of `FORMATS`.
    """
    if path.suffix.lower() not in FORMATS:
        what = f"the suffix {path.suffix!r}" if path.suffix else "a name without a suffix"
        message = f"cannot draw {path}: {what} is not a known format; use {', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
        raise UnknownNameError(message, path.suffix.lower(), FORMATS)


def check_output(path: Path, request: PlotRequest) -> None:
    """Check that a figure can be written to a file, before drawing it.

    Raises:
        UnknownNameError: The suffix is not one of `FORMATS`.
        LogError: The figure is too small to show anything, or too large for memory.
        OutputError: The file cannot be written.
    """
    check_format(path)
    require_writable_file(path)
    if request.size is None:
        return
    width, height = request.size
    if not (_LEAST <= width <= _MOST and _LEAST <= height <= _MOST):
        raise LogError(f"a figure of {width:g} x {height:g} inches cannot be drawn; take {_LEAST:g} to {_MOST:g}")
    if width * height * request.dpi**2 > _PIXELS:
        raise LogError(f"{width:g} x {height:g} inches at {request.dpi} dpi are too many pixels; take fewer dpi")
