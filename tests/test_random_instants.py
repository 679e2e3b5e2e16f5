"""States of shipped scenarios at random instants: the continuations are equal, or the state is refused."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "capture.py"


@pytest.mark.slow
def test_runs_from_twenty_random_instants_are_equal_unless_the_engine_is_refused() -> None:
    told = subprocess.run(
        [sys.executable, SCRIPT, "--seed", "2", "--pairs", "20", "--steps", "40"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    rows = [line for line in told.splitlines() if "scenarios/" in line]
    assert len(rows) == 20
    refused = [row for row in rows if "refused" in row]
    assert all("its engine does not expose" in row for row in refused)
    assert all(row.count(" equal |") == 2 for row in rows if row not in refused)
    assert len(refused) < 15
