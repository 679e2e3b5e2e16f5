"""How `control.mpc` follows plans in noise: against many runs of the same policy."""

import numpy as np
import pytest

pytest.importorskip("casadi", reason="CasADi is an extra")

from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.planning.control.feedback_policy import FeedbackPolicy
from symaware_cli.planning.optimal_control import Dynamics, Plan

STEP, NOISE = 0.1, 0.05


def plan_of(dynamics: Dynamics, steps: int) -> Plan:
    """A plan that accelerates, or goes on at a speed."""
    start = np.zeros(len(dynamics.model.state))
    inputs = np.tile([0.4, 0.1], (steps, 1))
    states = [start]
    for each in inputs:
        states.append(dynamics(states[-1][None], each[None])[0])
    return Plan(np.array(states), inputs, dynamics, steps)


@pytest.mark.parametrize("model", [SingleIntegrator(), DoubleIntegrator()])
def test_the_covariance_of_a_plan_that_is_followed_is_that_of_many_runs(model: SingleIntegrator) -> None:
    dynamics = Dynamics(model, STEP, "exact")
    policy, plan, size = FeedbackPolicy(dynamics, 2.0), plan_of(dynamics, 12), len(model.state)
    generator = np.random.default_rng(1)
    ends = []
    for _ in range(400):
        rest, state = plan, plan.states[0]
        for _ in range(12):
            rest = policy.followed(rest, state)
            state = rest.states[1] + NOISE * generator.normal(size=size)
            rest = rest.shifted()
        ends.append(state)
    noise = NOISE**2 * np.eye(size)
    expected = policy.covariances(np.zeros((size, size)), noise, 12)[-1]
    assert np.mean(ends, axis=0) == pytest.approx(plan.states[-1], abs=5 * np.sqrt(np.diag(expected).max() / 400))
    assert np.diag(np.cov(np.array(ends).T)) == pytest.approx(np.diag(expected), rel=0.35)


@pytest.mark.parametrize("model", [SingleIntegrator(), DoubleIntegrator()])
def test_after_its_end_it_stops_where_the_policy_says(model: SingleIntegrator) -> None:
    dynamics = Dynamics(model, STEP, "exact")
    policy, plan = FeedbackPolicy(dynamics, 2.0), plan_of(dynamics, 5)
    rest, state = plan, plan.states[0]
    for _ in range(200):
        rest = policy.followed(rest, state)
        state, rest = rest.states[1], rest.shifted()
    assert state == pytest.approx(policy.rest @ plan.states[-1], abs=1e-6)


def test_the_error_of_an_estimate_is_not_corrected_and_what_is_learned_is() -> None:
    policy = FeedbackPolicy(Dynamics(SingleIntegrator(), STEP, "exact"), 2.0)
    believed, noise = 0.04 * np.eye(2), 0.001 * np.eye(2)
    found = policy.covariances(believed, noise, 200)
    assert found[0] == pytest.approx(believed)
    assert found[1] == pytest.approx(believed + noise)
    assert found[-1] == pytest.approx(believed + noise / (1 - 0.8**2))
