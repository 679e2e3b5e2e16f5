"""Specifications about pairs: what can be kept, and how the risk is allocated between two agents."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import norm

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError

STEP, NOISE, RISK = 0.1, 0.1, 0.05


def scenario(formula: str, *, duration: float = STEP, apart: float = 2.0, goal: Any = (0, 0)) -> dict[str, Any]:
    """Two robots that want to meet, in noise."""
    keep = {"specifications": ["apart"], "maximal_risk": RISK, "horizon": STEP}
    return {
        "symaware": 1,
        "name": "meeting",
        "seed": 1,
        "run": {"duration": duration},
        "environment": {"use": "kinematic", "with": {"time_step": STEP}},
        "specifications": {"apart": {"pairs": "robot", "formula": formula}},
        "agents": {
            "robot": {
                "count": 2,
                "model": {"use": "single-integrator", "with": {"process_noise": NOISE}},
                "state": [[0.0, 0.0], [apart, 0.0]],
                "knowledge": {"goal": list(goal)},
                "components": {
                    "sense": {"use": "perception.omniscient"},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
                    "keep": {"use": "control.risk-aware", "with": keep},
                },
            }
        },
    }


def run(folder: Path, content: dict[str, Any]) -> Any:
    path = folder / "meeting.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    log = folder / "meeting.mcap"
    log.unlink(missing_ok=True)
    assert execute(build(path), log).status == "finished"
    return open_log(log)


@pytest.mark.parametrize(
    "formula", ["always distance > 1", "always 1 < distance", "always not distance <= 1", "not eventually distance < 1"]
)
def test_the_noise_of_both_counts_and_each_takes_half_of_the_risk(tmp_path: Path, formula: str) -> None:
    """After a step, the distance deviates by the noise of both; twice its risk is what each plans."""
    log = run(tmp_path, scenario(formula, apart=1.3, goal=[5, 0]))
    ids = ["robot.0", "robot.1"]
    velocities = [log.series(id, "requested_control").values[0, 0] for id in ids]
    risk = [log.series(id, "keep.risk_budget").values[0, 0] for id in ids]
    deviation = NOISE * np.sqrt(2 * STEP)
    margins = [0.3 - STEP * velocities[0], 0.3 + STEP * velocities[1]]  # the other has not moved yet
    assert risk == pytest.approx(2 * norm.sf(np.array(margins) / deviation))


def test_two_that_want_to_meet_stop_before(tmp_path: Path) -> None:
    distances = []
    for seed in range(3):
        log = run(tmp_path, {**scenario("always distance > 1", duration=3.0, apart=4.0, goal=[2, 0]), "seed": seed})
        one, other = (log.series(id, "state").values for id in ("robot.0", "robot.1"))
        distances.append(np.linalg.norm(one - other, axis=1).min())
    assert min(distances) > 1.0
    assert max(distances) < 2.2


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("always distance < 3", "only lower bounds of `distance`"),
        ("always 1 < distance < 3", "only lower bounds of `distance`"),
        ("always closing_speed < 1", "only comparisons of `distance` with numbers"),
        ("eventually distance > 1", "only `always`"),
    ],
)
def test_unsuitable_specifications_of_pairs_are_refused(tmp_path: Path, formula: str, said: str) -> None:
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scenario(formula), sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "bad.yaml")
