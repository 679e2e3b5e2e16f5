"""Differential drives with bodies track the plans, and accepted specifications hold at every instant."""

from __future__ import annotations

import numpy as np
from simulating import in_process as command
from warehouse_runs import SCENARIOS, run


def test_accepted_specifications_hold_at_every_instant_and_no_robot_hits_a_wall() -> None:
    log = run("drives.yaml")
    assert [each.verdict for each in log.outcomes] == ["satisfied"] * 3
    assert not [event for event in log.events() if event.name == "infeasible"]
    assert "contact" not in {event.name for event in log.events()}


def test_at_the_end_of_a_step_a_drive_is_within_the_margin_of_its_plan() -> None:
    log = run("drives.yaml")
    for agent in ("robot.0", "robot.1"):
        tracking = log.series(agent, "track.tracking")
        ends = np.asarray(tracking.times) % 1_000_000_000 == 900_000_000
        assert float(np.asarray(tracking.values)[ends].max()) < 0.4


def test_a_step_that_is_not_a_multiple_of_that_of_the_world_is_refused_before_the_run() -> None:
    done = command("validate", SCENARIOS / "drives.yaml", "--set", "agents.robot.components.plan.with.step=0.25")
    assert done.returncode == 2
    assert "the `step` of 0.25 s is not a multiple of 0.1 s" in done.stderr
