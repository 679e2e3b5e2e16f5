"""How often the robust controller and the one with a single scenario come too close, over seeds or realisations.

    python monte_carlo.py --seeds 50           # turn noise: the scenario tree beside a single scenario
    python monte_carlo.py --realisations       # the 20 intruders of the published figure, for the scenario tree

Each run is a `symaware run` of its own, of which only the summary is kept.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

HERE = Path(__file__).parent
#: rho = sqrt(2000) m, minus solver tolerances.
SEPARATION = 44.7213
#: The outlines of the two in these scenarios, discs, touch at this distance of their centres [m].
TOUCHING = 2 * 22.36
CONTROLLER = "agents.ownship.components.steer.with"
INTRUDER = "agents.intruder.components.fly.with"


def minimum_separation(scenario: str, seed: int, overrides: Sequence[str] = ()) -> float:
    """Run a scenario of this folder and return how close the two aircraft came [m]."""
    line = [sys.executable, "-m", "symaware_cli", "run", HERE / scenario, "--seed", seed, "--no-record", "--json"]
    line += [word for override in overrides for word in ("--set", override)]
    done = subprocess.run([str(word) for word in line], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{scenario} with the seed {seed} exited with {done.returncode}: {done.stderr}")
    value: float = json.loads(done.stdout)["minimum_separation"]["value"]
    return value + TOUCHING


def report(name: str, separations: Sequence[float]) -> None:
    """Print one line of the result."""
    close = sum(separation < SEPARATION for separation in separations)
    print(f"{name:16s} {len(separations):4d} runs  minimum {min(separations):.4f} m  below {SEPARATION} m: {close}")


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50, help="how many seeds of the turn noise (default 50)")
    parser.add_argument("--realisations", action="store_true", help="the realisations l = 1 .. 20 in place of noise")
    parser.add_argument("--set", action="append", default=[], help="passed on to every run", dest="overrides")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="how many runs at the same time")
    arguments = parser.parse_args()
    with ThreadPoolExecutor(arguments.jobs) as pool:
        if arguments.realisations:
            biases = [f"{INTRUDER}.turn_bias={1e-4 * (number - 10):.4f}" for number in range(1, 21)]
            runs = [[bias, *arguments.overrides] for bias in biases]
            separations = list(pool.map(partial(minimum_separation, "intent-avoidance.yaml", 0), runs))
            for number, separation in enumerate(separations, 1):
                print(f"l = {number:2d}  {separation:.4f} m")
            report("scenario tree", separations)
            return
        for name, horizon in (("scenario tree", 3), ("single scenario", 0)):
            overrides = [f"{CONTROLLER}.robust_horizon={horizon}", *arguments.overrides]
            run = partial(minimum_separation, "noisy.yaml", overrides=overrides)
            report(name, list(pool.map(run, range(arguments.seeds))))


if __name__ == "__main__":
    main()
