"""``symaware diff`` as a user sees it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from symaware_cli.cli.application import application
from symaware_cli.scenario.build import build
from symaware_cli.scenario.execution import execute

HELLO = Path(__file__).parents[2] / "scenarios" / "hello.yaml"


def diff(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(application, ["diff", *map(str, arguments)], catch_exceptions=False)
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    execute(build(HELLO, ["run.duration=2"]), folder / "one.mcap")
    execute(build(HELLO, ["run.duration=2"]), folder / "same.mcap")
    slower = ["run.duration=2", "agents.robot.components.steer.with.speed=1.1"]
    execute(build(HELLO, slower), folder / "slower.mcap")
    return folder


def test_equal_logs_have_exit_status_0(logs: Path) -> None:
    status, out, _ = diff(logs / "one.mcap", logs / "same.mcap")
    assert (status, out) == (0, f"{logs / 'one.mcap'} and {logs / 'same.mcap'}: equal\n")


def test_what_was_changed_and_since_when_is_told(logs: Path) -> None:
    status, out, _ = diff(logs / "one.mcap", logs / "slower.mcap")
    assert status == 1
    assert "  scenario     agents.robot.components.steer.with.speed: 1.2 and 1.1 (" in out
    assert "\n  from here on at 0 s on /agents/robot/" in out
    assert "\n  /world/robot/state " in out
    said = json.loads(diff(logs / "one.mcap", logs / "slower.mcap", "--json")[1])
    assert [each["path"] for each in said["scenario"]] == ["agents.robot.components.steer.with.speed"]
    world = next(each for each in said["channels"] if each["topic"] == "/world/robot/state")
    assert world["first"]["time"] == 50_000_000
    assert world["agents"] == ["robot.0", "robot.1", "robot.2", "robot.3"]


def test_scenarios_are_compared_with_their_places(logs: Path, tmp_path: Path) -> None:
    text = HELLO.read_text()
    (tmp_path / "other.yaml").write_text(text.replace("seed: 7", "seed: 8"))
    status, out, _ = diff(HELLO, tmp_path / "other.yaml")
    assert status == 1
    line = next(number for number, each in enumerate(text.splitlines(), 1) if each.startswith("seed"))
    assert f"  scenario     seed: 7 and 8 ({HELLO}:{line}, {tmp_path / 'other.yaml'}:{line})\n" in out
    assert diff(HELLO, HELLO)[0] == 0


def test_folders_and_what_is_no_log_are_wrong_input(logs: Path, tmp_path: Path) -> None:
    assert diff(tmp_path, logs / "one.mcap")[0] == 2
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    assert diff(tmp_path / "no.mcap", logs / "one.mcap")[0] == 2
