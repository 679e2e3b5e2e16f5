"""Changes in the folder of a sweep are detected and located by the expected level."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import yaml

from symaware_cli import verify_sweep
from symaware_cli.evidence.sweep_verification import Level, SweepVerification
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.digest import digest
from symaware_cli.log.reader import open_log
from symaware_cli.studies.folder import SweepFolder
from symaware_cli.studies.request import SweepRequest
from symaware_cli.studies.session import conduct, write_table
from symaware_cli.studies.sweep_error import SweepError
from symaware_cli.studies.sweep_files import JOURNAL, TABLE
from symaware_cli.studies.sweep_journal import SweepJournal
from symaware_cli.studies.sweep_source import read_sweep

SCENARIO: dict[str, Any] = {
    "symaware": 1,
    "name": "tiny",
    "seed": 1,
    "run": {"duration": 0.5},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "agents": {
        "robot": {
            "count": 2,
            "entity": {"shape": {"circle": {"radius": 0.2}}},
            "model": {"use": "single-integrator", "with": {"process_noise": 0.3}},
            "state": [[0, 0], [1, 0]],
            "knowledge": {"goal": [[1, 0], [0, 0]]},
            "components": {"see": {"use": "perception.self"}, "steer": {"use": "control.go-to-goal"}},
        }
    },
    "specifications": {"apart": {"pairs": "robot", "formula": "always distance > 0.5"}},
}


@pytest.fixture
def folder(tmp_path: Path) -> SweepFolder:
    """A finished sweep of 8 runs, all logs kept."""
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(SCENARIO))
    request = SweepRequest(entries={"runs": 8, "keep": "all"})
    made = SweepFolder.created(tmp_path / "out", read_sweep(tmp_path / "tiny.yaml", request))
    conduct(made, 0)
    return made


def changed(folder: SweepFolder, statement: str, *values: Any) -> None:
    """Change the journal, and rewrite the table from it, as a careful forger would."""
    with closing(sqlite3.connect(folder.path / JOURNAL)) as database, database:
        assert database.execute(statement, values).rowcount > 0
    with SweepJournal(folder.path / JOURNAL) as journal:
        write_table(folder, journal)


def verified(folder: SweepFolder, level: Level) -> SweepVerification:
    return verify_sweep(folder.path, level, rows=3, seed=1)


def test_a_sweep_is_sound_at_all_levels(folder: SweepFolder) -> None:
    result = verified(folder, "all")
    assert result.is_sound, result.findings
    assert (result.rows, result.logs, result.repeated) == (8, 8, 8)
    assert verified(folder, "sample").repeated == 3


def metrics(folder: SweepFolder, index: int) -> dict[str, Any]:
    with closing(sqlite3.connect(folder.path / JOURNAL)) as database, database:
        found = database.execute('SELECT metrics FROM runs WHERE "index" = ?', (index,)).fetchone()[0]
    said: dict[str, Any] = json.loads(found)
    return said


def a_seed(folder: SweepFolder) -> None:
    changed(folder, 'UPDATE runs SET seed = seed + 1 WHERE "index" = 5')


def a_verdict_alone(folder: SweepFolder) -> None:
    with closing(sqlite3.connect(folder.path / JOURNAL)) as database, database:
        found = json.loads(database.execute('SELECT verdicts FROM runs WHERE "index" = 5').fetchone()[0])
    other = "violated" if found["apart"] == "satisfied" else "satisfied"
    changed(folder, 'UPDATE runs SET verdicts = ? WHERE "index" = 5', json.dumps({"apart": other}))


def a_row_left_out(folder: SweepFolder) -> None:
    changed(folder, 'DELETE FROM runs WHERE "index" = 5')


def a_robustness(folder: SweepFolder) -> None:
    said = {"apart": 0.2501}
    by_agent = [{"agent": "robot.0 robot.1", "verdict": "satisfied", "robustness": 0.2501}]
    changed(
        folder,
        'UPDATE runs SET robustness = ?, verdicts = ?, metrics = ? WHERE "index" = 5',
        json.dumps(said),
        json.dumps({"apart": "satisfied"}),
        json.dumps({**metrics(folder, 5), "by_agent.apart": by_agent}),
    )


def a_metric(folder: SweepFolder) -> None:
    content = metrics(folder, 5)
    changed(
        folder,
        'UPDATE runs SET metrics = ? WHERE "index" = 5',
        json.dumps({**content, "path_length": content["path_length"] + 1e-9}),
    )


@pytest.mark.parametrize(
    ("change", "level"),
    [
        (a_seed, "arithmetic"),
        (a_verdict_alone, "arithmetic"),
        (a_row_left_out, "arithmetic"),
        (a_robustness, "monitor"),
        (a_metric, "all"),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_each_change_is_detected_from_the_expected_level_on(
    change: Callable[[SweepFolder], None], level: Level, folder: SweepFolder
) -> None:
    change(folder)
    result = verified(folder, level)
    assert not result.is_sound
    assert result.findings[0].index in (5, 6)
    if level == "all":
        # A consistently forged table looks like any other; only repetition detects it.
        assert verified(folder, "monitor").is_sound


def test_a_difference_between_table_and_journal_is_detected(folder: SweepFolder) -> None:
    import pyarrow
    from pyarrow import parquet

    path = folder.path / "runs.parquet"
    table = parquet.read_table(path)
    values = table.column("contacts").to_pylist()
    values[2] += 1
    place = table.column_names.index("contacts")
    forged = table.set_column(place, table.schema.field(place), pyarrow.array(values, table.schema.field(place).type))
    parquet.write_table(forged, path)
    found = verified(folder, "arithmetic").findings
    assert [(each.index, each.column) for each in found] == [(2, "contacts")]


def test_a_replaced_log_is_detected(folder: SweepFolder) -> None:
    logs = sorted(folder.logs.glob("*.mcap"))
    logs[0].write_bytes(logs[1].read_bytes())
    assert {each.column for each in verified(folder, "monitor").findings} >= {"log"}


def test_every_level_detects_a_log_of_another_scenario_with_the_same_outcome(folder: SweepFolder) -> None:
    with SweepJournal(folder.path / JOURNAL) as journal:
        row = next(row for row in journal.rows() if row.index == 5)
    assert row.log is not None
    # It moves in the same way and has the same outcomes, but different knowledge.
    changes = ["agents.robot.knowledge.told=1"]
    execute(build(folder.source.scenario, changes, folder.plan.seed(5)), folder.logs / "forged.mcap")
    name = f"{digest(open_log(folder.logs / 'forged.mcap')).combined[:32]}.mcap"
    assert name != row.log
    (folder.logs / "forged.mcap").rename(folder.logs / name)
    changed(folder, 'UPDATE runs SET log = ? WHERE "index" = 5', name)
    (scenario,) = verified(folder, "arithmetic").findings
    assert (scenario.index, scenario.column, scenario.found) == (5, "log", "another scenario")
    found = verified(folder, "all").findings
    assert {each.index for each in found} == {5}
    assert found[1].column.startswith("log, /agents/robot/knowledge at 0 s")
    assert [each.column for each in found[2:]] == ["log, resolved.yaml"]


def test_missing_and_lost_runs_are_counted(folder: SweepFolder) -> None:
    changed(folder, 'DELETE FROM runs WHERE "index" = 7')
    changed(folder, "UPDATE runs SET state = 'lost' WHERE \"index\" = 2")
    result = verified(folder, "all")
    assert (result.rows, result.missing, result.lost, result.repeated) == (7, 1, 1, 6)


def test_a_robustness_of_an_agent_that_contradicts_its_log_is_detected(folder: SweepFolder) -> None:
    content = metrics(folder, 5)
    (pair,) = content["by_agent.apart"]
    forged = {**content, "by_agent.apart": [{**pair, "robustness": pair["robustness"] + 1e-9}]}
    changed(folder, 'UPDATE runs SET metrics = ? WHERE "index" = 5', json.dumps(forged))
    assert verified(folder, "arithmetic").is_sound
    (found,) = verified(folder, "monitor").findings
    assert (found.index, found.column) == (5, f"by_agent.apart {pair['agent']}")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("recording.interval=0.2", "the log does not contain every step"),
        ("recording.omit=[world]", "the log does not contain world"),
    ],
)
def test_specifications_that_logs_cannot_evaluate_are_counted(tmp_path: Path, change: str, reason: str) -> None:
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(SCENARIO))
    request = SweepRequest(set=[change], entries={"runs": 2, "keep": "all"})
    made = SweepFolder.created(tmp_path / "out", read_sweep(tmp_path / "tiny.yaml", request))
    conduct(made, 0)
    result = verified(made, "monitor")
    assert result.is_sound, result.findings
    assert result.not_evaluated == {f"apart: {reason}": 2}
    assert json.loads(json.dumps(result.to_json()))["not_evaluated"] == result.not_evaluated


def test_the_difference_caused_by_a_nondeterministic_component_is_located(doubles: Path, tmp_path: Path) -> None:
    scenario = json.loads(json.dumps(SCENARIO))
    scenario["agents"]["robot"]["components"]["dice"] = {
        "use": "doubles.chance",
        "with": {"source": "random", "row": 1},
    }
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(scenario))
    request = SweepRequest(entries={"runs": 1, "keep": "all"})
    made = SweepFolder.created(tmp_path / "out", read_sweep(tmp_path / "tiny.yaml", request))
    conduct(made, 0)
    places = [each.column for each in verified(made, "all").findings if each.column.startswith("log, ")]
    assert places == ["log, /agents/robot/risk at 0.3 s robot.1 risk[0]"]


def test_a_missing_table_is_a_finding(folder: SweepFolder) -> None:
    (folder.path / TABLE).unlink()
    (finding,) = verify_sweep(folder.path, "arithmetic").findings
    assert (finding.column, finding.found, finding.expected) == (TABLE, "missing", "the table of 8 rows")


def test_a_folder_without_journal_is_rejected_and_left_unchanged(folder: SweepFolder) -> None:
    (folder.path / JOURNAL).unlink()
    with pytest.raises(SweepError, match="without it there are no rows to verify"):
        verify_sweep(folder.path)
    assert not (folder.path / JOURNAL).exists()
