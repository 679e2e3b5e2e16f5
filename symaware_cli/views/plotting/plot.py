"""Plots a log, or two logs and the difference of their states, as one figure in a file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symaware_cli.geometry import wrapped
from symaware_cli.log import Log, LogError, whole_file
from symaware_cli.views.plotting.content import gather
from symaware_cli.views.plotting.curves import PlottedCurves
from symaware_cli.views.plotting.motion import Motion, held, instants
from symaware_cli.views.plotting.panels import Content, Panel, Trajectories
from symaware_cli.views.plotting.request import PlotRequest, SeriesName, check_output


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
        LogError: There is nothing to plot, the log lacks requested data, or matplotlib is not installed.
        OutputError: The file cannot be written.
    """
    path, request = Path(path), request or PlotRequest()
    check_output(path, request)
    with matplotlib_required():
        from symaware_cli.views.plotting.figure import draw
    content = gather(log, request)
    with whole_file(path, log.path) as partial:
        draw(content, request, partial)
    return content


@contextmanager
def matplotlib_required() -> Iterator[None]:
    """Check that matplotlib is installed within the block; the error names the command that installs it.

    Raises:
        LogError: matplotlib is missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        raise LogError(
            "plots need the module `matplotlib`, which is not installed: pip install 'symaware-cli[plot]'"
        ) from error


Array = NDArray[np.float64]

#: Elements of the state that the map and the distance show.
_POSITION = ("x", "y", "z")

#: Maximum number of panels of elements of the state.
_MOST = 3

#: Differences up to this are rounding errors, which get no panel.
_ROUNDING = 1e-9


def plot_logs(one: Log, other: Log, path: str | os.PathLike[str], since: int | None) -> Content:
    """Draw two logs into one figure: the second's paths dashed, and the differences of its states from the first's.

    Args:
        one: A log.
        other: Another log, with some of the same agents.
        path: The file; its suffix, one of `FORMATS`, determines the format.
        since: The instant that is marked, from which on the logs differ [ns]; None for none.

    Returns:
        The content that was drawn.

    Raises:
        LogError: A log has no motion, the logs have no agent in common, or matplotlib is not installed.
        OutputError: The file cannot be written.
    """
    path = Path(path)
    title = f"{one.path.name} (solid) and {other.path.name} (dashed)"
    request = PlotRequest(title=title + ("" if since is None else f", different from {since / 1e9:.9g} s on"))
    check_output(path, request)
    with matplotlib_required():
        from symaware_cli.views.plotting.figure import draw
    content = _compared(one, other, since)
    with whole_file(path, one.path, other.path) as partial:
        draw(content, request, partial)
    return content


def _compared(one: Log, other: Log, since: int | None) -> Content:
    contents = [gather(log, PlotRequest(show=("trajectories",))) for log in (one, other)]
    (first,), (second,) = (content.panels for content in contents)
    assert isinstance(first, Trajectories)
    assert isinstance(second, Trajectories)
    common = [name for name in first.motion.names if name in second.motion.names]
    if not common:
        raise LogError(f"{one.path} and {other.path} have no agent in common")
    times = instants([first.motion.times, second.motion.times], 0, contents[0].window.end)
    apart = np.linalg.norm(_positions(second.motion, common, times) - _positions(first.motion, common, times), axis=2)
    lines = tuple(first.chosen.lines[first.chosen.agents.index(name)] for name in common)
    departures = {
        name: place
        for number, name in enumerate(common)
        if (place := _departure(first.motion, name, times, apart[:, number])) is not None
    }
    panels: list[Panel] = [
        replace(first, compared=second.motion, departures=departures),
        PlottedCurves("distance apart", "m", times, apart, lines),
    ]
    panels += [each for each in _elements(one, other) if np.nanmax(each.values) > _ROUNDING][:_MOST]
    return replace(contents[0], panels=tuple(panels), since=since)


def _positions(motion: Motion, names: Sequence[str], times: NDArray[np.int64]) -> Array:
    """Return positions at some instants (k, n, 3); NaN after the last one that is known."""
    rows = [motion.names.index(name) for name in names]
    found = held(motion.times, motion.positions[:, rows], times)
    found[times > motion.times[-1]] = np.nan
    return found


def _departure(motion: Motion, name: str, times: NDArray[np.int64], apart: Array) -> Array | None:
    """Return the position at which an agent first deviates from another run (1, 2); None if it never does."""
    (differing,) = np.nonzero(apart > 0)
    if not len(differing):
        return None
    index = motion.index(int(times[differing[0]]))
    return np.array(motion.positions[index, motion.names.index(name), :2]).reshape(1, 2)


def _elements(one: Log, other: Log) -> Iterator[PlottedCurves]:
    """Yield the absolute difference of each element of the state but the position, of groups that both have."""
    names = [group for group in one.manifest["groups"] if group in other.manifest["groups"]]
    for group in names:
        if any(f"/world/{group}/state" not in log.topics for log in (one, other)):
            continue
        request = PlotRequest(series=(SeriesName(group, "world"),))
        mine, theirs = (
            {each.name: each for each in gather(log, request).panels if isinstance(each, PlottedCurves)}
            for log in (one, other)
        )
        for name, curves in mine.items():
            if name in _POSITION or name not in theirs:
                continue
            owners = [line.name for line in theirs[name].lines]
            rows = [number for number, line in enumerate(curves.lines) if line.name in owners]
            columns = [owners.index(curves.lines[number].name) for number in rows]
            there = held(theirs[name].times, theirs[name].values[:, columns], curves.times)
            there[curves.times > theirs[name].times[-1]] = np.nan
            difference = np.abs(there - curves.values[:, rows])
            if curves.unit == "rad":
                difference = np.abs(wrapped(difference))
            if np.isfinite(difference).any():
                lines = tuple(curves.lines[number] for number in rows)
                yield PlottedCurves(f"difference of {name}", curves.unit, curves.times, difference, lines)
