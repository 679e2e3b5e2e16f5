"""Draw docs/pictures/hello.png from a log of scenarios/hello.yaml.

    symaware run scenarios/hello.yaml --output hello.mcap
    python docs/pictures/draw.py hello.mcap docs/pictures/hello.png

Everything in the picture is read from the log. Needs matplotlib (in the `dev` extra).
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from symaware_cli import open_log

GROUP = "robot"
MOMENT = 2.9  # seconds; every robot is under way, and its intent crosses those of the others

INK, FAINT, GROUND, ALARM = "#1f2933", "#9aa5b1", "#fbfaf7", "#d64545"
COLOURS = ("#2f6fde", "#e08a1e", "#1f9d6b", "#8a4fd0")

Array = NDArray[np.float64]


class Story:
    """What the picture needs of a log.

    Attributes:
        times: Instants of `states` [s]; shape (k,).
        states: True x [m], y [m], heading [rad] of each robot; shape (k, n, 3).
        intents: At the moment, the positions [m] that each robot means to pass; shape (n, h, 2).
        goals: Where each robot goes [m]; shape (n, 2).
        radius: Of each robot [m].
        contacts: For each pair of robots that touch, from when until when [s].
        place: Where they touch, on average [m]; shape (2,).
    """

    def __init__(self, path: Path) -> None:
        log = open_log(path)
        truth = log.series(GROUP, "world")
        self.times, self.states = truth.times / 1e9, truth.values
        end = round((MOMENT + 1e-6) * 1e9)
        last = list(log.messages(f"/agents/{GROUP}/intent", end=end))[-1].decode()
        self.intents = np.array([values for _, values in last])
        final = list(log.messages(f"/agents/{GROUP}/intent"))[-1].decode()
        self.goals = np.array([values[-1] for _, values in final])
        self.radius = log.manifest["groups"][GROUP]["entity"]["shape"]["circle"]["radius"]
        logged = list(log.contacts())
        begins = {(each.a, each.b): each for each in logged if each.stage == "BEGIN"}
        ends = {(each.a, each.b): each.time / 1e9 for each in logged if each.stage == "END"}
        self.contacts = {pair: (each.time / 1e9, ends[pair]) for pair, each in begins.items()}
        self.place: Array = np.mean([each.point for each in begins.values()], axis=0)

    def contact_span(self) -> tuple[float, float]:
        """When the first contact begins and the last one ends [s]."""
        return min(begin for begin, _ in self.contacts.values()), max(end for _, end in self.contacts.values())

    def separation(self) -> Array:
        """The distance [m] between the centres of the two robots nearest to each other; shape (k,)."""
        first, second = np.triu_indices(self.states.shape[1], 1)
        apart = np.linalg.norm(self.states[:, first, :2] - self.states[:, second, :2], axis=2)
        nearest: Array = apart.min(axis=1)
        return nearest


def fading(axes: Axes, points: Array, colour: str, *, width: float, start: float, end: float, order: int) -> None:
    """Draw a line whose opacity goes from one value to another along its way."""
    dense = np.linspace(0, len(points) - 1, 60)
    line = np.column_stack([np.interp(dense, range(len(points)), points[:, axis]) for axis in range(2)])
    pieces = np.stack([line[:-1], line[1:]], axis=1)
    shades = [mpl.colors.to_rgba(colour, alpha) for alpha in np.linspace(start, end, len(pieces))]
    axes.add_collection(LineCollection(list(pieces), colors=shades, linewidths=width, zorder=order))


def draw_plane(axes: Axes, story: Story) -> None:
    """The robots at the moment: where they were, where they are, where they mean to go."""
    index = int(np.searchsorted(story.times, MOMENT))
    for robot, colour in enumerate(COLOURS):
        way = story.states[:, robot]
        x, y, heading = way[index]
        axes.plot(way[:, 0], way[:, 1], color=FAINT, linewidth=0.8, linestyle=(0, (1, 3)), zorder=1)
        fading(axes, way[: index + 1, :2], colour, width=2.2, start=0.08, end=0.9, order=2)
        fading(axes, story.intents[robot], colour, width=7.0, start=0.55, end=0.04, order=3)
        axes.plot(*story.goals[robot], marker="+", color=colour, markersize=11, markeredgewidth=1.8, zorder=2)
        axes.add_patch(Circle((x, y), story.radius, facecolor=colour, edgecolor="white", linewidth=1.4, zorder=5))
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        nose = np.array([[0.2, 0.0], [-0.11, 0.12], [-0.05, 0.0], [-0.11, -0.12]]) @ turn.T + (x, y)
        axes.add_patch(Polygon(nose, facecolor="white", edgecolor="none", zorder=6))
        across = abs(np.sin(heading)) < 0.5  # it drives across the picture: the name stands above it, else beside it
        aside = (x, y + 0.42) if across else (x - 0.42, y)
        axes.text(
            *aside,
            f"robot.{robot}",
            color=colour,
            fontsize=8.5,
            ha="center" if across else "right",
            va="bottom" if across else "center",
            zorder=6,
        )
    middle = story.place
    axes.add_patch(Circle(middle, 0.42, facecolor="none", edgecolor=ALARM, linewidth=1.2, linestyle="--", zorder=4))
    axes.annotate(
        f"{len(story.contacts)} contacts, the first at {story.contact_span()[0]:g} s",
        tuple(middle + np.array([0.3, 0.3])),
        tuple(middle + np.array([1.1, 2.35])),
        color=ALARM,
        fontsize=9,
        arrowprops={"arrowstyle": "-", "color": ALARM, "linewidth": 0.8, "connectionstyle": "arc3,rad=0.2"},
    )
    axes.set(xlim=(-5.7, 5.7), ylim=(-5.7, 5.7), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_title(f"at {MOMENT:g} s: state, intent and goal of each robot", loc="left")


def draw_separation(axes: Axes, story: Story) -> None:
    """How near the two nearest robots are, and when that is too near."""
    apart, touch = story.separation(), 2 * story.radius
    axes.fill_between(story.times, 0, touch, color=ALARM, alpha=0.10, linewidth=0)
    axes.plot(story.times, apart, color=INK, linewidth=1.5)
    below = np.where(apart < touch, apart, np.nan)
    axes.plot(story.times, below, color=ALARM, linewidth=2.4)
    axes.text(story.times[-1] - 0.1, touch / 2, "touching", color=ALARM, fontsize=8.5, ha="right", va="center")
    axes.axvline(MOMENT, color=FAINT, linewidth=0.9, linestyle=":")
    axes.set(xlim=(0, story.times[-1]), ylim=(0, None), xlabel="simulated time [s]", ylabel="[m]")
    axes.set_title("least distance between two robots", loc="left")


def draw_contacts(axes: Axes, story: Story) -> None:
    """Which robots touch, from when until when."""
    for line, (pair, (begin, end)) in enumerate(reversed(story.contacts.items())):
        first, second = (COLOURS[int(agent.rpartition(".")[2])] for agent in pair)
        axes.plot([begin, end], [line + 0.11] * 2, color=first, linewidth=4.5, solid_capstyle="butt")
        axes.plot([begin, end], [line - 0.11] * 2, color=second, linewidth=4.5, solid_capstyle="butt")
        axes.text(end + 0.05, line, " and ".join(pair), fontsize=8.5, va="center")
    begin, end = story.contact_span()
    axes.set(xlim=(begin - 0.15, end + 0.75), ylim=(-0.6, len(story.contacts) - 0.4), xlabel="simulated time [s]")
    axes.set_title("who touches whom", loc="left")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)


def draw(log: Path, picture: Path) -> None:
    """Draw a log of the scenario."""
    style = {
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
        figure = Figure(figsize=(10, 5.2), dpi=160, layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1))
        story = Story(log)
        draw_plane(figure.add_subplot(grid[:, 0]), story)
        draw_separation(figure.add_subplot(grid[0, 1]), story)
        draw_contacts(figure.add_subplot(grid[1, 1]), story)
        # Without the software's version the same log gives the same file.
        figure.savefig(picture, metadata={"Software": None})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, help="a log of scenarios/hello.yaml")
    parser.add_argument("picture", type=Path, help="the picture to write")
    arguments = parser.parse_args()
    draw(arguments.log, arguments.picture)
