"""The table of a sweep contains the outcomes of offered specifications."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from sweeping import rows, symaware, tiny


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sweep of two runs in which one of two robots fails early or late, so that its offers are open again."""
    scenario = yaml.safe_load(tiny(tmp_path).read_text())
    scenario["run"]["duration"] = 2.0
    scenario["agents"]["robot"]["state"] = [[0, 0, 0], [1, 0, 0]]
    take = {"use": "allocation.nearest", "with": {"least": -5.0, "most": 3}}
    scenario["agents"]["robot"]["components"]["take"] = take
    scenario["parameters"] = {"breakdown": 1.0}
    scenario["faults"] = {"breakdown": {"stop": "robot.0", "at": "${parameters.breakdown}"}}
    scenario["specifications"] |= {
        "move": {"each": "robot", "offer": {"at": 0.5, "to": "robot.0"}, "formula": "always[0, 1] x > -1"},
        "hurry": {"each": "robot", "offer": {"at": 0.0, "to": "robot.1"}, "formula": "eventually[0, 1] x > 2.9"},
        "far": {"each": "robot", "offer": {"at": 0.0}, "formula": "eventually x > 50"},
    }
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(scenario))
    varied = ("--over", "parameters.breakdown=1.0,1.8", "--jobs", 0)
    symaware("sweep", tmp_path / "tiny.yaml", "-o", tmp_path / "out", *varied)
    return tmp_path / "out"


def test_a_row_counts_accepted_violated_and_rejected_offers(folder: Path) -> None:
    early, late = ((row["offers_accepted"], row["offers_violated"], row["offers_rejected"]) for row in rows(folder))
    # The offer accepted by the robot that failed early is open again, and the other robot did not receive it.
    assert early == (1, 1, 2)
    assert late == (2, 1, 1)
    first = rows(folder)[0]
    assert (first["verdict.move"], first["verdict.hurry"], first["verdict.far"]) == ("rejected", "violated", "rejected")


def test_the_counts_of_offers_are_shown_and_can_select_rows(folder: Path) -> None:
    assert symaware("rows", folder, "--where", "offers_rejected > 1", "--columns", "breakdown,offers_accepted") == (
        "breakdown  offers_accepted\n        1                1\n1 of 2 runs\n"
    )
    assert "offers_violated" in symaware("rows", folder)


def test_there_are_no_counts_without_offers(tmp_path: Path) -> None:
    symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "--jobs", 0)
    assert rows(tmp_path / "out")[0]["offers_accepted"] is None
    assert "offers" not in symaware("rows", tmp_path / "out")
