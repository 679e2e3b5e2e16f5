"""`symaware plot DIR` draws what a sweep came to."""

import json
from pathlib import Path

from sweeping import symaware, tiny


def test_a_sweep_is_drawn_from_its_journal(tmp_path: Path) -> None:
    folder, file = tmp_path / "swept", tmp_path / "picture.png"
    symaware("sweep", tiny(tmp_path), "-o", folder, "--runs", 3, "-j", 0, "--over", "agents.robot.count=1,2", "-q")
    # The table may be gone, as while the sweep goes on.
    (folder / "runs.parquet").unlink()
    facts = json.loads(symaware("plot", folder, "-o", file, "--show", "satisfied.near,path_length", "--json"))
    assert (facts["runs"], facts["planned"], facts["failed"]) == (6, 6, 0)
    assert [(panel["panel"], panel["kind"]) for panel in facts["panels"]] == [
        ("satisfied.near", "curve"),
        ("path_length", "curve"),
    ]
    assert file.read_bytes().startswith(b"\x89PNG")
    assert "picture.png: satisfied.near, " in symaware("plot", folder, "-o", file)


def test_options_of_logs_are_refused_for_sweeps(tmp_path: Path) -> None:
    assert "--agents goes with a log" in symaware("plot", tmp_path, "--agents", "robot", status=2)
    assert "is not the folder of a sweep" in symaware("plot", tmp_path, "-o", tmp_path / "a.png", status=2)
