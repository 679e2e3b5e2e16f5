"""Model checks: finds methods that return another shape or type than the model declares, before a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from symaware_cli.geometry import Array
from symaware_cli.world import Model, columns, counted

_RAISED = object()


def faults_of(model: Model, state: Array | None = None, step: float = 0.1) -> Iterator[str]:
    """Find results of a model's methods that have another shape or type than required.

    NumPy would broadcast many of them silently, and wrong elements of the state would move.

    Args:
        model: The model; its `state`, `control_input` and indices are valid.
        state: The state to evaluate the methods at; shape (nx,). Zeros if left out.
        step: The time step to evaluate them with, for a model in continuous time [s].

    Yields:
        A description of each fault, as a predicate such as "returns 2 elements from `derivative`, and the state has 3".
    """
    nx, nu, d = len(model.state), len(model.control_input), len(model.position)
    # A number of rows that differs from all dimensions, so that no wrong shape fits by chance.
    count = max(nx, nu, d) + 2
    states = np.tile(np.zeros(nx) if state is None else state, (count, 1))
    bounds = yield from _bounds(model, nu)
    inputs = np.tile(np.zeros(nu) if bounds is None else np.clip(0.0, *bounds), (count, 1))
    step = model.time_step or step
    x, u = columns(states), columns(inputs)
    parts = list(_elements("derivative", lambda: model.derivative(x, u, np), nx, count, needed=True))
    parts += _elements("successor", lambda: model.successor(x, u, step, np), nx, count)
    yield from parts
    if not parts:  # which the following are derived from by default
        yield from _array("exact_step", lambda: model.exact_step(states, inputs, step), (count, nx), may_be_none=True)
        yield from _array("turn_rate", lambda: model.turn_rate(states, inputs), (count,))
    if bounds is not None:
        yield from _array("limit", lambda: model.limit(inputs), (count, nu))
    yield from _array("positions", lambda: model.positions(states), (count, d))
    yield from _array("velocity", lambda: model.velocity(states, inputs), (count, d))
    yield from _array("jacobian", lambda: model.jacobian(states, inputs), (count, nx, nx))
    yield from _array("noise_deviation", lambda: model.noise_deviation(step), (nx,), may_be_none=True)
    yield from _array("noise_covariance", lambda: model.noise_covariance(step), (nx, nx), may_be_none=True)
    yield from _array("follow_velocity", lambda: model.follow_velocity(states, np.zeros((count, d))), (count, nu))
    yield from _array("slowed", lambda: model.slowed(states, inputs, np.full(count, 0.5)), (count, nu))


def _bounds(model: Model, nu: int) -> Iterator[str] | Any:
    """Return the bounds of the control input, each of shape (nu,); None if invalid."""
    try:
        low, high = (np.array(bound, float) for bound in model.input_bounds())
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        yield f"returns no two lists of numbers from `input_bounds`: {type(error).__name__}: {error}"
        return None
    for bound, which in ((low, "lower"), (high, "upper")):
        if bound.shape != (nu,):
            yield f"returns {_many(bound.shape)} as {which} `input_bounds`, and the control input has {nu}"
            return None
    if not (low <= high).all():
        yield f"returns `input_bounds` that leave nothing between {low.tolist()} and {high.tolist()}"
        return None
    return low, high


def _result_of(call: Callable[[], Any]) -> Any:
    """Return the result of a method; `_RAISED` if it raises, which is reported where the method is used."""
    try:
        with np.errstate(all="ignore"):
            return call()
    except KeyboardInterrupt:
        raise
    except BaseException:
        return _RAISED


def _elements(
    name: str, call: Callable[[], Sequence[Any] | None], nx: int, count: int, *, needed: bool = False
) -> Iterator[str]:
    """Check a method that returns an expression for each element of the state."""
    returned = _result_of(call)
    if returned is _RAISED or (returned is None and not needed):
        return
    try:
        given = len(returned)
    except TypeError:
        yield f"returns {type(returned).__name__} from `{name}`, and a sequence of {nx} elements is needed"
        return
    if given != nx:
        yield f"returns {_many((given,))} from `{name}`, and the state has {nx}"
        return
    for element, quantity in zip(returned, range(nx), strict=True):
        try:
            array = np.asarray(element)
        except ValueError:
            array = np.empty(0, object)
        if array.shape not in ((), (count,)) or array.dtype.kind not in "fiub":
            form = f"shape {array.shape}" if array.dtype.kind in "fiub" else f"type {array.dtype}"
            yield f"returns an element {quantity} of the {form} from `{name}`: one real number for each agent is needed"
            return


def _array(name: str, call: Callable[[], Any], shape: tuple[int, ...], *, may_be_none: bool = False) -> Iterator[str]:
    """Check a method that returns an array."""
    returned = _result_of(call)
    if returned is _RAISED or (returned is None and may_be_none):
        return
    try:
        array = np.asarray(returned)
    except ValueError:
        array = np.empty(0, object)
    if array.dtype.kind not in "fiub":
        yield f"returns no real numbers from `{name}`"
    elif array.shape != shape:
        yield f"returns an array of the shape {array.shape} from `{name}`, and {shape} is needed"


def _many(shape: tuple[int, ...]) -> str:
    return counted(shape[0], "element") if len(shape) == 1 else f"the shape {shape}"
