"""Designs depend on seeds and names, not on the process or the order of draws."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from symaware_cli.studies.statistics.design import independent, latin_hypercube, sobol

NAMES = ["noise", "range"]


def test_a_point_depends_only_on_its_run() -> None:
    whole = independent(5, NAMES, np.arange(1000))
    some = [17, 3, 999]
    assert (independent(5, NAMES, some) == whole[some]).all()
    assert (independent(5, ["range"], some)[:, 0] == whole[some, 1]).all()
    assert (independent(6, NAMES, some) != whole[some]).all()


def test_points_are_independent_and_uniformly_distributed() -> None:
    points = independent(5, NAMES, np.arange(20_000))
    for column in points.T:
        assert scipy.stats.kstest(column, "uniform").pvalue > 0.001
        assert abs(scipy.stats.pearsonr(column[1:], column[:-1]).statistic) < 0.03
    assert abs(scipy.stats.pearsonr(points[:, 0], points[:, 1]).statistic) < 0.03


@given(count=st.integers(0, 60), seed=st.integers(0, 1000))
def test_each_part_of_a_latin_hypercube_contains_one_point(count: int, seed: int) -> None:
    points = latin_hypercube(seed, NAMES, count)
    assert points.shape == (count, 2)
    for column in np.floor(points * count).astype(int).T:
        assert sorted(column) == list(range(count))


def test_a_column_of_a_latin_hypercube_depends_only_on_its_name() -> None:
    points = latin_hypercube(5, NAMES, 30)
    assert (latin_hypercube(5, ["range"], 30)[:, 0] == points[:, 1]).all()
    assert (points[:, 0] != points[:, 1]).any()


@given(few=st.integers(0, 40), more=st.integers(0, 40))
def test_adding_runs_keeps_the_existing_sobol_points(few: int, more: int) -> None:
    assert (sobol(5, NAMES, few + more)[:few] == sobol(5, NAMES, few)).all()


def test_sobol_points_fill_the_space_more_evenly_than_independent_ones() -> None:
    points = sobol(5, [*NAMES, "delay"], 256)
    assert scipy.stats.qmc.discrepancy(points) < 0.2 * scipy.stats.qmc.discrepancy(
        independent(5, [*NAMES, "delay"], np.arange(256))
    )
    # Each box of a grid of 16 x 16 contains exactly one point.
    boxes = np.floor(16 * points[:, :2]).astype(int)
    assert len({tuple(box) for box in boxes.tolist()}) == 256
    assert (sobol(6, NAMES, 8) != sobol(5, NAMES, 8)).all()


def test_points_are_inside_the_open_interval() -> None:
    for points in (sobol(5, NAMES, 4096), latin_hypercube(5, NAMES, 1), independent(5, NAMES, [0])):
        assert 0 < points.min() <= points.max() < 1


def test_a_design_may_have_no_parameters() -> None:
    assert independent(5, [], [1, 2]).shape == latin_hypercube(5, [], 2).shape == sobol(5, [], 2).shape == (2, 0)


def test_too_many_parameters_for_a_sobol_sequence_are_rejected() -> None:
    with pytest.raises(ValueError, match="at most 21,201 parameters, not 21,202"):
        sobol(5, ["x"] * 21_202, 1)
