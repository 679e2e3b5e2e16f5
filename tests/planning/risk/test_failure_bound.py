"""Bounds of `risk.specification` are never below the truth, and what they are where it is known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from failure_scenarios import STEP, estimates, last_step, scenario
from scipy.stats import norm

from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError


def bound(folder: Path, formula: str, method: str = "normal", **changes: Any) -> float:
    risks, errors, _ = estimates(folder, scenario(formula, risk={"method": method}, **changes))
    assert not errors.any()
    return float(risks[0])


@pytest.mark.parametrize("p", [1e-6, 0.001, 0.05, 0.3, 0.5])
def test_the_bound_of_one_face_at_one_instant_is_the_probability(tmp_path: Path, p: float) -> None:
    assert bound(tmp_path, last_step(p)) == pytest.approx(p, rel=1e-9)
    assert bound(tmp_path, last_step(p), "chebyshev") == pytest.approx(1 / (1 + norm.isf(p) ** 2))


def test_the_bound_of_several_instants_is_the_sum(tmp_path: Path) -> None:
    deviations = 0.5 * np.sqrt(STEP * np.arange(11))
    expected = sum(norm.sf(1.2 / each) for each in deviations[1:])
    assert bound(tmp_path, "always x < 1.2") == pytest.approx(expected, rel=1e-9)
    assert bound(tmp_path, "always (x < 1.2 and x > -1.2)") == pytest.approx(2 * expected, rel=1e-9)


FORMULAS = [
    "always x < 1.1",
    "always (x < 1.1 and y > -0.9)",
    "always inside(position, room)",
    "always not inside(position, wall)",
    "always not inside(position, pond)",
    "always inside(position, clearing)",
    "always inside([y, x], free)",
    "always inside(position, triangle)",
    "eventually[0, 1] x > 0.1",
    "eventually[0, 1] inside(position, pond)",
    "always (x > 0.3 implies eventually[0, 0.3] y > 0)",
    "x < 0.6 until[0, 0.9] y > 0.2",
    "always 2 * x - y / 2 < 1.5",
    "always (0.1 > x or historically[0, 0.2] y < 0.4)",
    "always position[0] - knowledge.limit < 0",
    "not eventually x >= 0.9",
]
REGIONS = {
    "room": {"box": [-1.2, 1.1, -1, 1.3]},
    "wall": {"box": [0.6, 0.8, -3, 3]},
    "pond": {"circle": {"centre": [0.7, 0.4], "radius": 0.4}},
    "clearing": {"circle": {"centre": [0, 0], "radius": 1.3}},
    "triangle": {"polygon": [[-1.5, -1], [1.5, -1], [0, 2]]},
    "free": {"intersection": ["room", {"complement": "wall"}]},
}


@pytest.mark.parametrize("formula", FORMULAS)
def test_bounds_are_never_below_the_share_of_samples_that_fail(tmp_path: Path, formula: str) -> None:
    changes: dict[str, Any] = {"regions": REGIONS, "robot": {"knowledge": {"limit": 1.0}}}
    sampled, errors, _ = estimates(tmp_path, scenario(formula, risk={"samples": 20_000}, **changes))
    normal = bound(tmp_path, formula, **changes)
    assert normal >= sampled[0] - 4 * errors[0]
    assert bound(tmp_path, formula, "chebyshev", **changes) >= normal - 1e-12


@pytest.mark.parametrize("correction", [0.0, 2.0])
@pytest.mark.parametrize("model", ["single-integrator", "double-integrator"])
def test_intents_and_their_correction_shape_the_covariance(tmp_path: Path, model: str, correction: float) -> None:
    """At one instant and one face the bound is the probability, which samples estimate."""
    changes: dict[str, Any] = {"risk": {"samples": 20_000, "follow_intents": True, "correction": correction}}
    content = scenario("always[1, 1] x < 1.2", **changes)
    robot = content["agents"]["robot"]
    robot["model"] = {"use": model, "with": {"process_noise": 0.3}}
    robot["state"] = [0.0] * (2 if model == "single-integrator" else 4)
    robot["knowledge"] = {"goal": [9, 0]}
    steer = {"use": "control.go-to-goal", "with": {"speed": 1.0}}
    robot["components"] = {"see": robot["components"]["see"], "steer": steer, "risk": robot["components"]["risk"]}
    sampled, errors, _ = estimates(tmp_path, content)
    robot["components"]["risk"]["with"]["method"] = "normal"
    exact, _, _ = estimates(tmp_path, content)
    assert 0.02 < exact[0] < 0.98
    assert abs(exact[0] - sampled[0]) <= 4 * errors[0]


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("always speed < 1", "it is not linear in the state"),
        ("always nearest > 1", "it is not linear in the state"),
        ("always x * y < 1", "it is not linear in the state"),
        ("always x != 1", "`!=` has no bound"),
    ],
)
def test_a_predicate_without_a_bound_is_refused_where_it_is_named(tmp_path: Path, formula: str, said: str) -> None:
    content = scenario(formula, risk={"method": "normal"})
    (tmp_path / "risk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ScenarioError, match=said):
        build(tmp_path / "risk.yaml")


def test_models_that_are_not_linear_are_refused(tmp_path: Path) -> None:
    content = scenario("always x < 1", risk={"method": "normal"})
    content["agents"]["robot"] |= {"model": {"use": "unicycle"}, "state": [0, 0, 0]}
    (tmp_path / "risk.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ScenarioError, match="not linear"):
        build(tmp_path / "risk.yaml")
