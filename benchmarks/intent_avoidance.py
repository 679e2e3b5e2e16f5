"""Benchmark of the scenario-tree MPC of case study I, compared with the same program in plain CasADi and IPOPT.

    pip install --no-deps ./plugins/symaware-aircraft
    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python benchmarks/intent_avoidance.py

It measures the CPU time of whole turns of the controller, from the perceived states to the control input: rolling out
28 scenarios, solving, and for SymAware also shifting the plan, risk and uncertainty. Every case flies its own 82 steps
in closed loop. The cases alternate, round after round, and the best round of each step counts, to exclude disturbances
by the machine. Finally, the whole run is timed, including recording, without start-up.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray
from symaware_aircraft import ScenarioTree, rollout, shortest_path

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

SCENARIO = Path(__file__).parents[1] / "plugins" / "symaware-aircraft" / "scenarios" / "intent-avoidance.yaml"
STEPS = 82
CONTROLLER = "agents.ownship.components.steer"

Array = NDArray[np.float64]


def plain_program(horizon: int, scenarios: int) -> Callable[..., dict[str, casadi.DM]]:
    """Formulate the program directly: multiple shooting, all states, then all inputs; IPOPT as in published runs.

    Its parameters are the present state, then x and y of each scenario at the stages 0 to N.
    """
    states, inputs = casadi.SX.sym("x", 3, horizon + 1), casadi.SX.sym("u", 2, horizon)
    present, others = casadi.SX.sym("present", 3), casadi.SX.sym("others", 2, (horizon + 1) * scenarios)
    target = casadi.DM([420.0, 560.0, np.pi / 2])
    cost = casadi.sumsqr(states[:, horizon] - target)
    constraints, lower, upper = [states[:, 0] - present], [0.0] * 3, [0.0] * 3
    for k in range(horizon):
        x, u = states[:, k], inputs[:, k]
        cost += 0.1 * casadi.sumsqr(x - target)
        if k:
            cost += 5.5e6 * (u[1] - inputs[1, k - 1]) ** 2
        after = x + casadi.vertcat(u[0] * casadi.cos(x[2]), u[0] * casadi.sin(x[2]), u[1])
        constraints.append(states[:, k + 1] - after)
        lower += [0.0] * 3
        upper += [0.0] * 3
    for j in range(scenarios):
        # Only the last scenario, the intent itself, counts at the end of the horizon.
        for k in range(1, horizon + (j == scenarios - 1)):
            constraints.append(casadi.sumsqr(states[:2, k] - others[:, j * (horizon + 1) + k]))
            lower.append(2000.0)
            upper.append(np.inf)
    program = {
        "x": casadi.veccat(states, inputs),
        "p": casadi.veccat(present, others),
        "f": cost,
        "g": casadi.vertcat(*constraints),
    }
    options: dict[str, Any] = {
        "ipopt.mu_init": 1e-4,
        "ipopt.mu_target": 1e-4,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
    }
    solve = casadi.nlpsol("plain", "ipopt", program, {**options, "print_time": False})
    free = np.full(3 * (horizon + 1), np.inf)
    low, high = np.append(-free, np.tile([6.0, -0.1], horizon)), np.append(free, np.tile([9.0, 0.1], horizon))
    return lambda guess, values: solve(x0=guess, p=values, lbx=low, ubx=high, lbg=lower, ubg=upper)


def plain(horizon: int) -> tuple[Array, float]:
    """Fly the encounter with the plain program; return the CPU time of each turn [s] and the minimum separation [m]."""
    tree = ScenarioTree(horizon, 3, 0.07, "recorded")
    solve = plain_program(horizon, tree.count)
    own, intruder = np.zeros(3), np.array([-120.0, 90.0, 0.0])
    path = shortest_path(intruder, (600, 450, 0), 10 / 0.07)
    intended = np.append(path.turn_rates(10.0, 1.0, "recorded"), np.zeros(horizon))
    inputs = np.tile([9.0, 0.0], (horizon, 1))
    taken, separation = np.empty(STEPS), np.hypot(*(own - intruder)[:2])
    for k in range(STEPS):
        begun = time.process_time()
        guess = np.append(rollout(own, inputs[:, 0], inputs[None, :, 1], 1.0), inputs)
        scenarios = rollout(intruder, 10.0, tree.turn_rates(intended[k : k + horizon]), 1.0)[:, :, :2]
        found = solve(guess, np.append(own, scenarios))
        inputs = np.array(found["x"]).ravel()[3 * (horizon + 1) :].reshape(horizon, 2)
        taken[k] = time.process_time() - begun
        own = rollout(own, inputs[:1, 0], inputs[None, :1, 1], 1.0)[0, 1]
        intruder = rollout(intruder, 10.0, intended[None, k : k + 1], 1.0)[0, 1]
        separation = min(separation, np.hypot(*(own - intruder)[:2]))
        inputs = np.append(inputs[1:], inputs[-1:], axis=0)
    return taken, float(separation)


def ours(horizon: int, solver: str) -> tuple[Array, float]:
    """Do the same with SymAware."""
    built = build(SCENARIO, [f"{CONTROLLER}.with.horizon={horizon}", f"{CONTROLLER}.with.solver={solver}"])
    events, taken = built.simulation.events, []
    begun = 0.0

    def begin(_: object) -> None:
        nonlocal begun
        begun = time.process_time()

    events.subscribe("computing", begin, "agents.ownship.steer")
    events.subscribe("computed", lambda _: taken.append(time.process_time() - begun), "agents.ownship.steer")
    summary = execute(built, None)
    assert summary.status == "finished"
    assert summary.minimum_separation is not None
    radii = sum(group.entity.radius for group in built.simulation.groups)
    return np.array(taken), summary.minimum_separation.value + radii  # of centres: outlines are discs


def whole_run(folder: str) -> float:
    """Return the CPU time of the recorded run, without start-up [s]."""
    built = build(SCENARIO)
    begun = time.process_time()
    execute(built, Path(folder) / "run.mcap")
    return time.process_time() - begun


def main() -> None:
    """Measure and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--horizons", type=int, nargs="+", default=[10, 20, 30])
    arguments = parser.parse_args()
    cases: dict[str, Callable[[int], tuple[Array, float]]] = {
        "fatrop": lambda horizon: ours(horizon, "fatrop"),
        "IPOPT": lambda horizon: ours(horizon, "ipopt"),
        "plain IPOPT": plain,
    }
    print(f"casadi {version('casadi')}, numpy {version('numpy')}; CPU time of a turn, the best of {arguments.rounds}\n")
    print("| N | program | mean | median | worst | plain by this, mean | minimum separation |")
    print("|---|---|---:|---:|---:|---:|---:|")
    for horizon in arguments.horizons:
        best: dict[str, Array] = {}
        separations: dict[str, float] = {}
        for _ in range(arguments.rounds):
            for case, fly in cases.items():
                taken, separations[case] = fly(horizon)
                best[case] = np.minimum(best.get(case, np.inf), taken)
        reference = best["plain IPOPT"].mean()
        for case, taken in best.items():
            mean, median, worst = (f"{1e3 * each:.1f} ms" for each in (taken.mean(), np.median(taken), taken.max()))
            ratio = f"{reference / taken.mean():.1f}"
            print(f"| {horizon} | {case} | {mean} | {median} | {worst} | {ratio} | {separations[case]:.4f} m |")
    with tempfile.TemporaryDirectory() as folder:
        seconds = min(whole_run(folder) for _ in range(arguments.rounds))
    print(f"\nThe whole run of {STEPS} steps, recorded: {seconds:.2f} s of CPU.")


if __name__ == "__main__":
    main()
