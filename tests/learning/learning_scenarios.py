"""Environments of shipped scenarios, and whole episodes in them."""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import symaware_cli as sa
from symaware_cli.learning.parallel_environment import ScenarioParallelEnv

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of an environment, imported by its tests
    from pettingzoo.test import parallel_api_test as parallel_api_test
    from pettingzoo.test import parallel_seed_test as parallel_seed_test

SCENARIOS = Path(__file__).parents[2] / "scenarios"

HEAD_ON = SCENARIOS / "head-on.yaml"

REWARD = "-distance(position, goal)"

#: Scenarios whose agents differ in sensors, messages, faults, models and modes.
TEN = (
    "asynchronous",
    "circle-swap",
    "corridor",
    "crossing",
    "fog",
    "formation",
    "gatekeeper",
    "hello",
    "market",
    "traffic",
)

#: The duration of their runs [s].
DURATION = 2.0


def head_on(**options: Any) -> ScenarioParallelEnv:
    """Return head-on.yaml as an environment in which all robots learn."""
    return sa.env(HEAD_ON, agents="robot", reward=REWARD, **options)


def shortened(name: str, duration: float = DURATION) -> tuple[sa.Scenario, str]:
    """Return a shipped scenario that lasts some seconds, and its first group."""
    scenario = sa.load(next(SCENARIOS.glob(f"{name}.*")), {"run.duration": duration})
    assert scenario.outline is not None
    return scenario, next(iter(scenario.outline.groups))


def shipped(name: str, duration: float = DURATION) -> ScenarioParallelEnv:
    """Return a shipped scenario as an environment in which its first group learns."""
    scenario, group = shortened(name, duration)
    return sa.env(scenario, agents=group, observation=["state", {"nearest": 2}], reward="-norm(position)")


def sampled(environment: ScenarioParallelEnv, random: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Return an action of each agent."""
    actions = {}
    for agent in environment.agents:
        space = environment.action_space(agent)
        actions[agent] = random.uniform(np.maximum(space.low, -1.0), np.minimum(space.high, 1.0))
    return actions


def digest(environment: ScenarioParallelEnv, seed: int, actions: int, most: int = 1000) -> str:
    """Return a digest of everything that an episode with random actions returns."""
    random, found = np.random.default_rng(actions), hashlib.sha256()
    observations, infos = environment.reset(seed=seed)
    found.update(repr((sorted(infos.items()), [each.tobytes() for each in observations.values()])).encode())
    for _ in range(most):
        if not environment.agents:
            break
        observations, *others = environment.step(sampled(environment, random))
        found.update(repr(([each.tobytes() for each in observations.values()], others)).encode())
    return found.hexdigest()
