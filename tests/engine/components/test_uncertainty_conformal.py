"""`uncertainty.conformal`: regions hold as often as they say, from a sweep to a run, and shifts are flagged."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conformal_scenarios import errors_of, pairs, watchers, write_table
from scipy.stats import beta, binom
from simulating import untyped

from symaware_cli import open_log, sweep
from symaware_cli.core import Event, EventBus
from symaware_cli.engine.components.calibration import Calibration, ErrorTable, quantile_rank
from symaware_cli.engine.components.uncertainty_conformal import PredictionError
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.files import open_scenario
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest

CALIBRATION: dict[str, Any] = {"calibration": {"file": "table.parquet"}}


@pytest.mark.parametrize(("runs", "coverage", "rank"), [(200, 0.9, 181), (9, 0.9, 9), (19, 0.95, 19), (19, 0.55, 11)])
def test_the_rank_of_the_quantile_is_that_of_the_decimal_digits(runs: int, coverage: float, rank: int) -> None:
    assert quantile_rank(runs, coverage) == rank
    with pytest.raises(ValueError, match="takes at least 9 runs, not 8"):
        Calibration(ErrorTable(np.ones(1), np.ones((8, 1))), 0.9, 0)


def test_coverage_with_200_runs_is_181_of_201_on_average_and_scatters_as_a_beta_distribution() -> None:
    random = np.random.Generator(np.random.PCG64(5))
    # A score is uniform after its distribution function, so the radius is the coverage.
    covered = [
        float(Calibration(ErrorTable(np.ones(1), random.random((200, 1))), 0.9, 0).radii[0]) for _ in range(4000)
    ]
    assert np.mean(covered) == pytest.approx(181 / 201, abs=4 * beta(181, 20).std() / np.sqrt(4000))
    assert np.std(covered) == pytest.approx(beta(181, 20).std(), rel=0.05)


def test_the_shape_of_regions_comes_from_other_runs_than_their_size() -> None:
    random = np.random.Generator(np.random.PCG64(5))
    errors = random.random((300, 3)) * [1.0, 5.0, 6.0]
    calibration = Calibration(ErrorTable(np.array([1.0, 2.0, 3.0]), errors), 0.9, 100)
    assert len(calibration.scores) == 200
    np.testing.assert_allclose(calibration.radii / calibration.radii[0], [1.0, 5.0, 6.0], rtol=0.1)
    assert (errors[100:] <= calibration.radii).all(axis=1).sum() == 181


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the errors of 200 pairs."""
    folder = tmp_path_factory.mktemp("calibrated")
    write_table(folder / "table.parquet", errors_of(watchers(folder, pairs(200))))
    return folder


