"""Benchmark of a run in two processes: CPU time per step of `head-on.yaml`, compared with the same run in one process.

``python processes.py`` prints microseconds as JSON. Each process reads its own CPU time, user and system, during the
run; its figure is the least over windows of a quarter of the steps, so that start-up and end do not count. The overhead
is the sum of both processes minus the run in one. The cases alternate; the minimum over the rounds counts, since other
programs only add time. ``--other PYTHON`` measures another installation in the same rounds.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

SCENARIO = Path(__file__).parent.parent / "scenarios" / "head-on.yaml"

#: The agents that the host and the member run; nothing stands for what is left.
WAYS = {"member runs all": ("", "robot"), "half each": ("robot.[23]", "robot.[01]")}


def main() -> None:
    """Print the figures, or, as one of the processes that are measured, the CPU time of a step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default=str(SCENARIO))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--other", metavar="PYTHON", help="the interpreter of another installation to compare with")
    parser.add_argument("--as", nargs=3, metavar=("ROLE", "PORT", "ONLY"), dest="process", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.process:
        print(_spent(given.scenario, given.steps, *given.process))
        return
    interpreters = {"": sys.executable} | ({"other: ": given.other} if given.other else {})
    least: dict[str, float] = {}
    for _ in range(given.rounds):
        for prefix, python in interpreters.items():
            for name, figure in _measure([python, __file__, given.scenario, "--steps", str(given.steps)]).items():
                least[prefix + name] = min(figure, least.get(prefix + name, figure))
    for prefix in interpreters:
        for way in WAYS:
            both = least[f"{prefix}{way}: host"] + least[f"{prefix}{way}: member"]
            least[f"{prefix}{way}: two processes beside one"] = both - least[f"{prefix}alone"]
    print(json.dumps({name: round(figure, 1) for name, figure in least.items()}, indent=2))


def _measure(command: list[str]) -> dict[str, float]:
    """Run the scenario alone and in both ways; return the CPU time of a step of each process [us]."""
    figures = {"alone": _together(command, [("alone", "0", "")])[0]}
    for way, (host, member) in WAYS.items():
        port = str(_free_port())
        pair = _together(command, [("host", port, host), ("member", port, member)])
        figures |= {f"{way}: host": pair[0], f"{way}: member": pair[1]}
    return figures


def _together(command: list[str], processes: list[tuple[str, str, str]]) -> list[float]:
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    running = [
        subprocess.Popen([*command, "--as", *each], env=os.environ | threads, stdout=subprocess.PIPE, text=True)
        for each in processes
    ]
    said = [process.communicate()[0] for process in running]
    if any(process.returncode for process in running):
        raise SystemExit(f"{processes} failed")
    return [float(each.splitlines()[-1]) for each in said]


def _spent(scenario: str, steps: int, role: str, port: str, only: str) -> float:
    """Run the scenario as one process of a run; return its CPU time per step [us]."""
    import symaware_cli as sa

    loaded = sa.load(scenario, {"run.duration": 0.05 * steps})
    agents = [only] if only else []
    places = {"host": lambda: sa.Place.host(int(port), *agents)}
    places["member"] = lambda: sa.Place.member(f"127.0.0.1:{port}", *agents)
    place = places[role]() if role in places else None
    seen: list[tuple[float, float]] = []
    loaded.run(record=False, place=place, progress=lambda now: seen.append((now / 0.05, time.process_time())))
    seen = [each for each in seen if 50 < each[0] < steps - 20]
    least = float("inf")
    for begin, (step, spent) in enumerate(seen):
        later = next((each for each in seen[begin:] if each[0] - step >= steps / 4), None)
        if later is not None:
            least = min(least, (later[1] - spent) / (later[0] - step))
    return 1e6 * least


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
