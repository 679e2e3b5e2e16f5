"""Benchmark of small quadratic programs: `solve_qp` beside the backends of qpsolvers.

``python qp.py`` prints the median CPU time of a program, as the filters of control barrier functions have them: a few
variables, a 20-gon of inputs and some half planes. ``--qpsolvers PYTHON`` names an interpreter with qpsolvers and the
backends to compare (``pip install qpsolvers daqp piqp proxsuite clarabel``); it solves the same programs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symaware_cli.planning.optimal_control.qp import solve_qp

HERE = Path(__file__).parent
VARIABLES, FACES, PLANES, PROGRAMS = 2, 20, 4, 1000


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--qpsolvers", metavar="PYTHON")
    parser.add_argument("--programs", type=int, default=PROGRAMS)
    arguments = parser.parse_args()
    data = programs(arguments.programs)
    times = []
    solutions = np.full((arguments.programs, VARIABLES), np.nan)
    for number in range(arguments.programs):
        H, f, A, upper = (data[name][number] for name in ("H", "f", "A", "upper"))
        lower = np.full(len(upper), -np.inf)
        began = time.perf_counter_ns()
        found = solve_qp(H, f, A, lower, upper)
        times.append((time.perf_counter_ns() - began) / 1e3)
        if found.status == "solved":
            solutions[number] = found.x
    print(f"solve_qp: median {np.median(times):.1f} us, {np.isfinite(solutions[:, 0]).sum()} solved")
    if arguments.qpsolvers is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "programs.npz")
        np.savez(path, H=data["H"], f=data["f"], A=data["A"], upper=data["upper"], solutions=solutions)
        command = [arguments.qpsolvers, str(HERE / "peers" / "qpsolvers_programs.py"), str(path)]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    for each in json.loads(said):
        print(
            f"{each['backend']} by qpsolvers: median {each['median']:.1f} us, {each['solved']} solved,"
            f" at most {each['apart']:.1e} from solve_qp"
        )


def programs(count: int) -> dict[str, NDArray[np.float64]]:
    """Return random programs: the closest input to a requested one, of a 20-gon and within some half planes."""
    chance = np.random.default_rng(1)
    angles = np.arange(FACES) * 2 * np.pi / FACES
    polygon = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ways = chance.uniform(0, 2 * np.pi, (count, PLANES))
    planes = np.stack([np.cos(ways), np.sin(ways)], axis=2)
    wanted = chance.normal(size=(count, VARIABLES))
    return {
        "H": np.tile(np.eye(VARIABLES), (count, 1, 1)),
        "f": -wanted,
        "A": np.concatenate([np.tile(polygon, (count, 1, 1)), planes], axis=1),
        "upper": np.concatenate([np.ones((count, FACES)), chance.uniform(-0.3, 1, (count, PLANES))], axis=1),
    }


if __name__ == "__main__":
    main()
