"""`control.risk-aware` with a maximal risk: the speed that it leaves, and the risk that it counts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from checkout import CHECKOUT
from numpy.typing import NDArray
from scipy.stats import norm

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.testing import assert_batchable

Array = NDArray[np.float64]

STEP, NOISE, RISK, HORIZON = 0.1, 0.1, 0.05, 0.5
QUAY = CHECKOUT / "scenarios" / "quay.yaml"


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
    """The risk of each speed is that of all instants or, by Levy's inequality, twice that of the last one."""
    speed, risk, events = run(tmp_path, scenario("always x < 0.4", duration=HORIZON))
    times: Array = STEP * np.arange(1.0, 6.0)

    def bound(means: Array) -> float:
        ever = 2 * norm.sf((0.4 - means.max()) / (NOISE * np.sqrt(HORIZON)))
        return float(min(norm.sf((0.4 - means) / (NOISE * np.sqrt(times))).sum(), ever))

    assert bound(speed * times) <= RISK < bound((speed + 0.05) * times)
    assert risk[0, 0] == pytest.approx(bound(np.full(5, speed * STEP)))
    assert risk[0, 1] == pytest.approx(norm.sf((0.4 - speed * STEP) / (NOISE * np.sqrt(STEP))))
    assert [event.name for event in events][:1] == ["slowed"]


@pytest.mark.parametrize("horizon", [STEP, 0.4, 10.0])
@pytest.mark.parametrize("formula", ["always x < 1.5", "always[0, 1] x < 1.0", "always not inside(position, pit)"])
def test_stopping_is_affordable_at_every_turn_whatever_the_horizon(
    tmp_path: Path, formula: str, horizon: float
) -> None:
    """What is planned at a turn is what is left after the one before, plus what the noise has changed."""
    content = scenario(formula, duration=2.5, horizon=horizon)
    content["regions"] = {"pit": {"circle": {"centre": [2.0, 0.3], "radius": 0.7}}}
    for seed in range(2):
        content["seed"] = seed
        (tmp_path / "wall.mcap").unlink(missing_ok=True)
        _, risk, events = run(tmp_path, content)
        assert "infeasible" not in {event.name for event in events}
        assert risk[0, 0] <= RISK
        assert (np.diff(risk[:, 1]) >= 0.0).all()


def test_it_stands_where_all_of_the_rest_of_the_run_is_affordable(tmp_path: Path) -> None:
    """With a short horizon, too, it does not go where only the next steps are."""
    content = scenario("always x < 1.0", duration=10.0, horizon=STEP)
    content["agents"]["robot"]["model"]["with"]["process_noise"] = 0.01
    run(tmp_path, content)
    place = open_log(tmp_path / "wall.mcap").series("robot", "state").values[30, 0]
    assert 1.0 - 4 * 0.01 * np.sqrt(7.0) < place < 1.0 - 1.5 * 0.01 * np.sqrt(7.0)


def test_speed_that_leads_away_is_not_reduced(tmp_path: Path) -> None:
    speed, _, events = run(tmp_path, scenario("always x > -0.05", duration=HORIZON, maximal_risk=0.5))
    assert speed == 1.0
    assert not events


def test_a_bound_that_no_speed_keeps_is_named_with_its_time_and_the_least_risk_is_taken(tmp_path: Path) -> None:
    speed, _, events = run(tmp_path, scenario("always x < 0.05", duration=HORIZON))
    (event,) = (each for each in events if each.name == "infeasible")
    assert speed == 0.0
    assert event.data["specification"] == "safe"
    assert event.data["time"] == pytest.approx(STEP)
    assert event.data["risk"] > event.data["allowed"]
    assert event.data["spent"] == pytest.approx(norm.sf(0.05 / (NOISE * np.sqrt(STEP))))


def test_runs_in_a_batch_keep_their_own_account() -> None:
    assert_batchable(QUAY, ["run.duration=1.5"])


@pytest.mark.parametrize(
    ("formula", "changes", "said"),
    [
        ("eventually x > 1", {}, "only `always`"),
        ("always x < 1", {"caution": 0.1}, "replaces `caution` and `bound`"),
        ("always x < 1", {"specifications": []}, "needs `specifications`"),
    ],
)
def test_an_unsuitable_condition_is_refused_in_the_file(
    tmp_path: Path, formula: str, changes: dict[str, Any], said: str
) -> None:
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scenario(formula, **changes), sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "bad.yaml")
