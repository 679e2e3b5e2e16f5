"""`control.risk-aware` with a maximal risk: the speed that it leaves, and the risk that it counts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.stats import norm

from symaware_cli import open_log
from symaware_cli.scenario.build import build
from symaware_cli.scenario.execution import execute
from symaware_cli.scenario.problem import ScenarioError
from symaware_cli.testing import assert_batchable

Array = NDArray[np.float64]

STEP, NOISE, RISK, HORIZON = 0.1, 0.1, 0.05, 0.5
QUAY = Path(__file__).parents[2] / "scenarios" / "quay.yaml"


def scenario(formula: str, *, duration: float = STEP, state: Any = (0.0, 0.0), **brake: Any) -> dict[str, Any]:
    """A robot that asks for 1 m/s along x, in noise."""
    given = {"specifications": ["safe"], "maximal_risk": RISK, "horizon": HORIZON}
    return {
        "symaware": 1,
        "name": "wall",
        "seed": 1,
        "run": {"duration": duration},
        "environment": {"use": "kinematic", "with": {"time_step": STEP}},
        "specifications": {"safe": {"each": "robot", "formula": formula}},
        "agents": {
            "robot": {
                "model": {"use": "single-integrator", "with": {"process_noise": NOISE}},
                "state": list(state),
                "knowledge": {"goal": [9, 0]},
                "components": {
                    "sense": {"use": "perception.self"},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
                    "brake": {"use": "control.risk-aware", "with": {**given, **brake}},
                },
            }
        },
    }


def run(folder: Path, content: dict[str, Any]) -> tuple[float, Array, list[Any]]:
    """The speed after the first turn, the risk planned and spent at each step, and the controller's events."""
    (folder / "wall.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    assert execute(build(folder / "wall.yaml"), folder / "wall.mcap").status == "finished"
    read = open_log(folder / "wall.mcap")
    events = [event for event in read.events() if event.source == "agents.robot.brake"]
    speed = read.series("robot", "requested_control").values[0, 0]
    return float(speed), read.series("robot", "brake.risk_budget").values, events


def test_it_goes_at_the_greatest_speed_with_little_enough_risk(tmp_path: Path) -> None:
    speed, risk, events = run(tmp_path, scenario("always x < 0.4", duration=HORIZON))
    times = STEP * np.arange(1, 6)

    def bound(at: float) -> float:
        return float(norm.sf((0.4 - at * times) / (NOISE * np.sqrt(times))).sum())

    assert bound(speed) <= RISK < bound(speed + 0.05)
    assert risk[0, 0] == pytest.approx(bound(speed))
    assert risk[0, 1] == pytest.approx(norm.sf((0.4 - speed * STEP) / (NOISE * np.sqrt(STEP))))
    assert [event.name for event in events][:1] == ["slowed"]


def test_speed_that_leads_away_is_not_reduced(tmp_path: Path) -> None:
    speed, _, events = run(tmp_path, scenario("always x > -0.05", duration=HORIZON, maximal_risk=0.5))
    assert speed == 1.0
    assert not events


def test_what_no_speed_keeps_is_named_with_its_time_and_the_least_risk_is_taken(tmp_path: Path) -> None:
    speed, _, events = run(tmp_path, scenario("always x < 0.05", duration=HORIZON))
    (event,) = (each for each in events if each.name == "infeasible")
    assert speed == 0.0
    assert event.data["specification"] == "safe"
    assert event.data["time"] == pytest.approx(STEP)
    assert event.data["risk"] > event.data["allowed"]


def test_runs_in_a_batch_keep_their_own_account() -> None:
    assert_batchable(QUAY, ["run.duration=3.0"])


@pytest.mark.parametrize(
    ("formula", "changes", "said"),
    [
        ("eventually x > 1", {}, "only `always`"),
        ("always x < 1", {"caution": 0.1}, "replaces `caution` and `bound`"),
        ("always x < 1", {"specifications": []}, "needs `specifications`"),
    ],
)
def test_what_it_cannot_keep_is_refused_in_the_file(
    tmp_path: Path, formula: str, changes: dict[str, Any], said: str
) -> None:
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scenario(formula, **changes), sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "bad.yaml")
