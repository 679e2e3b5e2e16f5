"""`symaware inspect`."""

import json

import pytest

from symaware_cli import open_log
from symaware_cli.recording.digest import digest


@pytest.fixture
def log(command, scenarios, tmp_path):
    assert command("run", scenarios / "hello.yaml", "--set", "run.duration=1", "-q").returncode == 0
    return tmp_path / "hello.mcap"


def test_it_tells_who_how_long_how_often_and_with_what(log, command):
    done = command("inspect", log)
    assert (done.returncode, done.stderr) == (0, "")
    for said in (
        *("finished", "hello, seed 7, synchronous", "robot (4)", "0 to 1 s, 20 steps of 0.05 s", "scenario/hello.yaml"),
        *("symaware-cli", "numpy", "/world/robot/state", "/agents/robot/control", "x [m], y [m], heading [rad]"),
    ):
        assert said in done.stdout
    overview = json.loads(command("inspect", log, "--json").stdout)
    assert overview["lost"] is False
    assert overview["steps"] == 20
    assert overview["agents"] == {"robot": 4}


def test_events_are_listed_for_people_and_for_tools(log, command):
    done = command("inspect", log, "--events")
    assert done.returncode == 0
    assert done.stdout.splitlines()[0].split()[:4] == ["0.0000", "s", "INFO", "started"]
    events = json.loads(command("inspect", log, "--events", "--json").stdout)
    assert [events[0]["name"], events[-1]["name"]] == ["started", "finished"]


def test_digests_are_those_of_the_library(log, command):
    expected = digest(open_log(log))
    lines = command("inspect", log, "--digest").stdout.splitlines()
    assert lines[-1] == f"{expected.combined}  combined"
    assert json.loads(command("inspect", log, "--digest", "--json").stdout)["channels"] == expected.channels


def test_a_log_that_was_cut_off_is_told_with_exit_status_3_whatever_is_asked(log, command):
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    for options in ([], ["--json"], ["--events"], ["--digest"]):
        done = command("inspect", log, *options)
        assert done.returncode == 3
        assert "breaks off" in done.stdout + done.stderr


@pytest.mark.parametrize("name", ["empty.mcap", "junk.mcap", "begun.mcap", "missing.mcap", "."])
def test_what_is_no_log_is_wrong_input(name, command, tmp_path):
    for each, content in {"empty": b"", "junk": b"junk", "begun": b"\x89MCAP0\r\n"}.items():
        (tmp_path / f"{each}.mcap").write_bytes(content)
    done = command("inspect", name)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


def test_scripts_are_told_of_what_is_no_log_as_well(command):
    assert json.loads(command("inspect", "missing.mcap", "--json").stdout)["error"] == "there is no file missing.mcap"
