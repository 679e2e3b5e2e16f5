"""Benchmark of a run in two processes: CPU time per step of `hello.yaml`, compared with the same run in one process.

``python processes.py`` prints microseconds as JSON. A figure is the difference in CPU time, user and system, between a
long and a short run, divided by the difference in steps, so that start-up and end cancel. The overhead is the sum of
both processes minus the run in one. The cases alternate; the minimum over the rounds counts, since other programs only
add time.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
PROGRAM = Path(sys.executable).with_name("symaware")
STEPS = 200, 4200

#: The agents that the member runs; the host runs the others.
WAYS = {"member runs all": "robot", "half each": "robot.[01]"}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario", nargs="?", default=str(HERE.parent / "scenarios" / "hello.yaml"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="with logs")
    arguments = parser.parse_args()
    least: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.rounds):
            for name, figure in _measure(arguments.scenario, folder if arguments.record else None).items():
                least[name] = min(figure, least.get(name, figure))
    for way in WAYS:
        least[f"{way}: two processes beside one"] = least[f"{way}: host"] + least[f"{way}: member"] - least["alone"]
    print(json.dumps({name: round(figure, 1) for name, figure in least.items()}, indent=2))


def _measure(scenario: str, folder: str | None) -> dict[str, float]:
    figures: dict[str, list[float]] = {}
    for steps in STEPS:
        common = [str(PROGRAM), "run", scenario, "--quiet", "--set", f"run.duration={0.05 * steps}"]
        output = [] if folder else ["--no-record"]
        for name, seconds in _together([[*common, *output]], folder).items():
            figures.setdefault(("alone", "")[name], []).append(seconds)
        for way, only in WAYS.items():
            port = _free_port()
            host = [*common, *output, "--listen", str(port)]
            if way == "half each":
                host += ["--only", "robot.[23]"]
            member = [*common, *output, "--join", f"127.0.0.1:{port}", "--only", only]
            for name, seconds in _together([host, member], folder).items():
                figures.setdefault(f"{way}: {('host', 'member')[name]}", []).append(seconds)
    return {name: 1e6 * (long - short) / (STEPS[1] - STEPS[0]) for name, (short, long) in figures.items()}


def _together(lines: list[list[str]], folder: str | None) -> dict[int, float]:
    """Run commands simultaneously; return the CPU time of each [s]."""
    if folder:
        lines = [
            [*line, "--output", os.devnull if False else f"/dev/shm/processes-{i}.mcap"] for i, line in enumerate(lines)
        ]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    running = [subprocess.Popen(line, env=environment, stdout=subprocess.DEVNULL) for line in lines]
    spent = {}
    for number, process in enumerate(running):
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{' '.join(lines[number])} failed")
        spent[number] = usage.ru_utime + usage.ru_stime
    return spent


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
