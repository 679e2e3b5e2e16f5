"""Ctrl-C and SIGTERM end a run with its log finished; whoever insists gets rid of it at once."""

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from simulating import COMMAND, Team, execute, present, simulation
from symaware_doubles import Progress

from symaware_cli import Agent, AwarenessDatabase, Component, KnowledgeDatabase, open_log
from symaware_cli.engine.runtime.interruption import Interrupted
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run
from symaware_cli.log.recorder import Recorder
from symaware_cli.log.writer import LogWriter

SCENARIO = """
symaware: 1
name: long
run: {{duration: 1000000.0}}
environment: {{use: kinematic}}
agents:
  robot:
    count: 3
    model: {{use: single-integrator}}
    components:
      see: {{use: perception.omniscient}}
      progress: {{use: doubles.progress}}
      {more}
"""


@pytest.fixture
def started(
    doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a run that would take hours, and wait until it is in the middle of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PROGRESS", str(tmp_path / "progress"))
    running = []

    def start(more: str = "", turns: int = 50) -> subprocess.Popen[str]:
        (tmp_path / "long.yaml").write_text(SCENARIO.format(more=more))
        process = subprocess.Popen(
            [*COMMAND, "run", "long.yaml"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        running.append(process)
        wait_for(lambda: len(Progress.read(tmp_path / "progress")) >= turns, process)
        return process

    yield start
    for process in running:
        process.kill()
        process.wait()


def wait_for(condition: Callable[[], bool], process: subprocess.Popen[str], timeout: float = 60.0) -> None:
    end = time.monotonic() + timeout
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.01)


def ended(process: subprocess.Popen[str], timeout: float = 60.0) -> tuple[str, str]:
    output, errors = process.communicate(timeout=timeout)
    assert "Traceback" not in errors, errors
    return output, errors


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_in_the_middle_finishes_the_log_and_exits_130(
    number: signal.Signals, started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started()
    process.send_signal(number)
    output, _ = ended(process)
    assert process.returncode == 130
    assert "long: interrupted after" in output
    log = open_log(tmp_path / "long.mcap")
    assert log.verify() is None
    assert present(log.outcome)["status"] == "interrupted"
    events = list(log.events())
    assert (events[-1].name, events[-1].text) == ("interrupted", f"ended by {number.name}")
    assert log.end_time == present(log.outcome)["time"]
    assert present(log.end_time) >= Progress.read(tmp_path / "progress")[-1][1] - 50_000_000


@pytest.mark.parametrize(
    "more", ["endless: {use: doubles.endless}", "sleep: {use: doubles.sleeper, with: {duration: 9e9}}"]
)
def test_a_component_that_does_not_come_back_is_interrupted_within_its_turn(
    more: str, started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started(more, turns=1)
    process.send_signal(signal.SIGINT)
    ended(process)
    assert process.returncode == 130
    assert present(open_log(tmp_path / "long.mcap").outcome)["status"] == "interrupted"


def test_a_component_that_catches_everything_is_interrupted_after_its_turn(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started("stubborn: {use: doubles.stubborn}", turns=2)
    process.send_signal(signal.SIGINT)
    ended(process)
    assert process.returncode == 130
    assert present(open_log(tmp_path / "long.mcap").outcome)["status"] == "interrupted"


def test_the_command_stops_showing_progress_and_leaves_the_shell_alone(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started()
    process.send_signal(signal.SIGINT)
    output, errors = ended(process)
    assert errors == ""
    assert str(tmp_path / "long.mcap") in output or "long.mcap" in output


class Signals(Component):
    """Sends itself signals, as somebody at the keyboard would, and catches what it is told to."""

    caught: tuple[type[BaseException], ...] = ()
    count = 1

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        for _ in range(self.count):
            with contextlib.suppress(*self.caught):
                signal.raise_signal(signal.SIGINT)


def test_a_signal_that_comes_twice_at_once_is_one(tmp_path: Path) -> None:
    kind = type("Signals", (Signals,), {"count": 2, "caught": (Interrupted,)})
    summary = execute(simulation({"robot": Team({"signal": kind})}), 5, tmp_path / "run.mcap")
    assert summary.status == "interrupted"
    assert present(open_log(tmp_path / "run.mcap").outcome)["status"] == "interrupted"


@pytest.mark.parametrize("how", ["hold", "release"])
def test_a_second_ctrl_c_ends_the_process_though_native_code_is_deaf(
    how: str, started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started(f"deaf: {{use: doubles.unruly, with: {{how: {how}, at: 5.0}}}}", turns=100)
    wait_for((tmp_path / "progress.deaf").exists, process)
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    assert process.poll() is None, "the first asks the run to end, which it cannot yet"
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=10.0)
    assert process.returncode == -signal.SIGINT  # a shell says 130
    log = open_log(tmp_path / "long.mcap")
    assert log.outcome is None
    assert present(log.damage).end_missing


def test_a_second_signal_ends_the_process_though_a_component_catches_everything(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started("bad: {use: doubles.unruly, with: {how: catch, at: 1.0}}", turns=20)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, errors = ended(process)
    assert time.monotonic() - began < 5.0
    assert process.returncode == 130
    assert "interrupted again; the log ends without an outcome" in errors
    assert open_log(tmp_path / "long.mcap").message_count > 0


def test_a_second_signal_ends_the_command_while_the_first_is_being_caught(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = started("stubborn: {use: doubles.stubborn}", turns=1)
    process.send_signal(signal.SIGSTOP)  # so that both come before it can answer to the first
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGCONT)
    ended(process)
    assert process.returncode == 130


def test_whoever_catches_everything_is_killed_in_the_end() -> None:
    code = """
import signal, time
from symaware_cli.engine.runtime.interruption import Interruption
with Interruption(exit_process=lambda: None):
    while True:
        time.sleep(0.2)
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException as error:
            print(type(error).__name__, flush=True)
"""
    done = subprocess.run([COMMAND[0], "-c", code], stdout=subprocess.PIPE, text=True, timeout=60, check=False)
    assert done.stdout.split() == ["Interrupted"]
    assert done.returncode == -signal.SIGINT


def test_a_signal_during_a_record_waits_until_the_record_is_whole(tmp_path: Path) -> None:
    class SignalledWriter(LogWriter):
        def add(self, channel_id: int, time_ns: int, data: bytes) -> None:
            if b"tick" in data:
                signal.raise_signal(signal.SIGINT)
            super().add(channel_id, time_ns, data)

    class Ticks(Component):
        def _compute(self) -> None:
            return None

        def _update(self, value: Any) -> None:
            self.emit("tick")
            raise AssertionError("the signal comes right after the record")

    ready = simulation({"robot": Team({"tick": Ticks})})
    with SignalledWriter(tmp_path / "run.mcap") as writer:
        summary = run(ready, 5, Recorder(writer, ready.environment, ready.groups))
    assert summary.status == "interrupted"
    log = open_log(tmp_path / "run.mcap")
    assert log.verify() is None
    assert [event.name for event in log.events()] == ["started", "tick", "interrupted"]


def test_a_component_that_takes_long_to_begin_is_interrupted(tmp_path: Path) -> None:
    class Begins(Component):
        def initialise_component(
            self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
        ) -> None:
            signal.raise_signal(signal.SIGINT)
            raise AssertionError("not reached")

        def _compute(self) -> None:
            return None

        def _update(self, value: Any) -> None:
            pass

    summary = execute(simulation({"robot": Team({"begin": Begins})}), 5, tmp_path / "run.mcap")
    assert summary.status == "interrupted"
    assert present(open_log(tmp_path / "run.mcap").outcome)["status"] == "interrupted"


def test_a_run_leaves_the_handlers_of_its_process_as_they_were() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    execute(simulation({"robot": Team()}), 2)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_run_in_another_thread_leaves_signals_to_the_main_one() -> None:
    summaries = []
    thread = threading.Thread(target=lambda: summaries.append(execute(simulation({"robot": Team()}), 2)))
    thread.start()
    thread.join(timeout=60)
    assert summaries[0].status == "finished"


def test_a_run_in_another_thread_ends_with_its_wall_time_too() -> None:
    summaries, options = [], RunOptions(timeout=0.2)
    thread = threading.Thread(
        target=lambda: summaries.append(execute(simulation({"robot": Team()}), 300_000, options=options))
    )
    thread.start()
    thread.join(timeout=60)
    assert summaries[0].status == "interrupted"


@pytest.mark.slow
def test_whenever_the_signal_comes_the_log_is_whole(
    started: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    for attempt in range(1, 40, 4):
        (tmp_path / "progress").unlink(missing_ok=True)
        (tmp_path / "long.mcap").unlink(missing_ok=True)
        process = started("bulk: {use: doubles.bulky}", turns=1 + attempt)
        os.kill(process.pid, signal.SIGINT)
        ended(process)
        assert process.returncode == 130
        log = open_log(tmp_path / "long.mcap")
        assert log.verify() is None
        assert present(log.outcome)["status"] == "interrupted"
        sequence = [message.sequence for message in log.messages(set(log.channels) - {"/timing"})]
        assert sequence == list(range(len(sequence)))
