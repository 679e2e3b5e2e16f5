"""Draw docs/pictures/promises.png, the figure of docs/promises.md, and print what the promise saves.

    python docs/pictures/promises.py docs/pictures

It runs `scenarios/promises.yaml` with and without the promise; everything in the picture is read from the logs. Needs
matplotlib (in the `plot` extra).
"""

import argparse
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

import symaware_cli as sa

SCENARIO = Path(__file__).parents[2] / "scenarios" / "promises.yaml"
INK, RED, ADAM, BOB = "#1f2933", "#d64545", "#e08a1e", "#2f6fde"
#: When the scene is shown [s].
SHOWN = 2.5


def draw(axes: Axes, log: sa.Log, title: str) -> None:
    """Draw the scene at an instant, with the risk map of Bob."""
    for y in (1.9, -1.9):
        axes.add_patch(Rectangle((-5.5, y - 0.3), 4.0, 0.6, color="#9aa5b1"))
    axes.add_patch(Rectangle((-6.5, -1.5), 6.7, 3.0, facecolor="none", edgecolor=RED, linewidth=1.5))
    if title.startswith("with "):
        axes.text(-6.3, 1.05, "red: Adam stays here", color=RED, fontsize=8)
    table = [each for each in log.tables("bob", "map.map") if each.time <= SHOWN * 1e9][-1]
    cells = [Rectangle((row[0], row[2]), row[1] - row[0], row[3] - row[2]) for row in table.values]
    shown = PatchCollection(cells, cmap="Reds", linewidths=0)
    shown.set_array(np.sqrt(table.values[:, 4]))
    shown.set_clim(0.0, 1.0)
    axes.add_collection(shown)
    axes.add_patch(Rectangle((-1.0, -5.0), 4.0, 10.0, facecolor="none", edgecolor=INK, linewidth=0.6, linestyle=":"))
    for name, colour in (("adam", ADAM), ("bob", BOB)):
        series = log.series(name, "state")
        past = series.times <= SHOWN * 1e9
        axes.plot(*series.values[:, :2].T, color=colour, linewidth=0.8, linestyle="--")
        axes.plot(*series.values[past, :2].T, color=colour, linewidth=1.6)
        place = series.values[past][-1]
        axes.add_patch(Circle((place[0], place[1]), 0.4, color=colour, zorder=3))
        axes.annotate(
            name.capitalize(), (place[0], place[1]), (0, 14), textcoords="offset points", ha="center", fontsize=9
        )
    axes.set(xlim=(-7.0, 3.5), ylim=(-5.2, 5.2), aspect="equal", title=title, xlabel="x [m]", ylabel="y [m]")


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    mpl.use("Agg")
    figure = Figure(figsize=(9.0, 4.8), layout="constrained")
    print("| | encounters evaluated for maps | highest risk | Bob's path [m] | Bob arrives [s] |")
    print("|---|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as scratch:
        for axes, title in zip(figure.subplots(1, 2), ("without the promise", "with the promise"), strict=True):
            changes: dict[str, object] = {} if title.startswith("with ") else {"promises": {}}
            path = Path(scratch) / f"{title}.mcap"
            sa.Scenario(SCENARIO, changes).run(output=path)
            log = sa.open_log(path)
            draw(axes, log, title)
            state = log.series("bob", "state")
            way = np.hypot(*np.diff(state.values[:, :2], axis=0).T).sum()
            near = np.hypot(*(state.values[:, :2] - [1.25, 4.0]).T) < 0.3
            arrives = state.times[near][0] / 1e9
            count, risk = log.series("bob", "map.evaluations").values.sum(), log.series("bob", "risk").values.max()
            print(f"| {title} | {count:.0f} | {risk:.3g} | {way:.2f} | {arrives:.1f} |")
    figure.savefig(folder / "promises.png", dpi=110)


if __name__ == "__main__":
    main()
