"""Scenarios as FMUs, stepped by FMPy in a separate process."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views import installed_format

#: Steps an FMU by FMPy, with validation of its description, and prints the results.
STEP = """
import json, sys
import numpy as np
from fmpy import simulate_fmu
path, stop, outputs, given = sys.argv[1], float(sys.argv[2]), json.loads(sys.argv[3]), json.loads(sys.argv[4])
signals = None
if given:
    kinds = [("time", float), *((name, bool if name.endswith("driven") else float) for name in given)]
    signals = np.array([(0.0, *given.values()), (stop, *given.values())], dtype=kinds)
found = simulate_fmu(path, stop_time=stop, step_size=0.05, output_interval=0.05, output=outputs, input=signals)
print(json.dumps({name: found[name].tolist() for name in outputs}))
"""


@pytest.fixture(scope="module")
def hello(scenarios: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the log of a run, and its scenario as an FMU."""
    folder = tmp_path_factory.mktemp("hello")
    execute(build(scenarios / "hello.yaml", ["run.duration=2"], 5), folder / "hello.mcap")
    exported = installed_format("fmu").export(open_log(folder / "hello.mcap"), folder / "hello.fmu")
    assert exported.facts["variables"] == {"robot": 4 * (3 + 2 + 1)}
    return folder


def stepped(fmu: Path, outputs: list[str], given: dict[str, Any] | None = None) -> dict[str, list[float]]:
    line = [sys.executable, "-c", STEP, str(fmu), "2.0", json.dumps(outputs), json.dumps(given or {})]
    done = subprocess.run(line, capture_output=True, text=True, check=True)
    found: dict[str, list[float]] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_a_stepped_fmu_has_the_states_of_the_run(hello: Path) -> None:
    log = open_log(hello / "hello.mcap")
    outputs = [f"robot[{number}].{name}" for number in range(4) for name in ("x", "y", "heading")]
    found = stepped(hello / "hello.fmu", outputs)
    for number in range(4):
        truth = log.series(f"robot.{number}", "world").values
        assert len(truth) == 41
        for column, name in enumerate(("x", "y", "heading")):
            assert found[f"robot[{number}].{name}"] == truth[:, column].tolist()


def test_the_host_may_drive_an_agent(hello: Path) -> None:
    given = {"robot[0].input.driven": True, "robot[0].input.speed": 0.5, "robot[0].input.turn_rate": 0.0}
    found = stepped(hello / "hello.fmu", ["robot[0].x", "robot[0].y"], given)
    steps = [
        ((x - last_x) ** 2 + (y - last_y) ** 2) ** 0.5
        for last_x, x, last_y, y in zip(
            found["robot[0].x"][1:],
            found["robot[0].x"][2:],
            found["robot[0].y"][1:],
            found["robot[0].y"][2:],
            strict=False,
        )
    ]
    assert steps == pytest.approx([0.5 * 0.05] * len(steps), abs=1e-9)
