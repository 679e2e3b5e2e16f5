"""`symaware run`."""

import json
import math
import os
import pty
import select
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from simulating import COMMAND, Command, present

from symaware_cli import open_log
from symaware_cli.cli import terminal
from symaware_cli.log.digest import digest
from symaware_cli.studies import seed_of

SCENARIO = """
symaware: 1
name: swap
seed: 5
run: {duration: 2.0}
environment: {use: kinematic}
agents:
  robot:
    count: 4
    entity: {shape: {circle: {radius: 0.5}}}
    model: {use: unicycle, with: {max_speed: 3.0}}
    state: {circle: {radius: 1.5}}
    knowledge: {goal: {circle: {radius: 1.5, phase: 3.14159}}, luck: {uniform: [0, 1]}}
    components: {sense: {use: perception.omniscient}, steer: {use: control.go-to-goal, with: {speed: 3.0}}}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "swap.yaml"
    path.write_text(SCENARIO)
    return path


def test_a_run_ends_with_a_summary_and_a_log(command: Command, scenario: Path, tmp_path: Path) -> None:
    done = command("run", "swap.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    for said in (
        *("swap: finished after 2 s of simulated time", "4 agents, 40 steps, seed 5", "wall time", "real time"),
        *("contacts", "m between the outlines of robot.", "recorded", "swap.mcap"),
    ):
        assert said in done.stdout
    assert sorted(os.listdir(tmp_path)) == ["swap.mcap", "swap.yaml"]
    assert present(open_log(tmp_path / "swap.mcap").outcome)["status"] == "finished"


def test_the_summary_for_scripts_says_the_same(command: Command, scenario: Path) -> None:
    done = command("run", "swap.yaml", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    summary = json.loads(done.stdout)
    expected = {"name": "swap", "seed": 5, "status": "finished", "agents": 4, "steps": 40, "simulated_time": 2.0}
    assert expected.items() <= summary.items()
    assert summary["log"] == "swap.mcap"
    assert summary["log_size"] > 0
    assert summary["contacts"] > 0
    assert -1.0 <= summary["minimum_separation"]["value"] < 0.0
    assert summary["failure"] is None


def test_a_quiet_run_says_nothing(command: Command, scenario: Path) -> None:
    done = command("run", "swap.yaml", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_folder_that_is_not_that_of_a_sweep_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    done = command("run", "plain")
    told = "symaware: plain is a folder, and not that of a sweep: give a scenario or a log\n"
    assert (done.returncode, done.stderr) == (2, told)


def test_a_failure_without_an_exception_promises_no_traceback(command: Command, scenario: Path) -> None:
    done = command("run", "swap.yaml", "-q", "--set", "agents.robot.model.with.process_noise=1e15")
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "beyond 1e+15" in done.stderr


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_run_needs_no_standard_streams(closed: str, scenario: Path, tmp_path: Path) -> None:
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh"]
    line = [*shell, *COMMAND, "run", "swap.yaml", "-o", "swap.mcap"]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(open_log(tmp_path / "swap.mcap").series("robot.0", "world").times) == 41


def test_a_run_without_a_record_leaves_nothing_behind(command: Command, scenario: Path, tmp_path: Path) -> None:
    done = command("run", "swap.yaml", "--no-record")
    assert done.returncode == 0
    assert "log" not in done.stdout.split()
    assert os.listdir(tmp_path) == ["swap.yaml"]


def test_logs_without_a_given_name_overwrite_none(command: Command, scenario: Path, tmp_path: Path) -> None:
    contents = []
    for name in ("swap.mcap", "swap-2.mcap", "swap-3.mcap"):
        assert json.loads(command("run", "swap.yaml", "--json").stdout)["log"] == name
        contents = [path.read_bytes() for path in sorted(tmp_path.glob("*.mcap"))]
    assert len(contents) == 3
    assert len({digest(open_log(path)).combined for path in tmp_path.glob("*.mcap")}) == 1


def test_a_log_of_a_given_name_is_replaced(command: Command, scenario: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.mcap").write_bytes(b"old" * 1_000_000)
    assert command("run", "swap.yaml", "-o", "mine.mcap", "--quiet").returncode == 0
    assert open_log(tmp_path / "mine.mcap").verify() is None


def test_a_log_is_enough_to_repeat_the_run(command: Command, scenario: Path, tmp_path: Path) -> None:
    first = command("run", "swap.yaml", "-o", "first.mcap", "--seed", "9", "--set", "agents.robot.count=3", "-q")
    assert first.returncode == 0
    scenario.unlink()
    assert command("run", "first.mcap", "-o", "second.mcap", "-q").returncode == 0
    one, other = (digest(open_log(tmp_path / name)) for name in ("first.mcap", "second.mcap"))
    assert one.channels == other.channels
    assert one.attachments["resolved.yaml"] == other.attachments["resolved.yaml"]
    assert one.attachments["manifest.json"] == other.attachments["manifest.json"]
    assert open_log(tmp_path / "second.mcap").manifest["seed"] == 9


def test_a_log_can_be_run_with_changes(command: Command, scenario: Path, tmp_path: Path) -> None:
    assert command("run", "swap.yaml", "-q").returncode == 0
    done = command("run", "swap.mcap", "--json", "--seed", "1", "--set", "run.duration=0.5")
    summary = json.loads(done.stdout)
    assert (summary["seed"], summary["steps"], summary["log"]) == (1, 10, "swap-2.mcap")


@pytest.mark.parametrize(
    ("output", "said"),
    [
        ("missing/run.mcap", "its folder does not exist"),
        (".", "it is a directory"),
        ("swap.yaml/x.mcap", "not a folder"),
    ],
)
def test_an_impossible_output_is_reported_in_a_sentence(
    output: str, said: str, command: Command, scenario: Path
) -> None:
    done = command("run", "swap.yaml", "--output", output)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("symaware: cannot create the log ")
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("output", ["swap.yaml", "./swap.yaml"])
def test_no_run_overwrites_its_own_scenario(output: str, command: Command, scenario: Path) -> None:
    done = command("run", "swap.yaml", "--output", output)
    assert done.returncode == 2
    assert done.stderr == "symaware: swap.yaml is a file of the scenario; the log needs another file\n"
    assert scenario.read_text() == SCENARIO


def test_no_run_overwrites_any_file_that_it_read_under_any_name(
    command: Command, scenario: Path, tmp_path: Path
) -> None:
    folder = scenario.parent
    shape = "{circle: null, mesh: {file: m.obj, radius: 1}}"
    (folder / "top.yaml").write_text(
        f"extends: swap.yaml\nname: top\nagents: {{robot: {{entity: {{shape: {shape}}}}}}}\n"
    )
    (folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    (folder / "hard.mcap").hardlink_to(folder / "swap.yaml")
    (folder / "soft.mcap").symlink_to(folder / "m.obj")
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    for output in ("top.yaml", "swap.yaml", "m.obj", "hard.mcap", "soft.mcap"):
        done = command("run", "top.yaml", "--output", output)
        assert (done.returncode, done.stdout) == (2, ""), output
        assert "is a file of the scenario" in done.stderr
    assert before == {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("verb", ["run", "validate"])
@pytest.mark.parametrize("name", ["missing.yaml", ".", "missing.mcap", "/dev/zero"])
def test_a_scenario_that_cannot_be_read_is_wrong_input(name: str, verb: str, command: Command, tmp_path: Path) -> None:
    if verb == "run":
        done = command(verb, name)
        assert (done.returncode, done.stdout) == (2, "")
        assert name in done.stderr
    else:
        done = command(verb, name, "--json")
        assert (done.returncode, done.stderr) == (2, "")
        assert isinstance(json.loads(done.stdout), dict)
    assert os.listdir(tmp_path) == []


def test_a_scenario_that_is_wrong_makes_no_log(command: Command, scenario: Path, tmp_path: Path) -> None:
    scenario.write_text(SCENARIO.replace("unicycle", "unicicle").replace("duration", "durration"))
    done = command("run", "swap.yaml")
    assert done.returncode == 2
    assert "unicycle" in done.stderr
    assert "swap.yaml:5" in done.stderr
    as_json = json.loads(command("run", "swap.yaml", "--json").stdout)
    assert as_json["valid"] is False
    assert len(as_json["problems"]) >= 2
    assert os.listdir(tmp_path) == ["swap.yaml"]


def test_a_log_that_holds_no_scenario_is_wrong_input(command: Command, tmp_path: Path) -> None:
    (tmp_path / "junk.mcap").write_bytes(b"junk" * 100)
    done = command("run", "junk.mcap")
    assert done.returncode == 2
    assert "junk.mcap is not a log" in done.stderr


def test_numbers_that_json_does_not_have_are_put_into_words(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.print_json({"highest": math.inf, "others": [-math.inf, math.nan, 1.5]})
    said = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert said == {"highest": "inf", "others": ["-inf", "nan", 1.5]}


def on_a_terminal(arguments: Sequence[str], cwd: Path, *, until: float = 60.0) -> str:
    """Run the command with a terminal for its standard error and output; what it wrote there."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *arguments], stdin=theirs, stdout=theirs, stderr=theirs, cwd=cwd, env={**os.environ, "TERM": "xterm"}
    )
    os.close(theirs)
    written, end = b"", time.monotonic() + until
    try:
        while time.monotonic() < end:
            ready, _, _ = select.select([ours], [], [], 0.1)
            if ready:
                try:
                    data = os.read(ours, 65536)
                except OSError:  # how Linux says that the other side was closed
                    break
                if not data:
                    break
                written += data
        assert process.wait(timeout=until) == 0
    finally:
        process.kill()
        os.close(ours)
    return written.decode()


