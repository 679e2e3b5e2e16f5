"""Benchmark of batches: many runs as one array program, beside the same runs made one by one, and beside others.

``python batches.py`` prints runs and agent-steps per CPU-second. Everything that a row of a sweep costs is counted:
values drawn for the start, the run, metrics and hash. Batched runs, single runs and a NumPy program written by hand
alternate; the least CPU time over the rounds counts, since other programs only add time.

``--vmas PYTHON`` and ``--jaxmarl PYTHON`` name interpreters that can import these; each simulates 1,000 environments of
3 agents on one core. ``--memory RUNS`` prints the memory of a process during a sweep of that many small runs,
``--overhead`` the CPU time of a run of a sweep that makes them one by one, beside that of the bare run.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import symaware_cli
from symaware_cli.studies import SweepFolder, SweepRequest, conduct, read_sweep

HERE = Path(__file__).parent
HEAD_ON = HERE.parent / "scenarios" / "head-on.yaml"
RUNS, ALONE, PEER_STEPS, EACH = 1000, 4, 200, 100

SEEING = {"use": "perception.omniscient"}
MEASURING = {"use": "perception.range", "with": {"range": 0.001, "self_noise": 0.02}}
ANYWHERE = {"uniform": [-6, 6]}

#: Ten agents that meet in the middle, in 240 steps.
TEN: dict[str, Any] = {
    "symaware": 1,
    "name": "ten",
    "seed": 1,
    "run": {"duration": 12.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
    "agents": {
        "robot": {
            "count": 10,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "unicycle", "with": {"max_speed": 1.0}},
            "state": {"circle": {"radius": 6}},
            "knowledge": {"goal": {"circle": {"radius": 6, "phase": 3.14159}}},
            "components": {"sense": SEEING, "steer": {"use": "control.go-to-goal"}},
        }
    },
}
NOISY = {"model": {"use": "unicycle", "with": {"max_speed": 1.0, "process_noise": 0.02}}}
DRAWN = {**NOISY, "state": [ANYWHERE, ANYWHERE, 0], "knowledge": {"goal": [ANYWHERE, ANYWHERE]}}
TINY: dict[str, Any] = {
    "symaware": 1,
    "name": "tiny",
    "run": {"duration": 0.25},
    "environment": {"use": "kinematic"},
    "agents": {
        "robot": {
            "count": 2,
            "model": {"use": "single-integrator"},
            "state": {"uniform": [-5, 5]},
            "knowledge": {"goal": [0, 0]},
            "components": {"see": {"use": "perception.self"}, "go": {"use": "control.go-to-goal"}},
        }
    },
}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", default="", help="cases whose names contain this")
    parser.add_argument("--vmas", metavar="PYTHON")
    parser.add_argument("--jaxmarl", metavar="PYTHON")
    parser.add_argument("--memory", metavar="RUNS", type=int)
    parser.add_argument("--overhead", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.memory:
            _print_memory(Path(folder), arguments.memory)
        elif arguments.overhead:
            _print_overhead(Path(folder), arguments.rounds)
        else:
            _print_speed(Path(folder), arguments.rounds, arguments.only)
            _print_peer("VMAS, `navigation`", arguments.vmas, "vmas_navigation.py", arguments.rounds)
            _print_peer("JaxMARL, `MPE_simple_spread_v3`", arguments.jaxmarl, "jaxmarl_spread.py", arguments.rounds)


def _cases(folder: Path) -> Mapping[str, tuple[Path, Mapping[str, str], int, int]]:
    """The scenario, changes, agents and steps of each case, by its name."""
    risk = {"agents.robot.components.risk": "{use: risk.time-to-collision, with: {horizon: 3.0}}"}
    senses = {"agents.robot.components": yaml.safe_dump(_three_senses(), default_flow_style=True)}
    ten = _written(folder, "ten", TEN)
    drawn = _written(folder, "drawn", _ten_with(**DRAWN, components={**_steering(MEASURING)}))
    return {
        "head-on": (HEAD_ON, {}, 4, 240),
        "head-on with risk": (HEAD_ON, risk, 4, 240),
        "ten": (ten, {}, 10, 240),
        "ten, drawn starts and goals, noise of states and motion": (drawn, {}, 10, 240),
        "ten, four draws an agent in each step": (drawn, senses, 10, 240),
    }


def _steering(sense: Mapping[str, Any]) -> dict[str, Any]:
    return {"sense": sense, "steer": {"use": "control.go-to-goal"}}


def _three_senses() -> dict[str, Any]:
    return {"first": MEASURING, "second": MEASURING, **_steering(MEASURING)}


def _ten_with(**changes: Any) -> dict[str, Any]:
    return {**TEN, "agents": {"robot": {**TEN["agents"]["robot"], **changes}}}


def _written(folder: Path, name: str, document: Mapping[str, Any]) -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def _sweep(folder: Path, scenario: Path, changes: Mapping[str, str], runs: int) -> SweepFolder:
    document = {
        "symaware-sweep": 1,
        "scenario": str(scenario),
        "set": {k: yaml.safe_load(v) for k, v in changes.items()},
    }
    source = _written(Path(tempfile.mkdtemp(dir=folder)), "sweep", document)
    return SweepFolder.created(source.parent / "out", read_sweep(source, SweepRequest(entries={"runs": runs})))


def _print_speed(folder: Path, rounds: int, only: str) -> None:
    print("runs per CPU-second; agent-steps per CPU-second\n")
    cases = {name: case for name, case in _cases(folder).items() if only in name}
    least: dict[tuple[str, str], float] = {}

    def measure(name: str, way: str, runs: int, call: Callable[[], object]) -> None:
        began = time.process_time()
        call()
        least[name, way] = min((time.process_time() - began) / runs, least.get((name, way), np.inf))

    sweeps = {name: _sweep(folder, path, changes, RUNS) for name, (path, changes, _, _) in cases.items()}
    together = {name: sweep.runner(None) for name, sweep in sweeps.items()}
    alone = {name: sweep.runner(1) for name, sweep in sweeps.items()}
    for name in cases:
        reason = together[name].refusal([0])
        assert reason is None, reason
        list(together[name].rows(range(2)))
        alone[name].run(0)
    gc.freeze()  # as executors do
    for _ in range(rounds):
        measure("by hand", "batched", RUNS, by_hand)
        for name in cases:
            measure(name, "batched", RUNS, lambda runner=together[name]: list(runner.rows(range(RUNS))))  # type: ignore[misc]
            measure(name, "alone", ALONE, lambda runner=alone[name]: [runner.run(each) for each in range(ALONE)])  # type: ignore[misc]
    hand = least["by hand", "batched"]
    print(f"a NumPy program by hand, ten agents: {1 / hand:,.0f}; {2400 / hand:,.0f}")
    for name, (_, _, agents, steps) in cases.items():
        batched, single = least[name, "batched"], least[name, "alone"]
        print(
            f"{name}: {1 / batched:,.0f}; {agents * steps / batched:,.0f}; one by one {1 / single:,.0f};"
            f" {agents * steps / single:,.0f}; {single / batched:.0f} times as fast,"
            f" {batched / hand:.2f} of the time of the program by hand"
        )


def by_hand(runs: int = RUNS, agents: int = 10, steps: int = 240, step: float = 0.05) -> None:
    """Compute the case `ten` with nothing around it: unicycles, the least distance, and contacts that begin."""
    angle = np.arange(agents) * 2 * np.pi / agents
    x = np.repeat((6 * np.cos(angle))[:, None], runs, axis=1)
    y = np.repeat((6 * np.sin(angle))[:, None], runs, axis=1)
    heading, goal_x, goal_y = np.zeros_like(x), -x, -y
    pairs = agents * (agents - 1) // 2
    touching, contacts, least = np.zeros((pairs, runs), bool), np.zeros(runs, int), np.full(runs, np.inf)
    for _ in range(steps):
        way_x, way_y = goal_x - x, goal_y - y
        speed = np.minimum(1.0, np.sqrt(way_x * way_x + way_y * way_y))
        error = np.remainder(np.arctan2(way_y, way_x) - heading + np.pi, 2 * np.pi) - np.pi
        half = 0.5 * step * np.clip(4.0 * error, -2.0, 2.0)
        half += 1e-300 * (half == 0.0)
        chord = step * speed * np.maximum(np.cos(error), 0.0) * np.sin(half) / half
        x, y, heading = x + chord * np.cos(heading + half), y + chord * np.sin(heading + half), heading + 2.0 * half
        begin = 0
        for agent in range(agents - 1):
            end = begin + agents - 1 - agent
            square = (x[agent + 1 :] - x[agent]) ** 2 + (y[agent + 1 :] - y[agent]) ** 2
            np.minimum(least, square.min(axis=0), out=least)
            now = square < 0.36
            contacts += (now & ~touching[begin:end]).sum(axis=0)
            touching[begin:end], begin = now, end


def _print_peer(name: str, python: str | None, program: str, rounds: int) -> None:
    if python is None:
        print(f"{name}: skipped, no interpreter given")
        return
    command = [python, str(HERE / "peers" / program), "3", str(PEER_STEPS), "--environments", str(RUNS)]
    one = {min(os.sched_getaffinity(0))}
    flags = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    best = 0.0
    for _ in range(rounds):
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "XLA_FLAGS": flags},
            preexec_fn=lambda: os.sched_setaffinity(0, one),
        )
        if done.returncode:
            print(f"{name}: skipped, {(done.stderr.strip().splitlines() or ['it failed'])[-1]}")
            return
        found = json.loads(done.stdout.splitlines()[-1])
        best = max(best, found["agent_steps"] / found["cpu"])
    print(f"{name}, 1,000 environments of 3 agents: {best:,.0f} agent-steps per CPU-second")


def _print_memory(folder: Path, runs: int) -> None:
    sweep, marks = _sweep(folder, _written(folder, "tiny", TINY), {}, runs), {runs // 50, runs // 10, runs // 2, runs}

    def show(made: int) -> None:
        for mark in sorted(marks):
            if made >= mark:
                marks.discard(mark)
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                print(f"{made:,} runs: {pages * os.sysconf('SC_PAGE_SIZE') / 1e6:.0f} MB", flush=True)

    began = time.process_time()
    conduct(sweep, 0, on_progress=lambda progress: show(progress.made))
    print(f"{1e3 * (time.process_time() - began) / runs:.2f} ms of CPU time a run")


def _print_overhead(folder: Path, rounds: int) -> None:
    """Alternate bare runs and whole sweeps, with their journals and tables."""
    scenario = symaware_cli.Scenario(HEAD_ON)
    for _ in range(rounds):
        began = time.process_time()
        for seed in range(EACH):
            scenario.run(seed=seed, record=False)
        bare = time.process_time() - began
        sweep = _sweep(folder, HEAD_ON, {}, EACH)
        began = time.process_time()
        conduct(sweep, 0, batch=1)
        whole = time.process_time() - began
        print(f"head-on: {1e3 * bare / EACH:.1f} ms of CPU time a bare run, {1e3 * whole / EACH:.1f} a run of a sweep")


if __name__ == "__main__":
    main()
