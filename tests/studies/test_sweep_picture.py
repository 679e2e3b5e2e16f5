"""`symaware plot DIR` draws the results of a sweep."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
from sweeping import symaware, tiny

from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.picture.finished_runs import finished_runs


def test_a_sweep_is_drawn_from_its_journal(tmp_path: Path) -> None:
    folder, file = tmp_path / "swept", tmp_path / "picture.png"
    symaware("sweep", tiny(tmp_path), "-o", folder, "--runs", 3, "-j", 0, "--over", "agents.robot.count=1,2", "-q")
    # The table may be missing, as during a running sweep.
    (folder / "runs.parquet").unlink()
    facts = json.loads(symaware("plot", folder, "-o", file, "--show", "satisfied.near,path_length", "--json"))
    assert (facts["runs"], facts["planned"], facts["failed"]) == (6, 6, 0)
    assert [(panel["panel"], panel["kind"]) for panel in facts["panels"]] == [
        ("satisfied.near", "curve"),
        ("path_length", "curve"),
    ]
    assert file.read_bytes().startswith(b"\x89PNG")
    assert "picture.png: satisfied.near, " in symaware("plot", folder, "-o", file)


def test_options_for_logs_are_rejected_for_sweeps(tmp_path: Path) -> None:
    (tmp_path / "else").mkdir()
    for name in ("sweep.yaml", "identity.json"):
        (tmp_path / name).touch()
    assert "--agents goes with a log" in symaware("plot", tmp_path, "--agents", "robot", status=2)
    assert "it is not a file" in symaware("plot", tmp_path / "else", "-o", tmp_path / "a.png", status=2)


def test_runs_are_read_up_to_the_first_missing_one(tmp_path: Path) -> None:
    folder = tmp_path / "swept"
    symaware("sweep", tiny(tmp_path), "-o", folder, "--runs", 3, "-j", 0, "--over", "agents.robot.count=1,2", "-q")
    whole = finished_runs(SweepFolder.opened(folder))
    assert (whole.intervals.is_final, whole.indices.tolist(), whole.shape) == (True, [0, 1, 2, 3, 4, 5], (2, 1))
    assert [axis.name for axis in whole.axes] == ["agents.robot.count"]
    # Runs 0, 2 and 4 belong to the first count.
    with closing(sqlite3.connect(folder / "journal.sqlite")) as journal, journal:
        journal.execute('DELETE FROM runs WHERE "index" = 2')
        journal.execute("""UPDATE runs SET state = 'failed', verdicts = '{}', metrics = '{}' WHERE "index" = 1""")
        journal.execute("""UPDATE runs SET state = 'lost', verdicts = '{}', metrics = '{}' WHERE "index" = 3""")
    part = finished_runs(SweepFolder.opened(folder))
    assert (part.intervals.is_final, part.indices.tolist(), part.failed) == (False, [0, 1, 3, 5], 2)
    satisfied, length = part.metrics["satisfied.near"].values, part.metrics["path_length"].values
    assert satisfied[1] == 0
    assert np.isnan(satisfied).tolist() == [False, False, True, False]
    assert np.isnan(length).tolist() == [False, True, True, False]
    assert length[3] == whole.metrics["path_length"].values[5]


def test_custom_metrics_are_drawn_like_built_in_ones(tmp_path: Path) -> None:
    sweep = f"symaware-sweep: 1\nscenario: {tiny(tmp_path).name}\nruns: 3\nover: {{agents.robot.count: [1, 2]}}\n"
    (tmp_path / "half.yaml").write_text(f"{sweep}metrics: {{half: final(time / 2)}}\n")
    folder, file = tmp_path / "swept", tmp_path / "picture.png"
    symaware("sweep", tmp_path / "half.yaml", "-o", folder, "-j", 0, "-q")
    facts = json.loads(symaware("plot", folder, "-o", file, "--show", "half", "--json"))
    assert [panel["panel"] for panel in facts["panels"]] == ["half"]
