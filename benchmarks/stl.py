"""Benchmark of plans for specifications: the problems of stlpy, by our encoding and by stlpy's, side by side.

``python stl.py`` prints the robustness, the gap and the CPU time of each problem for both ways to tell alternatives
apart; the least CPU time over the rounds counts. ``--stlpy PYTHON`` names an interpreter that can import stlpy, Drake
and SciPy: it solves the same problems by the branch and bound of Drake, the only free solver that stlpy supports, and
stlpy's constraints by HiGHS. ``--case NAME`` selects problems whose names contain it.

The problems are those of V. Kurtz and H. Lin, "Mixed-integer programming for signal temporal logic with fewer binary
variables", IEEE Control Systems Letters 6, 2022: a double integrator x+ = x + v, v+ = v + u with velocities up to 1 and
control inputs up to 0.5, and the least robustness of all predicates as the reward.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

import symaware_cli  # noqa: F401 # selects the kernels of NumPy, before it is imported
from symaware_cli.geometry import Region
from symaware_cli.planning.optimal_control import (
    Affine,
    LinearDynamics,
    SpecificationPlan,
    SpecificationProgram,
    predicate_sets,
)
from symaware_cli.specification import formulate, parse

HERE = Path(__file__).parent
NAMES = {"position": Affine(np.eye(4)[:2])}
SECOND = 10**9


class Problem(NamedTuple):
    """A problem of stlpy: its name there, formula, regions, steps, first state, size of the workspace and seed."""

    peer: str
    formula: str
    regions: Mapping[str, Region]
    steps: int
    state: tuple[float, ...]
    size: float = 10.0
    seed: int = 0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--nodes", type=int, default=20_000)
    parser.add_argument("--case", default="")
    parser.add_argument("--stlpy", metavar="PYTHON")
    parser.add_argument("--limit", type=int, default=60, help="CPU time of each solver of stlpy [s]")
    arguments = parser.parse_args()
    print("| problem | by | binary variables | robustness | gap | CPU time to build and solve |")
    print("|---|---|---|---|---|---|")
    for name, problem in problems().items():
        if arguments.case in name:
            for alternatives in ("binary", "logarithmic"):
                _print_ours(name, problem, alternatives, arguments.rounds, arguments.nodes)
            if arguments.stlpy:
                _print_peer(name, problem, arguments.stlpy, arguments.limit)


def problems() -> dict[str, Problem]:
    """Return the problems by name."""
    goal, pond = _box(7, 8, 8, 9), _box(3, 5, 4, 6)
    rooms = {"goal": goal, "pond": pond, "left": _box(1, 2, 6, 7), "right": _box(6, 7, 4.5, 5.5)}
    walls = [_box(2, 5, 4, 6), _box(5.5, 9, 3.8, 5.7), _box(4.6, 8, 0.5, 3.5), _box(2.2, 4.4, 6.4, 11)]
    passage = {"goal": goal, "other": _box(9.5, 10.5, 1.5, 2.5), **{f"w{k}": each for k, each in enumerate(walls)}}
    found = {
        "either-or": Problem(
            "either-or",
            "eventually[0, 20] (always[0, 5] inside(position, left) or always[0, 5] inside(position, right))"
            " and always[0, 25] not inside(position, pond) and eventually[0, 25] inside(position, goal)",
            rooms,
            25,
            (2, 2, 0, 0),
        ),
        "reach-avoid": Problem(
            "reach-avoid",
            "always[0, 15] not inside(position, pond) and eventually[0, 15] inside(position, goal)",
            rooms,
            15,
            (1, 2, 0, 0),
        ),
        "narrow passage": Problem(
            "narrow passage",
            f"{_avoids(4, 25)} and eventually[0, 25] (inside(position, goal) or inside(position, other))",
            passage,
            25,
            (3, 3.6, 0, 0),
        ),
    }
    for seed in (0, 2, 3):
        found[f"random {seed}"] = _random(seed, 20)
    return found


def _random(seed: int, steps: int) -> Problem:
    """Return the random problem of stlpy with three obstacles and two targets of two colours, as it draws them."""
    generator = np.random.RandomState(seed)
    corners = [(generator.uniform(0, 9), generator.uniform(0, 9)) for _ in range(7)]
    regions = {f"w{k}": _box(x, x + 2, y, y + 2) for k, (x, y) in enumerate(corners[:3])}
    regions |= {f"t{k}": _box(x, x + 1, y, y + 1) for k, (x, y) in enumerate(corners[3:])}
    reached = " and ".join(
        f"eventually[0, {steps}] (inside(position, t{k}) or inside(position, t{k + 1}))" for k in (0, 2)
    )
    return Problem("random", f"{_avoids(3, steps)} and {reached}", regions, steps, (2, 2, 0, 0), seed=seed)


def _avoids(count: int, steps: int) -> str:
    return " and ".join(f"always[0, {steps}] not inside(position, w{k})" for k in range(count))


def _box(*bounds: float) -> Region:
    return Region(box=bounds)


def _print_ours(
    name: str, problem: Problem, alternatives: Literal["binary", "logarithmic"], rounds: int, nodes: int
) -> None:
    best, plan, binaries = np.inf, None, 0
    for _ in range(rounds):
        started = time.process_time()
        program = _program(problem, alternatives)
        plan = program.solve(nodes=nodes)
        best, binaries = min(best, time.process_time() - started), len(program.program.integers)
    assert plan is not None
    _print_row(name, f"ours, {alternatives}", binaries, *_outcome(plan), best)


def _program(problem: Problem, alternatives: Literal["binary", "logarithmic"]) -> SpecificationProgram:
    unit, none = np.eye(2), np.zeros((2, 2))
    dynamics = LinearDynamics(
        np.block([[unit, unit], [none, unit]]),
        np.concatenate([none, unit]),
        np.zeros(4),
        np.full(2, -0.5),
        np.full(2, 0.5),
        np.zeros((0, 2)),
        np.zeros(0),
    )
    text, size = problem.formula, problem.size
    formulation = formulate(parse(text, [*NAMES, *problem.regions], {"inside": 2}), SECOND)
    program = SpecificationProgram(
        dynamics,
        problem.state,
        problem.steps,
        lower=[0, 0, -1, -1],
        upper=[size, size, 1, 1],
        robustness_weight=1.0,
        alternatives=alternatives,
    )
    program.require("it", formulation.formula, predicate_sets(formulation, NAMES, problem.regions))
    return program


def _outcome(plan: SpecificationPlan) -> tuple[float, str]:
    gap = "infeasible" if plan.status == "infeasible" else f"{plan.solution.gap:.1g}"
    return plan.robustness.get("it", np.nan), gap


def _print_peer(name: str, problem: Problem, python: str, limit: int) -> None:
    for solver, encoding, by in (
        ("highs", "logarithmic", "stlpy, logarithmic, HiGHS"),
        ("highs", "binary", "stlpy, binary, HiGHS"),
        ("bnb", "logarithmic", "stlpy, logarithmic, Drake"),
    ):
        command = [python, str(HERE / "peers" / "stlpy_problems.py"), problem.peer, solver, "--encoding", encoding]
        command += ["--steps", str(problem.steps), "--size", str(problem.size), "--seed", str(problem.seed)]
        command += ["--limit", str(limit), "--state", *map(str, problem.state)]
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        if run.returncode:
            print(f"| {name} | {by} | | | | none within {limit} s |", flush=True)
            continue
        found = json.loads(run.stdout.splitlines()[-1])
        gap = {"optimal": "0", "limit": "limit"}.get(found["status"], found["status"])
        _print_row(name, by, found["binaries"], found["robustness"], gap, found["build"] + found["solve"])


def _print_row(name: str, by: str, binaries: int, robustness: float, gap: str, seconds: float) -> None:
    print(f"| {name} | {by} | {binaries} | {robustness:.4f} | {gap} | {seconds:.2f} s |", flush=True)


if __name__ == "__main__":
    main()
