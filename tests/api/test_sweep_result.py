"""Frames of sweeps have the rows of their tables."""

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import pyarrow
import pytest
from sweeping import tiny

import symaware_cli as sa


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> sa.SweepResult:
    folder = tmp_path_factory.mktemp("swept")
    return sa.sweep(tiny(folder), folder / "out", over={"agents.robot.count": [1, 2]}, runs=2, seed=5)


def test_a_frame_has_the_rows_of_the_table_in_each_library(swept: sa.SweepResult) -> None:
    pandas, polars = swept.frame(), swept.frame("polars")
    assert swept.frame("arrow") is swept.table
    for name in ("agents.robot.count", "seed", "closest", "verdict.near", "robustness.near", "error"):
        values = swept[name].to_pylist()
        assert polars[name].to_list() == values
        assert [None if each != each else each for each in pandas[name]] == values
    assert pandas.attrs["units"]["time"] == "s"
    assert list(pandas.columns) == polars.columns == swept.column_names


def test_a_result_is_used_like_its_table(swept: sa.SweepResult) -> None:
    assert (len(swept), swept.num_rows, swept.planned) == (4, 4, 4)
    assert swept.equals(swept.table)
    assert swept.equals(copy.copy(swept))
    assert swept.equals(pickle.loads(pickle.dumps(swept)))
    assert pyarrow.table(swept).equals(swept.table)
    assert repr(swept).startswith("<SweepResult 4 of 4 runs, ")
    with pytest.raises(AttributeError, match="nothing"):
        _ = swept.nothing


def test_a_folder_is_read_with_the_conditions_of_rows(swept: sa.SweepResult) -> None:
    assert swept.path is not None
    assert sa.open_sweep(swept.path).equals(swept)
    few = sa.open_sweep(swept.path, where="count == 2", sort="-seed", limit=1, columns=["index", "count"])
    assert (few.column_names, few["agents.robot.count"].to_pylist(), few.planned) == (
        ["index", "agents.robot.count"],
        [2],
        4,
    )
    with pytest.raises(sa.SweepError, match="is not the folder of a sweep"):
        sa.open_sweep(swept.path / "logs")


def test_a_sweep_that_is_not_kept_has_no_folder(tmp_path: Path) -> None:
    assert sa.sweep(tiny(tmp_path), runs=1).path is None


def test_a_library_that_is_missing_is_named(swept: sa.SweepResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(sa.LogError, match=r"`polars`, which is not installed: pip install .symaware-cli\[frames\]"):
        swept.frame("polars")


def test_the_package_and_a_run_import_no_library_of_frames(path: Path) -> None:
    code = (
        "import sys, symaware_cli as sa\n"
        "run = sa.load('swap.yaml').run()\n"
        "run.series('robot', 'world'), sa.RunResult.frame, sa.Log.frame\n"
        "print([name for name in ('pandas', 'polars', 'pyarrow', 'xarray') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=path.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_run_has_the_frames_of_its_log(path: Path) -> None:
    run = sa.load(path).run()
    assert run.frame("robot", to="polars").equals(run.log.frame("robot", to="polars"), null_equal=True)
    assert run.to_xarray("robot.1").identical(run.log.to_xarray("robot.1"))
