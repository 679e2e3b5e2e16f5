"""The small programs of reciprocal avoidance, against a general solver."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog, nnls

from symaware_cli.engine.components.control.half_planes import TOLERANCE, HalfPlanes, nearest_velocity

SPEED = 1.5


def planes(
    angles: NDArray[np.float64], limits: NDArray[np.float64], weights: NDArray[np.float64] | None = None
) -> HalfPlanes:
    """One agent's constraints, from the directions of their normals."""
    angles, limits = np.atleast_2d(angles), np.atleast_2d(limits)
    return HalfPlanes(
        np.cos(angles), np.sin(angles), limits, np.ones_like(limits) if weights is None else np.atleast_2d(weights)
    )


def distance_from_optimality(one: HalfPlanes, velocity: NDArray[np.float64], preferred: NDArray[np.float64]) -> float:
    """How far an allowed velocity is from the closest one, by the conditions of Karush, Kuhn and Tucker.

    What separates the closest velocity from the preferred one is a sum of normals of constraints that hold it back,
    none of them backwards.
    """
    active = one.excess(velocity[:1], velocity[1:])[0] > -1e-6
    normals = [np.array([x, y]) for x, y in zip(one.x[0][active], one.y[0][active], strict=True)]
    if np.hypot(*velocity) > SPEED - 1e-6:
        normals.append(velocity / np.hypot(*velocity))
    if not normals:
        return float(np.hypot(*(preferred - velocity)))
    return nnls(np.stack(normals, axis=1), preferred - velocity)[1]


def least_violation(one: HalfPlanes) -> float:
    """The greatest violation that cannot be helped, by linear programming, with a polygon for the greatest speed."""
    around = np.linspace(-np.pi, np.pi, 1000, endpoint=False)
    rows = np.stack([one.x[0], one.y[0], -one.weight[0]], axis=1)
    disc = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    bounds = np.concatenate([one.limit[0], np.full(len(around), SPEED)])
    found = linprog([0, 0, 1], np.concatenate([rows, disc]), bounds, bounds=(None, None), method="highs")
    assert found.status == 0
    assert found.x is not None
    return float(found.x[2])


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_the_allowed_velocity_is_the_closest_to_the_preferred_one(count: int) -> None:
    chance = np.random.default_rng(count)
    kinds = []
    for _ in range(40):
        one = planes(chance.uniform(-np.pi, np.pi, count), chance.uniform(-0.3, 1.2, count))
        preferred = chance.uniform(-2, 2, (1, 2))
        (velocity,), (contradictory,) = nearest_velocity(one, preferred, SPEED)
        kinds.append(contradictory)
        assert contradictory == (least_violation(one) > 0.0)
        if not contradictory:
            assert one.excess(velocity[:1], velocity[1:]).max() < 10 * TOLERANCE
            assert distance_from_optimality(one, velocity, preferred[0]) < 1e-6
    assert kinds.count(False) > 5


@pytest.mark.parametrize("count", [2, 3, 5, 12])
def test_where_constraints_contradict_each_other_the_greatest_violation_is_least(count: int) -> None:
    chance = np.random.default_rng(count)
    compared = 0
    for _ in range(40):
        weights = chance.choice([0.01, 1.0], count)
        one = planes(chance.uniform(-np.pi, np.pi, count), chance.uniform(-2.0, 0.3, count), weights)
        velocity, (contradictory,) = nearest_velocity(one, chance.uniform(-2, 2, (1, 2)), SPEED)
        if contradictory:
            # The polygon reaches beyond the disc by 7 um/s, which a weight of 0.01 magnifies.
            assert one.excess(*velocity.T).max() == pytest.approx(least_violation(one), abs=1e-3)
            assert np.hypot(*velocity[0]) <= SPEED + 1e-8
            compared += 1
    assert compared > 10


ANGLES = st.floats(-np.pi, np.pi)
INSTANCES = st.tuples(
    st.tuples(ANGLES, st.floats(0, SPEED)),  # a velocity that is allowed
    st.lists(st.tuples(ANGLES, st.floats(0, 2)), min_size=1, max_size=8),  # constraints that leave it some room
    st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
)


@given(INSTANCES)
def test_if_some_velocity_is_allowed_the_answer_is_allowed_and_at_least_as_close(
    instance: tuple[tuple[float, float], list[tuple[float, float]], tuple[float, float]],
) -> None:
    (angle, speed), constraints, preferred = instance
    allowed = np.array([speed * np.cos(angle), speed * np.sin(angle)])
    angles = np.array([direction for direction, _ in constraints])
    room = np.array([room for _, room in constraints])
    one = planes(angles, np.cos(angles) * allowed[0] + np.sin(angles) * allowed[1] + room + 1e-6)
    (velocity,), (contradictory,) = nearest_velocity(one, np.array([preferred]), SPEED)
    assert not contradictory
    assert one.excess(velocity[:1], velocity[1:]).max() <= 10 * TOLERANCE
    assert np.hypot(*velocity) <= SPEED + 10 * TOLERANCE
    assert np.hypot(*(velocity - preferred)) <= np.hypot(*(allowed - preferred)) + 1e-6


def test_without_constraints_the_preferred_velocity_is_taken_or_shortened() -> None:
    free = HalfPlanes(*(np.zeros((2, 0)) for _ in range(4)))
    velocity, contradictory = nearest_velocity(free, np.array([[0.3, 0.4], [3.0, 4.0]]), 1.0)
    assert velocity == pytest.approx(np.array([[0.3, 0.4], [0.6, 0.8]]))
    assert not contradictory.any()


def test_an_agents_answer_depends_neither_on_the_others_nor_on_padding() -> None:
    chance = np.random.default_rng(3)
    angles, limits = chance.uniform(-np.pi, np.pi, (40, 8)), chance.uniform(-1.0, 1.0, (40, 8))
    preferred = chance.uniform(-2, 2, (40, 2))
    together, contradictory = nearest_velocity(planes(angles, limits), preferred, SPEED)
    assert 0 < contradictory.sum() < 40
    for row in range(40):
        alone = planes(angles[row], limits[row])
        padded = HalfPlanes(
            np.pad(alone.x, ((0, 0), (2, 3))),
            np.pad(alone.y, ((0, 0), (2, 3))),
            np.pad(alone.limit, ((0, 0), (2, 3)), constant_values=np.inf),
            np.ones((1, 13)),
        )
        for one in (alone, padded):
            assert nearest_velocity(one, preferred[row : row + 1], SPEED)[0].tobytes() == together[row].tobytes()


def test_a_half_plane_with_less_weight_is_relaxed_less() -> None:
    head_on = planes(np.array([0.0, np.pi]), np.array([-0.5, -0.5]), np.array([0.01, 1.0]))
    velocity, _ = nearest_velocity(head_on, np.zeros((1, 2)), SPEED)
    assert velocity[0, 0] == pytest.approx(-0.5 + 0.01 / 1.01, abs=1e-6)
