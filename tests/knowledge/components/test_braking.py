import numpy as np
import pytest

from symaware_cli.knowledge.components.cells import Braking


def driven(speed: float, wanted: float, change: float, step: float, count: int) -> tuple[float, float]:
    """How far a body gets in a number of physics steps, and its speed then."""
    way = 0.0
    for _ in range(count):
        speed += float(np.clip(wanted - speed, -change, change))
        way += step * speed
    return way, speed


def parameters(seed: int) -> tuple[float, float, int, float]:
    random = np.random.default_rng(seed)
    acceleration, step = (10 ** random.uniform([-1, -3], [1.5, -0.5])).tolist()
    return acceleration, step, int(random.integers(1, 30)), float(random.uniform(0.1, 4.0))


@pytest.mark.parametrize("seed", range(20))
def test_a_body_that_brakes_gets_as_far_as_the_formula_says(seed: int) -> None:
    acceleration, step, count, speed = parameters(seed)
    braking = Braking(acceleration, step, count * step)
    way, rest = driven(speed, 0.0, acceleration * step, step, 1 + int(speed / (acceleration * step)))
    assert rest == pytest.approx(0.0, abs=1e-12)
    assert braking.distance(np.array([speed]))[0] == pytest.approx(way, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("seed", range(40))
def test_a_body_comes_to_rest_at_the_point_and_never_gets_beyond_it(seed: int) -> None:
    acceleration, step, count, most = parameters(seed)
    braking, position, speed, end = Braking(acceleration, step, count * step), 0.0, 0.0, 1.0
    for _ in range(100_000):
        chosen = float(braking.approach(np.array([speed]), np.array([max(end - position, 0.0)]), most)[0])
        assert abs(chosen - speed) <= acceleration * count * step + 1e-12
        way, speed = driven(speed, chosen, acceleration * step, step, count)
        assert speed == pytest.approx(chosen, abs=1e-12)  # the drive reaches it within the period
        position += way
        assert position <= end + 1e-9
        if end - position < 1e-9 and speed < 1e-9:
            return
    pytest.fail("it does not come to rest there")


def test_without_a_limit_a_body_has_any_speed_at_once() -> None:
    braking = Braking(np.inf, 0.01, 0.1)
    assert braking.approach(np.array([3.0, 0.0]), np.array([0.1, 5.0]), 2.0).tolist() == [1.0, 2.0]
    assert braking.slowed(np.array([3.0])).tolist() == [0.0]


def test_a_body_that_cannot_stop_in_time_brakes_as_hard_as_it_can() -> None:
    braking = Braking(1.0, 0.1, 0.5)
    assert braking.approach(np.array([3.0]), np.array([0.1]), 3.0).tolist() == [2.5]
