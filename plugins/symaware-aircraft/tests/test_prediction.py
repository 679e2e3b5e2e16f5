"""Speeds and turn rates that follow from an intent reproduce its poses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symaware_aircraft import rollout
from symaware_aircraft.prediction import course

from symaware_cli import AwarenessVector, TimeSeries

SECOND = 10**9


@given(st.lists(st.floats(-0.07, 0.07), min_size=1, max_size=8), st.floats(1.0, 20.0), st.sampled_from([0.5, 1.0, 2.0]))
def test_an_intent_gives_back_what_it_was_rolled_out_from(turn_rates: list[float], speed: float, step: float) -> None:
    poses = rollout((3.0, -4.0, 0.5), speed, [turn_rates], step)[0]
    times = np.arange(len(poses)) * round(step * SECOND)
    told = AwarenessVector("other", poses[0], TimeSeries.sampled(times, poses))
    pose, speeds, found = course(told, 0, len(turn_rates), step)
    np.testing.assert_allclose(pose, (3.0, -4.0, 0.5))
    np.testing.assert_allclose(speeds, speed, rtol=1e-9)
    np.testing.assert_allclose(found, turn_rates, atol=1e-12)


def test_past_poses_do_not_count_and_beyond_the_end_the_motion_is_straight() -> None:
    poses = rollout((0, 0, 0), 10.0, [[0.01, 0.02, 0.03]], 1.0)[0]
    told = AwarenessVector("other", poses[0], TimeSeries.sampled(np.arange(4) * SECOND, poses))
    pose, speeds, turn_rates = course(told, SECOND, 4, 1.0)
    np.testing.assert_allclose(pose, poses[1])
    np.testing.assert_allclose(turn_rates, [0.02, 0.03, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(speeds, 10.0)


@pytest.mark.parametrize("state", [(1.0, 2.0, 3.0), (1.0, 2.0), (1.0, 2.0, 0.1, 0.2, 5.0)])
def test_an_agent_without_an_intent_is_assumed_to_stay_in_place(state: tuple[float, ...]) -> None:
    pose, speeds, turn_rates = course(AwarenessVector("other", state), 0, 3, 1.0)
    assert pose.tolist() == [1.0, 2.0, 0.0]
    assert not speeds.any()
    assert not turn_rates.any()
