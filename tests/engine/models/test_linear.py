"""The linear model: a map, its noise, and what it refuses."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from simulating import made, present, untyped
from specimens import COUPLED, SPECIMENS, WALK

from symaware_cli.engine.models.integrator import DoubleIntegrator
from symaware_cli.engine.models.linear import Linear
from symaware_cli.engine.runtime.run import run
from symaware_cli.language.build import build
from symaware_cli.language.problem import ScenarioError

GUIDE = CHECKOUT / "docs" / "models.md"


def test_the_map_is_a_x_plus_b_u() -> None:
    model = SPECIMENS["linear, coupled"]
    random = np.random.default_rng(3)
    state, control_input = random.normal(size=(30, 4)), random.normal(size=(30, 3))
    expected = state @ np.array(COUPLED["A"]).T + control_input @ np.array(COUPLED["B"]).T
    assert np.allclose(present(model.exact_step(state, control_input, 0.25)), expected, rtol=0.0, atol=1e-14)


def test_a_double_integrator_sampled_by_hand_moves_like_the_double_integrator() -> None:
    # Zero-order hold: p+ = p + h v + h^2/2 a, v+ = v + h a (Astrom and Wittenmark, Computer-Controlled Systems, ch. 2).
    h = 0.2
    sampled = made(
        Linear,
        time_step=h,
        state={"x": "m", "y": "m", "velocity_x": "m/s", "velocity_y": "m/s"},
        control_input={"acceleration_x": "m/s^2", "acceleration_y": "m/s^2"},
        A=[[1, 0, h, 0], [0, 1, 0, h], [0, 0, 1, 0], [0, 0, 0, 1]],
        B=[[h * h / 2, 0], [0, h * h / 2], [h, 0], [0, h]],
    )
    random = np.random.default_rng(4)
    state, push = random.normal(size=(20, 4)), random.normal(size=(20, 2))
    expected = made(DoubleIntegrator).exact_step(state, push, h)
    assert expected is not None
    assert np.allclose(present(sampled.exact_step(state, push, h)), expected, rtol=1e-14, atol=1e-14)
    # Its state is more than a position: what it is to accelerate with for a velocity is a matter of control.
    with pytest.raises(NotImplementedError, match="cannot be steered by a velocity"):
        sampled.follow_velocity(state, push)


def test_one_euler_step_of_its_mean_rate_is_the_map() -> None:
    model = SPECIMENS["linear, coupled"]
    random = np.random.default_rng(5)
    state, control_input = random.normal(size=(10, 4)), random.normal(size=(10, 3))
    rate = np.array(model.derivative(state.T, control_input.T, np)).T
    assert np.allclose(state + 0.25 * rate, present(model.exact_step(state, control_input, 0.25)), rtol=0.0, atol=1e-14)
    assert np.allclose(np.eye(4) + 0.25 * model.jacobian(state, control_input), untyped(COUPLED["A"]), atol=1e-15)


def test_it_takes_no_other_step_than_its_own() -> None:
    model = made(Linear, **WALK)
    with pytest.raises(ValueError, match=r"a map over 1 s; it has no step of 0\.05 s"):
        model.exact_step(np.zeros((1, 2)), np.zeros((1, 2)), 0.05)


def test_a_walker_follows_a_velocity_in_one_step() -> None:
    model = made(Linear, **{**WALK, "time_step": 0.5})
    assert model.follow_velocity(np.array([[3.0, 4.0]]), np.array([[2.0, -6.0]])).tolist() == [[1.0, -3.0]]
    # More inputs than axes: the least that does it, by the pseudo-inverse.
    wide = made(
        Linear,
        **{**WALK, "control_input": {"a": "m", "b": "m", "c": "m"}, "B": [[1, 1, 0], [0, 0, 2]], "max_input": None},
    )
    assert np.allclose(wide.follow_velocity(np.zeros((1, 2)), np.array([[4.0, 6.0]])), [[2.0, 2.0, 3.0]])


def test_each_input_is_limited_by_itself() -> None:
    # The norm of case III is the greatest magnitude.
    assert made(Linear, **WALK).limit(np.array([[9.0, -9.0], [6.0, 6.9]])).tolist() == [[7.0, -7.0], [6.0, 6.9]]
    limited = SPECIMENS["linear, coupled"].limit(np.array([[9.0, -9.0, 9.0]]))
    assert limited.tolist() == [[1.0, -2.0, 0.5]]


def test_the_noise_is_that_of_one_step() -> None:
    model = SPECIMENS["linear, coupled"]
    assert present(model.noise_covariance(0.25)).tolist() == COUPLED["W"]
    assert np.allclose(present(model.noise_deviation(0.25)) ** 2, [0.5, 0.4, 0.3, 0.2])
    quiet = made(Linear, **{**WALK, "W": None})
    assert quiet.noise_covariance(1.0) is None
    assert quiet.noise_deviation(1.0) is None


def test_quantities_are_those_that_are_named() -> None:
    model = SPECIMENS["linear, coupled"]
    assert [tuple(quantity) for quantity in model.state] == [("speed", "m/s"), ("x", "m"), ("load", "kg"), ("y", "m")]
    assert [quantity.name for quantity in model.control_input] == ["push", "pull", "tilt"]
    assert model.positions(np.array([[1.0, 2.0, 3.0, 4.0]])).tolist() == [[2.0, 4.0]]


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        ({"A": [[1.0, 0.0]]}, "`A` must have 2 rows of 2 numbers"),
        ({"A": [[1.0, 0.0], [0.0]]}, "`A` must have 2 rows of 2 numbers"),
        ({"A": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}, "`A` must have 2 rows of 2 numbers"),
        ({"A": []}, "`A` must have 2 rows of 2 numbers"),
        ({"A": [[float("nan"), 0.0], [0.0, 1.0]]}, "A.0.0"),
        ({"B": [[1.0], [0.0]]}, "`B` must have 2 rows of 2 numbers"),
        ({"W": [[0.01]]}, "`W` must have 2 rows of 2 numbers"),
        ({"W": [[0.1, 0.2], [0.2, 0.1]]}, "`W` is not a covariance"),
        ({"W": [[0.1, 0.05], [0.0, 0.1]]}, "`W` is not a covariance"),
        ({"W": [[-0.1, 0.0], [0.0, 0.1]]}, "`W` is not a covariance"),
        ({"position": [0, 2]}, "`position` must name different elements"),
        ({"position": [0, 0]}, "`position` must name different elements"),
        ({"position": [0]}, "position"),
        ({"position": [-1, 0]}, "position"),
        ({"max_input": [1.0]}, "`max_input` has 1 numbers, and the control input has 2"),
        ({"max_input": 0.0}, "max_input"),
        ({"time_step": 0.0}, "time_step"),
        ({"state": {}}, "`state` and `control_input` name at least one"),
        ({"state": {"x": 1}}, "state"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(bad: dict[str, list[Any]], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        made(Linear, **{**WALK, **bad})


@pytest.mark.parametrize("name", ["time_step", "state", "control_input", "A", "B"])
def test_its_quantities_and_matrices_are_required(name: str) -> None:
    with pytest.raises(ValueError, match=f"(?s){name}.*required"):
        made(Linear, **{key: value for key, value in WALK.items() if key != name})


@pytest.fixture
def warehouse(tmp_path: Path) -> Path:
    """The scenario of the guide."""
    path = tmp_path / "warehouse.yaml"
    path.write_text(
        present(re.search(r"(?ms)^```yaml\n(symaware: .*?)^```$", GUIDE.read_text(encoding="utf-8")))[1],
        encoding="utf-8",
    )
    return path


def test_the_robots_of_the_guide_reach_their_goal(warehouse: Path) -> None:
    built = build(warehouse)
    summary = run(built.simulation, built.steps)
    assert summary.status == "finished"
    group = built.simulation.groups[0]
    # The gain of the controller is 1/s, so that a step of 1 s ends at the goal but for the noise of that step, 0.1 m.
    distance = np.linalg.norm(built.simulation.environment.state(group) - [35.0, 5.0], axis=1)
    assert (distance < 0.5).all()
    assert (distance > 0.0).all()


def test_a_scenario_whose_time_steps_differ_is_refused(warehouse: Path) -> None:
    text = warehouse.read_text(encoding="utf-8")
    warehouse.write_text(text.replace("with: {time_step: 1.0}", "with: {time_step: 0.5}"), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"is a map over 1 s, and the environment steps by 0\.5 s"):
        build(warehouse)
