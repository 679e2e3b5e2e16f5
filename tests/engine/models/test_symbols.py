"""CasADi optimises over the very definition that NumPy simulates."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from casadi.casadi import Function, GenericExpressionCommon
from numpy.typing import NDArray
from simulating import made, present
from specimens import SPECIMENS, states_and_inputs, step_of

from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle

casadi = pytest.importorskip("casadi", reason="CasADi is an extra")

every_model = pytest.mark.parametrize("model", SPECIMENS.values(), ids=SPECIMENS)
every_kind = pytest.mark.parametrize("symbol", [casadi.SX.sym, casadi.MX.sym], ids=["SX", "MX"])


def function(model: NoisyModel, symbol: Callable[..., Any], expression: Callable[..., Any]) -> Function:
    """A CasADi function of state and control input."""
    state, control_input = symbol("x", len(model.state)), symbol("u", len(model.control_input))
    result: Function = casadi.Function("f", [state, control_input], [expression(state, control_input)])
    return result


def evaluated(compiled: Function, *arrays: NDArray[np.float64]) -> NDArray[np.float64]:
    """The function at every row; shape (n, ...)."""
    return np.array([np.array(compiled(*rows)) for rows in zip(*arrays, strict=True)])


@every_kind
@every_model
def test_symbols_and_numbers_have_the_same_derivative(model: NoisyModel, symbol: Callable[..., Any]) -> None:
    state, control_input = states_and_inputs(model, 20)
    compiled = function(model, symbol, lambda x, u: casadi.vertcat(*model.derivative(x, u, casadi)))
    rates = np.array(model.derivative(state.T, control_input.T, np)).T
    assert np.allclose(evaluated(compiled, state, control_input)[..., 0], rates, rtol=1e-12, atol=1e-12)


@every_kind
@every_model
def test_symbols_and_numbers_have_the_same_successor(model: NoisyModel, symbol: Callable[..., Any]) -> None:
    state, control_input = states_and_inputs(model, 40)
    step = step_of(model)
    if len(model.control_input) > 1:
        control_input[:5, 1], control_input[5:10, 1] = 0.0, 1e-9
    compiled = function(model, symbol, lambda x, u: casadi.vertcat(*present(model.successor(x, u, step, casadi))))
    after = model.exact_step(state, control_input, step)
    assert after is not None
    assert np.allclose(evaluated(compiled, state, control_input)[..., 0], after, rtol=1e-12, atol=1e-12)


@every_kind
@every_model
def test_the_jacobian_of_casadi_is_that_of_the_model(model: NoisyModel, symbol: Callable[..., Any]) -> None:
    state, control_input = states_and_inputs(model, 20)

    def jacobian(x: GenericExpressionCommon, u: GenericExpressionCommon) -> GenericExpressionCommon:
        result: GenericExpressionCommon = casadi.jacobian(casadi.vertcat(*model.derivative(x, u, casadi)), x)
        return result

    # Every model that ships has its Jacobian in closed form, so they agree to rounding.
    ours = model.jacobian(state, control_input)
    assert np.allclose(evaluated(function(model, symbol, jacobian), state, control_input), ours, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("turn_rate", [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.199999, 0.200001, 1.0])
def test_the_arc_has_right_derivatives_however_slightly_it_bends(turn_rate: float) -> None:
    # From the origin along x at v = 1 for 1 s, x = sin(w) / w = 1 - w^2 / 3! + w^4 / 5! - ..., derived term by term.
    model, step = made(Unicycle), 1.0
    x, u = casadi.MX.sym("x", 3), casadi.MX.sym("u", 2)
    ahead = model.successor(x, u, step, casadi)[0]
    hessian, gradient = casadi.hessian(ahead, u)
    compiled = casadi.Function("f", [x, u], [gradient, hessian])
    first, second = (np.array(each) for each in compiled(np.zeros(3), np.array([1.0, turn_rate])))
    w = turn_rate
    terms = np.arange(1, 12)
    factorials = np.cumprod(2.0 * terms * (2.0 * terms + 1.0))
    signs = (-1.0) ** terms
    assert first[1, 0] == pytest.approx(np.sum(signs * 2 * terms * w ** (2 * terms - 1) / factorials), abs=1e-12)
    expected = np.sum(signs * 2 * terms * (2 * terms - 1) * float(w) ** (2 * terms - 2) / factorials)
    assert second[1, 1] == pytest.approx(expected, abs=1e-10)


def test_casadi_may_leave_the_step_open() -> None:
    model = made(Unicycle)
    step = casadi.SX.sym("h")
    x, u = casadi.SX.sym("x", 3), casadi.SX.sym("u", 2)
    compiled = casadi.Function("f", [x, u, step], [casadi.vertcat(*present(model.successor(x, u, step, casadi)))])
    state, control_input = np.array([[1.0, 2.0, 0.3]]), np.array([[0.8, 1.1]])
    after = model.exact_step(state, control_input, 0.7)
    assert after is not None
    assert np.allclose(np.array(compiled(state[0], control_input[0], 0.7))[:, 0], after[0], rtol=1e-12)
