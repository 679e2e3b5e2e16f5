"""Sweeps as a user runs them: with the command, in separate processes."""

from __future__ import annotations

import gc
import json
import sqlite3
import weakref
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from sweeping import rows, symaware, table_digest, tiny

import symaware_cli
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.language.problem import ScenarioError
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.session import conduct
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_source import read_sweep


def test_a_sweep_has_a_row_for_each_run_of_each_combination(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    symaware("sweep", scenario, "-o", tmp_path / "out", "--over", "agents.robot.count=1,2", "--runs", 3, "--jobs", 0)
    found = rows(tmp_path / "out")
    assert [row["index"] for row in found] == [*range(6)]
    assert [row["agents.robot.count"] for row in found] == [1, 2] * 3
    assert {row["state"] for row in found} == {"done"}
    assert {row["verdict.near"] for row in found} == {"satisfied", "violated"}


def test_the_table_does_not_depend_on_the_number_of_workers(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    for jobs in (0, 1, 2):
        symaware("sweep", scenario, "-o", tmp_path / f"{jobs}", "--runs", 20, "--jobs", jobs)
    assert len({table_digest(tmp_path / f"{jobs}") for jobs in (0, 1, 2)}) == 1


def test_a_row_agrees_with_the_run_executed_alone(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    symaware("sweep", scenario, "-o", tmp_path / "out", "--over", "agents.robot.count=2,3", "--runs", 3, "--jobs", 0)
    for row in rows(tmp_path / "out"):
        count, seed = row["agents.robot.count"], row["seed"]
        alone = symaware_cli.load(scenario, {"agents.robot.count": count}, seed=seed).run(record=False).summary
        assert alone.minimum_separation is not None
        assert row["closest"] == alone.minimum_separation.value
        assert row["goals_reached"] == len(alone.goals_reached)
        assert row["contacts"] == alone.contacts
        assert (row["verdict.near"], row["robustness.near"]) == (
            alone.specifications[0].verdict,
            alone.specifications[0].robustness,
        )


def test_the_table_lists_each_goal_with_agent_and_time_with_and_without_batches(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    changes = ["--set", "run.duration=5", "--set", "agents.robot.knowledge.goal=[2, 0]", "--runs", 4, "--jobs", 0]
    for batch in ("off", 3):
        symaware("sweep", scenario, "-o", tmp_path / f"{batch}", *changes, "--batch", batch)
    assert table_digest(tmp_path / "off") == table_digest(tmp_path / "3")
    for row in rows(tmp_path / "3"):
        longer = {"run.duration": 5.0, "agents.robot.knowledge.goal": [2, 0]}
        alone = symaware_cli.load(scenario, longer, seed=row["seed"]).run(output=tmp_path / f"{row['index']}.mcap")
        events = [each for each in alone.events if each.name == "goal-reached"]
        expected = [(each.source.removeprefix("agents.").rpartition(".")[0], each.time / 1e9) for each in events]
        assert [(each["agent"], each["time"]) for each in row["goals"]] == expected
        assert len(expected) == row["goals_reached"] == 2
        assert row["goal_time"] == row["goals"][-1]["time"]
    out = tmp_path / "3"
    first = rows(out)[0]["goals"][0]
    assert f"{first['agent']} {first['time']:.6g}, robot." in symaware("rows", out, "--columns", "goals")
    assert '[{""agent"": ""robot.' in symaware("rows", out, "--csv")
    assert "`goals` is a list" in symaware("rows", out, "--where", "goals > 1", status=2)
    assert "`goals` is a list" in symaware("rows", out, "--sort", "goals", status=2)


def test_the_table_has_the_outcome_of_a_specification_for_each_agent_and_pair(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "off"
    both = {
        "near": {"each": "robot", "formula": "always x < 2"},
        "apart": {"pairs": "robot", "formula": "always distance > 0.1"},
    }
    # A specification about the world is not batched.
    for batch, stated in (("off", {**both, "quiet": {"formula": "always contacts < 1"}}), (3, both)):
        changes = ["--set", f"specifications={json.dumps(stated)}", "--set", "run.duration=5", "--runs", 4]
        symaware("sweep", scenario, "-o", tmp_path / f"{batch}", *changes, "--batch", batch, "--jobs", 0)
    for one, other in zip(rows(out), rows(tmp_path / "3"), strict=True):
        near = one["by_agent.near"]
        assert near == other["by_agent.near"]
        assert one["by_agent.apart"] == other["by_agent.apart"]
        assert {each["agent"] for each in near} == {"robot.0", "robot.1"}
        assert near[0]["verdict"] == one["verdict.near"]
        assert near[0]["robustness"] == one["robustness.near"] == min(each["robustness"] for each in near)
        assert [each["agent"] for each in one["by_agent.apart"]] == ["robot.0 and robot.1"]
        assert one["by_agent.quiet"] is None
    assert "robot.1 " in symaware("rows", out, "--columns", "by_agent.near")


def test_invalid_input_is_located_and_creates_nothing(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    before = sorted(tmp_path.iterdir())
    said = symaware("sweep", scenario, "-o", tmp_path / "out", "--over", "agents.robot.cont=1,2", status=2)
    assert "--over agents.robot.cont=1,2:1:1: unknown key `cont`" in said
    assert "did you mean `count`?" in said
    said = symaware("sweep", scenario, "-o", tmp_path / "out", "--over", "run.duration=1,-2", "--json", status=2)
    assert json.loads(said)["problems"][0]["span"]["column"] == 16
    assert sorted(tmp_path.iterdir()) == before


def test_a_dry_run_shows_the_plan_and_creates_nothing(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    before = sorted(tmp_path.iterdir())
    said = symaware("plan", scenario, "--over", "agents.robot.count=1,2", "--runs", 5)
    assert said.splitlines()[0] == "sound; 10 runs: 5 of each of 2"
    assert sorted(tmp_path.iterdir()) == before


def test_the_same_sweep_is_resumed_and_a_different_one_is_rejected(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    out = tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--runs", 3, "--jobs", 0)
    again = json.loads(symaware("sweep", scenario, "-o", out, "--runs", 3, "--jobs", 0, "--json"))
    assert (again["done"], again["made_now"]) == (3, 0)
    said = symaware("sweep", scenario, "-o", out, "--runs", 4, status=2)
    assert "runs: 3 there, 4 now" in said
    scenario.write_text(scenario.read_text().replace("max_speed: 1.0", "max_speed: 2.0"))
    said = symaware("sweep", scenario, "-o", out, "--runs", 3, status=2)
    assert "the file tiny.yaml is another one" in said


def test_a_sweep_is_not_resumed_with_different_files_or_versions(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    out = tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--runs", 1, "--jobs", 0)
    identity = json.loads((out / "identity.json").read_text())
    old = identity["versions"]["numpy"]
    identity["versions"]["numpy"] = "1.0"
    (out / "identity.json").write_text(json.dumps(identity))
    assert f"numpy: 1.0 then, {old} now" in symaware("resume", out, status=2)
    identity["versions"]["numpy"] = old
    (out / "identity.json").write_text(json.dumps(identity))
    kept = out / "scenario" / "tiny.yaml"
    kept.write_text(kept.read_text().replace("max_speed: 1.0", "max_speed: 2.0"))
    said = symaware("resume", out, status=2)
    assert "max_speed: 1.0" in said
    assert "max_speed: 2.0" in said


def test_adding_runs_keeps_the_existing_ones(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    out = tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--runs", 2, "--over", "agents.robot.count=1,2", "--jobs", 0)
    before = rows(out)
    symaware("resume", out, "--add-runs", 2, "--jobs", 0)
    assert rows(out)[:4] == before
    symaware("sweep", scenario, "-o", tmp_path / "all", "--runs", 4, "--over", "agents.robot.count=1,2", "--jobs", 0)
    assert table_digest(out) == table_digest(tmp_path / "all")


def test_the_logs_of_the_worst_runs_are_kept_and_named_by_their_digests(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    out = tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--runs", 8, "--with", "keep=worst:2", "--jobs", 0)
    worst = sorted(rows(out), key=lambda row: row["robustness.near"])[:2]
    with closing(sqlite3.connect(out / "journal.sqlite")) as journal, journal:
        kept = dict(journal.execute('SELECT "index", log FROM runs WHERE log IS NOT NULL').fetchall())
    assert {*kept} == {row["index"] for row in worst}
    for row in worst:
        log = symaware_cli.open_log(out / "logs" / kept[row["index"]])
        assert json.loads(log.attachments["manifest.json"])["seed"] == row["seed"]
    assert len(list((out / "logs").iterdir())) == 2


def test_the_python_interface_returns_the_same_table(tmp_path: Path) -> None:
    scenario = tiny(tmp_path)
    table = symaware_cli.sweep(scenario, over={"agents.robot.count": [1, 2]}, runs=2, seed=5)
    symaware("sweep", scenario, "-o", tmp_path / "out", "--over", "agents.robot.count=1,2", "--runs", 2, "--seed", 5)
    assert table.to_pylist() == rows(tmp_path / "out")
    with pytest.raises(ScenarioError, match="unknown key"):
        symaware_cli.sweep(scenario, over={"agents.robot.cont": "1..3"})


def test_a_run_of_a_sweep_can_be_repeated_to_write_its_log(tmp_path: Path) -> None:
    scenario, out, log = tiny(tmp_path), tmp_path / "out", tmp_path / "again.mcap"
    symaware("sweep", scenario, "-o", out, "--over", "agents.robot.count=2,3", "--runs", 2, "--jobs", 0)
    row = rows(out)[3]
    said = json.loads(
        symaware("run", out, "--index", 3, "-o", log, "--json", status=3 * (row["verdict.near"] == "violated"))
    )
    assert (said["seed"], said["agents"]) == (row["seed"], 3)
    assert said["minimum_separation"]["value"] == row["closest"]
    assert said["specifications"][0]["robustness"] == row["robustness.near"]
    assert log.exists()
    assert "numbered from 0 to 3" in symaware("run", out, "--index", 4, status=2)
    assert "--index" in symaware("run", out, status=2)


def test_rows_filters_and_sorts_even_the_table_of_a_killed_sweep(tmp_path: Path) -> None:
    scenario, out = tiny(tmp_path), tmp_path / "out"
    symaware("sweep", scenario, "-o", out, "--over", "agents.robot.count=2,3", "--runs", 10, "--jobs", 0)
    found = json.loads(
        symaware("rows", out, "--where", 'count == 3 and verdict.near == "violated"', "--sort", "-closest", "--json")
    )
    expected = [row for row in rows(out) if row["agents.robot.count"] == 3 and row["verdict.near"] == "violated"]
    assert found == sorted(expected, key=lambda row: -row["closest"])
    shown = symaware("rows", out, "--where", "closest < 0", "--columns", "index,closest", "--csv").splitlines()
    assert shown[0] == '"index","closest"'
    assert len(shown) - 1 == sum(row["closest"] < 0 for row in rows(out))
    whole = symaware("rows", out, "--json")
    (out / "runs.parquet").unlink()  # as after a kill
    assert symaware("rows", out, "--json") == whole
    assert "did you mean `closest`?" in symaware("rows", out, "--sort", "closet", status=2)
    assert "a number is not a condition" in symaware("rows", out, "--where", "closest", status=2)
    assert "is a folder" in symaware("log", "events", out, status=2)


def test_a_sweep_of_a_log_uses_the_scenario_that_it_contains(tmp_path: Path) -> None:
    scenario, log = tiny(tmp_path), tmp_path / "one.mcap"
    symaware("run", scenario, "--set", "agents.robot.count=3", "-o", log, "-q", status=3)
    options = ["--over", "run.duration=0.5,1.0", "--runs", 2, "--seed", 4, "-j", 0]
    symaware("sweep", log, "-o", tmp_path / "log", *options)
    changed = ["--set", "agents.robot.count=3"]
    symaware("sweep", scenario, "-o", tmp_path / "file", *options, *changed)
    assert table_digest(tmp_path / "log") == table_digest(tmp_path / "file")
    # The folder no longer needs the log, and the file of a sweep may name a log.
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text("symaware-sweep: 1\nscenario: one.mcap\nruns: 2\nseed: 4\nover: {run.duration: [0.5, 1.0]}\n")
    symaware("sweep", sweep, "-o", tmp_path / "log", "-j", 0)
    log.unlink()
    symaware("resume", tmp_path / "log", "--add-runs", 1, "-j", 0)
    assert len(rows(tmp_path / "log")) == 6


def test_missing_and_invalid_scenarios_of_logs_are_reported(tmp_path: Path) -> None:
    scenario, log = tiny(tmp_path), tmp_path / "one.mcap"
    (tmp_path / "no.mcap").write_bytes(b"no log")
    assert "no.mcap" in symaware("sweep", tmp_path / "no.mcap", "-o", tmp_path / "out", status=2)
    symaware("run", scenario, "-o", log, "-q", "--seed", 5, status=3)
    said = symaware("sweep", log, "-o", tmp_path / "out", "--over", "agents.robt.count=1,2", status=2)
    assert "did you mean `robot`" in said
    assert not (tmp_path / "out").exists()


def test_runs_cannot_be_added_while_another_process_works_on_the_sweep(tmp_path: Path) -> None:
    symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "-j", 0)
    folder = SweepFolder.opened(tmp_path / "out")
    before = (tmp_path / "out" / "sweep.yaml").read_bytes()
    with folder.locked(), pytest.raises(SweepError, match="another process is at work"):
        folder.add_runs(2)
    assert (tmp_path / "out" / "sweep.yaml").read_bytes() == before


def test_runs_added_by_two_processes_at_once_are_all_kept(tmp_path: Path) -> None:
    symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "-j", 0)
    # Both have read the sweep before either adds to it.
    folders = [SweepFolder.opened(tmp_path / "out") for _ in range(2)]

    def add(folder: SweepFolder) -> None:
        while True:
            try:
                folder.add_runs(2)
                return
            except SweepError:
                continue

    with ThreadPoolExecutor(2) as threads:
        list(threads.map(add, folders))
    assert read_sweep(tmp_path / "out" / "sweep.yaml").plan.document.runs == 5


def test_a_sweep_also_executes_runs_added_by_another_process(tmp_path: Path) -> None:
    symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "-j", 0)
    before = SweepFolder.opened(tmp_path / "out")
    SweepFolder.opened(tmp_path / "out").add_runs(2)
    assert conduct(before, 0).counts.done == 3
    assert len(rows(tmp_path / "out")) == 3


def test_finished_runs_are_freed_before_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the solvers of hundreds of runs would stay in memory, because full garbage collections are rare."""
    monkeypatch.setattr("symaware_cli.studies.runner._UNCOLLECTED", 0.0)
    symaware("sweep", tiny(tmp_path), "-o", tmp_path / "out", "--runs", 6, "-j", 0, "-q")
    started: list[weakref.ref[Simulation]] = []
    for batch in (1, 2):
        runner = SweepFolder.opened(tmp_path / "out").runner(
            batch, lambda _, simulation: started.append(weakref.ref(simulation))
        )
        gc.disable()
        try:
            alive = [sum(each() is not None for each in started) for _ in runner.rows(range(6))]
        finally:
            gc.enable()
        assert max(alive) <= 2
