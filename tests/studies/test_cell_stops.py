from __future__ import annotations

import json
from pathlib import Path

import pytest
from sweeping import rows, symaware, table_digest, tiny

from symaware_cli.studies.statistics.confidence_sequence import BetaMixture


def test_a_sweep_ends_when_its_rule_holds_at_a_look(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    rule = "halfwidth(satisfied.near) < 0.2"
    said = json.loads(
        symaware("sweep", scenario, "-o", out, "--runs", 1000, "--with", f"until={rule}", "--jobs", 0, "--json")
    )
    found = rows(out)
    assert said["runs"] == said["done"] == len(found) < 1000
    assert said["until"] == rule
    sequence = BetaMixture()
    values = [float(row["verdict.near"] == "satisfied") for row in found]
    before = values[: len(values) - 20]
    sequence.update(before)
    assert sequence.estimate().halfwidth >= 0.2
    sequence.update(values[len(before) :])
    assert sequence.estimate().halfwidth < 0.2
    # The sweep is finished: no runs are left.
    assert json.loads(symaware("resume", out, "--jobs", 0, "--json"))["made_now"] == 0


def test_the_number_of_workers_does_not_affect_where_a_sweep_ends(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    rule = "halfwidth(satisfied.near) < 0.25"
    for jobs in (0, 2):
        options = ["--runs", 1000, "--with", f"until={rule}", "--over", "agents.robot.count=1,3", "--jobs", jobs]
        symaware("sweep", scenario, "-o", tmp_path / f"{jobs}", *options)
    assert table_digest(tmp_path / "0") == table_digest(tmp_path / "2")
    counts = [sum(row["agents.robot.count"] == count for row in rows(tmp_path / "0")) for count in (1, 3)]
    assert all(20 <= count < 1000 for count in counts)


def test_a_resumed_sweep_with_a_rule_gives_the_same_table(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    options = ["--runs", 200, "--with", "until=halfwidth(satisfied.near) < 0.2", "--jobs", 0]
    symaware("sweep", scenario, "-o", tmp_path / "whole", *options)
    symaware("plan", scenario, *options[:-2])
    symaware("sweep", scenario, "-o", tmp_path / "out", *options)
    assert table_digest(tmp_path / "whole") == table_digest(tmp_path / "out")


def test_a_rule_on_a_mean_needs_values_within_declared_bounds(tmp_path: Path) -> None:
    tiny(tmp_path)
    sweep, out = tmp_path / "sweep.yaml", tmp_path / "out"
    text = 'symaware-sweep: 1\nscenario: tiny.yaml\nruns: 500\nuntil: "halfwidth(mean.closest) < 0.5"\n'
    sweep.write_text(text)
    assert "bounds of its values are declared" in symaware("sweep", sweep, "-o", out, status=2)
    sweep.write_text(text + "bounds: {closest: [-2, 2]}\n")
    symaware("sweep", sweep, "-o", out, "--jobs", 0)
    assert len(rows(out)) < 500


@pytest.mark.parametrize(
    ("rule", "column", "said"),
    [
        ("halfwidth(satisfied.nera) < 0.1", 11, "did you mean `satisfied.near`?"),
        ("halfwidth(satisfied.near) <", 27, "breaks off here"),
        ("satisfied.near", 1, "comparisons"),
    ],
)
def test_an_invalid_rule_is_located_and_nothing_is_created(tmp_path: Path, rule: str, column: int, said: str) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    options = ["--runs", 50, "--with", f"until={rule}"]
    found = json.loads(symaware("sweep", scenario, "-o", out, *options, "--json", status=2))
    problem = found["problems"][0]
    assert problem["span"]["file"] == f"--with until={rule}"
    assert said in symaware("sweep", scenario, "-o", out, *options, status=2)
    assert problem["span"]["column"] == column + len("until=")
    assert not out.exists()
