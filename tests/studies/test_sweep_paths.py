"""The trajectories of the runs of a sweep are drawn from repeated runs."""

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sweeping import rows, symaware, tiny

from symaware_cli import load
from symaware_cli.log import OutputError
from symaware_cli.studies import plot_paths
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.picture.paths_figure import draw, prepared
from symaware_cli.studies.picture.paths_picture import RunPaths, gathered
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_plan import brief_names


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of 10 runs of each of two combinations."""
    folder = tmp_path_factory.mktemp("paths")
    options = ["--runs", 10, "-j", 0, "--over", "run.duration=1.0,20.0", "-q"]
    symaware("sweep", tiny(folder), "-o", folder / "swept", *options)
    return folder / "swept"


def test_paths_equal_those_of_single_runs_with_and_without_batches(swept: Path) -> None:
    folder = SweepFolder.opened(swept)
    indices = [0, 2, 4]
    found = []
    for batch in (1, 3):
        paths = RunPaths()
        for _ in folder.runner(batch, paths.follow).rows(indices):
            pass
        found.append([paths.take(index) for index in indices])
    for alone, batched in zip(*found, strict=True):
        assert alone.shape == (11, 2, 2)
        assert (alone == batched).all()
    seed = folder.plan.seed(2)
    log = (
        load(swept / "scenario" / "tiny.yaml", {"run.duration": 1.0}, seed=seed).run(output=swept.parent / "2.mcap").log
    )
    assert found[0][1][:, 1] == pytest.approx(log.series("robot.1", "world").values[:, :2])


def test_paths_of_long_runs_are_thinned_but_keep_their_ends(swept: Path) -> None:
    folder, paths = SweepFolder.opened(swept), RunPaths()
    for _ in folder.runner(follow=paths.follow).rows([1, 3]):
        pass
    path = paths.take(1)
    assert 80 <= len(path) <= 161  # of 201 steps
    seed = folder.plan.seed(1)
    log = (
        load(swept / "scenario" / "tiny.yaml", {"run.duration": 20.0}, seed=seed)
        .run(output=swept.parent / "1.mcap")
        .log
    )
    world = log.series("robot.0", "world").values[:, :2]
    assert path[[0, -1], 0] == pytest.approx(world[[0, -1]])
    assert paths.goals_differ is False


def test_a_picture_of_paths_counts_violating_runs(swept: Path, tmp_path: Path) -> None:
    file = tmp_path / "paths.png"
    facts = json.loads(symaware("trajectories", swept, "--runs", 8, "-o", file, "--json"))
    violated = [row["verdict.near"] == "violated" for row in rows(swept) if row["replicate"] < 8]
    assert [panel["violating"] for panel in facts["panels"]] == [sum(violated[0::2]), sum(violated[1::2])]
    assert [panel["of"] for panel in facts["panels"]] == ["duration = 1.0", "duration = 20.0"]
    assert facts["runs"] == 16
    assert "The first runs of each combination: 16 of 20." in facts["notes"]
    assert file.read_bytes().startswith(b"\x89PNG")


def test_names_are_as_short_as_tells_them_apart() -> None:
    assert brief_names(["a.b.speed", "a.b.gain", "count"]) == ["speed", "gain", "count"]
    assert brief_names(["a.b.speed", "a.c.speed", "speed"]) == ["b.speed", "c.speed", "speed"]
    assert brief_names(["x.a.use", "y.a.use"]) == ["x.a.use", "y.a.use"]
    assert brief_names(["verdict.near", "a.b.near"], lambda name: name != "verdict.near") == ["verdict.near", "b.near"]


def test_long_values_of_a_combination_leave_the_panels_as_wide_as_short_ones(swept: Path) -> None:
    def widths(caption: str) -> list[float]:
        panels = [replace(panel, caption=caption) for panel in picture.panels]
        sheet, fill = prepared(replace(picture, panels=panels))
        with sheet.drawn(None, fill) as figure:
            return [axes.get_position().width for axes in figure.axes if axes.get_xlabel()]

    picture = gathered(SweepFolder.opened(swept), 2)
    short = widths("speed = 1")
    assert len(short) == 2
    assert widths(", ".join(["main.components.steer.use = control.velocity-obstacle"] * 3)) == pytest.approx(
        short, rel=0.1
    )


def test_a_picture_of_paths_is_reproducible_byte_for_byte(swept: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    for name in ("one.svg", "other.svg"):
        picture = gathered(SweepFolder.opened(swept), 2, lambda made, total: told.append((made, total)))
        draw(picture, tmp_path / name, dpi=50)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "other.svg").read_bytes()
    assert told[:4] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert np.isfinite(picture.panels[0].paths[0]).all()


def test_a_repeated_run_that_differs_is_not_drawn(tmp_path: Path) -> None:
    folder = tmp_path / "swept"
    symaware("sweep", tiny(tmp_path), "-o", folder, "--runs", 3, "-j", 0, "-q")
    with closing(sqlite3.connect(folder / "journal.sqlite")) as journal, journal:
        journal.execute("""UPDATE runs SET digest = 'another' WHERE "index" = 1""")
    with pytest.raises(SweepError, match=r"run 1 of .* had another result when it was repeated"):
        gathered(SweepFolder.opened(folder))


def test_a_picture_that_cannot_be_written_is_found_before_runs_are_repeated(swept: Path, tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    with pytest.raises(OutputError, match="its folder does not exist"):
        plot_paths(swept, tmp_path / "missing" / "paths.svg", on_progress=lambda *counts: done.append(counts))
    assert done == []


def test_paths_can_be_drawn_only_for_the_folder_of_a_sweep(swept: Path) -> None:
    assert "is not the folder of a sweep" in symaware("trajectories", swept / "sweep.yaml", status=2)
