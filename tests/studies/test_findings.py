from __future__ import annotations

import json
from pathlib import Path

import pytest
from sweeping import rows, symaware, tiny

from symaware_cli.studies.statistics.interval_estimate import clopper_pearson
from symaware_cli.studies.statistics.paired import compare


def test_the_shares_of_a_planned_sweep_have_exact_intervals(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--over", "agents.robot.count=1,2", "--runs", 20, "--jobs", 0)
    found = json.loads(symaware("shares", out, "--json"))
    assert [each["agents.robot.count"] for each in found] == [1, 2]
    for each in found:
        verdicts = [r["verdict.near"] for r in rows(out) if r["agents.robot.count"] == each["agents.robot.count"]]
        interval = clopper_pearson(verdicts.count("satisfied"), 20)
        assert (each["value"], each["lower"], each["upper"]) == (interval.value, interval.lower, interval.upper)
    assert "Clopper-Pearson" in symaware("shares", out)


def test_the_shares_of_a_sweep_stopped_by_a_rule_have_anytime_valid_intervals(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    rule = "halfwidth(satisfied.near) < 0.3"
    symaware("sweep", scenario, "-o", out, "--runs", 500, "--with", f"until={rule}", "--jobs", 0)
    (found,) = json.loads(symaware("shares", out, "--json"))
    assert found["method"] == "beta mixture"
    assert found["count"] == len(rows(out))


def test_paired_variants_are_compared_run_by_run(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    variants = ["--with", "variants.slow={agents.robot.model.with.max_speed: 0.5}", "--with", "variants.fast={}"]
    symaware("sweep", scenario, "-o", out, *variants, "--with", "paired=true", "--runs", 10, "--jobs", 0)
    slow, fast = ([row["path_length"] for row in rows(out) if row["variant"] == name] for name in ("slow", "fast"))
    (found,) = json.loads(symaware("compare", out, "path_length", "--json"))
    expected = compare(slow, fast)
    assert (found["variant"], found["against"]) == ("fast", "slow")
    assert found["mean"]["value"] == pytest.approx(expected.mean.value)
    assert found["greater"] == expected.greater == 10
    assert "path_length, less that of slow, run by run" in symaware("compare", out, "path_length")
    assert "did you mean" in symaware("compare", out, "path_lenth", status=2)


def test_unpaired_variants_are_not_compared(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--with", "variants.one={}", "--with", "variants.two={}", "--jobs", 0)
    assert "only paired variants" in symaware("compare", out, "closest", status=2)
