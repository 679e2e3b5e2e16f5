"""From the folder of a sweep to a picture in a file."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from symaware_cli.log import whole_file
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.picture.finished_runs import finished_runs
from symaware_cli.studies.picture.metric_panel import SweepPicture, composed
from symaware_cli.studies.picture.paths_picture import PathsPicture, gathered
from symaware_cli.views import PlotRequest, check_output, matplotlib_required


def plot_sweep(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str],
    show: Sequence[str] = (),
    title: str | None = None,
    size: tuple[float, float] | None = None,
    dpi: int = 150,
) -> SweepPicture:
    """Draw what a sweep came to into a file, which appears whole or not at all.

    A metric is a curve over the parameter that varies, a map over two, a map for each combination of the others where
    more vary, and a distribution where none does. Over each parameter that is drawn, runs are points with their means.
    Variants are told apart by colour, or have maps of their own.

    Args:
        folder: The folder of the sweep, which need not be finished.
        path: The file; its suffix says the format.
        show: The metrics, in their order; "satisfied.NAME" and "robustness.NAME" are those of a specification. Empty
            for those that differ from run to run.
        title: What stands above; None for the name of the folder.
        size: Width and height [inch]; None for what suits the panels.
        dpi: Dots for each inch.

    Returns:
        What was drawn.

    Raises:
        LogError: There is nothing to draw, no such metric, or matplotlib is not installed.
        OutputError: The file cannot be written.
    """
    path = Path(path)
    check_output(path, PlotRequest(size=size, dpi=dpi))
    with matplotlib_required():
        from symaware_cli.studies.picture.sweep_figure import draw
    picture = composed(finished_runs(SweepFolder.opened(folder)), show)
    with whole_file(path) as partial:
        draw(picture, partial, title, size, dpi)
    return picture


def plot_paths(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str],
    count: int | None = None,
    title: str | None = None,
    size: tuple[float, float] | None = None,
    dpi: int = 150,
    on_progress: Callable[[int, int], object] | None = None,
) -> PathsPicture:
    """Draw the trajectories of the runs of a sweep into a file, which appears whole or not at all.

    The runs are made again for that, so that nothing of them need be kept, and have to come out as they did.

    Args:
        folder: The folder of the sweep, which need not be finished.
        path: The file; its suffix says the format.
        count: How many runs of each combination at most; None for 1,000 among all of them.
        title: See `plot_sweep`, as for the next two.
        size: See there.
        dpi: See there.
        on_progress: Called after each run with how many were made, and how many there are.

    Returns:
        What was drawn.

    Raises:
        LogError: There is nothing to draw, or matplotlib is not installed.
        SweepError: A run came out otherwise than before.
        OutputError: The file cannot be written.
    """
    path = Path(path)
    check_output(path, PlotRequest(size=size, dpi=dpi))
    with matplotlib_required():
        from symaware_cli.studies.picture.paths_figure import draw
    picture = gathered(SweepFolder.opened(folder), count, on_progress)
    with whole_file(path) as partial:
        draw(picture, partial, title, size, dpi)
    return picture
