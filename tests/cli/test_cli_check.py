"""``symaware check`` as a user sees it: verdicts, reasons, tables of folders, and mistakes."""

import json
import shutil
from pathlib import Path

import pytest
from checkout import CHECKOUT
from mcap.opcode import Opcode
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

SCENARIOS = CHECKOUT / "scenarios"


def check(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(application, ["check", *map(str, arguments)], catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    for name in ("patrol", "shortcut"):
        execute(build(SCENARIOS / f"{name}.yaml", ["run.duration=10"]), folder / f"{name}.mcap")
    return folder


def test_a_violation_is_reported_with_its_reason_and_exit_status_3(logs: Path) -> None:
    status, out, _ = check(logs / "shortcut.mcap")
    assert status == 3
    lines = out.splitlines()
    assert lines[0] == f"{logs / 'shortcut.mcap'}: shortcut, seed 3"
    assert any(
        line.startswith("  violated   safe by 1 of 3, robustness -1.846: `inside(position, wall)`") for line in lines
    )


def test_undecided_specifications_are_reported_as_undecided(logs: Path) -> None:
    status, out, _ = check(logs / "patrol.mcap")
    assert status == 0
    assert "  undecided  fetch by 3 of 3" in out


def test_a_new_formula_is_for_each_agent_unless_said_otherwise(logs: Path) -> None:
    status, out, _ = check(logs / "patrol.mcap", "--formula", "always speed < 2.6", "--json")
    assert status == 0
    found = json.loads(out)
    assert found["specifications"][0]["counts"] == {"violated": 0, "undecided": 0, "satisfied": 3}
    _, out, _ = check(logs / "patrol.mcap", "--formula", "always distance > 1.7", "--pairs", "robot", "--json")
    assert json.loads(out)["specifications"][0]["counts"] == {"violated": 1, "undecided": 0, "satisfied": 2}


@pytest.mark.parametrize(
    ("formula", "option", "first", "last", "marked"),
    [
        ("always spee < 1", ("--each", "robot"), 8, 12, "--formula"),
        ("always spee < 1", (), 8, 12, "--formula"),
        ('always position["first"][0] + y < 1', ("--pairs", "robot"), 1, 36, "--formula"),
        ("always speed < 1", ("--each", "robto"), 1, 6, "--each"),
        ("always distance < 1", ("--pairs", "robto"), 1, 6, "--pairs"),
    ],
)
def test_a_mistake_is_located_in_the_option_in_which_it_was_typed(
    logs: Path, formula: str, option: tuple[str, ...], first: int, last: int, marked: str
) -> None:
    status, out, _ = check(logs / "patrol.mcap", "--formula", formula, *option, "--json")
    assert status == 2
    (problem,) = json.loads(out)["problems"]
    assert problem["span"] == {"file": marked, "line": 1, "column": first, "end_column": last}
    assert problem["source_line"] == (formula if marked == "--formula" else "robto")
    _, _, said = check(logs / "patrol.mcap", "--formula", formula, *option)
    assert said.startswith(f"{marked}:1:{first}: ")
    assert "--set" not in said


def test_missing_parts_of_a_damaged_log_are_reported_with_exit_status_3(logs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "damaged"
    folder.mkdir()
    log = folder / "patrol.mcap"
    execute(build(SCENARIOS / "patrol.yaml", ["run.duration=10", "specifications.fetch=null"]), log)
    before = check(log)[0]
    damaged(log)
    status, out, _ = check(log)
    assert (before, status) == (0, 3)
    assert "  note       the log is damaged, so verdicts are about a part of the run only: " in out
    assert "1 damaged chunk left out" in json.loads(check(log, "--json")[1])["damage"]
    shutil.copy(logs / "patrol.mcap", folder / "sound.mcap")
    status, _, said = check(folder)
    assert status == 3
    assert said.startswith(f"symaware: {log}: 1 damaged chunk left out")


def damaged(log: Path) -> None:
    """Change one byte in the first chunk of a log."""
    content = bytearray(log.read_bytes())
    start = 8
    while content[start] != Opcode.CHUNK:
        start += 9 + int.from_bytes(content[start + 1 : start + 9], "little")
    content[start + 8 + int.from_bytes(content[start + 1 : start + 9], "little") - 50] ^= 1
    log.write_bytes(content)


def test_a_folder_of_logs_is_a_table(logs: Path) -> None:
    status, out, _ = check(logs)
    assert status == 3
    assert out.splitlines()[0].split() == ["log", "safe", "fetch", "apart", "told"]
    assert out.splitlines()[-1] == "violated: safe in 1 of 2, apart in 1 of 2, told in 1 of 2"
    _, out, _ = check(logs, "--json")
    assert [each["scenario"] for each in json.loads(out)["logs"]] == ["patrol", "shortcut"]


def test_repeating_the_run_gives_the_same(logs: Path) -> None:
    assert check(logs / "patrol.mcap", "--again") == check(logs / "patrol.mcap")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--formula", "always sped < 2"], "did you mean `speed`?"),
        (["--formula", "always speed < 2", "--each", "robots"], "did you mean `robot`?"),
        (["--each", "robot"], "--each says what a formula is about: it goes with --formula"),
        (["--formula", "x > 1", "--file", "more.yaml"], "give one of them"),
        (["--formula", "x > 1", "--of", "beliefs"], "--of takes truth or belief, not beliefs"),
        (["--file", "missing.yaml"], "missing.yaml"),
    ],
)
def test_mistakes_are_located_and_cost_nothing(logs: Path, arguments: list[str], said: str) -> None:
    status, out, err = check(logs / "patrol.mcap", *arguments)
    assert (status, out) == (2, "")
    assert said in err


def test_a_folder_without_logs_is_a_mistake(tmp_path: Path) -> None:
    assert check(tmp_path)[0] == 2


def test_a_log_without_specifications_is_refused_with_a_remedy(tmp_path: Path) -> None:
    execute(build(SCENARIOS / "hello.yaml", ["run.duration=1"]), tmp_path / "hello.mcap")
    status, out, _ = check(tmp_path / "hello.mcap")
    assert status == 0
    assert "there are no specifications; give one with --formula or --file" in out


def test_a_damaged_log_is_checked_as_far_as_it_goes(logs: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.mcap"
    shutil.copy(logs / "patrol.mcap", broken)
    with broken.open("r+b") as file:
        file.truncate(broken.stat().st_size * 2 // 3)
    status, out, _ = check(broken)
    assert status == 3
    assert "the run did not come to its end" in out


@pytest.mark.parametrize("name", ["patrol", "shortcut"])
def test_inspect_lists_each_specification_as_the_summary_of_the_run_does(name: str, tmp_path: Path) -> None:
    log = tmp_path / f"{name}.mcap"
    summary = execute(build(SCENARIOS / f"{name}.yaml", ["run.duration=10"]), log)
    done = CliRunner().invoke(application, ["inspect", str(log)], catch_exceptions=False)
    for outcome in summary.specifications:
        assert f"  {outcome.verdict:<9} {outcome}" in done.stdout.splitlines()
    told = CliRunner().invoke(application, ["inspect", str(log), "--json"], catch_exceptions=False)
    assert json.loads(told.stdout)["specifications"] == [
        json.loads(json.dumps(each.to_json())) for each in summary.specifications
    ]
