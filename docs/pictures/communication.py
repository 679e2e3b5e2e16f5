"""Draw docs/pictures/consensus.png and gossip.png, the figures of docs/communication.md.

    python docs/pictures/communication.py docs/pictures

Makes runs of its own, about a minute of them; everything in the pictures is read from their logs. Needs matplotlib (in
the `plot` extra).
"""

import argparse
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.reader import Log

INK, FAINT = "#1f2933", "#9aa5b1"
COLOURS = ("#2f6fde", "#e08a1e", "#1f9d6b", "#8a4fd0")

Array = NDArray[np.float64]

#: Topologies of 20 agents, each with a gain.
GRAPHS = {
    "ring": ("{use: ring}", 0.4),
    "star": ("{use: star}", 0.05),
    "random": ("{use: random, with: {probability: 0.2, connected: true}}", 0.1),
}


def logged(content: str, folder: Path) -> Log:
    """Run a scenario and open its log."""
    path, log = folder / "scenario.yaml", folder / "scenario.mcap"
    path.write_text(content)
    execute(build(path), log)
    return open_log(log)


def consensus(topology: str, gain: float, loss: float, turns: int, folder: Path) -> tuple[Array, float]:
    """How far all values together are from the mean at each turn, and the factor that the Laplacian predicts."""
    count = 20
    log = logged(
        f"""
symaware: 1
name: consensus
seed: 4
run: {{duration: {turns * 0.1}}}
environment: {{use: kinematic, with: {{time_step: 0.1}}}}
agents:
  node:
    count: {count}
    model: {{use: single-integrator}}
    knowledge: {{value: {{uniform: [0, 10]}}}}
    components: {{agree: {{use: communication.consensus, with: {{gain: {gain}}}}}}}
topology: {topology[:-1]}, channel: {{loss: {loss}}}}}
""",
        folder,
    )
    values = np.full((turns + 1, count), np.nan)
    for entry in log.knowledge("node"):
        values[round(entry.time / 1e8), int(entry.agent.rpartition(".")[2])] = entry.values["value"]
    values[1] = np.where(np.isnan(values[1]), values[0], values[1])
    kept = ~np.isnan(values).any(axis=1)
    values = values[kept]
    adjacency = np.zeros((count, count))
    roster = log.manifest["roster"]
    for told in log.communications(end=1):
        adjacency[roster.index(told.sender), roster.index(told.receiver)] = 1.0
    eigenvalues = np.linalg.eigvalsh(np.diag(adjacency.sum(axis=1)) - adjacency)
    error = np.linalg.norm(values - values[0].mean(), axis=1)
    return error / error[0], float(max(1 - gain * eigenvalues[1], gain * eigenvalues[-1] - 1))


def gossip(count: int, seed: int, folder: Path) -> Array:
    """The turn at which each of some agents came to know a rumour, ascending."""
    log = logged(
        f"""
symaware: 1
name: rumour
seed: {seed}
run: {{duration: 40}}
environment: {{use: kinematic, with: {{time_step: 1.0}}}}
agents:
  teller:
    model: {{use: single-integrator}}
    knowledge: {{rumour: fire}}
    components: {{tell: {{use: communication.gossip}}}}
  listener:
    count: {count - 1}
    model: {{use: single-integrator}}
    components: {{tell: {{use: communication.gossip}}}}
topology: {{use: complete}}
recording: {{messages: none, omit: [world, state, knowledge, control, awareness]}}
""",
        folder,
    )
    return np.sort([0.0, *(event.time / 1e9 for event in log.events() if event.name == "informed")])


def main() -> None:
    """Draw both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    mpl.rcParams.update({"font.size": 9, "axes.edgecolor": FAINT, "text.color": INK, "axes.labelcolor": INK})
    with tempfile.TemporaryDirectory() as scratch:
        _draw_consensus(folder / "consensus.png", Path(scratch))
        _draw_gossip(folder / "gossip.png", Path(scratch))


def _draw_consensus(path: Path, scratch: Path) -> None:
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    turns = 150
    for axes, loss in zip(panels, (0.0, 0.2), strict=True):
        for (name, (topology, gain)), colour in zip(GRAPHS.items(), COLOURS, strict=False):
            error, factor = consensus(topology, gain, loss, turns, scratch)
            axes.semilogy(error, color=colour, lw=1.8, label=f"{name}: {factor:.3f}")
            # Where it has begun to follow the slowest mode.
            start = 30
            line = error[start] * factor ** np.arange(-start, len(error) - start)
            axes.semilogy(line, color=INK, lw=0.8, ls=(0, (4, 3)), zorder=3)
        axes.set(xlabel="turn", ylim=(1e-7, 2.0), xlim=(0, turns))
        axes.set_title("every message arrives" if not loss else "a fifth of all messages is lost", fontsize=10)
        _tidy(axes)
    panels[0].set_ylabel("distance to the mean, of the first")
    panels[0].plot([], [], color=INK, lw=0.8, ls=(0, (4, 3)), label="predicted")
    panels[0].legend(frameon=False, fontsize=8, loc="lower left")
    figure.savefig(path, dpi=130)


def _draw_gossip(path: Path, scratch: Path) -> None:
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    spread, rounds = figure.subplots(1, 2)
    counts, seeds = (10, 30, 100, 300, 1000), (1, 2, 3)
    taken: dict[int, list[float]] = {}
    shown = dict(zip((10, 100, 1000), COLOURS, strict=False))
    for count in counts:
        for seed in seeds:
            times = gossip(count, seed, scratch)
            taken.setdefault(count, []).append(times[-1])
            if seed == seeds[0] and count in shown:
                share = np.arange(1, len(times) + 1) / count
                spread.step(
                    [*times, 30.0], [*share, share[-1]], where="post", color=shown[count], label=f"{count} agents"
                )
    spread.set(xlabel="turn", ylabel="share of those who know", xlim=(0, 26), ylim=(0, 1.03))
    spread.legend(frameon=False, fontsize=8, loc="lower right")
    for count, each in taken.items():
        rounds.plot(
            [count] * len(each), each, "o", color=COLOURS[0], ms=4, label="runs" if count == counts[0] else None
        )
    axis = np.geomspace(10, 1000, 50)
    rounds.plot(axis, np.log2(axis) + np.log(axis), color=INK, lw=1.0, ls=(0, (4, 3)), label="log₂ n + ln n")
    rounds.set(xlabel="agents", ylabel="turns until all know", xscale="log", ylim=(0, 26))
    rounds.legend(frameon=False, fontsize=8, loc="upper left")
    for axes in (spread, rounds):
        _tidy(axes)
    figure.savefig(path, dpi=130)


def _tidy(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=INK, labelsize=8)
    axes.grid(color="#e5e9ee", lw=0.6)
    axes.set_axisbelow(True)


if __name__ == "__main__":
    main()
