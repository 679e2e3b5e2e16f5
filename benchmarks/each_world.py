"""CPU time of a step in each installed world that can run a scenario: ``python benchmarks/each_world.py``.

The same scenario is run with only `environment.use` changed, without a log. A step includes the components of agents,
which cost the same in each world; the images of cameras are left out. Worlds take turns, round after round, and the
median over the rounds is printed.
"""

import argparse
import statistics
import time
from importlib import metadata
from pathlib import Path

import yaml

import symaware_cli as sa

FOLDER = Path(__file__).parents[1] / "scenarios"
SCENARIOS = ("three-worlds", "billiards", "racecars", "drones")


def scenario(name: str, world: str) -> sa.Scenario | None:
    """Return a shipped scenario in a world; None if the world refuses it."""
    content = yaml.safe_load((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
    content["environment"]["use"] = world
    for group in content["agents"].values():
        group["components"] = {
            key: each for key, each in group["components"].items() if each["use"] != "perception.camera"
        }
    content["environment"]["with"].pop("visuals", None)
    try:
        return sa.scenario(content)
    except sa.ScenarioError:
        return None


def cost(run: sa.Scenario, seconds: float) -> float:
    """Return the CPU time of a step [ms]."""
    with run.start() as simulation:
        simulation.step()
        begin = time.process_time()
        while simulation.time < seconds and not simulation.done:
            simulation.step(10)
        return 1e3 * (time.process_time() - begin) / (simulation.steps - 1)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0, help="simulated time of a run")
    arguments = parser.parse_args()
    worlds = sorted(point.name for point in metadata.entry_points(group="symaware.environments"))
    print(f"| CPU time of a step [ms] | {' | '.join(worlds)} |")
    print("|---" * (len(worlds) + 1) + "|")
    for name in SCENARIOS:
        runs = {world: scenario(name, world) for world in worlds}
        figures: dict[str, list[float]] = {world: [] for world in worlds}
        for _ in range(arguments.rounds):
            for world, run in runs.items():
                if run is not None:
                    figures[world].append(cost(run, arguments.seconds))
        cells = [f"{statistics.median(each):.2f}" if each else "refused" for each in figures.values()]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
