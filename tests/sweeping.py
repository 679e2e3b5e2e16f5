"""Functions for tests of sweeps: scenarios that run in milliseconds, and the command in this process."""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path
from typing import Any

from pyarrow import parquet
from simulating import invoked

#: Two robots that drive to their goals with noise, one of whom may leave the arena.
SCENARIO = """\
symaware: 1
name: tiny
seed: 1
run: {duration: 1.0}
environment: {use: kinematic, with: {time_step: 0.1}}
specifications: {near: {each: robot, formula: "always position[1] < 0.35"}}
agents:
  robot:
    count: 2
    model: {use: unicycle, with: {max_speed: 1.0}}
    state: {uniform: [[0, 0, 0], [1, 0.5, 0]]}
    knowledge: {goal: [3, 0]}
    components:
      sense: {use: perception.self}
      steer: {use: control.go-to-goal}
"""


def tiny(folder: Path) -> Path:
    """Write the scenario to a folder, and return its path."""
    path = folder / "tiny.yaml"
    path.write_text(SCENARIO)
    return path


def symaware(*arguments: object, status: int = 0) -> str:
    """Run the command in this process, and return all that it prints."""
    done = invoked(*arguments)
    assert done.exit_code == status, done.output
    return done.output


def rows(folder: Path) -> list[dict[str, Any]]:
    """The rows of a sweep's table."""
    found: list[dict[str, Any]] = parquet.read_table(folder / "runs.parquet").to_pylist()
    return found


def table_digest(folder: Path) -> str:
    """The SHA-256 of the bytes of a sweep's table."""
    return hashlib.sha256((folder / "runs.parquet").read_bytes()).hexdigest()


def children(parent: int) -> list[int]:
    """The processes that a process started and that have not ended."""
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(parent)], capture_output=True, text=True).stdout
    return [int(pid) for pid in found.split()]
