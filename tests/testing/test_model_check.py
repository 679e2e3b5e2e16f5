"""Models that contradict themselves are named, with the method, the line, and a correction."""

import math as floats
import time
from typing import Any, ClassVar

import numpy as np
import pytest
from deviating import deviations, is_located
from numpy.typing import NDArray

from symaware_cli import Model, Quantity
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.testing import check_model

Array = NDArray[np.float64]


class Cart(Model):
    """A valid model of a cart that turns."""

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))
    control_input = (Quantity("speed", "m/s"), Quantity("turn_rate", "rad/s"))
    heading = 2

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (control_input[0] * math.cos(state[2]), control_input[0] * math.sin(state[2]), control_input[1])

    def input_bounds(self) -> Any:
        return [-1.0, -2.0], [1.0, 2.0]


class Branching(Cart):
    """Branches on an array."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        if state[0] > 0:
            return (control_input[0], 0.0 * state[0], control_input[1])
        return (0.0 * state[0], control_input[0], control_input[1])


class Scalar(Cart):
    """Uses functions for single numbers."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (control_input[0] * floats.cos(state[2]), 0.0 * state[0], control_input[1])


class Short(Cart):
    """Returns two of three elements."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (control_input[0], control_input[1])


class Singular(Cart):
    """Divides by zero."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (control_input[0] / (0.0 * state[0]), control_input[0], control_input[1])


class Imaginary(Cart):
    """Takes the root of a number that may be negative."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (math.sqrt(state[0]), control_input[0], control_input[1])


class Mean(Cart):
    """Lets all agents follow their mean."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (state[0] - np.mean(state[0]), control_input[0], control_input[1])


class Overwriting(Cart):
    """Changes the state that it was given."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        state[2] = state[2] % 3.0
        return (math.cos(state[2]), math.sin(state[2]), control_input[1])


class Remembering(Cart):
    """Counts its calls."""

    calls = 0

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        self.calls += 1
        return super().derivative(state, control_input, math)


class Noisy(Cart):
    """Draws noise from the global generator."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (control_input[0] + 0.01 * np.random.randn(), state[1], control_input[1])  # noqa: NPY002


class Late(Cart):
    """Depends on the time of day."""

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        return (control_input[0], state[1] + 0.0 * time.time(), control_input[1])


class WrongJacobian(Cart):
    """Has a Jacobian with a wrong sign."""

    def jacobian(self, state: Array, control_input: Array) -> Array:
        jacobian = super().jacobian(state, control_input)
        jacobian[:, 1, 2] *= -1.0
        return jacobian


class WrongVelocity(Cart):
    """Has a velocity that is not the derivative of the position."""

    def velocity(self, state: Array, control_input: Array) -> Array:
        return 2.0 * super().velocity(state, control_input)


class WrongTurnRate(Cart):
    """Turns the other way."""

    def turn_rate(self, state: Array, control_input: Array) -> Array:
        return -super().turn_rate(state, control_input)


class WrongSuccessor(Cart):
    """Returns an Euler step in place of the closed form."""

    def successor(self, state: Any, control_input: Any, step: Any, math: Any) -> Any:
        rates = self.derivative(state, control_input, math)
        return [state[index] + 1.5 * step * rate for index, rate in enumerate(rates)]


class Discrete(Cart):
    """Is in discrete time, without a successor."""

    time_step = 0.1


class WrongVelocities(Cart):
    """Names its heading as a velocity."""

    velocities = (2, 0)


class Unbounded(Cart):
    """Does not saturate."""

    def limit(self, control_input: Array) -> Array:
        return control_input


class Uneven(Cart):
    """Has a lower bound above the upper one."""

    def input_bounds(self) -> Any:
        return [1.0, 1.0], [-1.0, -1.0]


class Negative(Cart):
    """Has a negative standard deviation."""

    def noise_deviation(self, step: float) -> Array:
        return np.array([0.1, -0.1, 0.0])


class Skewed(Cart):
    """Has a covariance that is not symmetric."""

    def noise_covariance(self, step: float) -> Array:
        return np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


class Sums(Cart):
    """Computes other last bits for a group, and declares `batchable`."""

    batchable: ClassVar = True

    def derivative(self, state: Any, control_input: Any, math: Any) -> Any:
        count = state.shape[1]
        return (control_input[0] * (1.0 + 1e-15 * count), control_input[0], control_input[1])


class Nameless(Cart):
    """Has an element without a name."""

    state = (Quantity("", "m"), Quantity("y", "m"), Quantity("heading", "rad"))


class Unitless(Cart):
    """Has an element without a unit."""

    control_input = (Quantity("speed", ""), Quantity("turn_rate", "rad/s"))


