"""Environments of reinforcement learning: agent-steps and resets per CPU-second, beside mpe2's.

    python benchmarks/learning.py [--rounds 5] [--steps 120]

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


def report(rounds: int = 5, steps: int = 120) -> str:
    """Measure, and return the two tables.

    Args:
        rounds: Rounds, each of which measures everything once.
        steps: Steps of each environment in a round; a tenth of that with 100 agents.
    """
    lines = [
        "| agents | as it is | without controller | mpe2 | ratio, as it is | ratio, without controller |",
        "|---:|---:|---:|---:|---:|---:|",
    ]
    for count in COUNTS:
        environments = [ours(count, True), ours(count, False), spread(count)]
        rates: list[list[float]] = [[] for _ in environments]
        for _ in range(rounds):
            for found, environment in zip(rates, environments, strict=True):
                if environment is not None:
                    found.append(rate(environment, max(10, steps // (10 if count > 50 else 1))))
        cells = [shown(each, ",.0f") if each else "" for each in rates]
        for each in rates[:2]:
            paired = [own / other for own, other in zip(each, rates[2], strict=False)]
            cells.append(shown(paired, ".1f") if paired else "")
        lines.append(f"| {count} | {' | '.join(cells)} |")
    drawn = {"agents.robot.state": {"all": [{"uniform": [-5, 5]}, {"uniform": [-5, 5]}, 0.0]}}
    cases = {
        "`hello.yaml`": ours(4, True),
        "the same with random initial states": sa.env(HELLO, agents="robot", changes=drawn),
        "mpe2, 4 agents": spread(4),
    }
    lines += ["", "| reset of | CPU time [ms] |", "|---|---:|"]
    for name, environment in cases.items():
        if environment is not None:
            lines.append(f"| {name} | {shown([resets(environment) for _ in range(rounds)], '.2f')} |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=120)
    given = parser.parse_args()
    print(report(given.rounds, given.steps))


if __name__ == "__main__":
    main()
