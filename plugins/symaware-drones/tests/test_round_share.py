"""The metric of rounds: how often gamma was limited, in the table of a sweep."""

import subprocess
from pathlib import Path

import pyarrow.parquet as pq
import yaml
from drone_flights import SCENARIOS
from simulating import in_process as command


def swept(folder: Path, **metric: str) -> "subprocess.CompletedProcess[str]":
    """Sweep the first second of the five drones with the metric."""
    content = {
        "symaware-sweep": 1,
        "scenario": "five-drones.yaml",
        "set": {"run.duration": 1.0},
        "metrics": {"share": {"use": "drones.rounds", "with": metric}},
    }
    (folder / "five-drones.yaml").write_text((SCENARIOS / "five-drones.yaml").read_text())
    (folder / "sweep.yaml").write_text(yaml.safe_dump(content))
    return command("sweep", folder / "sweep.yaml", "-o", folder / "rows", "--quiet", "--jobs", "1")


def test_the_share_of_limited_rounds_is_between_none_and_all(tmp_path: Path) -> None:
    done = swept(tmp_path, agent="hub")
    assert done.returncode == 0, done.stderr
    share = pq.read_table(tmp_path / "rows" / "runs.parquet").column("share")[0].as_py()
    assert 0.5 < share <= 1.0


def test_an_agent_that_is_not_there_is_refused_before_any_run(tmp_path: Path) -> None:
    done = swept(tmp_path, agent="hob")
    assert done.returncode == 2
    assert "there is no agent `hob`" in done.stderr