def test_recorded_regions_hold_the_others_as_often_as_they_say(calibrated: Path) -> None:
    content = {**pairs(150, **CALIBRATION), "seed": 2}
    (calibrated / "run.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    built = build(calibrated / "run.yaml")
    group = next(each for each in built.simulation.groups if each.name == "watcher")
    mover = next(each for each in built.simulation.groups if each.name == "mover")
    held = np.ones(150, bool)
    seen: list[Any] = []

    def look(event: Any) -> None:
        now, places = event.time, built.simulation.environment.state(mover)[:, :2]
        for row in range(150):
            for regions in seen:
                region = regions[row]
                after = int(np.searchsorted(region.times, now))
                if after < len(region):
                    centre = [np.interp(now, region.times, region.values[:, axis]) for axis in (0, 1)]
                    held[row] &= np.hypot(*(places[row] - centre)) <= region.values[after, 2] + 1e-9
        seen.append([agent.awareness_database[f"mover.{row}"]["region"] for row, agent in enumerate(group.agents)])

    built.simulation.events.subscribe("stepping", look)
    summary = execute(built, None)
    assert summary.status == "finished", summary.failure
    # What the component counts and what the regions say are the same.
    radii = seen[0][0].values[1:, 2]
    np.testing.assert_array_equal(held, (errors_of(group) <= radii + 1e-9).all(axis=1))
    assert held.mean() == pytest.approx(181 / 201, abs=0.1)


@pytest.mark.slow
def test_coverage_over_many_tables_is_181_of_201(tmp_path: Path) -> None:
    ahead, covered = np.array([0.25, 0.5, 0.75, 1.0]), []
    for seed in range(24):
        errors = errors_of(watchers(tmp_path, {**pairs(500, duration=1.5), "seed": seed}))
        calibration = Calibration(ErrorTable(ahead, errors[:200]), 0.9, 0)
        covered.append((errors[200:] <= calibration.radii).all(axis=1).mean())
    assert np.mean(covered) == pytest.approx(181 / 201, abs=3 * np.std(covered, ddof=1) / np.sqrt(24))


def _note(flagged: list[str], event: Event) -> None:
    flagged.append(str(event.agent))


def test_a_shift_is_flagged_and_its_absence_seldom(calibrated: Path) -> None:
    for noise, low, high in ((0.3, 0.0, float(binom(300, 0.02).isf(1e-3)) / 300 + 0.03), (0.9, 0.8, 1.0)):
        content = {**pairs(300, noise=noise, false_alarm=0.02, **CALIBRATION), "seed": 3}
        (calibrated / "run.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
        built = build(calibrated / "run.yaml")
        flagged: list[str] = []
        built.simulation.events.subscribe("calibration-shifted", partial(_note, flagged))
        execute(built, None)
        assert len(set(flagged)) == len(flagged)
        assert low <= len(flagged) / 300 <= high


@pytest.mark.parametrize(("greatest", "count"), [(1e-6, 4), (1e6, 0)])
def test_errors_beyond_those_of_all_calibrating_runs_are_flagged_once(
    greatest: float, count: int, tmp_path: Path
) -> None:
    random = np.random.Generator(np.random.PCG64(5))
    write_table(tmp_path / "table.parquet", greatest * random.uniform(0.9, 1.0, (60, 4)))
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(pairs(4, false_alarm=0.05, **CALIBRATION), sort_keys=False))
    built = build(tmp_path / "run.yaml")
    flagged: list[str] = []
    built.simulation.events.subscribe("calibration-shifted", partial(_note, flagged))
    assert execute(built, None).status == "finished"
    assert len(flagged) == len(set(flagged)) == count


def test_the_metric_is_the_greatest_error_of_all_agents_for_each_look_ahead(tmp_path: Path) -> None:
    group = watchers(tmp_path, pairs(3))
    metric = PredictionError(PredictionError.Parameters())
    metric.attach(untyped(None), [group], EventBus())
    expected = zip([0.25, 0.5, 0.75, 1.0], errors_of(group).max(axis=0).tolist(), strict=True)
    assert metric.value() == list(expected)
    for groups, said in (([], "no `uncertainty"), ([group, group], "name the `group`")):
        with pytest.raises(ValueError, match=said):
            metric.attach(untyped(None), groups, EventBus())
    with pytest.raises(ValueError, match="the agents of `mover` have no"):
        PredictionError(PredictionError.Parameters(group="mover")).attach(untyped(None), [group], EventBus())


def test_a_sweep_calibrates_a_scenario_whose_log_repeats_without_the_table(tmp_path: Path) -> None:
    (tmp_path / "pairs.yaml").write_text(yaml.safe_dump(pairs(2), sort_keys=False))
    metric = {"prediction_error": {"use": "prediction.error"}}
    plan = {"symaware-sweep": 1, "scenario": "pairs.yaml", "runs": 12, "metrics": metric}
    (tmp_path / "sweep.yaml").write_text(yaml.safe_dump(plan, sort_keys=False))
    sweep(tmp_path / "sweep.yaml", output=tmp_path / "table", jobs=0)
    content = pairs(2, calibration={"file": "table/runs.parquet"}, coverage=0.8, false_alarm=0.1)
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    execute(build(tmp_path / "run.yaml"), tmp_path / "run.mcap")
    log = open_log(tmp_path / "run.mcap")
    assert "scenario/table/runs.parquet" in log.attachments
    (tmp_path / "table" / "runs.parquet").unlink()
    execute(open_scenario(tmp_path / "run.mcap"), tmp_path / "again.mcap")
    assert digest(open_log(tmp_path / "again.mcap")) == digest(log)


def test_files_of_components_are_relative_to_the_scenario_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "base").mkdir()
    write_table(tmp_path / "base" / "table.parquet", np.ones((60, 4)))
    (tmp_path / "base" / "base.yaml").write_text(yaml.safe_dump(pairs(2, **CALIBRATION), sort_keys=False))
    (tmp_path / "run.yaml").write_text("extends: base/base.yaml\nname: other\n")
    built = build(tmp_path / "run.yaml")
    assert "base/table.parquet" in built.files


@pytest.mark.parametrize(
    ("errors", "parameters", "said"),
    [
        (None, {}, "there is no file `table.parquet`"),
        (np.ones((8, 4)), {}, "a coverage of 0.9 takes at least 9 runs, not 8"),
        (np.ones((60, 4)), {"shaping_runs": 55}, "takes at least 9 runs beside 55 for the shape, not 5"),
        (np.ones((60, 3)), {}, "has 3 look-aheads up to 0.75 s, and `horizon` and `step` ask for 4 up to 1 s"),
        (np.ones((20, 4)), {}, "`false_alarm` is at least 0.0476 with 20 runs"),
        (np.ones((60, 4)), {"calibration": {"file": "table.parquet", "column": "error"}}, "has no column `error`"),
        (np.ones((60, 4)), {"step": 0.3}, r"step \(0.3\) must divide the horizon \(1\)"),
    ],
)
def test_an_unsuitable_calibration_is_refused(
    tmp_path: Path, errors: Any, parameters: dict[str, Any], said: str
) -> None:
    if errors is not None:
        write_table(tmp_path / "table.parquet", errors)
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(pairs(2, **{**CALIBRATION, **parameters}), sort_keys=False))
    with pytest.raises(ScenarioError, match=said) as caught:
        build(tmp_path / "run.yaml")
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].path.startswith("agents.watcher.components.regions")


def test_a_file_that_is_no_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "table.parquet").write_text("no table")
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(pairs(2, **CALIBRATION), sort_keys=False))
    with pytest.raises(ScenarioError, match=r"`table.parquet` is no table of a sweep"):
        build(tmp_path / "run.yaml")
