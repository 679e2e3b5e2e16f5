"""`risk.specification`: the probability that a specification fails, by sampling, against known answers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conformal_scenarios import write_table
from failure_scenarios import estimates, last_step, scenario
from scipy.stats import beta, multivariate_normal, norm

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.reader import Log


def logged(folder: Path, content: dict[str, Any]) -> Log:
    (folder / "risk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    summary = execute(build(folder / "risk.yaml"), folder / "risk.mcap")
    assert summary.status == "finished", summary.failure
    return open_log(folder / "risk.mcap")


def both_halves(p: float) -> tuple[str, float]:
    """A formula about two instants, and the probability that it fails: correlated, since noise accumulates."""
    limit = 0.5 * float(norm.isf(p))
    covariance = 0.25 * np.array([[0.5, 0.5], [0.5, 1.0]])
    held = multivariate_normal([0, 0], covariance).cdf([limit, limit])
    return f"always[0.5, 0.5] x <= {limit} and always[1, 1] x <= {limit}", 1.0 - float(held)


CASES = [
    *((last_step(p), p) for p in (0.001, 0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)),
    both_halves(0.05),
    both_halves(0.3),
]


@pytest.mark.parametrize(("formula", "truth"), CASES, ids=[f"{truth:.3f}" for _, truth in CASES])
def test_the_risk_lies_within_three_standard_errors_of_the_truth(tmp_path: Path, formula: str, truth: float) -> None:
    """In 99 % of 1,000 trials; of small probabilities, in the exact binomial interval of the same confidence."""
    risks, errors, _ = estimates(tmp_path, scenario(formula, agents=1000))
    assert (np.abs(risks - truth) <= 3 * errors).mean() >= 0.99
    if truth < 0.05:
        fails, tail = np.rint(400 * risks), float(norm.sf(3))
        low = np.where(fails > 0, beta.ppf(tail, fails, 401 - fails), 0.0)
        high = beta.isf(tail, fails + 1, 400 - fails)
        assert ((low <= truth) & (truth <= high)).mean() >= 0.99
    # The estimates scatter as those of independent samples do.
    assert risks.std() == pytest.approx(np.sqrt(truth * (1 - truth) / 400), rel=0.15)


@pytest.mark.parametrize(("formula", "truth"), CASES, ids=[f"{truth:.3f}" for _, truth in CASES])
def test_no_bound_is_below_the_truth(tmp_path: Path, formula: str, truth: float) -> None:
    normal, chebyshev = (
        estimates(tmp_path, scenario(formula, risk={"method": method}))[0][0] for method in ("normal", "chebyshev")
    )
    assert truth * (1 - 1e-9) <= normal <= chebyshev


def test_the_uncertainty_of_the_belief_counts(tmp_path: Path) -> None:
    own = {"use": "uncertainty.gaussian", "with": {"initial_deviation": 0.3}}
    content = scenario("always[0, 0] x <= 0.3", agents=200, noise=0.0)
    components = content["agents"]["robot"]["components"]
    content["agents"]["robot"]["components"] = {"belief": own, "risk": components["risk"]}
    risks, errors, believed = estimates(tmp_path, content)
    assert (np.abs(risks - norm.sf((0.3 - believed[:, 0]) / 0.3)) <= 3 * errors).mean() >= 0.98


@pytest.mark.parametrize(
    ("formula", "risk"),
    [
        ("always x < 0.95", 1.0),  # is reached after 1 s at 1 m/s
        ("always x < 1.05", 0.0),
        ("eventually[0, 0.9] x > 0.95", 1.0),
        ("eventually[0, 1.0] x > 0.95", 0.0),
        ("eventually[0, 9.0] x > 5", 0.0),  # undecided within the horizon
        ("x < 0.5 until[0, 1] x > 0.55", 1.0),
        ("x < 0.65 until[0, 1] x > 0.55", 0.0),
        ("always (inside(position, zone) implies time > 0.25)", 0.0),
        ("always (inside(position, zone) implies time > 0.35)", 1.0),
        ("always distance(position, knowledge.goal) > 9", 1.0),
        ("always nearest > 1.85", 1.0),  # they approach each other at 2 m/s
        ("always nearest > 1.75", 0.0),
        ("always not inside(position, around)", 0.0),
    ],
)
@pytest.mark.parametrize("interval", [True, False])
def test_without_chance_the_risk_is_whether_the_specification_will_fail(
    tmp_path: Path, formula: str, risk: float, interval: bool
) -> None:
    components = {
        "see": {"use": "perception.omniscient"},
        "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0}},
    }
    content = scenario(formula, noise=None, risk={"follow_intents": True})
    content["regions"] = {
        "zone": {"box": [0.25, 9, -1, 1]},
        "around": {"around": "guest", "circle": {"centre": [0, 0], "radius": 1.9}},
    }
    content["specifications"]["wanted"]["interval"] = interval
    robot = content["agents"]["robot"]
    robot.update(count=1, knowledge={"goal": [9, 0]}, components={**components, **robot["components"]})
    del robot["components"]["see"]
    robot["components"] = {"see": components["see"], "steer": components["steer"], "risk": robot["components"]["risk"]}
    content["agents"]["guest"] = {
        "model": {"use": "single-integrator"},
        "state": [4, 0],
        "knowledge": {"goal": [-9, 0]},
        "components": dict(components),
    }
    content["run"]["duration"] = 2.0
    log = logged(tmp_path, content)
    # In the second turn, the velocity of the other is known.
    risks = np.ravel(log.series("robot", "risk").values)
    assert risks[0 if "nearest" not in formula else 1] == risk
    satisfied = {event.name: event.time for event in log.events() if event.name in ("violated", "satisfied")}
    if risk == 1.0:
        assert "violated" in satisfied


def test_an_agent_is_at_risk_in_each_of_its_pairs(tmp_path: Path) -> None:
    content = scenario("always distance > 1", agents=3, noise=0.2)
    robot = content["agents"]["robot"]
    robot["state"] = [[0, 0], [1.5, 0], [4, 0]]
    robot["components"]["see"] = {"use": "perception.omniscient"}
    content["specifications"] = {
        "wanted": {
            "pairs": [["robot.1", "robot.0"], ["robot.1", "robot.2"]],
            "formula": "always distance > 1.35 and always position.first[0] > position.second[0] - 9",
        }
    }
    risks, _, _ = estimates(tmp_path, content)
    assert 0.2 < risks[0] < 0.9
    assert abs(risks[0] - risks[1]) < 0.15  # the same pair, from either side
    assert risks[2] == 0.0


def test_other_agents_change_nothing(tmp_path: Path) -> None:
    alone = estimates(tmp_path, scenario(last_step(0.3), agents=5))[0]
    among = estimates(tmp_path, scenario(last_step(0.3), agents=700))[0]
    np.testing.assert_array_equal(alone, among[:5])
    assert len(set(among.tolist())) > 30


def test_the_past_counts(tmp_path: Path) -> None:
    content = scenario("eventually[0, 1] x > 0.55", noise=None, robot={"knowledge": {"goal": [0.4, 0]}})
    components = content["agents"]["robot"]["components"]
    content["agents"]["robot"]["components"] = {
        "see": components["see"],
        "steer": {"use": "control.go-to-goal", "with": {"speed": 1.0, "gain": 10.0}},
        "risk": components["risk"],
    }
    content["run"]["duration"] = 2.0
    risks = np.ravel(logged(tmp_path, content).series("robot", "risk").values)
    assert risks[0] == 0.0  # at this speed it would get there
    assert risks[-1] == 1.0  # the time is over, whatever follows


@pytest.mark.parametrize(
    ("named", "specification", "said"),
    [
        (["wantd"], {"each": "robot", "formula": "always x < 1"}, "did you mean `wanted`"),
        (["wanted"], {"formula": "always contacts < 1"}, "is about the world"),
        (["wanted"], {"each": "robot", "of": "belief", "formula": "always risk < 1"}, "is about beliefs"),
    ],
)
def test_an_unpredictable_model_is_refused_where_it_is_named(
    tmp_path: Path, named: list[str], specification: dict[str, Any], said: str
) -> None:
    content = scenario("always x < 1", risk={"specifications": named})
    content["specifications"] = {"wanted": specification}
    (tmp_path / "risk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "risk.yaml")


def beside_another(formula: str, region: float | None, *, noise: Any = None, **risk: Any) -> dict[str, Any]:
    """A robot at 0 and a guest at rest at 3; regions have this radius after 1 s."""
    content = scenario(formula, noise=noise, risk={"others": "regions", **risk})
    robot = content["agents"]["robot"]
    regions = {"horizon": 1.0, "calibration": None if region is None else {"file": "table.parquet"}}
    robot["components"] = {
        "see": {"use": "perception.omniscient"},
        "regions": {"use": "uncertainty.conformal", "with": regions},
        "risk": robot["components"]["risk"],
    }
    robot["count"] = 1
    content["agents"]["guest"] = {"model": {"use": "single-integrator"}, "state": [3, 0]}
    return content


@pytest.mark.parametrize(
    ("kind", "limit", "risk"),
    [("nearest", 1.9, 0.1), ("nearest", 2.1, 1.0), ("distance", 1.9, 0.1), ("distance", 2.1, 1.0)],
)
def test_in_regions_others_are_at_the_nearest_point_and_may_leave_them(
    tmp_path: Path, kind: str, limit: float, risk: float
) -> None:
    write_table(tmp_path / "table.parquet", np.tile([0.25, 0.5, 0.75, 1.0], (60, 1)))
    content = beside_another(f"always {kind} > {limit}", 1.0)
    if kind == "distance":
        content["specifications"]["wanted"] = {"pairs": [["guest", "robot.0"]], "formula": f"always distance > {limit}"}
    risks, _, _ = estimates(tmp_path, content)
    assert risks[0] == pytest.approx(risk)


def test_in_regions_the_risk_is_never_below_that_of_others_who_keep_to_them(tmp_path: Path) -> None:
    """With noise, the robot meets the nearest point of the region with a known probability."""
    write_table(tmp_path / "table.parquet", np.tile([0.25, 0.5, 0.75, 1.0], (60, 1)))
    content = beside_another("always[1, 1] nearest > 1.5", 1.0, noise=[0.5, 0.0], samples=20_000)
    risks, errors, _ = estimates(tmp_path, content)
    assert abs(risks[0] - 0.1 - norm.sf(0.5 / 0.5)) <= 4 * errors[0]


def test_without_regions_others_may_be_anywhere(tmp_path: Path) -> None:
    assert estimates(tmp_path, beside_another("always nearest > 0.1", None))[0][0] == 1.0


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("always nearest < 5", "`nearest < 5` has no worst place of another"),
        ("eventually not nearest > 5", "`nearest > 5` has no worst place of another"),
        ("always nearest - 1 > 0", "has no worst place of another"),
        ("always not inside(position, around)", "has no worst place of another"),
    ],
)
def test_with_regions_predicates_about_others_are_about_their_distance(tmp_path: Path, formula: str, said: str) -> None:
    content = beside_another(formula, None)
    content["regions"] = {"around": {"around": "guest", "circle": {"centre": [0, 0], "radius": 1.9}}}
    (tmp_path / "risk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "risk.yaml")
