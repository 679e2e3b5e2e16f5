"""Pictures of sweep folders, written to files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from symaware_cli.log import whole_file
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.picture.finished_runs import finished_runs
from symaware_cli.studies.picture.metric_panel import SweepPicture, composed
from symaware_cli.studies.picture.paths_picture import PathsPicture, gathered
from symaware_cli.views import PaperPreset, PlotRequest, check_output, matplotlib_required


def plot_sweep(
    folder: str | os.PathLike[str],
    path: str | os.PathLike[str],
    show: Sequence[str] = (),
    title: str | None = None,
    size: tuple[float, float] | None = None,
    dpi: int = 150,
    preset: PaperPreset | None = None,
) -> SweepPicture:
    """Draw the results of a sweep into a file, which is written completely or not at all.

    A metric is shown as a curve if one parameter varies, as a map if two vary, as one map for each combination of the
    remaining parameters if more vary, and as a distribution if none varies. Over each drawn parameter, runs are points
    with their means. Variants are distinguished by colour or have separate maps.

    Args:
        folder: The folder of the sweep, which need not be finished.
        path: The file; its suffix determines the format.
        show: The metrics, in this order; "satisfied.NAME" and "robustness.NAME" are those of a specification. Empty for
            those that differ between runs.
        title: The text above the panels; None for the default: name, number of runs and seed.
        size: Width and height [inch]; None to fit the panels.
        dpi: Dots per inch.
        preset: Width, type and colours for a paper; None for the usual ones.

    Returns:
        The content of the picture.

    Raises:
        LogError: There is nothing to draw, no such metric, or matplotlib is not installed.
        OutputError: The file cannot be written.
    """
    path = Path(path)
    check_output(path, PlotRequest(size=size, dpi=dpi, preset=preset))
    with matplotlib_required():
        from symaware_cli.studies.picture.sweep_figure import draw
    picture = composed(finished_runs(SweepFolder.opened(folder)), show)
    with whole_file(path) as partial:
        draw(picture, partial, title, size, dpi, preset)
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
    """Draw the trajectories of the runs of a sweep into a file, which is written completely or not at all.

    The runs are repeated for this, so that no logs need be kept, and must have the same results as before.

    Args:
        folder: The folder of the sweep, which need not be finished.
        path: The file; its suffix determines the format.
        count: The maximum number of runs per combination; None for 1,000 in total.
        title: See `plot_sweep`.
        size: See `plot_sweep`.
        dpi: See `plot_sweep`.
        on_progress: Called after each run with the number of completed runs and the total.

    Returns:
        The content of the picture.

    Raises:
        LogError: There is nothing to draw, or matplotlib is not installed.
        SweepError: A repeated run differs from the original.
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
