"""What grows beyond all measure during a run ends it with its place, before anything calculates with it."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from symaware_cli import open_log

DIVERGING = """
symaware: 1
name: diverging
run: {duration: 100}
environment: {use: kinematic, with: {time_step: 1.0}}
agents:
  quiet:
    model: {use: single-integrator}
  loud:
    count: 2
    model:
      use: linear
      with:
        time_step: 1.0
        state: {x: m, y: m}
        control_input: {u: m}
        A: [[GROWTH, 0], [0, 1]]
        B: [[1], [1]]
    state: [[0, 0], [1, 1]]
    components: {see: {use: COMPONENT}}
"""


@pytest.mark.parametrize(("growth", "said"), [("1.0e+4", "has run away, beyond 1e+15"), ("1.0e+15", "has run away")])
def test_a_growing_state_ends_the_run_with_the_name_of_its_agent_while_it_is_finite(
    growth: Any, said: Any, tmp_path: Path
) -> None:
    scenario, log = tmp_path / "diverging.yaml", tmp_path / "log.mcap"
    scenario.write_text(DIVERGING.replace("GROWTH", growth).replace("COMPONENT", "perception.omniscient"))
    line = [sys.executable, "-P", "-m", "symaware_cli", "run", str(scenario), "--json", "--output", str(log)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    failure = json.loads(done.stdout)["failure"]
    assert failure.startswith("environment (kinematic) failed at")
    assert f"the state of loud.1 {said}" in failure
    # The last state that was recorded still means something.
    assert abs(open_log(log).series("loud.1", "world").values).max() <= 1e15
