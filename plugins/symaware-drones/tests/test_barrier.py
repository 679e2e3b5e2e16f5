"""Barriers are below the least margin of a face, by no more than ln(n) / eta, and their derivatives are right."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from symaware_drones.barrier import Barrier
from symaware_drones.polygon import regular
from symaware_drones.schedule import Schedule
from symaware_drones.task import Task

SECOND = 1_000_000_000
ETA = 20.0


def corners(x: float, y: float, radius: float) -> tuple[tuple[float, float], ...]:
    return tuple((x + dx, y + dy) for dx, dy in regular(5, radius))


TASKS = [
    Task("one", ("a",), corners(1.0, 0.0, 0.5), 2 * SECOND, 2 * SECOND, SECOND),
    Task("two", ("a",), corners(-1.0, 1.0, 0.4), 6 * SECOND, 6 * SECOND, SECOND),
]
PLACE = st.floats(-3, 3)


@pytest.mark.parametrize("activation", ["sequence", "start"])
@given(x=PLACE, y=PLACE, now=st.integers(0, 7 * SECOND))
def test_a_barrier_is_a_smooth_minimum_with_its_derivatives(activation: str, x: float, y: float, now: int) -> None:
    tasks = Schedule(TASKS, {"a": (0.0, 0.0)}, activation=activation).tasks[("a",)]  # type: ignore[arg-type]
    barrier = Barrier(tasks, ETA)
    faces = [
        offset - normal_x * x - normal_y * y + wide
        for task in barrier.in_force(now)
        for (normal_x, normal_y, offset, _), wide in zip(task.faces, task.width(now), strict=True)
    ]
    found = barrier.sample(now, x, y)
    assert found is not None
    assert found.value <= min(faces) + 1e-9
    assert min(faces) <= found.value + math.log(len(faces)) / ETA + 1e-9
    step = 1e-6
    for derivative, direction in ((found.x, (step, 0.0)), (found.y, (0.0, step))):
        ahead, behind = (barrier.sample(now, x + sign * direction[0], y + sign * direction[1]) for sign in (1, -1))
        assert ahead is not None
        assert behind is not None
        assert (ahead.value - behind.value) / (2 * step) == pytest.approx(derivative, abs=1e-6)
    changes = {task.start for task in tasks} | {task.end for task in tasks} | {task.activation for task in tasks}
    if all(abs(now - change) > 2000 for change in changes):
        later, earlier = barrier.sample(now + 1000, x, y), barrier.sample(now - 1000, x, y)
        assert later is not None
        assert earlier is not None
        assert (later.value - earlier.value) / 2e-6 == pytest.approx(found.rate, abs=1e-6)


def test_no_barrier_is_in_force_after_the_last_task() -> None:
    barrier = Barrier(Schedule(TASKS, {"a": (0.0, 0.0)}).tasks[("a",)], ETA)
    assert barrier.sample(7 * SECOND + 1, 0.0, 0.0) is None
    assert set(barrier.values(7 * SECOND, 0.0, 0.0)) == {"two"}
