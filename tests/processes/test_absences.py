"""A member whose process dies in a run that goes on: its agents are absent until it continues from its state."""

import copy
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spreading import TALK, Process, Spread, alone, await_file, busy, differences, events, successor

from symaware_cli import Log, open_log

WEST = {"car": "car.0", "robot": "robot.[02]", "walker": "walker.1"}
"""The agents that die, by group."""


def going_on(mode: str = "synchronous", pace: float | None = None) -> dict[str, Any]:
    """`TALK`, which goes on when a process dies; its steps take some wall time: without a pace, since somebody sleeps.

    In the asynchronous mode the components have periods, latencies and triggers that are no multiples of a step.
    """
    document = copy.deepcopy(TALK)
    # Nobody who may be absent: the order of two reasons to stop at one instant is not the same.
    document["faults"]["rest"]["stop"] = "walker.0"
    document["run"] = {"mode": mode, "duration": 1.25 if pace else 4.0} | ({"pace": pace} if pace else {})
    if mode == "asynchronous":
        document = busy(document)
    for group in document["agents"].values():
        for component in group["components"].values():
            component |= {"on_failure": "isolate"}
    if not pace:
        document["agents"]["clock"] = {
            "model": {"use": "single-integrator"},
            "state": [90.0, 90.0],
            "components": {"tick": {"use": "doubles.sleeper", "period": 0.05, "with": {"duration": 0.03}}},
        }
    return document


def started(run: Spread, *host: str, substitutes: int = 1) -> tuple[Process, Process, list[Process]]:
    """Start a host, a member, and others that wait to take its place; then a third one, as the run begins."""
    first = run.host("--only", ",".join(("car.1,walker.[02]", *host)))
    west = run.member("west", ",".join(WEST.values()))
    first.wait_for("west is there")
    waiting = [run.member("west", ",".join(WEST.values())) for _ in range(substitutes)]
    for each in waiting:
        each.wait_for("run in west; waits for them")
    run.member("east", "car.2,robot.1,robot.3")
    first.wait_for("east takes part")
    return first, west, waiting


def absences(log: Log) -> list[tuple[float, float]]:
    """The intervals in which agents were absent [s]."""
    rejoined = [each for each in log.events() if each.name == "rejoined"]
    return [(each.data["absent_from"], each.data["absent_until"]) for each in rejoined]


def lateness(process: Process) -> float:
    """The greatest delay of an instant in a process of a run with a pace [s]; 0 without a pace."""
    timings = [message.decode() for message in open_log(process.log).messages(["/timing"])]
    return max((float(each.worst_lateness) for each in timings), default=0.0)


def compare_with_faults(folder: Path, run: Spread) -> None:
    """Compare a run with that of one process, in which faults stop the agents of the member while they were absent."""
    merged, faults = run.merged(), []
    for number, (begin, end) in enumerate(absences(merged)):
        assert 0.0 < begin < end
        for name, stop in WEST.items():
            fault = f"{{at: {begin!r}, for: {end - begin:.9g}, stop: '{stop}'}}"
            faults += ["--set", f"faults.away_{name}_{number}={fault}"]
    whole = alone(folder, run.scenario, *faults)
    found = differences(whole, merged)
    if max(map(lateness, run.processes[:2] + run.processes[-1:])) > 0.1:
        # With a pace nobody waits for data that arrives late, so the numbers depend on how busy the machine is.
        found = {"/events": found["/events"]}
    if merged.manifest["mode"] == "asynchronous" and found.pop("/world/robot/control", None) is not None:
        # Zeros may differ in sign: a host stops agents from their input at the step, one process from their latest one.
        for row in range(4):
            ones, others = (log.series(f"robot.{row}", "applied_control") for log in (whole, merged))
            np.testing.assert_array_equal(ones.times, others.times)
            np.testing.assert_array_equal(ones.values, others.values)
    only_alone, only_merged = found.pop("/events")
    assert found == {}
    # The same agents stop and restart at the same times; the reasons differ.
    stopped = [events(log, "terminated", "restarted") for log in (whole, merged)]
    assert sorted(stopped[0]) == sorted(stopped[1])
    assert {name for _, name, *_ in only_alone} == {"fault", "fault-over", "terminated"}
    assert {name for _, name, *_ in only_merged} == {"terminated"}
    assert whole.outcome == merged.outcome


@pytest.mark.parametrize(
    ("mode", "pace"),
    [
        ("synchronous", None),
        pytest.param("synchronous", 0.2, marks=pytest.mark.slow),
        pytest.param("asynchronous", None, marks=pytest.mark.slow),
    ],
)
def test_agents_are_absent_while_their_process_is_gone_as_if_a_fault_stopped_them(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path, mode: str, pace: float | None
) -> None:
    run = spread(going_on(mode, pace))
    host, west, [again] = started(run, *() if pace else ("clock",))
    await_file(run.folder / "talk.west.state")
    time.sleep(0.6)
    west.send(signal.SIGKILL)
    again.wait_for("continues from its state")
    host.wait_for("west is back")
    assert run.end() == [0, -signal.SIGKILL, 0, 0]
    assert len(absences(run.merged())) == 1
    compare_with_faults(tmp_path, run)


@pytest.mark.slow
def test_a_member_that_dies_twice_is_absent_twice(spread: Callable[..., Spread], doubles: Path, tmp_path: Path) -> None:
    document = going_on()
    document["run"]["duration"] = 8.0
    run = spread(document)
    host, west, waiting = started(run, "clock", substitutes=2)
    died = []
    for count in (1, 2):
        await_file(run.folder / "talk.west.state")
        time.sleep(0.8)
        west.send(signal.SIGKILL)
        died.append(west)
        host.wait_for("west is back", count)
        west = successor([each for each in waiting if each not in died], "west")
    assert [each.end() for each in run.processes if each not in died] == [0] * 3
    assert len(absences(run.merged())) == 2
    compare_with_faults(tmp_path, run)
