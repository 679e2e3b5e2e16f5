"""Runs one case of SymAware and prints its figures as JSON: ``python ours.py CASE AGENTS STEPS [--record]``.

Only the CPU time of the run is counted, without imports and building the scenario.
"""

import argparse
import json
import math
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from symaware_cli.language.build import Built, build
from symaware_cli.language.execution import execute

_COMPONENTS = {
    # For comparison with frameworks that step each agent in Python.
    "python": "sense: {use: benchmark.perception}, steer: {use: benchmark.controller}",
    # As in the original framework: each perception fills a dictionary of all agents, which each controller reads.
    "dictionary": "sense: {use: benchmark.dictionary-perception}, steer: {use: benchmark.aware-controller}",
    "own-dictionary": "sense: {use: benchmark.own-dictionary-perception}, steer: {use: benchmark.aware-controller}",
    # The same work as IR-SIM's `dash`: unicycles with limits that never arrive; in Python, and with built-in
    # components.
    "dash": "sense: {use: benchmark.perception}, steer: {use: benchmark.dash}",
    "stock-dash": "sense: {use: perception.omniscient}, steer: {use: control.go-to-goal}",
    # Built-in perception for the whole group; only the controller is Python for single agents.
    "mixed": "sense: {use: perception.omniscient}, steer: {use: benchmark.controller}",
    "stock": "sense: {use: perception.omniscient}, steer: {use: control.go-to-goal}",
    "risk": (
        "sense: {use: perception.omniscient}, risk: {use: risk.time-to-collision, with: {reach: 3.0, horizon: 3.0}},"
        " steer: {use: control.go-to-goal}"
    ),
    "gaussian": (
        "see: {use: perception.range, with: {range: 3.0, position_noise: 0.1, velocity_noise: 0.1}},"
        " believe: {use: uncertainty.gaussian}, steer: {use: control.go-to-goal}"
    ),
}


def scenario(case: str, agents: int, steps: int) -> str:
    """Return a scenario with the given numbers of agents and steps."""
    if case in ("drones", "drones-mujoco"):
        return _quadrotors(agents, steps, "mujoco" if case == "drones-mujoco" else "pybullet")
    return _field(case, agents, steps)


def _quadrotors(agents: int, steps: int, world: str) -> str:
    """Return a scenario of adjacent quadrotors that track a velocity: physics at 240 Hz, controllers at 48 Hz."""
    places = [[row, 0, 1, *[0] * 9] for row in range(agents)]
    return f"""
symaware: 1
name: benchmark
seed: 1
run: {{duration: {steps / 48}}}
environment: {{use: {world}, with: {{time_step: {1 / 48}, substeps: 5}}}}
agents:
  drone:
    count: {agents}
    model: {{use: quadrotor}}
    state: {places if agents > 1 else places[0]}
    knowledge: {{velocity: {{all: [0.3, 0.1, 0.05]}}}}
    components:
      sense: {{use: perception.omniscient}}
      fly: {{use: control.quadrotor-velocity}}
"""


def _field(case: str, agents: int, steps: int) -> str:
    """Return a scenario of agents with individual goals, with a density that does not depend on their number."""
    # One agent per 20 square metres: on average, about 1.4 others are within 3 m of an agent.
    side = math.sqrt(20.0 * agents)
    rolls = case in ("risk", "gaussian", "dash", "stock-dash")
    model = "unicycle" if rolls else "single-integrator"
    state = f"[{{uniform: [0, {side}]}}, {{uniform: [0, {side}]}}"
    state += ", {uniform: [-3.14, 3.14]}]" if rolls else "]"
    goal = f"[{{uniform: [0, {side}]}}, {{uniform: [0, {side}]}}]"
    if case in ("dash", "stock-dash"):
        # Opposite positions on a large circle, as in IR-SIM: no agent meets another or arrives.
        state, goal = "{circle: {radius: 90.0}}", "{circle: {radius: 90.0, phase: 3.14159}}"
    return f"""
symaware: 1
name: benchmark
seed: 1
run: {{duration: {steps * 0.05}}}
environment: {{use: kinematic, with: {{time_step: 0.05}}}}
agents:
  robot:
    count: {agents}
    entity: {{shape: {{circle: {{radius: 0.1}}}}}}
    model: {{use: {model}}}
    state: {state}
    knowledge: {{goal: {goal}}}
    components: {{{_COMPONENTS[case]}}}
"""


def main() -> None:
    """Run the case given on the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("case", choices=[*_COMPONENTS, "drones", "drones-mujoco", "numpy", "numpy-kept"])
    parser.add_argument("agents", type=int)
    parser.add_argument("steps", type=int)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--profile", action="store_true")
    arguments = parser.parse_args()
    if arguments.case.startswith("numpy"):
        from bare_numpy import run

        cpu = run(arguments.agents, arguments.steps, 1.0 if arguments.case == "numpy-kept" else 0.0)
        print(json.dumps({"cpu": cpu, "agent_steps": arguments.agents * arguments.steps}))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "benchmark.yaml"
        # A short run first, so that imports and caches are not counted.
        path.write_text(scenario(arguments.case, 100, 2))
        execute(build(path), Path(folder) / "warm.mcap")
        path.write_text(scenario(arguments.case, arguments.agents, arguments.steps))
        built = build(path)
        log = Path(folder) / "benchmark.mcap" if arguments.record else None
        if arguments.profile:
            _profile(built, log)
            return
        started = time.process_time()
        summary = execute(built, log)
        cpu = time.process_time() - started
    print(
        json.dumps(
            {
                "cpu": cpu,
                "agent_steps": arguments.agents * summary.steps,
                "log_size": summary.log_size,
                "peak_memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
            }
        )
    )


def _profile(built: Built, log: Path | None) -> None:
    """Print the share of each module in the CPU time of the run."""
    import cProfile
    import pstats
    from collections import defaultdict

    profile = cProfile.Profile()
    profile.runcall(execute, built, log)
    shares: dict[str, float] = defaultdict(float)
    figures: Any = vars(pstats.Stats(profile))["stats"]
    for (file, _, name), (_, _, own, _, _) in figures.items():
        part = file.partition("symaware_cli/")[2] or ("NumPy, SciPy and zstd" if file in ("~", "") else "other Python")
        if file not in ("~", "") and ("numpy" in file or "scipy" in file):
            part = "NumPy, SciPy and zstd"
        shares[part if part else name] += own
    total = sum(shares.values())
    print(json.dumps({part: time / total for part, time in sorted(shares.items(), key=lambda share: -share[1])[:12]}))


if __name__ == "__main__":
    main()
