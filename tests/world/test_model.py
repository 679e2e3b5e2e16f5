"""Models: the result for an agent depends on its own row only, to the bit, for any number of rows."""

from collections.abc import Callable, Iterator
from importlib import metadata
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import untyped

from symaware_cli import EnvironmentParameters
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.models.noise import NoisyModel
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.world.integration import euler, rk4

MODELS = [
    each.load()
    for each in metadata.entry_points(group="symaware.models")
    if each.dist and each.dist.name == "symaware-cli"
]
# Those that need parameters are put to the same tests, and more, in tests/engine/models.
MODELS = [kind for kind in MODELS if not any(field.is_required() for field in kind.Parameters.model_fields.values())]


def layouts(array: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """The same values laid out in memory as an author might hand them over."""
    yield np.ascontiguousarray(array)
    yield np.asfortranarray(array)
    wide = np.empty((2 * len(array), 2 * array.shape[1]))
    wide[::2, ::2] = array
    yield wide[::2, ::2]
    wider = np.empty((len(array), array.shape[1] + 3))
    wider[:, : array.shape[1]] = array
    yield wider[:, : array.shape[1]]
    shifted = np.empty(array.size + 1)[1:].reshape(array.shape)
    shifted[:] = array
    yield shifted
    yield array[::-1].copy()[::-1]


def values(random: np.random.Generator, count: int, width: int) -> NDArray[np.float64]:
    """Numbers of many magnitudes, with zeros among them."""
    scale = random.choice([0.0, 0.1, 1.0, 10.0, 1e3], size=(count, width))
    result: NDArray[np.float64] = random.normal(size=(count, width)) * scale
    return result


@pytest.mark.parametrize("kind", MODELS, ids=lambda kind: kind.__name__)
@settings(max_examples=25)
@given(count=st.integers(1, 40) | st.sampled_from([64, 65, 257]), seed=st.integers(0, 2**32 - 1))
def test_a_rows_result_depends_neither_on_how_many_rows_there_are_nor_on_memory_layout(
    kind: type[NoisyModel], count: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    model = kind(untyped(kind).Parameters(max_speed=1.3)) if "max_speed" in kind.Parameters.model_fields else kind()
    state = values(random, count, len(model.state))
    control_input = values(random, count, len(model.control_input))
    velocity = values(random, count, len(model.position))

    def outcomes(
        state: NDArray[np.float64], control_input: NDArray[np.float64], velocity: NDArray[np.float64]
    ) -> Iterator[NDArray[np.float64]]:
        limited = model.limit(control_input)
        yield limited
        yield euler(model, state, limited, 0.05)
        yield rk4(model, state, limited, 0.05)
        yield model.positions(state)
        yield model.velocity(state, limited)
        try:
            yield model.follow_velocity(state, velocity)
        except NotImplementedError:
            return

    with np.errstate(all="ignore"):
        alone = [
            list(outcomes(state[row : row + 1].copy(), control_input[row : row + 1].copy(), velocity[row : row + 1]))
            for row in range(count)
        ]
        expected = [np.concatenate([each[number] for each in alone]).tobytes() for number in range(len(alone[0]))]
        for laid_out in zip(layouts(state), layouts(control_input), layouts(velocity), strict=True):
            for number, outcome in enumerate(outcomes(*laid_out)):
                assert np.ascontiguousarray(outcome).tobytes() == expected[number]


@pytest.mark.parametrize("kind", MODELS, ids=lambda kind: kind.__name__)
def test_a_model_does_not_change_its_arguments(kind: type[NoisyModel]) -> None:
    model = kind()
    state = np.full((3, len(model.state)), 0.3)
    control_input = np.full((3, len(model.control_input)), 99.0)
    for array in (state, control_input):
        array.flags.writeable = False
    model.limit(control_input)
    model.velocity(state, control_input)
    rk4(model, state, model.limit(control_input), 0.05)


@pytest.mark.parametrize("kind", MODELS, ids=lambda kind: kind.__name__)
def test_a_model_names_its_quantities_and_gives_a_rate_for_each(kind: type[NoisyModel]) -> None:
    model = kind()
    assert len({quantity.name for quantity in model.state}) == len(model.state) > 0
    rates = model.derivative(np.zeros((len(model.state), 4)), np.zeros((len(model.control_input), 4)), np)
    assert len(rates) == len(model.state)
    assert max(model.position) < len(model.state)
    assert model.heading is None or model.heading < len(model.state)


def test_a_unicycle_on_a_circle_comes_back_to_where_it_was() -> None:
    model = Unicycle(Unicycle.Parameters(max_speed=2.0))
    state, control_input = np.array([[1.0, 0.0, np.pi / 2]]), np.array([[1.0, 1.0]])
    for _ in range(1000):
        state = rk4(model, state, control_input, 2 * np.pi / 1000)
    # The unit circle around the origin, in closed form; rk4 errs by about step^4.
    assert np.allclose(state, [[1.0, 0.0, np.pi / 2 + 2 * np.pi]], atol=1e-9)


def test_euler_errs_in_proportion_to_the_step_and_rk4_to_its_fourth_power() -> None:
    model = Unicycle(Unicycle.Parameters(max_speed=2.0))
    control_input = np.array([[1.0, 1.0]])

    def error(integrate: Callable[..., Any], steps: int) -> float:
        state = np.array([[1.0, 0.0, np.pi / 2]])
        for _ in range(steps):
            state = integrate(model, state, control_input, 1.0 / steps)
        return float(np.abs(state[0, :2] - [np.cos(1.0), np.sin(1.0)]).max())

    assert error(euler, 20) / error(euler, 40) == pytest.approx(2, rel=0.1)
    assert error(rk4, 20) / error(rk4, 40) == pytest.approx(16, rel=0.1)


def test_control_inputs_are_saturated_within_the_bounds_of_the_model() -> None:
    unicycle = Unicycle(Unicycle.Parameters(min_speed=-0.5, max_speed=1.5, max_turn_rate=2.0))
    limited = unicycle.limit(np.array([[9.0, -9.0], [-9.0, 9.0], [0.1, 0.2]]))
    assert limited.tolist() == [[1.5, -2.0], [-0.5, 2.0], [0.1, 0.2]]


def test_a_velocity_that_is_too_long_keeps_its_direction() -> None:
    limited = SingleIntegrator(SingleIntegrator.Parameters(max_speed=1.0)).limit(np.array([[3.0, 4.0], [0.3, 0.4]]))
    assert np.allclose(limited, [[0.6, 0.8], [0.3, 0.4]])
    assert SingleIntegrator().limit(np.array([[300.0, 400.0]])).tolist() == [[300.0, 400.0]]


def test_a_unicycle_that_follows_a_velocity_turns_the_short_way_and_does_not_drive_away_from_it() -> None:
    state = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    velocity = np.array([[np.cos(-3.0), np.sin(-3.0)], [-1.0, 0.0], [0.0, 0.0]])
    followed = Unicycle().follow_velocity(state, velocity)
    assert followed[0, 1] == pytest.approx(4.0 * (2 * np.pi - 6.0))
    assert followed[1, 0] == pytest.approx(0.0, abs=1e-12)
    assert followed[2].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("step", [0.0, -0.1, 1e-7, float("nan"), float("inf"), 1e7])
def test_an_environment_refuses_an_invalid_time_step(step: float) -> None:
    with pytest.raises(ValueError, match="time_step"):
        EnvironmentParameters(time_step=step)
