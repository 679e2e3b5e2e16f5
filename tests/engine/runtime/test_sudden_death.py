"""kill -9 loses at most the last second of wall time."""

import json
import random
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from simulating import COMMAND, Command, present
from symaware_doubles import Progress

from fuzzing.log_verbs import VERBS, called
from symaware_cli import Log, open_log
from symaware_cli.log.digest import digest

SCENARIO = """
symaware: 1
name: doomed
run: {{duration: 1000000.0}}
environment: {{use: kinematic}}
agents:
  robot:
    count: 20
    model: {{use: unicycle}}
    components:
      see: {{use: perception.omniscient}}
      {slow}
      progress: {{use: doubles.progress}}
"""


def doomed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slow: str, wall_time: float
) -> tuple[Any, list[tuple[float, int]]]:
    """Kill a run that has lasted for some wall time; its progress, and what the log said when it was dead."""
    progress = tmp_path / "progress"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PROGRESS", str(progress))
    (tmp_path / "doomed.yaml").write_text(SCENARIO.format(slow=slow))
    process = subprocess.Popen([*COMMAND, "run", "doomed.yaml", "--quiet"])
    try:
        end = time.monotonic() + 60
        while True:
            turns = Progress.read(progress)
            if turns and turns[-1][0] - turns[0][0] >= wall_time:
                break
            assert process.poll() is None
            assert time.monotonic() < end, "it took too long"
            time.sleep(0.01)
    finally:
        killed = time.monotonic()
        process.send_signal(signal.SIGKILL)
        process.wait()
    return killed, Progress.read(progress)


@pytest.mark.parametrize(
    ("slow", "wall_time"),
    [("", 2.5), ("slow: {use: doubles.sleeper, with: {duration: 0.3}}", 2.5), ("bulk: {use: doubles.bulky}", 2.0)],
    ids=["fast", "slow", "bulky"],
)
def test_everything_up_to_the_last_second_is_read_and_the_loss_is_reported(
    slow: str, wall_time: float, doubles: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed, turns = doomed(tmp_path, monkeypatch, slow, wall_time)
    # A turn that began a second before the end was recorded within the flush rule, unless the machine itself slept
    # in between: then what was written after its last sign of life cannot have been lost by us.
    last = turns[-1][0]
    promised = max(now for wall, now in turns if wall <= min(killed, last) - 1.0)
    done = command("inspect", "doomed.mcap", "--json")
    assert done.returncode == 3
    read = json.loads(done.stdout)
    assert read["lost"] is True
    assert read["status"] == "broken off"
    assert read["simulated_time"] * 1e9 >= promised
    assert f"breaks off after {read['simulated_time']:.9g} s" in read["damage"]
    assert read["name"] == "doomed"
    assert read["agents"] == {"robot": 20}

    text = command("inspect", "doomed.mcap")
    assert text.returncode == 3
    assert "the end of the run is missing" in text.stdout


def test_the_readable_part_after_a_kill_equals_an_undisturbed_run(
    doubles: Path, process: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    doomed(tmp_path, monkeypatch, "", 1.2)
    broken = open_log(tmp_path / "doomed.mcap")
    duration = min(present(broken.end_time), 20_000_000_000) / 1e9
    done = process("run", "doomed.yaml", "--set", f"run.duration={duration}", "--output", "whole.mcap")
    assert done.returncode == 0, done.stderr
    whole = open_log(tmp_path / "whole.mcap")
    end = int(duration * 1e9)

    def content(log: Log) -> list[tuple[str, int, int, bytes]]:
        topics = [topic for topic in log.channels if topic != "/timing"]
        return [
            (message.channel.topic, message.time, message.sequence, message.data)
            for message in log.messages(topics, end=end)
        ]

    assert content(broken) == content(whole)
    assert len(content(whole)) > 100


def test_a_turn_without_end_does_not_lose_earlier_records(
    doubles: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    progress = tmp_path / "progress"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PROGRESS", str(progress))
    slow = "slow: {use: doubles.sleeper, with: {duration: 1000.0, start: 5.0}}"
    (tmp_path / "doomed.yaml").write_text(SCENARIO.format(slow=slow))
    process = subprocess.Popen([*COMMAND, "run", "doomed.yaml", "--quiet"])
    try:
        end = time.monotonic() + 60
        while not (turns := Progress.read(progress)) or turns[-1][1] < 4_950_000_000:
            assert process.poll() is None
            assert time.monotonic() < end, "it took too long"
            time.sleep(0.01)
        time.sleep(1.0)  # the promise: what is older than a second is on the disk
    finally:
        process.kill()
        process.wait()
    done = command("inspect", "doomed.mcap", "--json")
    assert done.returncode == 3
    assert json.loads(done.stdout)["simulated_time"] == 4.95


@pytest.mark.slow
def test_after_a_kill_at_any_moment_every_verb_reports_the_loss_and_shows_the_rest(
    doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = "slow: {use: doubles.sleeper, with: {duration: 0.002}}"  # or the log would take minutes to draw
    bulk = "\n      bulk: {use: doubles.bulky}"
    for number, wall_time in enumerate(random.Random(9).uniform(0.0, 3.0) for _ in range(4)):
        folder = tmp_path / str(number)
        folder.mkdir()
        killed, turns = doomed(folder, monkeypatch, slow + bulk * (number % 2), wall_time)
        path = folder / "doomed.mcap"
        content = path.read_bytes()
        promised = [now for wall, now in turns if wall <= min(killed, turns[-1][0]) - 1.0]
        log = open_log(path)
        assert present(log.damage).end_missing
        if promised:
            assert present(log.end_time) >= promised[-1]
        for verb, arguments in VERBS.items():
            written = folder / "written" / verb
            written.mkdir(parents=True)
            status, output, trouble = called(arguments(path, written))
            # A log without a single message has nothing to draw.
            assert status == 3 or (status == 2 and log.end_time is None and not verb.startswith(("inspect", "log"))), (
                trouble
            )
            assert "Traceback (most recent call last)" not in output + trouble
            assert "breaks off" in output + trouble
        recovered = open_log(folder / "written" / "recover" / "recovered.mcap")
        assert recovered.verify() is None
        assert digest(recovered) == digest(log)
        assert path.read_bytes() == content
