"""Benchmark of `risk.specification`: 1,000 agents in noise, 100 samples, 20 steps ahead, one region to avoid.

``python benchmarks/risk.py [--turns N] [--profile]`` prints the CPU time of a turn: the least and the median. The
perfect perception and the controller beside it are not counted.
"""

import argparse
import cProfile
import json
import pstats
import statistics
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import symaware_cli as sa
from symaware_cli.planning.risk.failure_probability import FailureProbability, RiskEstimate

AGENTS, SAMPLES, STEP, STEPS = 1000, 100, 0.1, 20


def scenario(turns: int, interval: bool) -> dict[str, Any]:
    """The robots in front of a wall."""
    risk = {"specifications": ["safe"], "horizon": STEP * STEPS, "samples": SAMPLES}
    return {
        "symaware": 1,
        "name": "risk",
        "seed": 3,
        "run": {"duration": STEP * turns},
        "environment": {"use": "kinematic", "with": {"time_step": STEP}},
        "regions": {"wall": {"box": [4, 6, -1, 1]}},
        "agents": {
            "robot": {
                "count": AGENTS,
                "model": {"use": "single-integrator", "with": {"process_noise": 0.3}},
                "state": [{"uniform": [0, 4]}, {"uniform": [-3, 3]}],
                "knowledge": {"goal": [10, 0]},
                "components": {
                    "see": {"use": "perception.omniscient"},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 2.0}},
                    "risk": {"use": "risk.specification", "with": risk},
                },
            }
        },
        "specifications": {
            "safe": {"each": "robot", "formula": "always not inside(position, wall)", "interval": interval}
        },
    }


def turns_of(turns: int, interval: bool) -> list[float]:
    """Return the CPU time of each turn [s]."""
    measured: list[float] = []
    compute = FailureProbability._compute

    def timed(self: FailureProbability) -> RiskEstimate:
        begun = time.process_time()
        found = compute(self)
        measured.append(time.process_time() - begun)
        return found

    with TemporaryDirectory() as folder:
        path = Path(folder) / "risk.json.yaml"
        path.write_text(json.dumps(scenario(turns, interval)))
        FailureProbability._compute = timed  # type: ignore[method-assign]
        try:
            sa.load(path).run()
        finally:
            FailureProbability._compute = compute  # type: ignore[method-assign]
    return measured


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=10, help="turns of each case")
    parser.add_argument("--profile", action="store_true", help="print where the time goes instead")
    arguments = parser.parse_args()
    if arguments.profile:
        profile = cProfile.Profile()
        profile.runcall(turns_of, arguments.turns, False)
        pstats.Stats(profile).sort_stats("tottime").print_stats(22)
        return
    for interval in (False, True):
        measured = [1000 * each for each in turns_of(arguments.turns, interval)]
        said = "with the interval" if interval else "without the interval"
        print(f"{said}: {min(measured):.1f} ms a turn at least, {statistics.median(measured):.1f} ms in the median")


if __name__ == "__main__":
    main()
