"""What holds 95 % of a normal distribution, where an agent is and along its plan."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from simulating import STEP, Team, execute, simulation

from symaware_cli import AgentGroup, Component, Quantity, TimeSeries, open_log
from symaware_cli.language.parts import name_columns
from symaware_cli.views.detail import detail_of
from symaware_cli.views.scene.marks import Ellipsoids
from symaware_cli.views.scene.own_awareness import DEVIATIONS, Uncertainties, ellipsoids
from symaware_cli.views.scene.scene import Scene
from symaware_cli.views.views import run_view_of


@pytest.mark.parametrize("dimension", [2, 3])
def test_they_reach_as_far_as_the_chi_square_distribution_says(dimension: int) -> None:
    assert DEVIATIONS[dimension] == pytest.approx(np.sqrt(chi2.ppf(0.95, dimension)), abs=1e-4)


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 3]))
def test_the_turned_half_sizes_make_the_covariance_again(seed: int, dimension: int) -> None:
    factors = np.random.default_rng(seed).normal(size=(4, dimension, dimension))
    covariances = factors @ factors.swapaxes(1, 2)
    half_sizes, quaternions = ellipsoids(covariances)
    axes = Rotation.from_quat(quaternions).as_matrix()
    made = axes @ (np.eye(3) * (half_sizes[:, None] / DEVIATIONS[dimension]) ** 2) @ axes.swapaxes(1, 2)
    np.testing.assert_allclose(made[:, :dimension, :dimension], covariances, atol=1e-9)
    if dimension == 2:
        assert (half_sizes[:, 2] == 0).all()


def test_an_unknown_covariance_has_no_size() -> None:
    half_sizes, quaternions = ellipsoids(np.array([np.full((2, 2), np.nan), np.eye(2)]))
    assert half_sizes[0].tolist() == [0, 0, 0]
    assert np.isfinite(quaternions).all()
    assert half_sizes[1, :2].tolist() == [DEVIATIONS[2]] * 2


class Plan(Component):
    """Plans to go east; the second agent plans a step more than it knows the uncertainty of."""

    def series_quantities(self, group: AgentGroup) -> Mapping[str, Sequence[Quantity]]:
        x, y = (group.model.state[index] for index in group.model.position)
        covariance = [Quantity(f"cov_{one.name}_{other.name}", "m*m") for one in (x, y) for other in (x, y)]
        return {"intent": [x, y], "uncertainty": covariance}

    def _compute(self) -> Any:
        return None

    def _update(self, value: Any) -> None:
        times = self.now + STEP * np.arange(4, dtype=np.int64)
        own = self._agent.self_awareness
        covariances = np.outer([0.0, 1.0, 4.0, 9.0], np.eye(2).ravel())
        own.intent = TimeSeries.sampled(times, np.array([[10.0 + step, 0.0] for step in range(4)]))
        known = 4 - self._agent.row
        own.uncertainty = TimeSeries.sampled(times[:known], covariances[:known])


def test_an_uncertainty_along_a_plan_is_a_tube_around_it(tmp_path: Path) -> None:
    made = simulation({"robot": Team({"plan": Plan}, count=2)})
    (group,) = made.groups
    name_columns(group, Plan())
    execute(made, 3, tmp_path / "log.mcap")
    log = open_log(tmp_path / "log.mcap")
    run_view = run_view_of(log)
    scene = Scene(run_view, detail_of(run_view), [Uncertainties])
    marks = [mark for chunk in scene.chunk_reader().chunks(log.messages()) for mark in scene.marks(chunk)]
    tubes = [mark for mark in marks if mark.path == "awareness/robot/uncertainty/tube"]
    assert tubes
    for mark in tubes:
        assert isinstance(mark, Ellipsoids)
        assert np.asarray(mark.counts).tolist() == [3] * len(mark.times)
        assert mark.who is not None
        assert {*mark.who.tolist()} == {0}
        assert mark.centres[:3, :2].tolist() == [[11.0, 0.0], [12.0, 0.0], [13.0, 0.0]]
        np.testing.assert_allclose(mark.half_sizes[:3, 0], DEVIATIONS[2] * np.array([1.0, 2.0, 3.0]))
        fading = np.asarray(mark.transparency)[:3]
        assert (np.diff(fading) > 0.0).all()