def test_progress_is_shown_on_a_terminal_and_nowhere_else(command: Command, scenario: Path, tmp_path: Path) -> None:
    long = ["--set", "run.duration=200", "--set", "agents.robot.count=40", "--no-record"]
    shown = on_a_terminal(["run", "swap.yaml", *long], tmp_path)
    assert "of 200 s" in shown
    assert "swap: finished after 200 s" in shown
    short = ["--set", "run.duration=20", "--no-record"]
    for option in ("--quiet", "--json"):
        assert "of 20 s" not in on_a_terminal(["run", "swap.yaml", *short, option], tmp_path)
    done = command("run", "swap.yaml", *short)
    assert "of 20 s" not in done.stdout + done.stderr
    assert "\x1b" not in done.stdout + done.stderr


def test_a_run_prints_the_warnings_of_validate_once(command: Command, tmp_path: Path) -> None:
    (tmp_path / "open.yaml").write_text(
        """symaware: 1
name: open
run: {duration: 1}
environment: {use: kinematic, entities: {pillar: {shape: {circle: {radius: 0.3}}, position: [2, 0]}}}
agents:
  robot: {model: {use: unicycle}}
specifications:
  never: {each: robot, formula: "always next x > 2"}
"""
    )
    validated = command("validate", "open.yaml")
    warnings = json.loads(command("validate", "open.yaml", "--json").stdout)["warnings"]
    assert {each["code"] for each in warnings} >= {"no-body", "unsatisfiable"}
    loud = command("run", "open.yaml", "-o", "loud.mcap")
    assert loud.stderr == validated.stderr
    assert "warning" not in loud.stdout.partition("specifications")[0]
    quiet = command("run", "open.yaml", "-o", "quiet.mcap", "--quiet")
    assert (quiet.stdout, quiet.stderr) == ("", "")
    as_json = command("run", "open.yaml", "-o", "json.mcap", "--json")
    assert as_json.stderr == ""
    assert json.loads(as_json.stdout)["scenario_warnings"] == warnings
    assert loud.returncode == quiet.returncode == as_json.returncode
    digests = [digest(open_log(tmp_path / f"{name}.mcap")) for name in ("loud", "quiet", "json")]
    assert not any(digests[0].differences(each) for each in digests[1:])
    repeated = command("run", "loud.mcap", "-o", "again.mcap")
    assert repeated.stderr.count("has no body") == 1


def test_a_run_with_an_index_has_the_seed_of_that_run_of_a_sweep(
    command: Command, scenario: Path, tmp_path: Path
) -> None:
    done = command("run", "swap.yaml", "--seed", "9", "--index", "2", "--set", "run.duration=0.1", "-o", "third.mcap")
    assert done.returncode == 0
    assert open_log(tmp_path / "third.mcap").manifest["seed"] == seed_of(9, 2)
