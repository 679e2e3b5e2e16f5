"""The picture of an explanation: candidates, errors of beliefs, and instants at which corrections have effect."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.evidence.causes.explanation import CandidateRow, Explanation
from symaware_cli.log import LogError, OutputError, reason
from symaware_cli.views import AGENTS, RISK, hexadecimal, matplotlib_required

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: The greatest number of candidates in the picture.
_MOST = 14

#: The colour of cells in which nothing is believed; an error of 0 is nearly white.
_NOTHING = "#dfe3e9"

#: The formats, by the suffix of the file.
FORMATS = (".png", ".svg", ".pdf")

#: Widths of the picture and its row of a belief, and the room around the rows [inches].
_WIDTH, _ROW, _AROUND = 11.0, 0.5, 1.9


def require_timeline_format(path: Path) -> None:
    """Check the name of a picture before anything is run.

    Raises:
        LogError: The suffix is none of `FORMATS`, the path is a folder or in a folder that does not exist, or
            matplotlib is missing.
    """
    if path.suffix.lower() not in FORMATS:
        raise LogError(f"{path}: the picture of an explanation is a file {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    if path.is_dir():
        raise LogError(f"cannot write {path}: it is a folder")
    if not path.parent.is_dir():
        raise LogError(f"cannot write {path}: there is no folder {path.parent}")
    with matplotlib_required():
        import matplotlib  # noqa: F401


def draw_timeline(explanation: Explanation, path: Path) -> None:
    """Draw an explanation.

    Each row is a candidate. The band of a belief shows the error of the believed position, in white without a belief. A
    dot marks each instant from which the candidate was corrected; it is filled if that prevents the violation of this
    run. The text at the right is the difference that the correction makes in redrawn futures.

    Args:
        explanation: The explanation.
        path: A file .png, .svg or .pdf.

    Raises:
        LogError: matplotlib is not installed, or the file's name has another ending.
        OutputError: The file cannot be written.
    """
    require_timeline_format(path)
    with matplotlib_required():
        from matplotlib.figure import Figure

        from symaware_cli.views.plotting.figure_style import FAINT, save, styled
    rows = list(explanation.rows[:_MOST])
    with styled():
        figure = Figure(figsize=(_WIDTH, _AROUND + _ROW * max(len(rows), 1)))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        height = figure.get_figheight()
        axes.set_position((0.2, 0.95 / height, 0.46, 1.0 - _AROUND / height))
        _draw(axes, explanation, rows)
        figure.text(0.02, 1.0 - 0.3 / height, _title(explanation), weight="bold", va="center")
        figure.text(0.02, 1.0 - 0.58 / height, explanation.text, va="center", size=9.0, color=FAINT)
        try:
            save(figure, path, 150)
        except OSError as error:
            raise OutputError(f"cannot write {path}: {reason(error)}") from error


def _title(explanation: Explanation) -> str:
    beginning = f"{explanation.specification}, violated at {explanation.violated:g} s"
    if not explanation.is_among_candidates:
        return f"{beginning}: no cause in {explanation.where}"
    causes = [each.candidate.noun for each in explanation.causes[:2]]
    if not causes and explanation.together is not None:
        return f"{beginning}, together: {', and '.join(each.noun for each in explanation.together.candidates)}"
    return f"{beginning}: {', and '.join(causes)}" if causes else f"{beginning}: no single cause"


def _draw(axes: Axes, explanation: Explanation, rows: list[CandidateRow]) -> None:
    instants, times = explanation.plan.instants, np.asarray(explanation.times)
    step = float(times[1] - times[0]) if len(times) > 1 else 1.0
    begin, end = max(0.0, 2.0 * min(instants) - explanation.violated), explanation.violated + 3.0 * step
    shown = (times >= begin - 1e-9) & (times <= end)
    table = np.full((max(len(rows), 1), int(shown.sum())), np.nan)
    for number, row in enumerate(rows):
        if len(row.wrongness):
            table[number] = np.asarray(row.wrongness)[shown]
    known = table[np.isfinite(table)]
    greatest = float(np.quantile(known, 0.98)) if len(known) else 1.0
    edges = np.append(times[shown], times[shown][-1] + step)
    bands: Any = axes.pcolormesh(
        edges,
        np.arange(len(table) + 1) - 0.5,
        np.ma.masked_invalid(table),
        cmap="Oranges",
        vmin=0.0,
        vmax=greatest or 1.0,
    )
    axes.grid(visible=False)
    axes.set_facecolor(_NOTHING)
    for number in range(len(rows) + 1):
        axes.axhline(number - 0.5, color="white", linewidth=5)
    axes.axvline(explanation.violated, color=hexadecimal(RISK), linewidth=2)
    axes.text(explanation.violated, -0.6, "violated", color=hexadecimal(RISK), ha="right", va="bottom", size=9.0)
    ink = hexadecimal(AGENTS[0])
    for number, row in enumerate(rows):
        for instant, saved in zip(instants, row.in_this_run, strict=False):
            fill = ink if saved else "white"
            axes.plot(instant, number, "o", markersize=9, markerfacecolor=fill, markeredgecolor=ink, clip_on=False)
        weight = "bold" if row.is_cause else "normal"
        axes.text(
            1.02, number, _difference(row), transform=axes.get_yaxis_transform(), va="center", size=9.0, weight=weight
        )
    axes.set_yticks(range(len(rows)), [row.candidate.text for row in rows])
    for label, row in zip(axes.get_yticklabels(), rows, strict=True):
        label.set_fontweight("bold" if row.is_cause else "normal")
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.set_xlim(begin, end)
    axes.set_xlabel("time [s]")
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    figure = axes.figure
    height = figure.get_figheight()  # type: ignore[union-attr]
    bar = figure.add_axes((0.72, 0.62 / height, 0.24, 0.12 / height))
    colours = figure.colorbar(bands, cax=bar, orientation="horizontal", extend="max")
    colours.set_label("error of the believed position [m]", size=9.0)
    bar.tick_params(labelsize=8.0)
    filled = axes.plot(
        [], [], "o", color=ink, label=f"{explanation.made_right} from here on, it prevents this violation"
    )[0]
    hollow = axes.plot([], [], "o", markerfacecolor="white", markeredgecolor=ink, label="it does not")[0]
    from symaware_cli.views.plotting.figure_style import FAINT  # this module needs matplotlib

    blank = axes.plot([], [], "s", color=_NOTHING, markeredgecolor=FAINT, label="nothing believed")[0]
    figure.legend(
        handles=[filled, hollow, blank],
        loc="lower left",
        bbox_to_anchor=(0.01, 0.0),
        ncols=3,
        frameon=False,
        handletextpad=0.1,
    )


def _difference(row: CandidateRow) -> str:
    best = row.best
    if best is None:
        return "not compared" if row.is_uncompared else "no effect when screened"
    if not best.has_placebo:
        return f"saves only {best.shares.first} of {best.shares.trials} futures"
    return f"saves {100 * best.shares.difference:.0f} % more futures (at least {100 * best.lower:.0f} %)"
