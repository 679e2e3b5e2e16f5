"""Worlds of IR-SIM in the language of scenarios: the lines of both, and the CPU time of a step.

    python benchmarks/irsim_worlds.py PATH_TO_IRSIM/usage [--time PYTHON]

`benchmarks/irsim_scenarios` has 20 worlds of its folder `usage` (https://github.com/hanruihua/ir-sim), written anew
with the same names. Lines are those of the YAML files, without comments and empty ones; the Python files beside the
worlds are not counted. Each of ours is run for 20 steps of 0.1 s. With `--time`, the interpreter of an environment in
which `ir-sim` is installed, its worlds are stepped as well, without pictures.

Exits with 1 if our files have more lines together, or one has more than 1.3 times as many.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import symaware_cli

HERE = Path(__file__).parent
OURS = HERE / "irsim_scenarios"

#: How many steps are timed, after a first one.
STEPS = 20

#: The largest ratio of lines for one world.
MOST = 1.3


def line_count(path: Path) -> int:
    """Return the number of lines that are neither empty nor comments alone."""
    lines = (line.strip() for line in path.read_text(encoding="utf-8").splitlines())
    return sum(bool(line) and not line.startswith("#") for line in lines)


def our_time(path: Path) -> float:
    """Return the CPU time of a step [s]."""
    with symaware_cli.load(path, {"run.until": None}).start() as simulation:
        simulation.step(1)
        started = time.process_time()
        simulation.step(STEPS)
        return (time.process_time() - started) / STEPS


def their_time(python: str, path: Path) -> float | None:
    """Return the CPU time of a step of IR-SIM [s]; None if it cannot be run."""
    line = [python, str(HERE / "peers" / "irsim_world.py"), path.name, str(STEPS)]
    try:
        done = subprocess.run(
            line, cwd=path.parent, capture_output=True, text=True, timeout=120, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired:
        print(f"{path.name}: not over within 120 s", file=sys.stderr)
        return None
    if done.returncode:
        print(f"{path.name}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return None
    return float(json.loads(done.stdout.strip().splitlines()[-1])["cpu"]) / STEPS


def milliseconds(seconds: float | None) -> str:
    """Return a time for the table."""
    return "" if seconds is None else f"{1e3 * seconds:.2f}"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("usage", type=Path, help="The folder `usage` of IR-SIM.")
    parser.add_argument("--time", metavar="PYTHON", help="An interpreter with IR-SIM.")
    arguments = parser.parse_args()
    print("| world | lines of IR-SIM | ours | ms a step of IR-SIM | ours |")
    print("|---|---:|---:|---:|---:|")
    theirs_in_all = ours_in_all = 0
    too_long = []
    for ours in sorted(OURS.glob("*.yaml")):
        (theirs,) = arguments.usage.glob(f"*/{ours.name}")
        their_lines, our_lines = line_count(theirs), line_count(ours)
        theirs_in_all, ours_in_all = theirs_in_all + their_lines, ours_in_all + our_lines
        if our_lines > MOST * their_lines:
            too_long.append(ours.name)
        taken = their_time(arguments.time, theirs) if arguments.time else None
        row = (theirs.relative_to(arguments.usage).with_suffix(""), their_lines, our_lines)
        print("|", " | ".join([*map(str, row), milliseconds(taken), milliseconds(our_time(ours))]), "|", flush=True)
    print(f"| together | {theirs_in_all} | {ours_in_all} | | |")
    for name in too_long:
        print(f"{name} has more than {MOST} times as many lines", file=sys.stderr)
    return int(bool(too_long) or ours_in_all > theirs_in_all)


if __name__ == "__main__":
    sys.exit(main())
