"""The converter of BARN worlds, on a world of our own in their format."""

import importlib.util
import io
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from checkout import CHECKOUT

from symaware_cli import scenario

MODEL = """<model name='unit_cylinder_{number}'><static>1</static>
<pose frame=''>{x:.6f} {y:.6f} 0.000000 0.000000 0.000000 0.000000</pose>
<link name='link'><collision name='collision'><geometry><cylinder><radius>0.075000</radius><length>1</length></cylinder>
</geometry></collision></link></model>
"""
PLANE = """<model name='ground_plane'>
<link name='link'><collision name='c'><geometry><plane/></geometry></collision></link></model>
"""
CENTRES = [(-2.25, 6.0), (-2.4, 6.0), (-2.1, 6.0), (-4.425, 0.075)]


@pytest.fixture(scope="module")
def barn() -> ModuleType:
    """The program, as a module."""
    found = importlib.util.spec_from_file_location("barn", CHECKOUT / "benchmarks" / "barn.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules["barn"] = module
    found.loader.exec_module(module)
    return module


def world(body: str | None = None) -> bytes:
    models = [MODEL.format(number=number, x=x, y=y) for number, (x, y) in enumerate(CENTRES)]
    content = PLANE + "".join(models) if body is None else body
    return f"<sdf version='1.6'><world name='default'>{content}</world></sdf>".encode()


def path(cells: object = ((15, 0), (15, 29))) -> bytes:
    content = io.BytesIO()
    np.save(content, np.array(cells))
    return content.getvalue()


def test_cylinders_and_the_path_are_read(barn: ModuleType) -> None:
    found = barn.read_world(world(), path())
    assert found.centres.tolist() == [list(each) for each in CENTRES]
    assert found.radii.tolist() == [0.075] * 4
    # From the start by way of the first and last cell to the goal; the cells are those of `run.py`.
    assert found.path == pytest.approx(np.array([[-2.25, 3.0], [-2.325, 5.075], [-2.325, 9.425], [-2.25, 13.0]]))
    assert found.optimal_time == pytest.approx(0.5 * (np.hypot(0.075, 2.075) + 4.35 + np.hypot(0.075, 3.575)))


@pytest.mark.parametrize(
    ("content", "cells", "said"),
    [
        (b"<sdf>", path(), "it is no XML"),
        (world(PLANE), path(), "it has 0 cylinders"),
        (world(MODEL.format(number=0, x=np.nan, y=0.0)), path(), "it is no cylinder"),
        (world(), b"nothing", "the path cannot be read"),
        (world(), path([1, 2, 3]), "the path is no array"),
        (world(), path([[np.inf, 0.0]]), "no finite numbers"),
        (world(), path([["a", "b"]]), "no finite numbers"),
        (b" " * 5_000_000, path(), "it is larger than"),
    ],
)
def test_what_is_no_world_is_refused(barn: ModuleType, content: bytes, cells: bytes, said: str) -> None:
    with pytest.raises(barn.BarnError, match=said):
        barn.read_world(content, cells)


@pytest.mark.parametrize("controller", ["histogram", "window", "map-window"])
def test_the_scenario_has_the_cylinders_and_is_valid(barn: ModuleType, controller: str) -> None:
    document = barn.scenario(barn.read_world(world(), path()), controller)
    assert len(document["environment"]["entities"]) == len(CENTRES)
    assert document["agents"]["robot"]["knowledge"]["goal"] == [-2.25, 13.0]
    scenario(document).validate()


def test_the_metric_is_at_most_a_half_and_nothing_for_those_that_fail(barn: ModuleType) -> None:
    found = barn.read_world(world(), path())
    (outcome,) = barn.drive(found, "window", [0])
    assert outcome.status == "succeeded"
    optimal = found.optimal_time
    assert outcome.metric == optimal / min(max(outcome.time, 2 * optimal), 8 * optimal)
    assert 0.125 <= outcome.metric <= 0.5
    fallen = barn.row_of("window", {barn.Pair(0, 0): outcome, barn.Pair(0, 1): barn.Outcome("collided", 3.0, 0.0)})
    assert (fallen.succeeded, fallen.collided, fallen.metric) == (1, 1, 0.5 * outcome.metric)


def test_runs_continue_a_file_and_the_table_has_the_seeds_of_all_worlds(
    barn: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, rows = tmp_path / barn.FOLDER, tmp_path / "rows.jsonl"
    (folder / "path_files").mkdir(parents=True)
    for number in (0, 1):
        (folder / f"world_{number}.world").write_bytes(world())
        (folder / "path_files" / f"path_{number}.npy").write_bytes(path())
    row = '{"controller": "window", "world": %d, "seed": %d, "status": "collided", "time": 7.0, "metric": 0.0}\n'
    rows.write_text("".join(row % pair for pair in ((0, 0), (1, 0), (0, 1))) + '{"contr')
    options = [str(tmp_path), "--worlds", "0:2", "--runs", "2", "--controllers", "window"]
    assert barn.main([*options, "--read", str(rows)]) == 0
    assert "| window | 2 | 2 | 0.0000 | 0.000 | 1.000 |" in capsys.readouterr().out
    assert barn.main([*options, "--output", str(rows), "--jobs", "1"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("1 runs")
    assert "| window | 2 | 4 |" in said
    assert barn.read_outcomes([rows])["window", barn.Pair(1, 1)].status == "succeeded"


def test_pairs_are_drawn_from_all_worlds_and_repeat(barn: ModuleType) -> None:
    pairs = barn.drawn_pairs(3_000, 0)
    assert pairs == barn.drawn_pairs(3_000, 0)
    assert {each.world for each in pairs} == set(range(300))
    assert min(each.seed for each in pairs) >= barn.FIRST_DRAWN


def test_worlds_are_read_from_a_folder_or_a_git_directory(barn: ModuleType, tmp_path: Path) -> None:
    folder = tmp_path / barn.FOLDER
    (folder / "path_files").mkdir(parents=True)
    (folder / "world_7.world").write_bytes(world())
    (folder / "path_files" / "path_7.npy").write_bytes(path())
    direct = barn.Source(tmp_path).world(7)
    author = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for command in (["init", "-q"], ["add", "."], [*author, "commit", "-qm", "worlds"]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True, capture_output=True)
    stored = barn.Source(tmp_path / ".git").world(7)
    assert np.array_equal(stored.centres, direct.centres)
    with pytest.raises(barn.BarnError, match=r"world_8\.world"):
        barn.Source(tmp_path).world(8)
