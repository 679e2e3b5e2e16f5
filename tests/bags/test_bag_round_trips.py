"""Runs exported as bags move the same bodies in another run; the benchmark tries twenty scenarios."""

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "bag_round_trips.py"


def test_an_exported_run_moves_bodies_to_the_same_places_as_mcap_and_as_database() -> None:
    line = [sys.executable, "-W", "ignore", str(SCRIPT), "gusts", "drones"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "drones: MCAP, 4 bodies, 484 poses, at most 0 m apart",
        "gusts: database, 1 bodies, 31 poses, at most 0 m apart",
        "2 of 2 move as they did",
    ]
