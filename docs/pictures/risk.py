"""Draw docs/pictures/risk-calibration.png, and print the figures of docs/risk.md.

    python docs/pictures/risk.py docs/pictures

1,000 robots pass a wall in noise; each estimates the risk of touching it once, at the start. They know nothing of each
other and have random numbers of their own, so they are 1,000 runs in one. Needs matplotlib (in the `plot` extra).
"""

import argparse
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import yaml
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binomtest

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

INK, FAINT, BLUE = "#1f2933", "#9aa5b1", "#2f6fde"

Array = NDArray[np.float64]

RUNS = 1000
EDGES = np.array([0.0, 0.005, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.001])


def scenario(method: str) -> dict[str, Any]:
    """The robots, at different places, so that some pass the wall safely and some will hardly miss it."""
    risk = {"specifications": ["safe"], "horizon": 3.0, "samples": 400, "method": method}
    return {
        "symaware": 1,
        "name": "risk-calibration",
        "seed": 1,
        "run": {"duration": 3.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "regions": {"wall": {"box": [1.5, 2.0, -1.0, 1.0]}},
        "agents": {
            "robot": {
                "count": RUNS,
                "model": {"use": "single-integrator", "with": {"process_noise": 0.3}},
                "state": [0.0, {"uniform": [-2.5, 2.5]}],
                "knowledge": {"goal": {"each": [[500.0, 0.0]] * RUNS}},
                "components": {
                    "see": {"use": "perception.self"},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0, "horizon": 4.0}},
                    "risk": {"use": "risk.specification", "period": 100.0, "with": risk},
                },
            }
        },
        "specifications": {
            "safe": {"each": "robot", "formula": "always not inside(position, wall)", "interval": False}
        },
    }


def estimated(method: str) -> tuple[Array, NDArray[np.bool_]]:
    """Return the risk of each robot at the start, and whether it came to touch the wall."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.yaml"
        path.write_text(yaml.safe_dump(scenario(method), sort_keys=False))
        built = build(path)
        assert execute(built, None).status == "finished"
        group = built.simulation.groups[0]
        shared = group.awareness.risk.shared
        assert shared is not None
        statuses = [group.specifications["safe"].of(id) for id in group.ids]
        return shared[1].ravel(), np.array([each is not None and each.verdict is False for each in statuses])


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    mpl.use("Agg")
    figure = Figure(figsize=(4.4, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=FAINT, linewidth=1)
    risks, failed = estimated("sampling")
    spread = float(np.sum(risks * (1 - risks)))
    print(f"expected {risks.sum():.1f}, failed {failed.sum()}, z {(failed.sum() - risks.sum()) / np.sqrt(spread):.2f}")
    for low, high in pairwise(EDGES):
        chosen = (risks >= low) & (risks < high)
        if not chosen.any():
            continue
        count, bad, mean = int(chosen.sum()), int(failed[chosen].sum()), float(risks[chosen].mean())
        interval = binomtest(bad, count).proportion_ci()
        print(f"{mean:.3f}  {bad} of {count}  {bad / count:.3f}  {interval.low:.3f} to {interval.high:.3f}")
        axes.plot([mean, mean], [interval.low, interval.high], color=BLUE, linewidth=1.5)
        axes.plot(mean, bad / count, "o", color=BLUE, markersize=4)
    bounds, _ = estimated("normal")
    print(f"bounds below the estimate by more than 4 errors: {(bounds < risks - 4 * 0.025).sum()}")
    print(f"mean risk {risks.mean():.4f}, mean bound {bounds.mean():.4f}, share {failed.mean():.4f}")
    axes.set_xlabel("estimated risk", color=INK)
    axes.set_ylabel("share of runs that fail", color=INK)
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(-0.02, 1.02)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(folder / "risk-calibration.png", dpi=90)


if __name__ == "__main__":
    main()
