"""The example that trains a policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from learning_scenarios import SCENARIOS

import symaware_cli as sa
from examples.train_policy import train, write

DRIVE = "agents.robot.components.drive"


def straight_ahead(changes: dict[str, Any]) -> float:
    """Return the mean return of robots that drive straight ahead at full speed, over eight episodes."""
    environment = sa.env(SCENARIOS / "learned.yaml", changes=changes)
    total = 0.0
    for episode in range(8):
        environment.reset(seed=1 if episode == 0 else None)
        while environment.agents:
            _, rewards, *_ = environment.step({agent: [1.0, 0.0] for agent in environment.agents})
            total += sum(rewards.values())
    return total / 8 / len(environment.possible_agents)


@pytest.mark.slow
def test_the_return_of_the_example_rises_above_that_of_a_fixed_policy(tmp_path: Path) -> None:
    changes: dict[str, Any] = {DRIVE: None, "run.duration": 8.0}
    trained = train(SCENARIOS / "learned.yaml", 10, changes=changes)
    fixed = straight_ahead(changes)
    assert trained.returns[0] < 1.0
    assert trained.returns[-1] > max(fixed, 0.0) + 2.0
    path = tmp_path / "goal.onnx"
    write(trained, path)
    assert sa.Policy(path).observed == 2


def test_a_training_is_repeated_by_its_seed() -> None:
    changes = {DRIVE: None, "run.duration": 0.5}
    one, other = (train(SCENARIOS / "learned.yaml", 1, episodes=1, changes=changes) for _ in range(2))
    assert one.returns == other.returns
    for (weights, bias), (same, also) in zip(one.layers, other.layers, strict=True):
        assert weights.tobytes() == same.tobytes()
        assert bias.tobytes() == also.tobytes()