class Doubled(Cart):
    """Has two elements with one name."""

    state = (Quantity("x", "m"), Quantity("x", "m"), Quantity("heading", "rad"))


class Tuples(Cart):
    """Has a pair in place of a quantity."""

    state: Any = (("x", "m"), Quantity("y", "m"), Quantity("heading", "rad"))


class Beyond(Cart):
    """Has its heading beyond the state."""

    heading = 3


class Degrees(Cart):
    """Has its heading in degrees."""

    state = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "deg"))


class Empty(Cart):
    """Has no control input."""

    control_input: Any = ()


BROKEN: dict[type[Model], tuple[str, ...]] = {
    Branching: ("Branching.derivative (", "branches on an array", "np.where(condition, one, other)"),
    Scalar: ("Scalar.derivative (", "gives an array to a function for single numbers", "the argument `math`"),
    Short: ("Short.derivative (", "returns 2 elements from `derivative`, and the state has 3"),
    Singular: ("Singular.derivative (", "inf", "at the state [", "return finite numbers"),
    Imaginary: ("Imaginary.derivative (", "nan", "at the state ["),
    Mean: ("Mean.derivative (", "other values for a group than for each agent alone", "let no row depend on others"),
    Overwriting: ("Overwriting.derivative (", "changes the states that it was given", "compute new arrays"),
    Remembering: ("Remembering.derivative (", "changes self.calls", "a model holds parameters and no state"),
    Noisy: ("Noisy.derivative (", "the global generator of NumPy"),
    Late: ("Late.derivative (", "reads the wall clock (`time.time`)"),
    WrongJacobian: ("WrongJacobian.jacobian (", "for the rate of `y` by `heading`, and finite differences give"),
    WrongVelocity: ("WrongVelocity.velocity (", "along axis 0, and the derivative of the position is"),
    WrongTurnRate: ("WrongTurnRate.turn_rate (", "and the heading's derivative is"),
    WrongSuccessor: ("WrongSuccessor.successor (", "for `x`, and the integral of `derivative` is"),
    Discrete: ("Discrete.successor (", "returns None, although the model is in discrete time"),
    WrongVelocities: ("WrongVelocities.velocities (", "names `heading`, which is not the derivative of `x`"),
    Unbounded: ("Unbounded.limit (", "beyond `input_bounds`", "saturate"),
    Uneven: ("Uneven.input_bounds (", "leave nothing between"),
    Negative: ("Negative.noise_deviation (", "is negative"),
    Skewed: ("Skewed.noise_covariance (", "is no covariance", "symmetric"),
    Sums: ("Sums.derivative (", "differs in its last bits", "omit `batchable`"),
    Nameless: ("Nameless.state (", "an element 0 called ''", 'Quantity("x", "m")'),
    Unitless: ("Unitless.control_input (", "`speed` without a unit"),
    Doubled: ("Doubled.state (", "two elements called `x`"),
    Tuples: ("Tuples.state (", "a tuple as element 0"),
    Beyond: ("Beyond.heading (", "the index 3, and the state has 3 elements", "count from 0"),
    Degrees: ("Degrees.heading (", "`heading` in deg", "use rad"),
    Empty: ("Empty.control_input (", "is empty", "declare a name and a unit"),
}


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_a_broken_model_is_named_with_the_method_and_a_correction(kind: type[Model]) -> None:
    said = deviations(check_model, kind)
    for words in BROKEN[kind]:
        assert words in said


@pytest.mark.parametrize("kind", BROKEN, ids=lambda kind: kind.__name__)
def test_the_place_is_a_line_of_the_model_itself(kind: type[Model]) -> None:
    assert is_located(deviations(check_model, kind), kind)


def test_a_branch_is_located_at_its_line() -> None:
    said = deviations(check_model, Branching)
    line = Branching.derivative.__code__.co_firstlineno + 1
    assert said.count("\n") == 0
    assert f"(test_model_check.py, line {line}) branches on an array" in said


def test_a_model_is_checked_at_the_states_that_are_given() -> None:
    check_model(Cart)
    check_model(Unicycle, [[1.0, 2.0, 0.5], [0.0, 0.0, -3.0]], max_speed=1.3)
    assert "nan" in deviations(check_model, Imaginary, [-1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="shape"):
        check_model(Cart, [1.0, 2.0])


def test_parameters_that_a_model_refuses_are_named() -> None:
    assert "Unicycle.Parameters (" in deviations(check_model, Unicycle, max_speed=-1.0)
    assert "refuse `max_speed`" in deviations(check_model, Unicycle, max_speed="fast")
