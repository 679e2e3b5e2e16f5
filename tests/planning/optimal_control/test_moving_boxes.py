"""A plan stays outside of a box that moves, at its steps and on the straight ways between them."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from symaware_cli.planning.optimal_control import (
    LinearDynamics,
    SpecificationPlan,
    SpecificationProgram,
    avoid_moving_box,
)

pytest.importorskip("highspy")

Array = NDArray[np.float64]
UNIT = np.eye(2)
STEPS = 4
GOAL = np.array([8.0, 0.0])


def planned(
    centres: Array, sizes: Array, state: tuple[float, float] = (0.0, 0.0), radius: float | None = None
) -> SpecificationPlan:
    """Plan to go from a state to (8, 0) in four steps of at most 3 m along each axis."""
    free = np.full(2, 3.0)
    dynamics = LinearDynamics(UNIT, UNIT, np.zeros(2), -free, free, np.zeros((0, 2)), np.zeros(0))
    program = SpecificationProgram(dynamics, state, STEPS)
    if radius is not None:
        for instant in range(1, STEPS + 1):
            (variable,) = program.program.add_variables(1, radius, radius).tolist()
            program.add_radius(instant, variable, radius, radius)
    avoid_moving_box(program, "other", state, centres, sizes)
    for variable, value in zip(program.states[-1].tolist(), GOAL.tolist(), strict=True):
        program.program.add_row([variable], [1.0], value, value)
    program.add_effort(1.0)
    return program.solve()


def least_distance(plan: SpecificationPlan, centres: Array) -> float:
    """The least distance along x or y on the straight ways."""
    assert plan.states is not None
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    gaps = plan.states - centres
    ways = np.concatenate([(1 - shares) * one + shares * other for one, other in pairwise(gaps)])
    return float(np.abs(ways).max(axis=1).min())


def oncoming(offset: float = 0.0) -> Array:
    """Somebody who comes from (8, 0) and goes to (0, 0)."""
    return np.array([[8.0 - 2.0 * step, offset] for step in range(STEPS + 1)])


def test_without_a_box_they_would_meet_and_with_it_they_do_not_on_the_way_either() -> None:
    free = planned(oncoming() + 100.0, np.ones(STEPS + 1))
    assert least_distance(free, oncoming()) < 1e-3
    found = planned(oncoming(), np.ones(STEPS + 1))
    assert least_distance(found, oncoming()) >= 1.0 - 1e-6


def test_they_do_not_change_places_between_two_steps() -> None:
    # At the steps alone, they would be 3 m and 6 m from each other.
    centres = np.array([[6.0, 0.0], [5.0, 0.0], [-2.0, 0.0], [-9.0, 0.0], [-16.0, 0.0]])
    found = planned(centres, np.full(STEPS + 1, 0.9))
    assert least_distance(found, centres) >= 0.9 - 1e-6


def test_the_radius_of_a_tube_is_kept_free_as_well() -> None:
    found = planned(oncoming(), np.ones(STEPS + 1), radius=0.5)
    assert found.states is not None
    assert np.abs(found.states - oncoming())[1:].max(axis=1).min() >= 1.5 - 1e-6


def test_an_agent_within_the_box_leaves_it_in_a_step() -> None:
    centres = np.zeros((STEPS + 1, 2))
    found = planned(centres, np.ones(STEPS + 1), (0.2, 0.0))
    assert found.states is not None
    assert np.abs(found.states[1:]).max(axis=1).min() >= 1.0 - 1e-6


def test_a_set_that_cannot_be_left_in_a_step_is_infeasible() -> None:
    assert planned(np.zeros((STEPS + 1, 2)), np.full(STEPS + 1, 5.0)).states is None


def test_beyond_what_is_known_nothing_is_avoided() -> None:
    found = planned(oncoming()[:2], np.ones(2))
    assert least_distance(found, oncoming()) < 1e-3
