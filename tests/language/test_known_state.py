"""A maximal risk requires exact states, or the covariances of their errors."""

from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError

#: Controllers that take a `maximal_risk`, with their further parameters.
CONTROLLERS: dict[str, dict[str, Any]] = {
    "control.mpc": {"horizon": 0.4, "steps": 4},
    "control.risk-aware": {},
}

#: Perceptions, each with whether it gives the own state exactly, and others exactly.
PERCEPTIONS: dict[str, tuple[dict[str, Any] | None, bool, bool]] = {
    "none": (None, False, False),
    "self": ({"use": "perception.self"}, True, False),
    "omniscient": ({"use": "perception.omniscient"}, True, True),
    "late": ({"use": "perception.omniscient", "period": 0.3}, False, True),
    "range": ({"use": "perception.range", "with": {"range": 5.0}}, True, True),
    "noisy": ({"use": "perception.range", "with": {"range": 5.0, "self_noise": 0.1}}, False, True),
    "noisy-elements": ({"use": "perception.range", "with": {"range": 5.0, "self_noise": [0.0, 0.1]}}, False, True),
    "delayed": ({"use": "perception.range", "with": {"range": 5.0, "delay": 0.1}}, False, False),
    "noisy-others": ({"use": "perception.range", "with": {"range": 5.0, "position_noise": 0.1}}, True, False),
    "noisy-velocities": ({"use": "perception.range", "with": {"range": 5.0, "velocity_noise": 0.1}}, True, False),
}


def scenario(controller: str, perception: str, *, estimates: bool = False, pairs: bool = False) -> dict[str, Any]:
    """Two robots."""
    sense = PERCEPTIONS[perception][0]
    given = {"specifications": ["safe"], "maximal_risk": 0.1, **CONTROLLERS[controller]}
    components: dict[str, Any] = {} if sense is None else {"sense": sense}
    if estimates:
        components["estimate"] = {"use": "uncertainty.gaussian"}
    if controller == "control.risk-aware":
        components["steer"] = {"use": "control.go-to-goal"}
    about = (
        {"pairs": "robot", "formula": "always distance > 1"} if pairs else {"each": "robot", "formula": "always x < 9"}
    )
    return {
        "symaware": 1,
        "name": "known",
        "run": {"duration": 0.3},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "specifications": {"safe": about},
        "agents": {
            "robot": {
                "count": 2,
                "model": {"use": "single-integrator", "with": {"process_noise": 0.1}},
                "state": [[0.0, 0.0], [3.0, 0.0]],
                "knowledge": {"goal": [1, 0]},
                "components": {**components, "keep": {"use": controller, "with": given}},
            }
        },
    }


def written(folder: Path, content: dict[str, Any]) -> Path:
    path = folder / "known.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


@pytest.mark.parametrize(("controller", "perception"), list(product(CONTROLLERS, PERCEPTIONS)))
def test_a_maximal_risk_needs_a_covariance_unless_perception_is_exact(
    tmp_path: Path, controller: str, perception: str
) -> None:
    if controller == "control.mpc":
        pytest.importorskip("casadi", reason="CasADi is an extra")
    _, own, others = PERCEPTIONS[perception]
    for pairs in (False, True):
        path = written(tmp_path, scenario(controller, perception, pairs=pairs))
        if own and (others or not pairs):
            build(path)
            continue
        with pytest.raises(ScenarioError, match=r"`uncertainty\.gaussian` before it") as error:
            build(path)
        assert [problem.path for problem in error.value.problems] == ["agents.robot.components.keep.with.maximal_risk"]


@pytest.mark.parametrize("perception", ["noisy", "delayed", "noisy-others"])
def test_an_estimate_with_a_covariance_suffices(tmp_path: Path, perception: str) -> None:
    for pairs in (False, True):
        build(written(tmp_path, scenario("control.risk-aware", perception, estimates=True, pairs=pairs)))


def test_an_estimate_after_the_controller_comes_too_late(tmp_path: Path) -> None:
    content = scenario("control.risk-aware", "noisy")
    content["agents"]["robot"]["components"]["estimate"] = {"use": "uncertainty.gaussian"}
    with pytest.raises(ScenarioError, match="perceives the own state with errors"):
        build(written(tmp_path, content))


def test_without_a_maximal_risk_no_covariance_is_required(tmp_path: Path) -> None:
    content = scenario("control.risk-aware", "noisy")
    content["agents"]["robot"]["components"]["keep"].pop("with")
    build(written(tmp_path, content))
