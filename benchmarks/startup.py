"""Benchmark of start-up: CPU time of whole processes, compared with ``python -c pass``.

``python benchmarks/startup.py [--rounds N]`` measures each command once per round, in turn, so that a temporary
slowdown of the machine affects all of them, and prints minimum, median and maximum of the ratios over the rounds.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

SCENARIO = Path(__file__).parent.parent / "scenarios" / "head-on.yaml"
PROGRAM = [sys.executable, "-P", "-m", "symaware_cli"]
VERSIONS = """
import time, symaware_cli.core
from symaware_cli.language.versions import versions
for name in ("first", "again"):
    began = time.process_time()
    versions()
    print(time.process_time() - began)
"""


def cpu_time(line: list[str]) -> float:
    """Run a process; return its user and system time, including children [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(line, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    # Bytecode is cached by default; without the cache, each process would compile the modules again.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryDirectory() as folder:
        log = str(Path(folder) / "head-on.mcap")
        commands = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "import numpy": [sys.executable, "-c", "import numpy"],
            "import numpy, pydantic, typer, rich": [sys.executable, "-c", "import numpy, pydantic, typer, rich"],
            "--version": [*PROGRAM, "--version"],
            "--help": [*PROGRAM, "--help"],
            "validate head-on": [*PROGRAM, "validate", str(SCENARIO)],
            "run head-on --no-record": [*PROGRAM, "run", "-q", "--no-record", str(SCENARIO)],
            "run head-on": [*PROGRAM, "run", "-q", str(SCENARIO), "--output", log],
        }
        for line in commands.values():
            cpu_time(line)
        times: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(rounds):
            for name, line in commands.items():
                times[name].append(cpu_time(line))
    print(
        "| command | CPU time, median | beside `python -c pass`: median | least | greatest |\n|---|---:|---:|---:|---:|"
    )
    for name, own in times.items():
        ratios = [one / base for one, base in zip(own, times["python -c pass"], strict=True)]
        figures = " | ".join(f"{value:.1f} x" for value in (statistics.median(ratios), min(ratios), max(ratios)))
        print(f"| `{name}` | {1e3 * statistics.median(own):.0f} ms | {figures} |")
    taken = [
        [float(each) for each in subprocess.check_output([sys.executable, "-c", VERSIONS], text=True).split()]
        for _ in range(rounds)
    ]
    told = {
        name: round(1e3 * statistics.median(part), 2)
        for name, part in zip(("first", "again"), zip(*taken, strict=True), strict=True)
    }
    print(f"\nversions() [ms]: {json.dumps(told)}")


if __name__ == "__main__":
    main()
