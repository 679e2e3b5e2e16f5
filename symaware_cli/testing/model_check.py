"""Checks of models: quantities, shapes, purity, rows, finite values, and derivatives against finite differences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from symaware_cli.engine import faults_of
from symaware_cli.geometry import Array
from symaware_cli.language import KINDS
from symaware_cli.testing.conformance import DeviationList, method_of, require_kind, unlike, with_parameters
from symaware_cli.testing.side_effects import own_state, watched
from symaware_cli.world import Model, Quantity, columns, integrate

_KIND = next(each for each in KINDS if each.name == "model")

#: The number of rows of the check, the step of finite differences, and the tolerance of comparisons with them.
_ROWS, _WIDTH, _TOLERANCE = 5, 1e-6, 1e-4


def check_model(kind: type[Model], states: Any = None, /, **parameters: Any) -> None:
    """Check a model at some states and control inputs.

    Quantities must have names and units, results the declared shapes, and no row may depend on others. `jacobian`,
    `velocity`, `turn_rate` and `velocities` must agree with `derivative`, `successor` with its integral, and the
    covariance of the noise must be a covariance matrix. Methods must not change their arguments or draw random numbers,
    and must return the same value when called again.

    Args:
        kind: The class.
        states: States at which it is evaluated, shape (n, nx) or (nx,); by default five near 0.
        parameters: The parameters of the model.

    Raises:
        ConformanceError: A line for each deviation.
    """
    found = require_kind(kind, _KIND)
    model: Model = with_parameters(found, parameters)
    _check_quantities(found, model)
    found.settle()
    for fault in faults_of(model):
        where = next((each for each in fault.split("`")[1::2] if hasattr(kind, each)), "derivative")
        found.add(where, fault)
    x, u = _points(found, model, states)
    found.settle()
    own = {name for name in _methods(model) if getattr(kind, name) is not getattr(Model, name)}
    results = {
        name: _check_method(found, model, name, call, x, u) if name in own else None
        for name, call in _methods(model).items()
    }
    found.settle()
    for name, value in results.items():
        if value is not None and not np.isfinite(value).all():
            row = int(np.argwhere(~np.isfinite(value))[0][0])
            where = f"at the state {np.round(x[row], 4).tolist()} and the input {np.round(u[row], 4).tolist()}"
            found.add(name, f"returns {value[row].tolist()} {where}", "return finite numbers for all finite states")
    found.settle()
    with found.calling("derivative"):
        _check_against_differences(found, model, x, u, results)
        _check_noise(found, model)
        _check_limits(found, model, u)
    found.settle()


def _check_quantities(found: DeviationList, model: Model) -> None:
    how = 'declare a name and a unit for each: (Quantity("x", "m"), Quantity("heading", "rad"))'
    for where, quantities in (("state", model.state), ("control_input", model.control_input)):
        if not quantities:
            found.add(where, "is empty", how)
            continue
        for number, each in enumerate(quantities):
            if not isinstance(each, Quantity):
                found.add(where, f"has a {type(each).__name__} as element {number}", how)
            elif not isinstance(each.name, str) or not each.name.isidentifier():
                found.add(where, f"has an element {number} called {each.name!r}, which is not a name", how)
            elif not isinstance(each.unit, str) or not each.unit:
                found.add(where, f"has an element `{each.name}` without a unit", 'state it, or "1" for none')
        names = [each.name for each in quantities if isinstance(each, Quantity)]
        for name in sorted({name for name in names if names.count(name) > 1}):
            found.add(where, f"has two elements called `{name}`", "give each a name of its own")
    if found:
        return
    count = len(model.state)
    groups = {"position": model.position, "velocities": model.velocities, "angles": model.angles}
    groups["heading"] = () if model.heading is None else (model.heading,)
    for where, indices in groups.items():
        for index in indices:
            if not isinstance(index, int | np.integer) or not 0 <= index < count:
                found.add(where, f"has the index {index}, and the state has {count} elements", "count from 0")
            elif where in ("heading", "angles") and model.state[index].unit != "rad":
                found.add(where, f"is `{model.state[index].name}` in {model.state[index].unit}", "use rad")
            elif where == "position" and model.state[index].unit != "m":
                found.add(where, f"is `{model.state[index].name}` in {model.state[index].unit}", "use m")
    if model.velocities and len(model.velocities) != len(model.position):
        found.add("velocities", f"has {len(model.velocities)} indices", f"one for each of {len(model.position)} axes")


def _points(found: DeviationList, model: Model, states: Any) -> tuple[Array, Array]:
    """Return states (n, nx) and control inputs within their bounds (n, nu)."""
    random = np.random.default_rng(7)
    nx, nu = len(model.state), len(model.control_input)
    x = random.uniform(-1.0, 1.0, (_ROWS, nx)) if states is None else np.atleast_2d(np.asarray(states, float))
    if x.ndim != 2 or x.shape[1] != nx:
        raise ValueError(f"states have the shape (n, {nx}), not {x.shape}")
    if len(x) == 1:
        x = np.repeat(x, 2, axis=0)
    u = random.uniform(-1.0, 1.0, (len(x), nu))
    with found.calling("input_bounds"):
        low, high = (np.asarray(bound, float) for bound in model.input_bounds())
        low, high = np.maximum(low, -1e3), np.minimum(high, 1e3)
        # Slightly within the bounds, so that finite differences do not leave them.
        u = np.clip(u, low + 1e-3 * (high - low), high - 1e-3 * (high - low))
    return x, u


Method = Callable[[Array, Array], Any]


def _methods(model: Model) -> Mapping[str, Method]:
    """Return the methods as functions of states (n, nx) and control inputs (n, nu), which return a row for each."""
    step = model.time_step or 0.05

    def by_elements(call: Callable[[Array, Array], Any]) -> Method:
        """Call a method with the elements of states and inputs, each contiguous, and copy changes that it made back."""

        def method(x: Array, u: Array) -> Array | None:
            states, inputs = columns(x), columns(u)
            found = _rows(call(states, inputs), len(x))
            x[:], u[:] = states.T, inputs.T
            return found

        return method

    return {
        "derivative": by_elements(lambda x, u: model.derivative(x, u, np)),
        "successor": by_elements(lambda x, u: model.successor(x, u, step, np)),
        "exact_step": lambda x, u: model.exact_step(x, u, step),
        "limit": lambda x, u: model.limit(u),
        "positions": lambda x, u: model.positions(x),
        "velocity": model.velocity,
        "turn_rate": lambda x, u: model.turn_rate(x, u)[:, None],
        "jacobian": model.jacobian,
        "follow_velocity": lambda x, u: model.follow_velocity(x, np.full((len(x), len(model.position)), 0.3)),
        "slowed": lambda x, u: model.slowed(x, u, np.full(len(x), 0.5)),
    }


def _rates(model: Model, x: Array, u: Array) -> Array:
    rates = _rows(model.derivative(columns(x), columns(u), np), len(x))
    assert rates is not None
    return rates


def _rows(elements: Any, count: int) -> Array | None:
    """Turn an expression for each element of the state into rows of agents; shape (n, nx)."""
    if elements is None:
        return None
    return np.stack([np.broadcast_to(np.asarray(each, float), (count,)) for each in elements], axis=1)


def _check_method(found: DeviationList, model: Model, name: str, call: Method, x: Array, u: Array) -> Array | None:
    """Return the value of a method; None if the method is not supported or fails."""
    given_x, given_u, before = x.copy(), u.copy(), own_state(model)
    try:
        with np.errstate(all="ignore"), watched(found, name):
            value = call(given_x, given_u)
            if value is None:
                return None
            value = np.array(value, float)
            again = np.array(call(x.copy(), u.copy()), float)
    except NotImplementedError:
        return None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        found.failure(method_of(found.kind, error) or name, error)
        return None
    for which, now, then in (("states", given_x, x), ("control inputs", given_u, u)):
        if not np.array_equal(now, then):
            found.add(name, f"changes the {which} that it was given", "compute new arrays")
    for attribute in unlike(before, own_state(model)):
        found.add(name, f"changes {attribute}", "a model holds parameters and no state: all agents share it")
    if not np.array_equal(value, again, equal_nan=True):
        found.add(name, "returns other values when it is called again", "depend on the arguments and parameters only")
        return value
    with found.calling(name):
        _check_rows(found, model, name, call, x, u, value)
    return value


def _check_rows(found: DeviationList, model: Model, name: str, call: Method, x: Array, u: Array, value: Array) -> None:
    """Check that each row is computed like a group of one."""
    with np.errstate(all="ignore"):
        alone = np.concatenate(
            [np.array(call(x[row : row + 1].copy(), u[row : row + 1].copy())) for row in range(len(x))]
        )
    if alone.shape == value.shape and np.allclose(alone, value, rtol=1e-9, atol=1e-12, equal_nan=True):
        if vars(type(model)).get("batchable") and not np.array_equal(alone, value, equal_nan=True):
            what = "differs in its last bits for a group and for one agent, although `batchable` is declared"
            found.add(name, what, "avoid sums across rows and BLAS, or omit `batchable`")
        return
    found.add(name, "returns other values for a group than for each agent alone", "let no row depend on others")


def _check_against_differences(
    found: DeviationList, model: Model, x: Array, u: Array, results: Mapping[str, Array | None]
) -> None:
    rates = _rates(model, x, u)
    how = f"agree with `derivative` within {_TOLERANCE:g}"
    jacobian = Model.jacobian(model, x, u)
    for row, column in _wrong(results["jacobian"], jacobian):
        what = f"is {_entry(results['jacobian'], row, column)} for the rate of `{model.state[row].name}` by"
        what += f" `{model.state[column].name}`, and finite differences give {_entry(jacobian, row, column)}"
        found.add("jacobian", what, how)
    velocity = rates[:, list(model.position)]
    for (axis,) in _wrong(results["velocity"], velocity):
        what = f"is {_entry(results['velocity'], axis)} along axis {axis}, and the derivative of the position is"
        found.add("velocity", f"{what} {_entry(velocity, axis)}", how)
    for number, index in enumerate(model.velocities):
        if not _near(rates[:, model.position[number]], x[:, index]):
            what = f"names `{model.state[index].name}`, which is not the derivative of"
            found.add("velocities", f"{what} `{model.state[model.position[number]].name}`", how)
    turning = np.zeros((len(x), 1)) if model.heading is None else rates[:, [model.heading]]
    if results["turn_rate"] is not None and not _near(results["turn_rate"], turning):
        found.add(
            "turn_rate",
            f"is {_entry(results['turn_rate'], 0)}, and the heading's derivative is {_entry(turning, 0)}",
            how,
        )
    after = results["successor"]
    if model.time_step is not None and after is None:
        found.add("successor", "returns None, although the model is in discrete time", "return the state after a step")
    elif after is not None:
        _check_successor(found, model, x, u, after)


def _check_successor(found: DeviationList, model: Model, x: Array, u: Array, after: Array) -> None:
    if model.time_step is not None:
        expected, words = x + model.time_step * _rates(model, x, u), "x + time_step * derivative"
    else:
        expected, words = integrate(model, x, u, 0.05, "rk4", 20), "the integral of `derivative`"
    for (index,) in _wrong(after, expected):
        what = f"is {_entry(after, index)} for `{model.state[index].name}`, and {words} is {_entry(expected, index)}"
        found.add("successor", what, "let both describe the same motion")


def _check_noise(found: DeviationList, model: Model) -> None:
    step = model.time_step or 0.05
    deviation, covariance = model.noise_deviation(step), model.noise_covariance(step)
    if deviation is not None and (np.asarray(deviation) < 0).any():
        found.add("noise_deviation", "is negative", "return standard deviations")
    if covariance is None:
        return
    if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance).min() < -1e-12:
        found.add("noise_covariance", "is no covariance", "return a symmetric matrix without negative eigenvalues")
    elif deviation is not None and not np.allclose(np.diag(covariance), np.square(deviation)):
        found.add("noise_covariance", "has another diagonal than the squares of `noise_deviation`", "let them agree")


def _check_limits(found: DeviationList, model: Model, u: Array) -> None:
    low, high = (np.asarray(bound, float) for bound in model.input_bounds())
    limited = model.limit(u * 1e6)
    if (limited < low).any() or (limited > high).any():
        found.add("limit", "returns control inputs beyond `input_bounds`", "saturate to the bounds")
    elif not np.array_equal(model.limit(u), u):
        found.add("limit", "changes control inputs within `input_bounds`", "return these as they are")


def _wrong(value: Array | None, expected: Array) -> Iterator[tuple[int, ...]]:
    """Yield the indices, without that of the row, of entries that differ from the expected values."""
    if value is not None:
        scale = np.maximum(1.0, np.abs(expected))
        differs = (np.abs(value - expected) > _TOLERANCE * scale).any(axis=0)
        yield from (tuple(int(each) for each in index) for index in np.argwhere(differs))


def _near(value: Array, expected: Array) -> bool:
    return bool(np.allclose(value, expected, rtol=_TOLERANCE, atol=_TOLERANCE))


def _entry(values: Array | None, *index: int) -> str:
    assert values is not None
    return f"{values[(0, *index)]:.6g}"
