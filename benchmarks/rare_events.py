"""Benchmark of splitting: its cost beside that of plain runs, for the same precision, on a walk with known answers.

``python rare_events.py [--runs 30000]`` estimates how probable it is that the walk of scenarios/random-walk.yaml comes
to site 20 before site 0, for probabilities of a step up of 0.3 and 0.37. Of an estimate with the relative variance r,
plain runs of the same precision are (1 - p) / (p r) many. Their cost follows from that of a plain run, which is
measured; for 0.37 so many plain runs are made that the event is seen.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import symaware_cli as sa

SCENARIO = Path(__file__).parent.parent / "scenarios" / "random-walk.yaml"
LEVELS = [-12.5, -10.5, -8.5, -6.5, -4.5, -2.5]
SITES, START = 20, 5


def main() -> None:
    """Print the figures of both walks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30_000)
    runs = parser.parse_args().runs
    for up, plain in ((0.3, 2_000), (0.37, runs)):
        odds = (1.0 - up) / up
        known = (1.0 - odds**START) / (1.0 - odds**SITES)
        split, cost = estimate(up, LEVELS, trials=50, repeats=10)
        mean = split.probability.value
        relative = statistics.variance([each.estimate for each in split.repeats]) / len(split.repeats) / mean**2
        print(f"p = {up}, known {known:.4g}: {told(split)}, {cost:.1f} s of CPU time", flush=True)
        outright, spent = estimate(up, [], trials=plain // 10, repeats=10)
        needed = (1.0 - known) / (known * relative)
        print(f"  {plain} plain runs: {told(outright)}, {spent:.1f} s, {1e3 * spent / plain:.2f} ms a run")
        print(f"  plain runs of the same precision: {needed:.3g}, {needed * spent / plain:.3g} s", flush=True)
        print(f"  ratio of the costs: {needed * spent / plain / cost:.3g}", flush=True)


def estimate(up: float, levels: list[float], trials: int, repeats: int) -> tuple[sa.RareEventEstimate, float]:
    """Return an estimate, and the CPU time that it took [s]."""
    changes = {"agents.walker.components.walk.with.probabilities": [up, 1.0 - up], "run.duration": 1000.0}
    since = time.process_time()
    found = sa.estimate(
        SCENARIO, "far", levels, event="satisfied", trials=trials, repeats=repeats, changes=changes, seed=1
    )
    return found, time.process_time() - since


def told(found: sa.RareEventEstimate) -> str:
    """Return an estimate with its interval as text."""
    value = found.probability
    return f"{value.value:.3g} ({value.lower:.3g} to {value.upper:.3g})"


if __name__ == "__main__":
    main()
