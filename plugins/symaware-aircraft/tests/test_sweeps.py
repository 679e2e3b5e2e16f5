"""The sweeps of the package say the same as single runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from simulating import Command

    from tests.conftest import Fly

SWEEPS = Path(__file__).parent.parent / "sweeps"
CONTROLLER = "agents.ownship.components.steer.with"


def rows(command: Command, sweep: Path, folder: Path, *options: object) -> list[dict[str, Any]]:
    """Run a sweep, and return its table."""
    done = command("sweep", sweep, "-o", folder, "-q", "--jobs", 0, *options)
    assert done.returncode == 0, done.stderr
    found: list[dict[str, Any]] = json.loads(command("rows", folder, "--json").stdout)
    return found


@pytest.mark.parametrize("sweep", sorted(SWEEPS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_sweep_is_sound(command: Command, sweep: Path) -> None:
    assert json.loads(command("plan", sweep, "--json").stdout)["valid"]


def test_a_row_is_the_run_of_its_seed_with_its_separation_and_its_fallbacks(
    command: Command, fly: Fly, tmp_path: Path
) -> None:
    noise = "agents.intruder.components.fly.with.turn_noise=0.02"
    both = rows(command, SWEEPS / "turn-noise.yaml", tmp_path / "noise", "--over", noise, "--runs", 1)
    for row, horizon in zip(both, (3, 0), strict=True):
        flight = fly("noisy.yaml", f"{CONTROLLER}.robust_horizon={horizon}", seed=row["seed"])
        assert row["separation"] == pytest.approx(flight.separation.min(), abs=1e-9)
        assert row["fallbacks"] == len(flight.events("fell-back"))
    assert both[0]["seed"] == both[1]["seed"]
