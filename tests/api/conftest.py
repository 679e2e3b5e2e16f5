"""A small scenario, in a folder of its own that is the present one."""

from pathlib import Path

import pytest

SCENARIO = """\
symaware: 1
name: swap
seed: 5
run: {duration: 2.0}
environment: {use: kinematic}
agents:
  lone: {model: {use: single-integrator}, state: [9.0, 9.0]}
  robot:
    count: 3
    entity: {shape: {circle: {radius: 0.5}}}
    model: {use: unicycle, with: {max_speed: 3.0}}
    state: {circle: {radius: 1.5}}
    knowledge: {goal: {circle: {radius: 1.5, phase: 3.14159}}}
    components:
      sense: {use: perception.range, with: {range: 9.0, position_noise: 0.1}}
      steer: {use: control.go-to-goal, with: {speed: 3.0}}
"""


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swap.yaml").write_text(SCENARIO)
    return tmp_path / "swap.yaml"
