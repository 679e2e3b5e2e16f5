"""Environments of reinforcement learning: agent-steps and resets per CPU-second, beside mpe2's.

    python benchmarks/learning.py [--rounds 5] [--steps 120] [--vmas PYTHON] [--jaxmarl PYTHON]
    python benchmarks/learning.py --episodes 1000

Needs the extra `rl`, and mpe2 for the comparison. `head-on.yaml` with 4, 10 and 100 robots: each observes its own state
and its goal, and is rewarded by its distance to the goal; the omniscient perception and the controller whose control
input is replaced run as in the scenario (*as it is*), or the controller is left out (*without controller*). mpe2 is
`simple_spread_v3` with as many agents, each of which observes all others. Each round measures all of them one after the
other, resets included; the table has medians, the least and the greatest of the rounds, and the ratios within a round.

The third table has 1,000 environments at once: `spread.yaml`, beside `simple_spread` of VMAS and of JaxMARL, each in an
interpreter that has it, on one thread or on the CPU. All begin anew at random positions after 25 steps. Agents observe
their own state, all landmarks and all others, and are rewarded by the distances of the landmarks to the nearest agents
and for not touching each other. In VMAS and JaxMARL agents that touch repel each other, which the kinematic world does
not compute; JaxMARL observes messages besides, which are zero; both compute with 32 bits. A step of JaxMARL is one call
of a compiled function.

With `--episodes` nothing else is measured: that many episodes of random actions in ten shipped scenarios are recorded
and verified from their logs alone, and as many that components drive are compared with their runs, byte for byte.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
import warnings
from pathlib import Path
from statistics import median
from typing import Any

import symaware_cli as sa

# isort: split
import numpy as np

from symaware_cli.learning.team import Team

HEAD_ON = Path(__file__).parents[1] / "scenarios" / "head-on.yaml"

SPREAD = Path(__file__).with_name("spread.yaml")

COUNTS = 4, 10, 100

#: Scenarios that differ in sensors, messages, faults, models and modes.
SHIPPED = (
    *("asynchronous", "circle-swap", "corridor", "crossing", "fog"),
    *("formation", "gatekeeper", "hello", "market", "traffic"),
)

#: The numbers of environments and of steps of an episode, and of agents.
ROWS, EPISODE, TEAMS = 1000, 25, (3, 10)


def ours(count: int, controller: bool) -> Any:
    """Return head-on.yaml with some robots."""
    changes: dict[str, Any] = {"agents.robot.count": count}
    if not controller:
        changes["agents.robot.components.steer"] = None
    return sa.env(
        HEAD_ON,
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
        "`head-on.yaml`": ours(4, True),
        "the same with random initial states": sa.env(HEAD_ON, agents="robot", changes=drawn),
        "mpe2, 4 agents": spread(4),
    }
    lines += ["", "| reset of | CPU time [ms] |", "|---|---:|"]
    for name, environment in cases.items():
        if environment is not None:
            lines.append(f"| {name} | {shown([resets(environment) for _ in range(rounds)], '.2f')} |")
    return "\n".join(lines)


def observe(team: Team) -> np.ndarray:
    """Return the state of each agent, and landmarks and others relative to its position; shape (B n, 4 n + 2)."""
    rows, count = team.environments, len(team.agents) // team.environments
    state = team.believed("state")
    positions = state[:, :2].reshape(rows, count, 2)
    landmarks = team.believed("landmark").reshape(rows, 1, count, 2)
    others = np.array([[each for each in range(count) if each != own] for own in range(count)])
    found = np.empty((rows, count, 4 * count + 2))
    found[..., :4] = state.reshape(rows, count, 4)
    found[..., 4 : 4 + 2 * count] = (landmarks - positions[:, :, None]).reshape(rows, count, -1)
    found[..., 4 + 2 * count :] = (positions[:, others] - positions[:, :, None]).reshape(rows, count, -1)
    return found.reshape(rows * count, -1)


def rewarded(team: Team) -> np.ndarray:
    """Return the negative distances of the landmarks to the nearest agents, less one for each agent touched."""
    rows, count = team.environments, len(team.agents) // team.environments
    positions = team.true("position").reshape(rows, count, 2)
    landmarks = team.true("landmark").reshape(rows, count, 2)
    nearest = np.sqrt(_squared(positions[:, :, None], landmarks[:, None]).min(axis=1))
    total = np.zeros(rows)
    for landmark in range(count):  # not a sum over an axis, whose order depends on the number of rows
        total -= nearest[:, landmark]
    touched = (_squared(positions[:, :, None], positions[:, None]) < 0.3**2).sum(axis=2) - 1
    return np.asarray((total[:, None] - touched).reshape(-1))


def _squared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    x, y = one[..., 0] - other[..., 0], one[..., 1] - other[..., 1]
    return np.asarray(x * x + y * y)


def rows_rate(count: int, drawn: bool) -> float:
    """Return the agent-steps per CPU-second of 1,000 environments of spread.yaml.

    Args:
        count: The number of agents.
        drawn: Whether each episode begins at random; otherwise all begin in the same way, which is restored.
    """
    changes: dict[str, Any] = {"agents.agent.count": count}
    if not drawn:
        changes |= {"agents.agent.state": {"circle": {"radius": 1.0}}}
        changes |= {"agents.agent.knowledge.landmark": {"circle": {"radius": 0.5}}}
    environment = sa.vector_env(
        SPREAD, ROWS, "agent", observe, None, rewarded, changes=changes, mixes=False, batched=True
    )
    environment.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, environment.action_space.shape)
    for _ in range(EPISODE + 1):
        environment.step(actions)
    started = time.process_time()
    for _ in range(2 * (EPISODE + 1)):  # one step of each episode begins the next
        environment.step(actions)
    return ROWS * count * 2 * EPISODE / (time.process_time() - started)


_VMAS = """
import sys, time, torch, vmas
torch.set_num_threads(1)
rows, steps, count = map(int, sys.argv[1:])
env = vmas.make_env("simple_spread", num_envs=rows, device="cpu", continuous_actions=True, seed=0, n_agents=count)
env.reset()
actions = [torch.rand(rows, 2) * 2 - 1 for _ in range(count)]
def episode():
    for _ in range(steps):
        env.step(actions)
    env.reset()
