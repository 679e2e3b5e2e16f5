"""How much faster runs are with the optional compiled functions: ``python compiled.py [--rounds 5]``.

The package is built into a temporary folder. Each case runs in processes with and without it, in turn; the table shows
the median of the ratios of their CPU times, with the least and the greatest.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent

#: The case and its number of agents, steps of each run, and whether it is recorded.
CASES = {
    "4 unicycles with built-in components": ("stock-dash", 4, 3000, False),
    "4 unicycles, recorded": ("stock-dash", 4, 3000, True),
    "10 unicycles": ("stock-dash", 10, 3000, False),
    "10 unicycles, recorded": ("stock-dash", 10, 3000, True),
    "10 points": ("stock", 10, 3000, False),
    "1,000 unicycles": ("stock-dash", 1000, 200, False),
    "1,000 unicycles, recorded": ("stock-dash", 1000, 200, True),
    "10 unicycles in Python": ("dash", 10, 2000, False),
    "10 unicycles in Python, recorded": ("dash", 10, 2000, True),
    "10 unicycles in Python that fill a dictionary": ("dictionary", 10, 1000, False),
}

#: Batches of 1,000 runs, by their names in `batches.py`.
BATCHES = ("head-on", "ten", "ten, drawn starts and goals, noise of states and motion")

_BATCH = """
import sys, tempfile, time
from pathlib import Path
sys.path.insert(0, {here!r})
import batches
with tempfile.TemporaryDirectory() as folder:
    scenario, changes, _, _ = batches._cases(Path(folder))[{name!r}]
    runner = batches._sweep(Path(folder), scenario, changes, batches.RUNS).runner(None)
    list(runner.rows(range(2)))
    began = time.process_time()
    list(runner.rows(range(batches.RUNS)))
    print(time.process_time() - began)
"""


def main() -> None:
    """Build the package, measure all cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory() as folder:
        package = str(HERE.parent / "plugins" / "symaware-compiled")
        install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder, package]
        subprocess.run(install, check=True)
        commands = {name: _command(*case) for name, case in CASES.items()} | {
            f"batch: {name}": [sys.executable, "-c", _BATCH.format(here=str(HERE), name=name)] for name in BATCHES
        }
        ratios: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(rounds):
            for name, command in commands.items():
                ratios[name].append(_seconds(command, "") / _seconds(command, folder))
    print("| case | times as fast, median (least to greatest) |\n|---|---:|")
    for name, found in ratios.items():
        print(f"| {name} | {statistics.median(found):.2f} ({min(found):.2f} to {max(found):.2f}) |")


def _command(case: str, agents: int, steps: int, recorded: bool) -> list[str]:
    options = ["--record"] if recorded else []
    return [sys.executable, str(HERE / "ours.py"), case, str(agents), str(steps), *options]


def _seconds(command: list[str], package: str) -> float:
    """Return the CPU time that a command reports, in an environment with a folder of packages, or none."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, (str(HERE.parent), package)))}
    printed = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout.strip()
    return float(printed) if "{" not in printed else float(printed.partition('"cpu": ')[2].partition(",")[0])


if __name__ == "__main__":
    main()
