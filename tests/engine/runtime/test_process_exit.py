"""What a component does to the process that it runs in: the run fails, its log says why, and the command ends."""

import json
import multiprocessing
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from simulating import COMMAND, Command, Team, present, simulate

from symaware_cli import Component, open_log
from symaware_cli.engine.runtime.process_exit import ExitsRefused

SCENARIO = """
symaware: 1
name: unruly
run: {{duration: 0.5}}
environment: {{use: kinematic}}
agents:
  robot:
    count: 2
    model: {{use: single-integrator}}
    components:
      see: {{use: perception.self}}
      bad: {{use: doubles.unruly, with: {{how: {how}}}}}
"""


@pytest.fixture
def unruly(process: Command, doubles: Path, tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    def run(how: str, *arguments: object) -> subprocess.CompletedProcess[str]:
        (tmp_path / "unruly.yaml").write_text(SCENARIO.format(how=how))
        return process("run", "unruly.yaml", *arguments)

    return run


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("exit", "os._exit(0) would end the process"),
        ("interrupt", "KeyboardInterrupt: by a component"),
        ("leave", "SystemExit"),
    ],
)
def test_a_component_that_would_end_the_process_is_blamed_with_status_1(
    how: str, said: str, unruly: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    done = unruly(how)
    assert done.returncode == 1
    assert "agents.robot.bad (doubles.unruly) failed at 0.2 s" in done.stderr
    assert said in done.stderr
    log = open_log(tmp_path / "unruly.mcap")
    assert log.verify() is None
    assert present(log.outcome)["status"] == "failed"


def test_without_a_log_the_traceback_is_shown(
    unruly: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    unruly("leave")
    command = [*COMMAND, "run", "unruly.yaml", "--no-record", "--quiet"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    said, traceback = done.stderr.split("\n", 1)
    assert said == "symaware: agents.robot.bad (doubles.unruly) failed at 0.2 s: SystemExit: 0"
    assert traceback.startswith("Traceback (most recent call last):")
    assert "symaware_doubles.py" in traceback
    done = unruly("leave", "--no-record", "--json")
    assert "symaware_doubles.py" in json.loads(done.stdout)["traceback"]


@pytest.mark.parametrize("arguments", [("--json",), ("--json", "--no-record")])
def test_output_of_plugins_and_libraries_is_not_in_the_json(
    arguments: tuple[str, ...], unruly: Callable[..., subprocess.CompletedProcess[str]]
) -> None:
    done = unruly("print", *arguments)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "finished"
    for said in ("printed by a plugin", "printed by a library", "written by a library"):
        assert said in done.stderr
    assert "printed by a plugin" in unruly("print").stdout


def test_a_thread_that_goes_on_is_named_and_not_waited_for(
    unruly: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    began = time.monotonic()
    done = unruly("thread")
    assert time.monotonic() - began < 60.0
    assert done.returncode == 0
    assert "threads that go on after the end" in done.stderr
    assert "`lingering` of agents.robot.bad (doubles.unruly)" in done.stderr
    assert "unruly: finished" in done.stdout
    assert present(open_log(tmp_path / "unruly.mcap").outcome)["status"] == "finished"
    done = unruly("thread", "--json")
    assert json.loads(done.stdout)["status"] == "finished"


def test_a_process_that_goes_on_is_named_and_ended(
    unruly: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    began = time.monotonic()
    done = unruly("process")
    assert time.monotonic() - began < 60.0
    assert done.returncode == 0, done.stderr
    assert "processes that go on after the end are ended: `child`" in done.stderr
    assert present(open_log(tmp_path / "unruly.mcap").outcome)["status"] == "finished"


def test_a_log_without_an_outcome_is_reported(process: Command, doubles: Path, tmp_path: Path) -> None:
    """As where native code ends the process, which nothing in it can prevent."""

    class Vanishes(Component):
        def _compute(self) -> None:
            if self.now > 200_000_000:
                os.kill(os.getpid(), 9)

        def _update(self, value: Any) -> None:
            pass

    child = os.fork()
    if not child:
        simulate({"robot": Team({"bad": Vanishes})}, 10, tmp_path / "run.mcap")
        os._exit(0)
    os.waitpid(child, 0)
    done = process("inspect", "run.mcap")
    assert done.returncode == 3
    assert "the end of the run is missing" in done.stdout


def _child(queue: Any) -> None:
    queue.put("came to its end")


def test_child_processes_of_components_end_as_ever(tmp_path: Path) -> None:
    """Those that `multiprocessing` forks call `os._exit` themselves."""
    said = []

    class Forks(Component):
        def _compute(self) -> None:
            context = multiprocessing.get_context("fork")
            queue = context.SimpleQueue()
            process = context.Process(target=_child, args=(queue,))
            process.start()
            process.join()
            said.append((queue.get(), process.exitcode))

        def _update(self, value: Any) -> None:
            pass

    summary = simulate({"robot": Team({"fork": Forks})}, 2, tmp_path / "run.mcap")
    assert summary.status == "finished", summary.failure
    assert said == [("came to its end", 0)] * 2


def test_afterwards_the_process_may_end_as_it_likes() -> None:
    before = os._exit
    with ExitsRefused():
        assert os._exit is not before
    assert os._exit is before