episode()
started = time.process_time()
episode(), episode()
print(2 * rows * steps * count / (time.process_time() - started))
"""

_JAXMARL = """
import os, sys, time
os.environ["JAX_PLATFORMS"] = "cpu"
import jax
from jaxmarl import make
rows, steps, count = map(int, sys.argv[1:])
env = make("MPE_simple_spread_v3", num_agents=count, num_landmarks=count, action_type="Continuous", max_steps=steps)
key = jax.random.PRNGKey(0)
keys = jax.random.split(key, rows)
actions = {each: jax.random.uniform(key, (rows, 5)) for each in env.agents}
_, state = jax.jit(jax.vmap(env.reset))(keys)
step = jax.jit(jax.vmap(env.step))
def run(state):
    for _ in range(2 * steps):
        found, state, *_ = step(keys, state, actions)
        jax.block_until_ready(found)
run(state)
started = time.process_time()
run(state)
print(2 * rows * steps * count / (time.process_time() - started))
"""


def theirs(python: str | None, script: str, count: int) -> float | None:
    """Return what a script prints in another interpreter; None if there is none."""
    if python is None:
        return None
    command = [python, "-W", "ignore", "-c", script, str(ROWS), str(EPISODE), str(count)]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout.split()[-1])


def many(rounds: int, vmas: str | None, jaxmarl: str | None) -> str:
    """Measure 1,000 environments at once, and return the table.

    Args:
        rounds: See `report`.
        vmas: An interpreter that has VMAS; None to leave it out.
        jaxmarl: One that has JaxMARL.
    """
    lines = [
        "| agents | random beginnings | the same beginning | VMAS | JaxMARL | ratio to VMAS | ratio to JaxMARL |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for count in TEAMS:
        found: list[list[float]] = [[], [], [], []]
        for _ in range(rounds):
            measured = (
                rows_rate(count, True),
                rows_rate(count, False),
                theirs(vmas, _VMAS, count),
                theirs(jaxmarl, _JAXMARL, count),
            )
            for values, each in zip(found, measured, strict=True):
                if each is not None:
                    values.append(each)
        cells = [shown(each, ",.0f") if each else "" for each in found]
        for other in found[2:]:
            ratios = [own / each for own, each in zip(found[0], other, strict=False)]
            cells.append(shown(ratios, ".2f") if ratios else "")
        lines.append(f"| {count} | {' | '.join(cells)} |")
    return "\n".join(lines)


def shipped(name: str) -> tuple[sa.Scenario, Any]:
    """Return a shipped scenario that lasts one second, and its environment, in which its first group learns."""
    scenario = sa.load(next(HEAD_ON.parent.glob(f"{name}.*")), {"run.duration": 1.0})
    assert scenario.outline is not None
    group = next(iter(scenario.outline.groups))
    return scenario, sa.env(scenario, agents=group, observation=["state", {"nearest": 2}], reward="-norm(position)")


def verified(name: str, count: int) -> int:
    """Return how many episodes of random actions are equal when they are repeated from their logs alone."""
    _, environment = shipped(name)
    random, equal = np.random.default_rng(1), 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            environment.reset(seed=1 if number == 0 else None)
            while environment.agents:
                spaces = {agent: environment.action_space(agent) for agent in environment.agents}
                bounds = {agent: (np.maximum(each.low, -1), np.minimum(each.high, 1)) for agent, each in spaces.items()}
                environment.step({agent: random.uniform(*each) for agent, each in bounds.items()})
            equal += sa.verify_log(environment.record(Path(folder, "episode.mcap"))).is_equal
    return equal


def driven(name: str, count: int) -> int:
    """Return how many episodes that components drive have the states of their runs at every step."""
    scenario, environment = shipped(name)
    assert scenario.outline is not None
    equal = 0
    for number in range(count):
        environment.reset(seed=3 if number == 0 else None)
        episode, same = environment.episodes.simulation, True
        with scenario.start(seed=environment.episodes.seed) as simulation:
            while environment.agents:
                environment.step({})
                simulation.step(episode.steps - simulation.steps or 1)
                for group in scenario.outline.groups:
                    same = same and simulation.state(group).tobytes() == episode.state(group).tobytes()
        equal += same
    return equal


def episodes(count: int) -> str:
    """Record, verify and compare episodes in ten scenarios, and return the table."""
    lines = ["| scenario | verified from their logs | equal to their runs |", "|---|---:|---:|"]
    share = -(-count // len(SHIPPED))
    for name in SHIPPED:
        found = verified(name, share), driven(name, share)
        lines.append(f"| {name} | {found[0]} of {share} | {found[1]} of {share} |")
        print(lines[-1], flush=True)
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=120)
    parser.add_argument("--vmas", help="an interpreter that has VMAS")
    parser.add_argument("--jaxmarl", help="an interpreter that has JaxMARL")
    parser.add_argument("--episodes", type=int, help="check so many episodes instead")
    given = parser.parse_args()
    if given.episodes:
        print(episodes(given.episodes))
        return
    print(report(given.rounds, given.steps))
    print()
    print(many(given.rounds, given.vmas, given.jaxmarl))


if __name__ == "__main__":
    main()
