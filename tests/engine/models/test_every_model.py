"""What holds for every model that ships with SymAware."""

from collections.abc import Iterator
from importlib import metadata
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from simulating import made, present, untyped
from specimens import SPECIMENS, VEHICLES, numbers, states_and_inputs, step_of

from symaware_cli import Model
from symaware_cli.engine.models.aircraft import DubinsAircraft
from symaware_cli.engine.models.bicycle import Bicycle
from symaware_cli.engine.models.heading import HeadingModel
from symaware_cli.engine.models.integrator import DoubleIntegrator, SingleIntegrator
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.world.integration import derivative, euler, rk4

EVERYTHING = SPECIMENS | VEHICLES
every_model = pytest.mark.parametrize("model", EVERYTHING.values(), ids=EVERYTHING)
steerable = pytest.mark.parametrize("model", [model for name, model in SPECIMENS.items() if name != "linear, coupled"])


def outcomes(model: Model, *arrays: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Everything that a model can be asked for a group: states, control inputs, velocities, factors."""
    state, control_input, velocity, factor = arrays
    step = step_of(model)
    limited = model.limit(control_input)
    yield limited
    exact = model.exact_step(state, limited, step)
    if exact is not None:
        yield exact
    yield euler(model, state, limited, step)
    yield rk4(model, state, limited, step)
    yield model.positions(state)
    yield model.velocity(state, limited)
    yield model.jacobian(state, limited)
    try:
        yield model.follow_velocity(state, velocity)
        yield model.slowed(state, limited, factor)
    except NotImplementedError:
        return


def bits(arrays: Iterator[NDArray[np.float64]] | list[NDArray[np.float64]]) -> list[bytes]:
    return [np.ascontiguousarray(array).tobytes() for array in arrays]


def test_every_model_that_is_registered_is_tested_here() -> None:
    registered = {
        entry.name
        for entry in metadata.entry_points(group="symaware.models")
        if entry.dist and entry.dist.name == "symaware-cli"
    }
    # An FMU is no model of equations: tests/fmi.
    assert registered == {*(name.split()[0].rstrip(",") for name in EVERYTHING), "fmu"}


@every_model
@settings(max_examples=40)
@given(count=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
def test_a_row_does_not_depend_on_the_rows_around_it(model: Model, count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    arrays = [
        numbers(random, count, len(model.state)),
        numbers(random, count, len(model.control_input)),
        numbers(random, count, len(model.position)),
    ]
    factor = random.uniform(size=count)
    everybody = list(outcomes(model, *arrays, factor))
    some = random.choice(count, size=random.integers(1, count + 1), replace=False)
    for rows in (some, np.arange(count)[::-1], np.array([count - 1])):
        alone = outcomes(model, *(array[rows] for array in arrays), factor[rows])
        assert bits(alone) == bits(each[rows] for each in everybody)
    # Nor on how the rows lie in memory: by columns, with gaps, backwards.
    for lay_out in (
        np.asfortranarray,
        lambda array: np.repeat(np.repeat(array, 2, 0), 2, 1)[::2, ::2],
        lambda array: array[::-1].copy()[::-1],
    ):
        assert bits(outcomes(model, *(lay_out(array) for array in arrays), factor)) == bits(everybody)


@every_model
def test_one_row_among_ten_thousand_equals_the_row_alone(model: Model) -> None:
    state, control_input = states_and_inputs(model, 10_000)
    velocity, factor = state[:, : len(model.position)], np.full(10_000, 0.3)
    everybody = list(outcomes(model, state, control_input, velocity, factor))
    for row in (0, 4_321, 9_999):
        one = slice(row, row + 1)
        alone = outcomes(model, state[one], control_input[one], velocity[one], factor[one])
        assert bits(alone) == bits(each[one] for each in everybody)


@every_model
def test_a_model_changes_nothing_that_it_is_given(model: Model) -> None:
    state, control_input = states_and_inputs(model, 5)
    velocity, factor = np.ones((5, len(model.position))), np.full(5, 0.5)
    for array in (state, control_input, velocity, factor):
        array.flags.writeable = False
    for outcome in outcomes(model, state, 9.0 * control_input, velocity, factor):
        assert np.isfinite(outcome).all()


@every_model
def test_a_model_names_its_quantities_and_where_among_them_the_position_is(model: Model) -> None:
    assert len({quantity.name for quantity in model.state}) == len(model.state) > 0
    assert len({quantity.name for quantity in model.control_input}) == len(model.control_input) > 0
    assert [model.state[index].unit for index in model.position] == ["m"] * len(model.position)
    assert [model.state[index].name for index in model.position] == ["x", "y", "z"][: len(model.position)]
    angles = tuple(index for index, quantity in enumerate(model.state) if quantity.unit == "rad")
    assert model.angles == angles
    # Of several angles it is the one of the horizontal plane.
    names = {"heading", "yaw"}
    assert model.heading == next((index for index in angles if model.state[index].name in names), None)


@every_model
def test_the_velocity_is_the_rate_of_the_position(model: Model) -> None:
    # By central differences of the closed form; the mean over the step for models in discrete time.
    state, control_input = states_and_inputs(model, 20)
    if model in VEHICLES.values():
        rate = derivative(model, state, control_input)[:, model.position]
    elif model.time_step:
        after = model.exact_step(state, control_input, model.time_step)
        assert after is not None
        rate = (model.positions(after) - model.positions(state)) / model.time_step
    else:
        ahead, behind = (present(model.exact_step(state, control_input, step)) for step in (1e-5, -1e-5))
        rate = (model.positions(ahead) - model.positions(behind)) / 2e-5
    assert np.allclose(model.velocity(state, control_input), rate, rtol=1e-8, atol=1e-8)


@every_model
def test_the_jacobian_is_that_of_the_derivative(model: Model) -> None:
    state, control_input = states_and_inputs(model, 20)
    by_differences = untyped(super(type(model), model)).jacobian
    for kind in type(model).__mro__:
        if kind.__name__ == "Model":
            by_differences = untyped(kind).jacobian.__get__(model)
    assert np.allclose(model.jacobian(state, control_input), by_differences(state, control_input), atol=1e-7)


@every_model
def test_control_inputs_within_the_limits_are_left_alone_and_others_are_brought_there(model: Model) -> None:
    random = np.random.default_rng(5)
    low, high = (np.array(bound) for bound in model.input_bounds())
    limited = model.limit(random.normal(size=(200, len(low))) * 50.0)
    assert (limited >= low - 1e-12).all()
    assert (limited <= high + 1e-12).all()
    assert np.allclose(model.limit(limited), limited, rtol=1e-15)


@steerable
def test_a_model_that_follows_a_velocity_comes_to_have_it(model: Model) -> None:
    # 20 s are more than ten time constants of the slowest gain, that of the aircraft, whose turn rate is bounded too.
    dimensions, step = len(model.position), step_of(model)
    state = np.zeros((4, len(model.state)))
    wanted = np.array([[1.0, 0.0], [0.0, 1.0], [-0.6, 0.3], [0.4, -0.8]])
    if isinstance(model, DubinsAircraft):
        wanted = wanted / np.linalg.norm(wanted, axis=1)[:, None] * 7.0
    wanted = np.pad(wanted, ((0, 0), (0, dimensions - 2)), constant_values=0.2)
    for _ in range(int(60.0 / step)):
        applied = model.limit(model.follow_velocity(state, wanted))
        state = present(model.exact_step(state, applied, step))
    applied = model.limit(model.follow_velocity(state, wanted))
    assert np.allclose(model.velocity(state, applied), wanted, atol=1e-6)


@steerable
def test_a_model_told_to_stand_still_does_as_far_as_it_can(model: Model) -> None:
    state, _ = states_and_inputs(model, 6)
    step = step_of(model)
    for _ in range(int(20.0 / step)):
        applied = model.limit(model.follow_velocity(state, np.zeros((6, len(model.position)))))
        state = present(model.exact_step(state, applied, step))
    speed = np.linalg.norm(model.velocity(state, applied), axis=1)
    # An aircraft flies straight on at its least speed.
    assert np.allclose(speed, 6.0 if isinstance(model, DubinsAircraft) else 0.0, atol=1e-12)


@steerable
def test_slowed_to_a_part_a_model_goes_the_same_way_at_that_part_of_the_speed(model: Model) -> None:
    state, control_input = states_and_inputs(model, 50)
    if isinstance(model, DoubleIntegrator):
        # Its speed is in its state: it follows a part of the velocity that it was told to follow.
        wanted = 0.1 * state[:, : len(model.position)]
        followed = model.follow_velocity(state, wanted)
        part = model.slowed(state, followed, np.full(50, 0.3))
        assert np.allclose(part, model.follow_velocity(state, 0.3 * wanted), atol=1e-12)
        return
    velocity = model.velocity(state, control_input)
    slowed = model.velocity(state, model.slowed(state, control_input, np.full(50, 0.3)))
    flat = slice(0, 2) if isinstance(model, DubinsAircraft) else slice(None)
    assert np.allclose(slowed[:, flat], 0.3 * velocity[:, flat], atol=1e-12)


@steerable
def test_not_slowed_at_all_a_control_input_stays_as_it_is(model: Model) -> None:
    state, control_input = states_and_inputs(model, 50)
    assert np.array_equal(model.slowed(state, control_input, np.ones(50)), control_input)


def test_a_velocity_that_cannot_be_followed_is_said_to_be_so() -> None:
    model = SPECIMENS["linear, coupled"]
    state, control_input = states_and_inputs(model, 2)
    with pytest.raises(NotImplementedError, match="cannot be steered by a velocity"):
        model.follow_velocity(state, np.zeros((2, 2)))
    with pytest.raises(NotImplementedError, match="cannot be steered by a velocity"):
        model.slowed(state, control_input, np.full(2, 0.5))


VEHICLE = [
    {"max_speed": 0.0},
    {"max_speed": float("nan")},
    {"min_speed": 2.0, "max_speed": 1.0},
    {"steering_gain": 0.0},
    {"process_noise": -0.1},
    {"process_noise": [0.1, 0.1]},
    {"process_noise": [0.1, 0.1, -0.1]},
    {"process_noise": float("inf")},
    {"process_noise": "much"},
    {"colour": "red"},
]
#: What is wrong comes first.
BAD = [
    *((kind, bad) for kind in (Unicycle, Bicycle) for bad in VEHICLE),
    (Unicycle, {"max_turn_rate": -1.0}),
    (Bicycle, {"wheelbase": 0.0}),
    (Bicycle, {"max_steering_angle": 0.0}),
    (Bicycle, {"max_steering_angle": 1.5708}),
    *((kind, {"dimensions": bad}) for kind in (SingleIntegrator, DoubleIntegrator) for bad in (0, 1, 4, 2.5, "two")),
    *((kind, {"max_speed": bad}) for kind in (SingleIntegrator, DoubleIntegrator) for bad in (0.0, -1.0)),
    *((kind, {"process_noise": [0.1]}) for kind in (SingleIntegrator, DoubleIntegrator)),
    (SingleIntegrator, {"process_noise": [0.1, 0.1], "dimensions": 3}),
    (DoubleIntegrator, {"max_acceleration": 0.0}),
    (DoubleIntegrator, {"velocity_gain": 0.0}),
    *((DubinsAircraft, bad) for bad in [*VEHICLE, {"min_speed": 0.0}, {"min_speed": -1.0}]),
    (DubinsAircraft, {"max_turn_rate": 0.0}),
    (DubinsAircraft, {"max_climb_rate": 1.0}),
    (DubinsAircraft, {"max_climb_rate": 0.0, "dimensions": 3}),
]


@pytest.mark.parametrize(("kind", "bad"), BAD, ids=[f"{kind.__name__}-{bad}" for kind, bad in BAD])
def test_parameters_that_make_no_sense_are_refused(kind: type[HeadingModel], bad: dict[str, Any]) -> None:
    sound = {"min_speed": 6.0, "max_speed": 9.0, "max_turn_rate": 0.1} if kind is DubinsAircraft else {}
    with pytest.raises(ValueError, match=next(iter(bad))):
        made(kind, **{**sound, **bad})


def test_an_aircraft_requires_its_limits() -> None:
    with pytest.raises(ValueError, match=r"(?s)min_speed.*max_speed.*max_turn_rate"):
        made(DubinsAircraft)
