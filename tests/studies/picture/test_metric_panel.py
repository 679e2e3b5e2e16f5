"""The panels of a picture are determined by the varied parameters."""

from dataclasses import replace

import numpy as np
import pytest
from swept import swept

from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.studies.picture.finished_runs import MetricColumn, ParameterAxis
from symaware_cli.studies.picture.metric_panel import composed


def test_without_parameters_distributions_are_drawn() -> None:
    picture = composed(swept({}, 40, ["slow", "fast"]))
    assert [(panel.metric.name, panel.kind) for panel in picture.panels] == [
        ("satisfied.even", "distribution"),
        ("number", "distribution"),
    ]
    panel = picture.panels[1]
    assert panel.series == ("slow", "fast")
    assert [len(sample) for sample in panel.samples] == [40, 40]
    assert panel.value == pytest.approx([0, 1], abs=0.1)
    assert panel.samples[1].mean() == pytest.approx(panel.value[1])


def test_one_parameter_gives_a_curve_for_each_variant() -> None:
    picture = composed(swept({"a": [1, 2, 4]}, variants=["slow", "fast"]), ["number"])
    (panel,) = picture.panels
    assert (panel.kind, panel.series, panel.value.shape) == ("curve", ("slow", "fast"), (2, 3))
    assert panel.value == pytest.approx(np.array([[0, 2, 4], [1, 3, 5]]), abs=0.2)
    assert (panel.lower < panel.value).all()
    assert (panel.value < panel.upper).all()


def test_two_parameters_give_a_map_for_each_variant() -> None:
    picture = composed(swept({"a": [1, 2, 4], "b": ["x", "y"]}, variants=["slow", "fast"]), ["number"])
    slow, fast = picture.panels
    assert (slow.kind, slow.caption, fast.caption, picture.facets) == ("map", "slow", "fast", 2)
    assert slow.value == pytest.approx(np.array([[[0, 2], [4, 6], [8, 10]]]), abs=0.2)
    assert fast.value == pytest.approx(np.array([[[1, 3], [5, 7], [9, 11]]]), abs=0.2)


def test_further_parameters_give_a_map_for_each_of_their_values() -> None:
    picture = composed(swept({"a": [1, 2, 4], "one": [5], "b": [0.5, 1.5], "c": [1, 2, 3]}), ["number"])
    assert [panel.caption for panel in picture.panels] == ["b = 0.5", "b = 1.5"]
    assert [axis.name for axis in picture.panels[0].axes] == ["a", "c"]
    assert picture.panels[1].value == pytest.approx(np.array([[[3, 4, 5], [9, 10, 11], [15, 16, 17]]]), abs=0.2)


def test_specifications_and_varying_metrics_are_shown() -> None:
    assert [panel.metric.name for panel in composed(swept({"a": [1, 2]})).panels] == ["satisfied.even", "number"]
    assert [panel.metric.name for panel in composed(swept({}), ["constant", "number"]).panels] == ["constant", "number"]


def test_an_unfinished_sweep_has_only_anytime_valid_intervals() -> None:
    whole, part = (composed(swept({"a": [1, 2]}, 30, ended=ended)) for ended in (60, 41))
    share, mean = part.panels
    assert np.isnan(mean.lower).all()
    assert not np.isnan(mean.value).any()
    assert (share.upper - share.lower > whole.panels[0].upper - whole.panels[0].lower).all()
    assert part.notes[0] == "Intervals hold with 95 % each: beta mixture."
    assert part.notes[2] == "41 of at most 60 runs."
    assert "Means without declared bounds" in part.notes[3]
    assert whole.notes[0] == "Intervals hold with 95 % each: Clopper-Pearson, bootstrap (BCa)."


def test_runs_without_a_value_are_left_out_and_counted() -> None:
    runs = swept({"a": [1, 2]})
    values = runs.metrics["number"].values.copy()
    values[:3] = np.nan
    runs = replace(runs, failed=1, metrics={"number": MetricColumn("number", "m", False, values)})
    picture = composed(runs)
    assert picture.panels[0].value == pytest.approx(np.array([[0, 1]]), abs=0.1)
    assert picture.notes[-2:] == (
        "1 of 20 runs failed or were lost, and have no metrics.",
        "number: 2 runs have no value.",
    )


def test_pictures_that_cannot_be_drawn_are_reported() -> None:
    with pytest.raises(UnknownNameError, match=r"no metric 'numbre'; there are satisfied\.even, number"):
        composed(swept({}), ["numbre"])
    with pytest.raises(LogError, match="run 0 has not ended"):
        composed(swept({}, ended=0))
    with pytest.raises(LogError, match="no metric differs"):
        composed(replace(swept({}), metrics={}))
    with pytest.raises(LogError, match="1 metrics in 49 panels each are too many"):
        composed(swept({"a": range(7), "b": range(8), "c": range(7), "d": range(8)}, 1), ["number"])


def test_only_ascending_numbers_have_positions_on_a_numeric_axis() -> None:
    assert ParameterAxis("a", [1, 2.5]).positions == pytest.approx([1, 2.5])
    for values in (["x", "y"], [2, 1], [True, False], [[1, 2], [3, 4]]):
        assert ParameterAxis("a", values).positions is None
    assert ParameterAxis("a", ["x", 0.5, [1, "y"], True]).labels == ["x", "0.5", '[1, "y"]', "true"]


def test_a_drawn_parameter_gives_points_for_runs_and_estimates_for_parts() -> None:
    picture = composed(swept({"a": [1, 2]}, 60, ["slow", "fast"], is_drawn=True), ["number", "satisfied.even"])
    assert picture.facets == 6
    first, magnitude, option = picture.panels[0], picture.panels[2], picture.panels[4]
    assert {panel.kind for panel in picture.panels} == {"scatter"}
    assert [first.caption, picture.panels[1].caption] == ["a = 1", "a = 2"]
    assert (first.axes[0].name, magnitude.scale, option.scale) == ("linear", "logarithmic", "options")
    # Three parts of 20 runs each; the first contains the runs 1 to 20.
    assert first.value.shape == (2, 3)
    assert first.axes[0].values == [10.5, 30.5, 50.5]
    assert option.axes[0].values == ["x", "y", "z"]
    for variant in range(2):
        assert first.drawn[variant].tolist() == [*range(1, 61)]
        assert first.value[variant] == pytest.approx([variant] * 3, abs=0.1)
        assert first.value[variant, 0] == pytest.approx(first.samples[variant][:20].mean())
        assert (first.lower[variant] < first.value[variant]).all()


def test_parts_of_a_drawn_parameter_have_no_intervals_in_an_unfinished_sweep() -> None:
    (panel, *_) = composed(swept({}, 60, ended=50, is_drawn=True), ["satisfied.even"]).panels
    assert panel.value.shape == (1, 2)
    assert np.isnan(panel.lower).all()


def test_runs_with_the_same_drawn_value_form_one_part() -> None:
    runs = swept({}, 60, is_drawn=True)
    runs = replace(runs, drawn=[replace(runs.drawn[0], values=np.full(60, 2.5))])
    (panel,) = composed(runs, ["number"]).panels
    assert (panel.value.shape, panel.axes[0].values) == ((1, 1), [2.5])
