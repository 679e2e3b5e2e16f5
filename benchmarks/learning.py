"""Environments of reinforcement learning: agent-steps and resets per CPU-second, beside mpe2's.

    python benchmarks/learning.py [--rounds 7] [--steps 200]

Needs the extra `rl`, and mpe2 for the comparison. `hello.yaml` with 4, 10 and 100 robots: each observes its own state
and its goal, and is rewarded by its distance to the goal; the omniscient perception and the controller whose control
input is replaced run as in the scenario (*as it is*), or the controller is left out (*without controller*). mpe2 is
`simple_spread_v3` with as many agents, each of which observes all others. Each round measures all of them one after the
other, resets included; the table has medians, the least and the greatest of the rounds, and the ratios within a round.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import symaware_cli as sa

HELLO = Path(__file__).parents[1] / "scenarios" / "hello.yaml"

COUNTS = 4, 10, 100


def ours(count: int, controller: bool) -> Any:
    """Return hello.yaml with some robots."""
    changes: dict[str, Any] = {"agents.robot.count": count}
    if not controller:
        changes["agents.robot.components.steer"] = None
    return sa.env(
        HELLO,
        agents="robot",
        observation=["state", "goal - position"],
        reward="-distance(position, goal)",
        changes=changes,
    )


def spread(count: int) -> Any:
    """Return mpe2's `simple_spread` with some agents; None if it is not installed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from mpe2 import simple_spread_v3
    except ImportError:
        return None
    return simple_spread_v3.parallel_env(N=count, max_cycles=240, continuous_actions=True)


def rate(environment: Any, steps: int) -> float:
    """Return agent-steps per CPU-second of some steps, with the resets between episodes."""
    environment.reset(seed=1)
    actions = {agent: environment.action_space(agent).sample() for agent in environment.agents}
    made, started = 0, time.process_time()
    for _ in range(steps):
        if not environment.agents:
            environment.reset()
        made += len(environment.agents)
        environment.step(actions)
    return made / (time.process_time() - started)


def resets(environment: Any, count: int = 50) -> float:
    """Return the CPU time of a reset, in milliseconds."""
    environment.reset(seed=1)
    started = time.process_time()
    for _ in range(count):
        environment.reset()
    return 1e3 * (time.process_time() - started) / count


def shown(values: list[float], form: str) -> str:
    """Format the median with the least and the greatest."""
    return f"{median(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--steps", type=int, default=200)
    given = parser.parse_args()
    print("| agents | as it is | without controller | mpe2 | ratio, as it is | ratio, without controller |")
    print("|---:|---:|---:|---:|---:|---:|")
    for count in COUNTS:
        made: list[Callable[[], Any]] = [lambda n=count: ours(n, True), lambda n=count: ours(n, False)]  # type: ignore[misc]
        environments = [*(each() for each in made), spread(count)]
        rates: list[list[float]] = [[] for _ in environments]
        for _ in range(given.rounds):
            for found, environment in zip(rates, environments, strict=True):
                if environment is not None:
                    found.append(rate(environment, max(10, given.steps // (1 + 9 * (count > 50)))))
        cells = [shown(each, ",.0f") if each else "" for each in rates]
        ratios = [
            shown([own / other for own, other in zip(each, rates[2], strict=True)], ".1f") if rates[2] else ""
            for each in rates[:2]
        ]
        print(f"| {count} | {' | '.join([*cells, *ratios])} |")
    print("\n| reset of | CPU time [ms] |\n|---|---:|")
    cases = {"`hello.yaml`": ours(4, True), "with random initial states": None, "mpe2, 4 agents": spread(4)}
    cases["with random initial states"] = sa.env(
        HELLO,
        agents="robot",
        changes={"agents.robot.state": {"all": [{"uniform": [-5, 5]}, {"uniform": [-5, 5]}, 0.0]}},
    )
    for name, environment in cases.items():
        if environment is not None:
            print(f"| {name} | {shown([resets(environment) for _ in range(given.rounds)], '.2f')} |")


if __name__ == "__main__":
    main()
