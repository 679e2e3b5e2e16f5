"""Scenarios with agents that watch others that move at random, and tables of the errors of their predictions."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import yaml
from numpy.typing import NDArray
from pyarrow import parquet

from symaware_cli.core import AgentGroup
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

Array = NDArray[np.float64]


def pairs(count: int, *, noise: float = 0.3, duration: float = 2.0, **parameters: Any) -> dict[str, Any]:
    """Watchers, each with one mover near it; the pairs are independent of each other."""
    regions = {"horizon": 1.0, "step": 0.25, **parameters}
    mover = {"use": "double-integrator", "with": {"process_noise": [0, 0, noise, noise]}}
    return {
        "symaware": 1,
        "name": "pairs",
        "seed": 1,
        "run": {"duration": duration},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {
            "watcher": {
                "count": count,
                "model": {"use": "single-integrator"},
                "state": [[40.0 * number, 0.0] for number in range(count)],
                "components": {
                    "see": {"use": "perception.range", "with": {"range": 15.0}},
                    "regions": {"use": "uncertainty.conformal", "with": regions},
                },
            },
            "mover": {
                "count": count,
                "model": mover,
                "state": [[40.0 * number, 3.0, 0.2, 0.0] for number in range(count)],
            },
        },
    }


def watchers(folder: Path, content: dict[str, Any]) -> AgentGroup:
    """The watchers at the end of a run."""
    (folder / "pairs.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    built = build(folder / "pairs.yaml")
    summary = execute(built, None)
    assert summary.status == "finished", summary.failure
    return next(group for group in built.simulation.groups if group.name == "watcher")


def errors_of(group: AgentGroup) -> Array:
    """The greatest errors of each watcher; shape (n, H)."""
    return np.array([each[:, 1] for each in group.awareness["regions.prediction_error"]])


def write_table(path: Path, errors: Array, step: float = 0.25) -> None:
    """Write a table as a sweep does: a run for each row of errors."""
    rows = [[{"time": step * (1 + number), "value": value} for number, value in enumerate(row)] for row in errors]
    parquet.write_table(pyarrow.table({"prediction_error": rows}), path)
