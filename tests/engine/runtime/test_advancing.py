"""A run in a process that is not its own: made step by step, beside others, in a thread, within a loop of asyncio."""

import asyncio
import contextlib
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from simulating import Team, execute, present, simulation

from symaware_cli import Component, TimeSeries, open_log
from symaware_cli.core import Controller
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.process_exit import ExitsRefused
from symaware_cli.engine.runtime.run import Run

GUEST = RunOptions(may_exit=False)


class Deaf(Component):
    """Swallows the first Ctrl-C, and does not come back until the second."""

    def _compute(self) -> None:
        with contextlib.suppress(BaseException):
            signal.raise_signal(signal.SIGINT)
        time.sleep(0.2)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("not reached")

    def _update(self, value: Any) -> None:
        pass


def test_a_second_ctrl_c_ends_the_run_and_not_the_process(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    summary = execute(simulation({"robot": Team({"deaf": Deaf})}), 5, tmp_path / "run.mcap", GUEST)
    assert summary.status == "interrupted"
    assert present(open_log(tmp_path / "run.mcap").outcome)["status"] == "interrupted"
    assert signal.getsignal(signal.SIGINT) is before


class Fetch(Controller):
    """Awaits something outside."""

    async def _async_compute(self) -> Any:
        await asyncio.sleep(0.001)
        return [1.0, 0.0], TimeSeries()

    def _compute(self) -> tuple[Any, ...]:
        raise AssertionError("it awaits")


def test_components_await_the_outside_within_a_loop_that_runs_already() -> None:
    async def cell() -> Any:
        ready = simulation({"robot": Team({"fetch": Fetch})})
        summary = execute(ready, 5, options=RunOptions(mode="asynchronous", pace=1.0, may_exit=False))
        await asyncio.sleep(0.001)
        return summary.status, ready.groups[0].control_input.tolist()

    assert asyncio.run(cell()) == ("finished", [[1.0, 0.0]])


def test_runs_of_several_threads_may_overlap_in_any_order() -> None:
    before = os._exit
    first, second = ExitsRefused(), ExitsRefused()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    with pytest.raises(BaseException, match="would end the process"):
        os._exit(3)
    second.__exit__(None, None, None)
    assert os._exit is before


def test_a_time_out_holds_in_another_thread() -> None:
    summaries = []

    def work() -> None:
        summaries.append(execute(simulation({"robot": Team()}), 10**9, options=RunOptions(timeout=0.2, may_exit=False)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join(timeout=60)
    assert summaries[0].status == "interrupted"


def test_a_run_that_advances_by_parts_is_the_run() -> None:
    def states(*parts: Any) -> Any:
        ready = simulation({"robot": Team({}, count=2)})
        course = Run(ready, 6, None, None, GUEST)
        for part in parts:
            course.advance(part)
        assert (course.status, course.done) == ("finished", 6)
        return ready.environment.state(ready.groups[0]).tolist()

    assert states(None) == states(0, 1, 2, 3) == states(6)


def test_a_run_that_is_left_before_it_began_has_an_outcome() -> None:
    course = Run(simulation({"robot": Team()}), 6, None, None, GUEST)
    course.leave("no need")
    course.leave("no need")
    assert (course.summary.status, course.summary.steps) == ("interrupted", 0)
