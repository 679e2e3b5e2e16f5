"""The scenario tree contains all sequences of turns, in both published variants."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from symaware_aircraft import ScenarioTree, rollout
from symaware_aircraft.tree import ThirdBranch

LIMIT = 0.07
intents = st.lists(st.floats(-LIMIT, LIMIT), min_size=6, max_size=6)


@given(intents)
def test_every_sequence_of_branches_occurs_once_and_is_followed_by_the_intent(intended: list[float]) -> None:
    rates = ScenarioTree(6, 3, LIMIT, "paper").turn_rates(intended)
    assert rates.shape == (27, 6)
    branches = [(LIMIT, -LIMIT, intended[k]) for k in range(3)]
    expected = {(*first, *intended[3:]) for first in itertools.product(*branches)}
    assert {tuple(row) for row in rates.tolist()} == expected


@given(intents)
def test_a_scenario_picks_its_branches_by_the_digits_of_its_number(intended: list[float]) -> None:
    rates = ScenarioTree(6, 3, LIMIT, "paper").turn_rates(intended)
    for j, row in enumerate(rates.tolist()):
        for i in range(3):
            assert row[i] == (LIMIT, -LIMIT, intended[i])[j // 3**i % 3]


@given(intents)
def test_the_recorded_variant_goes_straight_and_keeps_the_intent_as_the_last_scenario(intended: list[float]) -> None:
    tree = ScenarioTree(6, 3, LIMIT, "recorded")
    rates = tree.turn_rates(intended)
    assert tree.count == 28
    assert set(rates[:-1, :3].ravel()) == {LIMIT, -LIMIT, 0.0}
    assert rates[-1].tolist() == intended
    assert (rates[:, 3:] == intended[3:]).all()


def test_the_recorded_variant_leaves_all_but_the_intent_out_at_the_end() -> None:
    along, at_end = ScenarioTree(6, 3, LIMIT, "recorded").counting
    assert along.all()
    assert at_end.tolist() == [False] * 27 + [True]
    assert all(mask.all() for mask in ScenarioTree(6, 3, LIMIT, "paper").counting)


@pytest.mark.parametrize("third_branch", ["paper", "recorded"])
def test_without_a_robust_horizon_the_intent_is_the_only_scenario(third_branch: ThirdBranch) -> None:
    tree = ScenarioTree(4, 0, LIMIT, third_branch)
    assert tree.count == 1
    assert tree.turn_rates([0.01, 0.02, 0.03, 0.04]).tolist() == [[0.01, 0.02, 0.03, 0.04]]
    assert all(mask.all() for mask in tree.counting)


def test_a_robust_horizon_is_no_longer_than_the_horizon() -> None:
    assert ScenarioTree(2, 3, LIMIT, "paper").turn_rates([0.0, 0.0]).shape == (9, 2)


@given(intents, st.tuples(st.floats(-100, 100), st.floats(-100, 100), st.floats(-4, 4)), st.floats(0.1, 2.0))
def test_a_rollout_is_step_by_step_the_model_of_the_case_study(
    rates: list[float], pose: tuple[float, float, float], step: float
) -> None:
    poses = rollout(pose, 10.0, [rates, rates[::-1]], step)
    assert poses.shape == (2, 7, 3)
    x, y, heading = pose
    for k, rate in enumerate([*rates, 0.0]):
        np.testing.assert_allclose(poses[0, k], (x, y, heading), atol=1e-9)
        x, y, heading = x + step * 10 * np.cos(heading), y + step * 10 * np.sin(heading), heading + step * rate


def test_the_nominal_intruder_ends_at_the_pose_of_the_case_study() -> None:
    rates = [0.07] * 7 + [0.24 * 0.07] + [0.0] * 66 + [-0.07] * 8
    end = rollout((-120, 90, 0), 10.0, [rates], 1.0)[0, -1]
    np.testing.assert_allclose(end, (609.9, 449.9, -0.05), atol=0.06)
