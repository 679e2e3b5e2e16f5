"""What an agent costs in large runs, compared with the same mathematics in NumPy: ``python large.py [--rounds 3]``.

Unicycles steer to their goals at a density that does not depend on their number, and for each the time to collision
with its neighbours is computed (`bare_numpy.py`, with a list of neighbours that is kept while no agent has moved far).
The cost is the difference between a long and a short run, so that what a run needs once does not count. All cases of
a round run in turn, and the medians over the rounds are shown.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent

#: The case of `ours.py` and whether it is recorded.
CASES = {
    "NumPy, neighbours kept": ("numpy-kept", False),
    "NumPy, neighbours found anew": ("numpy", False),
    "built-in components with risk": ("risk", False),
    "the same, recorded": ("risk", True),
    "noisy perception and `uncertainty.gaussian`": ("gaussian", False),
    "points to their goals, without risk": ("stock", False),
    "the same points, recorded": ("stock", True),
}
#: Numbers of agents, with the numbers of steps of the short and the long run.
SIZES = {1_000: (60, 460), 10_000: (10, 60), 100_000: (4, 14)}


def main() -> None:
    """Measure all cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    found: dict[tuple[str, int], list[float]] = {(name, agents): [] for name in CASES for agents in SIZES}
    for _ in range(parser.parse_args().rounds):
        for name, agents in found:
            short, long = (_seconds(*CASES[name], agents, steps) for steps in SIZES[agents])
            found[name, agents].append(1e6 * (long - short) / (agents * (SIZES[agents][1] - SIZES[agents][0])))
    cost = {each: statistics.median(costs) for each, costs in found.items()}
    kept = next(iter(CASES))
    print("us per agent and step, and the speed compared with NumPy with kept neighbours\n")
    print("| | " + " | ".join(f"{agents:,} agents" for agents in SIZES) + " | growth from the first; from the second |")
    print("|---|" + "---:|" * (len(SIZES) + 1))
    first, second, last = SIZES
    for name in CASES:
        cells = [f"{cost[name, agents]:.2f}; {cost[kept, agents] / cost[name, agents]:.2f}" for agents in SIZES]
        growth = f"{cost[name, last] / cost[name, first]:.2f}; {cost[name, last] / cost[name, second]:.2f}"
        print(f"| {name} | {' | '.join(cells)} | {growth} |")


def _seconds(case: str, recorded: bool, agents: int, steps: int) -> float:
    command = [sys.executable, str(HERE / "ours.py"), case, str(agents), str(steps)]
    command += ["--record"] if recorded else []
    return float(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["cpu"])


if __name__ == "__main__":
    main()
