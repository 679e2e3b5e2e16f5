"""States of a scene with contacts: restored at any instant, they continue a run to the same bytes."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import symaware_cli as sa

pytestmark = pytest.mark.filterwarnings("ignore::symaware_cli.ProcessorWarning")

SCENARIOS = Path(__file__).parents[1] / "scenarios"
#: How many instants the slow test tries.
INSTANTS = int(os.environ.get("SYMAWARE_INSTANTS", "200"))


def crowd() -> dict[str, Any]:
    """Balls and crates of several surfaces that fall on a heap, through which two robots drive."""
    shapes = [{"circle": {"radius": 0.2}}, {"box": {"length": 0.3, "width": 0.4, "height": 0.3}}]
    entities: dict[str, Any] = {
        f"b{number}": {
            "shape": shapes[number % 2],
            "position": [0.45 * (number % 3) - 0.5, 0.45 * (number // 3 % 3) - 0.5, 0.4 + 0.45 * (number // 9)],
            "mass": 1.0 + number % 3,
            "friction": 0.3 + 0.1 * (number % 4),
            "elasticity": 0.25 * (number % 4),
        }
        for number in range(12)
    }
    yard = [[-1.2, -1.2], [1.2, -1.2], [1.2, 1.2], [-1.2, 1.2], [-1.2, -1.2]]
    entities["yard"] = {"shape": {"wall": {"points": yard, "thickness": 0.1}}}
    entities["gate"] = {
        "shape": {"box": {"length": 0.2, "width": 0.6, "height": 0.4}},
        "path": {"times": [0, 2, 4], "positions": [[-0.9, 0], [0.9, 0.1], [-0.9, 0]], "repeat": True},
    }
    return {
        "symaware": 1,
        "name": "crowd",
        "run": {"duration": 100.0},
        "environment": {"use": "mujoco", "with": {"time_step": 0.02, "substeps": 5}, "entities": entities},
        "agents": {
            "robot": {
                "count": 2,
                "model": {"use": "double-integrator"},
                "entity": {"shape": {"circle": {"radius": 0.15}}, "mass": 5.0, "elasticity": 0.5},
                "state": {"each": [[-0.8, -0.8, 1.0, 0.7], [0.8, 0.8, -0.7, -1.0]]},
                "components": {
                    "wander": {"use": "control.random", "with": {"inputs": [[3, 1], [-3, 2], [1, -3], [-1, 0]]}}
                },
            }
        },
    }


@pytest.mark.parametrize("instants", [40, pytest.param(INSTANTS, marks=pytest.mark.slow)])
def test_a_state_restored_at_a_random_instant_continues_to_the_same_bytes(instants: int, tmp_path: Path) -> None:
    (tmp_path / "crowd.yaml").write_text(yaml.safe_dump(crowd()))
    steps, further = instants + 20, 3
    summary = sa.load(tmp_path / "crowd.yaml", [f"run.duration={0.02 * steps}"]).run(record=False).summary
    assert summary.contacts > 12
    chosen = np.random.default_rng(instants).choice(steps, instants, replace=False).tolist()
    with sa.load(tmp_path / "crowd.yaml").start() as simulation:
        states = [simulation.capture().to_bytes()]
        for _ in range(steps + further):
            simulation.step()
            states.append(simulation.capture().to_bytes())
        # No two instants have the same state, so the comparison is not trivial.
        assert len(set(states)) == len(states)
        for instant in chosen:
            simulation.restore(sa.SimulationState.from_bytes(states[instant]))
            simulation.step(further)
            assert simulation.capture().to_bytes() == states[instant + further], instant


def test_a_branch_by_capture_of_a_scene_with_contacts_is_the_run_with_the_change(tmp_path: Path) -> None:
    (tmp_path / "crowd.yaml").write_text(yaml.safe_dump(crowd()))
    sa.load(tmp_path / "crowd.yaml", ["run.duration=0.8"]).run(output=tmp_path / "log.mcap")
    changes: list[dict[str, Any]] = [{}, {"agents.robot.components.wander.with.inputs": [[0, 0]]}]
    same, other = sa.branches(tmp_path / "log.mcap", 0.5, changes, tmp_path / "out", way="capture")
    assert (same.way, other.way) == ("capture", "capture")
    whole = sa.open_log(tmp_path / "log.mcap")
    paths = [sa.open_log(each.summary.log or "") for each in (same, other)]
    for name in ("robot.0", "b0", "b7"):
        before, after = (each.series(name, "world").values[-1].tolist() for each in (whole, paths[0]))
        assert before == after
    assert (
        paths[1].series("robot.0", "world").values[-1].tolist() != whole.series("robot.0", "world").values[-1].tolist()
    )


def test_splitting_estimates_the_probability_that_plain_runs_have() -> None:
    """Both estimates have intervals, which overlap; the plain one is a binomial proportion."""
    changes = ["agents.robot.components.wander.with.probabilities=[0.65,0.35]", "run.duration=2.5"]
    given: dict[str, Any] = {"specification": "stays", "changes": changes, "jobs": 0}
    plain = sa.estimate(SCENARIOS / "ledge.yaml", levels=[], trials=15, repeats=4, **given).probability
    split = sa.estimate(SCENARIOS / "ledge.yaml", levels=[0.6], trials=10, repeats=4, **given).probability
    assert 0.0 < split.lower < plain.upper
    assert plain.lower < split.upper < 0.5
