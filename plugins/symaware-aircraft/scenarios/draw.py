"""Draw docs/pictures/intent-avoidance.png from logs of intent-avoidance.yaml and no-avoidance.yaml.

    symaware run intent-avoidance.yaml && symaware run no-avoidance.yaml
    python draw.py intent-avoidance.mcap no-avoidance.mcap intent-avoidance.png

Everything in the picture is read from the logs. Needs matplotlib.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from symaware_cli import open_log

#: rho [m].
SEPARATION = 2000.0**0.5
INK, FAINT, GROUND, ALARM = "#1f2933", "#9aa5b1", "#fbfaf7", "#d64545"
OWN, OTHER = "#2f6fde", "#e08a1e"

Array = NDArray[np.float64]


class Story:
    """The data of a log for the picture.

    Attributes:
        times: Instants of the states [s]; shape (k,).
        own: True poses of the ownship; shape (k, 3).
        intruder: Those of the intruder; shape (k, 3).
        separation: The distance between them [m]; shape (k,).
        moment: The index of the closest approach.
        plan: At that moment, the positions that the ownship means to pass [m]; shape (h, 2).
        path: Likewise the intruder.
        fan: At that moment, where each scenario has the intruder [m]; shape (M, h, 2).
        target: Where the ownship goes [m]; shape (2,).
        risk: Of the ownship, with its instants [s]; each of shape (m,).
    """

    def __init__(self, path: Path) -> None:
        self._log = open_log(path)
        truth = self._log.series("ownship", "world")
        self.times, self.own = truth.times / 1e9, truth.values
        self.intruder = self._log.series("intruder", "world").values
        self.separation = np.hypot(*(self.own - self.intruder)[:, :2].T)
        self.moment = int(self.separation.argmin())
        self.plan = self._then("ownship", "intent")[:, :2]
        self.path = self._then("intruder", "intent")[:, :2]
        spread = self._then("ownship", "uncertainty")
        self.fan = spread.reshape(len(spread), -1, 2).swapaxes(0, 1)
        known = next(iter(self._log.messages("/agents/ownship/knowledge"))).decode().values[0]
        self.target = np.array(json.loads(known)["target"][:2])
        risk = self._log.series("ownship", "risk")
        self.risk = risk.times / 1e9, risk.values[:, 0]

    def _then(self, agent: str, kind: str) -> Array:
        """Return a series of an agent at the moment of the picture."""
        end = round(self.times[self.moment] * 1e9) + 1
        *_, last = self._log.messages(f"/agents/{agent}/{kind}", end=end)
        return np.asarray(last.decode().values)


def draw_aircraft(axes: Axes, pose: Array, colour: str) -> None:
    """Draw an arrowhead along the direction of flight."""
    x, y, heading = pose
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    outline = np.array([[16.0, 0.0], [-10.0, 9.0], [-5.0, 0.0], [-10.0, -9.0]]) @ turn.T + (x, y)
    axes.add_patch(Polygon(outline, facecolor=colour, edgecolor="white", linewidth=1.0, zorder=6))


def draw_plane(axes: Axes, story: Story) -> None:
    """Draw both aircraft at the moment: past paths, intents, and scenarios of the intruder."""
    k = story.moment
    own, intruder = story.own[k], story.intruder[k]
    axes.add_patch(Circle(intruder[:2], SEPARATION, facecolor=ALARM, alpha=0.10, linewidth=0))
    axes.add_patch(Circle(intruder[:2], SEPARATION, facecolor="none", edgecolor=ALARM, linewidth=1.0, zorder=4))
    axes.add_collection(LineCollection(list(story.fan), colors=mpl.colors.to_rgba(OTHER, 0.3), linewidths=0.8))
    for way, ahead, colour in ((story.own, story.plan, OWN), (story.intruder, story.path, OTHER)):
        axes.plot(*way[: k + 1, :2].T, color=colour, linewidth=2.2, zorder=3)
        axes.plot(*ahead.T, color=colour, linewidth=1.6, linestyle=(0, (4, 2)), zorder=5)
        axes.plot(*way[0, :2], marker="o", color=colour, markersize=4)
        draw_aircraft(axes, way[k], colour)
    axes.plot(*story.target, marker="+", color=OWN, markersize=12, markeredgewidth=1.8)
    for text, place, colour, side in (
        ("ownship", np.add(story.own[22, :2], (10, -14)), OWN, "left"),
        ("its plan", np.add(story.plan[16], (-12, 0)), OWN, "right"),
        ("target", np.add(story.target, (14, 0)), OWN, "left"),
        ("intruder", np.add(story.intruder[16, :2], (-8, 10)), OTHER, "right"),
        ("its Dubins path", np.add(story.path[14], (40, -75)), OTHER, "left"),
        (f"in {len(story.fan)} scenarios", np.add(story.path[14], (40, -103)), OTHER, "left"),
        ("separation to keep", np.add(intruder[:2], (-SEPARATION - 8, 18)), ALARM, "right"),
    ):
        axes.text(place[0], place[1], text, color=colour, fontsize=8.5, ha=side, va="center")
    axes.set(xlim=(-140, 690), ylim=(-25, 600), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    apart, time = np.hypot(*(own - intruder)[:2]), story.times[k]
    axes.set_title(f"the closest approach: {apart:.2f} m at {time:g} s", loc="left")


def draw_separation(axes: Axes, story: Story, careless: Story) -> None:
    """Draw the distance with the controller and without the constraint, and the separation."""
    end = story.times[-1]
    axes.fill_between([0, end], 0, SEPARATION, color=ALARM, alpha=0.10, linewidth=0)
    axes.plot(careless.times, careless.separation, color=FAINT, linewidth=1.3)
    axes.plot(story.times, story.separation, color=INK, linewidth=1.6)
    axes.axvline(story.times[story.moment], color=FAINT, linewidth=0.9, linestyle=":")
    axes.text(
        end - 1, SEPARATION / 2, f"less than {SEPARATION:.1f} m", color=ALARM, fontsize=8.5, ha="right", va="center"
    )
    axes.text(20, story.separation[20] + 10, "scenario tree", fontsize=8.5)
    axes.text(25, careless.separation[25] - 8, "no avoidance", color=FAINT, fontsize=8.5, ha="right", va="top")
    axes.set(xlim=(0, end), ylim=(0, None), xlabel="simulated time [s]", ylabel="[m]")
    axes.set_title("distance between the two", loc="left")


def draw_risk(axes: Axes, story: Story) -> None:
    """Draw the fraction of scenarios that are a threat."""
    times, risk = story.risk
    axes.fill_between(times, 0, risk, color=ALARM, alpha=0.25, linewidth=0, step="post")
    axes.step(times, risk, color=ALARM, linewidth=1.3, where="post")
    axes.axvline(story.times[story.moment], color=FAINT, linewidth=0.9, linestyle=":")
    axes.set(xlim=(0, story.times[-1]), ylim=(0, 1.04), xlabel="simulated time [s]")
    axes.set_title("risk: scenarios that come within 60 m of the plan", loc="left")


def draw(log: Path, careless: Path, picture: Path) -> None:
    """Draw the logs of the two scenarios."""
    style: Any = {
        "font.family": "DejaVu Sans",
        "font.size": 9,
        "text.color": INK,
        "axes.edgecolor": FAINT,
        "axes.facecolor": GROUND,
        "axes.labelcolor": INK,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 10,
        "axes.titlecolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "figure.facecolor": GROUND,
    }
    with mpl.rc_context(style):
        figure = Figure(figsize=(10.5, 5.0), dpi=160, layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.35, 1))
        story = Story(log)
        draw_plane(figure.add_subplot(grid[:, 0]), story)
        draw_separation(figure.add_subplot(grid[0, 1]), story, Story(careless))
        draw_risk(figure.add_subplot(grid[1, 1]), story)
        # Without the software's version the same logs give the same file.
        figure.savefig(picture, metadata={"Software": None})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, help="a log of intent-avoidance.yaml")
    parser.add_argument("careless", type=Path, help="a log of no-avoidance.yaml")
    parser.add_argument("picture", type=Path, help="the picture to write")
    arguments = parser.parse_args()
    draw(arguments.log, arguments.careless, arguments.picture)
