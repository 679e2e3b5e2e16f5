"""A run that several processes share is the run that one process makes."""

import copy
import hashlib
import itertools
import signal
import socket
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from ports import free_port
from simulating import Command, present
from spreading import TALK, Process, Spread, alone, differences, events, goal_seekers
from symaware_doubles import Progress

from symaware_cli import Log, MessageBatch, __version__, open_log
from symaware_cli.language.build import build
from symaware_cli.processes.codec import decode, encode
from symaware_cli.processes.frame import Hello, Post, Report, Welcome
from symaware_cli.processes.tcp import Tcp

STEP = 50_000_000

SHORT = ("--set", "run.duration=3")
"""For crossing.yaml: until the first robots have met."""


def messages(log: Log) -> list[tuple[str, int, bytes]]:
    """All that a log says, in order, but for how fast the machine was."""
    return [(each.channel.topic, each.time, each.data) for each in log.messages() if each.channel.topic != "/timing"]


@pytest.fixture(scope="module")
def crossings(tmp_path_factory: pytest.TempPathFactory, scenarios: Path) -> tuple[Log, list[Spread]]:
    """crossing.yaml in one process, and twice in three: members that come after the host, and before it."""
    folder, port = tmp_path_factory.mktemp("crossing"), free_port()
    whole, runs = alone(folder, scenarios / "crossing.yaml", *SHORT), []
    for name in ("host-first", "host-last"):
        run = Spread(folder / name, scenarios / "crossing.yaml", *SHORT, port=port)
        runs.append(run)
        try:
            if name == "host-first":
                run.host().wait_for("waits at")
                run.member("east", "robot.[6-9],robot.1?")
            run.member("west", "agents.robot.[0-5]")
            if name == "host-last":
                run.member("east", "robot.[6-9],robot.1?")
                run.host()
            run.finish()
        finally:
            run.close()
    return whole, runs


def test_the_records_of_three_processes_equal_those_of_one(crossings: tuple[Log, list[Spread]]) -> None:
    whole, runs = crossings
    merged = runs[0].merged()
    assert differences(whole, merged) == {}
    assert whole.outcome == merged.outcome


def test_the_host_records_the_world_as_one_process_does_to_the_byte(crossings: tuple[Log, list[Spread]]) -> None:
    whole, runs = crossings

    def world(log: Log) -> list[tuple[str, int, bytes]]:
        return [each for each in messages(log) if each[0].startswith("/world/")]

    assert len(world(whole)) == 121
    assert world(whole) == world(open_log(runs[0].log("host")))


def test_a_part_records_its_own_agents_only(crossings: tuple[Log, list[Spread]]) -> None:
    _, runs = crossings
    east, host = (open_log(runs[0].log(name)) for name in ("east", "host"))
    assert {row for message in east.messages(["/agents/robot/control"]) for row in message.decode().rows} == {
        *range(6, 12)
    }
    assert not any(topic.startswith("/world/") for topic in east.channels)
    assert not any(topic.startswith("/agents/") for topic in host.channels)
    assert east.manifest["part"] == {
        "name": "east",
        "host": False,
        "agents": ["robot.6", "robot.7", "robot.8", "robot.9", "robot.10", "robot.11"],
    }


def test_the_order_of_joining_does_not_show_and_every_run_gives_the_same_bytes(
    crossings: tuple[Log, list[Spread]],
) -> None:
    _, (first, second) = crossings
    for name in ("host", "west", "east"):
        assert messages(open_log(first.log(name))) == messages(open_log(second.log(name)))


def test_everybody_records_who_takes_part(crossings: tuple[Log, list[Spread]]) -> None:
    _, runs = crossings
    for name in ("host", "west", "east"):
        joined = events(open_log(runs[1].log(name)), "joined")
        assert joined == [(0, "joined", "processes.west"), (0, "joined", "processes.east")]


def test_python_components_messages_and_faults_are_the_same_too(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path
) -> None:
    run = spread(TALK)
    run.host("--only", "car.1,walker.[02]")
    run.member("west", "car.0,robot.[02],walker.1")
    run.member("east", "car.2,robot.1,robot.3")
    run.finish()
    whole, merged = alone(tmp_path, run.scenario), run.merged()
    assert differences(whole, merged) == {}
    stages = Counter(each.stage for each in merged.communications())
    assert stages["DELIVERED"] > 100
    assert stages["DROPPED"] > 10
    assert {source for _, _, source in events(merged, "thought")} == {f"agents.robot.{row}.think" for row in range(4)}


def heard(log: Log) -> dict[str, list[tuple[int, str, int]]]:
    """What each component heard, in order: when it arrived, whose it was, and its number."""
    ears = defaultdict(list)
    for each in log.events():
        if each.name == "heard":
            time, sender, number = each.text.split()
            ears[each.source].append((int(time), sender, int(number)))
    return ears


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_single_messages_and_batches_are_heard_oldest_first_in_every_process(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path, mode: str
) -> None:
    document = copy.deepcopy(TALK)
    document["run"]["mode"] = mode
    document["topology"] |= {"use": "complete", "with": {}}
    del document["faults"]
    for name, use in {"car": "doubles.ear", "robot": "doubles.ears", "walker": "doubles.ear"}.items():
        document["agents"][name]["components"] |= {"hear": {"use": use, "period": 0.35}}
    run = spread(document)
    run.host("--only", "car.1,walker.[02]")
    run.member("west", "car.0,robot.[02],walker.1")
    run.member("east", "car.2,robot.1,robot.3")
    run.finish()
    whole, merged = heard(alone(tmp_path, run.scenario)), heard(run.merged())
    assert len(whole) == len(merged) == 10
    for each in (*whole.values(), *merged.values()):
        assert each == sorted(each)
        # Of broadcasts, which are sent singly, and of states, which are not, some come between the others.
        kinds = [sender.startswith("car") for _, sender, _ in each]
        assert sum(before != after for before, after in itertools.pairwise(kinds)) > 10
    assert mode == "asynchronous" or merged == whole


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "world", "duration"),
    [
        ("three-worlds", "pymunk", 16),
        ("three-worlds", "pybullet", 16),
        ("drones", "pybullet", 3),
        ("noisy", "kinematic", 3),
        ("flooding", "kinematic", 3),
        ("consensus", "kinematic", 3),
    ],
)
def test_every_world_can_be_followed(
    spread: Callable[..., Spread], scenarios: Path, tmp_path: Path, name: str, world: str, duration: int
) -> None:
    changes = ("--set", f"run.duration={duration}", "--set", f"environment.use={world}")
    ids = list(build(scenarios / f"{name}.yaml").simulation.environment.roster.ids)
    run = spread(scenarios / f"{name}.yaml", *changes)
    run.host("--only", ",".join(ids[::2]))
    run.member("others", ",".join(ids[1::2]))
    run.finish()
    assert differences(alone(tmp_path, run.scenario, *changes), run.merged()) == {}


@pytest.mark.slow
def test_members_have_workers_of_their_own(spread: Callable[..., Spread], doubles: Path, tmp_path: Path) -> None:
    document = copy.deepcopy(TALK)
    document["agents"]["robot"]["components"]["think"]["run_in"] = "process"
    run = spread(document)
    run.host("--only", "car,walker,robot.0")
    run.member("robots", "robot.[1-3]")
    run.finish()
    assert differences(alone(tmp_path, run.scenario), run.merged()) == {}


@pytest.mark.slow
def test_agents_have_parameters_of_their_own_in_every_process(
    spread: Callable[..., Spread], scenarios: Path, tmp_path: Path
) -> None:
    own = ("see.with.range=4", "avoid.with.speed=0.7")
    changes = [*SHORT, *(word for each in own for word in ("--set", f"agents.robot[2].components.{each}"))]
    run = spread(scenarios / "crossing.yaml", *changes)
    run.host("--only", "robot.[0-3]")
    run.member("others", "robot.[4-9],robot.1?")
    run.finish()
    assert differences(alone(tmp_path, run.scenario, *changes), run.merged()) == {}


@pytest.mark.slow
def test_a_convoy_is_led_by_radio_from_another_process(
    spread: Callable[..., Spread], scenarios: Path, tmp_path: Path
) -> None:
    jammed = ("--set", "run.duration=4", "--set", "faults.jammer.at=2", "--set", "faults.jammer.for=1")
    run = spread(scenarios / "convoy.yaml", *jammed)
    run.host("--only", "south")
    run.member("cars", "north_car.[3-4],south_car")
    run.member("radio", "north,north_car.[0-2]")
    run.finish()
    assert differences(alone(tmp_path, run.scenario, *jammed), run.merged()) == {}


def test_a_run_ends_when_goals_are_reached_in_other_processes(spread: Callable[..., Spread], tmp_path: Path) -> None:
    document = goal_seekers(distance=2.0)
    run = spread(document)
    run.host("--only", "ticker")
    run.member("west", "robot.0")
    run.member("east", "robot.1")
    run.finish()
    whole, merged = alone(tmp_path, run.scenario), run.merged()
    assert differences(whole, merged) == {}
    # Not a step later than in one process, and all say why.
    assert whole.outcome == merged.outcome
    texts = {[each.text for each in open_log(each.log).events()][-1] for each in run.processes}
    assert texts == {[each.text for each in whole.events()][-1]}
    assert "all(goals_reached)" in texts.pop()


@pytest.fixture
def goals(spread: Callable[..., Spread], doubles: Path) -> Callable[..., tuple[Spread, Process, Process, Process]]:
    """Begin a run of three processes that lasts; return it, the host, and the members that run robot.0 and robot.1."""

    def begin(*arguments: object, **options: Any) -> tuple[Spread, Process, Process, Process]:
        run = spread(goal_seekers(**options), *arguments)
        processes = run.host("--only", "ticker"), run.member("west", "robot.0"), run.member("east", "robot.1")
        for each in processes:
            each.wait_for("east takes part")
        return run, *processes

    return begin


def truth(log: Log, row: int) -> NDArray[np.float64]:
    """Where a robot was at each step; shape (n, 2)."""
    return np.array([message.decode().values[row] for message in log.messages(["/world/robot/state"])])


def when(log: Log, name: str) -> list[int]:
    """When an event was recorded, in steps; all of them."""
    return [time // STEP for time, _, _ in events(log, name)]


@pytest.mark.parametrize("coast", ["safe", pytest.param("last", marks=pytest.mark.slow)])
def test_a_member_that_is_killed_is_reported_and_comes_back(
    goals: Callable[..., tuple[Spread, Process, Process, Process]], coast: str
) -> None:
    run, host, west, east = goals(wait=0.01, on_failure="isolate", coast=coast)
    west.send(signal.SIGKILL)
    for each in (host, east):
        assert "west, which runs robot.0, is gone: " in each.wait_for("is gone")
    back = run.member("west", "robot.0")
    for each in (host, east, back):
        each.wait_for("west is back")
    assert run.end() == [0, -signal.SIGKILL, 0, 0]
    logs = [open_log(each.log) for each in (host, east, back)]
    [lost], [again] = (when(logs[0], name) for name in ("lost", "rejoined"))
    assert [when(log, "lost") for log in logs] == [[lost], [lost], []]
    assert [when(log, "rejoined") for log in logs] == [[again]] * 3
    positions = truth(logs[0], 0)
    if coast == "safe":
        assert (positions[lost:again] == positions[lost]).all()
    else:
        assert np.allclose(np.diff(positions[lost - 1 : again], axis=0), positions[lost] - positions[lost - 1])
    # It has come to its goal, as the run is over, and that because it moves again.
    assert np.linalg.norm(positions[-1] - [4.0, 0.0]) < 0.3
    assert present(logs[0].outcome)["status"] == "finished"


@pytest.mark.slow
def test_the_logs_of_a_run_with_a_death_make_one_log(
    goals: Callable[..., tuple[Spread, Process, Process, Process]], command: Command
) -> None:
    run, host, west, _ = goals(wait=0.02, distance=8.0, on_failure="isolate")
    time.sleep(1.3)  # what a process has recorded is in its log after a second
    west.send(signal.SIGKILL)
    host.wait_for("is gone")
    run.member("west", "robot.0")
    run.end()
    dead = command("inspect", west.log)
    assert dead.returncode == 3, dead.stderr
    merged = run.merged()
    parts = [(part["name"], part["end_missing"]) for part in merged.manifest["parts"]]
    assert parts == [("host", False), ("east", False), ("west", True), ("west", False)]
    assert [len(events(merged, name)) for name in ("lost", "rejoined", "finished")] == [1, 1, 1]
    told = [(message.time // STEP, message.decode()) for message in merged.messages(["/agents/robot/control"])]
    inputs = [(step, each.values[list(each.rows).index(0)]) for step, each in told if 0 in each.rows]
    [lost], [again] = (when(merged, name) for name in ("lost", "rejoined"))
    assert not [step for step, value in inputs if lost < step < again and value.any()]
    assert [step for step, value in inputs if step >= again and value.any()]


def test_by_default_the_death_of_a_member_ends_the_run(
    goals: Callable[..., tuple[Spread, Process, Process, Process]],
) -> None:
    run, host, west, east = goals(wait=0.02, timeout=1.0, distance=1000.0)
    west.send(signal.SIGKILL)
    assert run.end() == [1, -signal.SIGKILL, 1]
    for process in (host, east):
        log = open_log(process.log)
        assert present(log.outcome)["status"] == "failed"
        assert not log.damage
        [(_, _, source)] = events(log, "lost")
        assert source == "processes.west"
        [failed] = [each for each in log.events() if each.name == "failed"]
        assert "west, which runs robot.0, is gone: " in failed.text
        assert failed.source == "processes.west"
        assert "`agents.robot.sense` has `on_failure: stop`" in failed.text
        assert "west, which runs robot.0, is gone: " in process.text


def test_without_a_pace_the_run_waits_for_a_member_that_shall_be_restarted(
    goals: Callable[..., tuple[Spread, Process, Process, Process]],
) -> None:
    run, host, west, east = goals(wait=0.02, distance=2.0, on_failure="restart")
    west.send(signal.SIGKILL)
    host.wait_for("waits 60 s for it")
    run.member("west", "robot.0")
    assert run.end() == [0, -signal.SIGKILL, 0, 0]
    for each in (host, east):
        [lost], [again] = (when(open_log(each.log), name) for name in ("lost", "rejoined"))
        assert again - lost <= 1


@pytest.mark.slow
def test_a_run_does_not_wait_for_ever_for_a_member_that_shall_be_restarted(
    spread: Callable[..., Spread], doubles: Path
) -> None:
    run = spread(goal_seekers(wait=0.02, distance=1000.0, on_failure="restart"))
    host, west = run.host("--only", "ticker,robot.1", "--wait", "3"), run.member("west", "robot.0")
    west.wait_for("west takes part")
    west.send(signal.SIGKILL)
    assert run.end() == [1, -signal.SIGKILL]
    assert "no process rejoined within 3 s for robot.0" in host.text


@pytest.mark.slow
def test_a_member_may_die_so_often_as_tries_says(
    goals: Callable[..., tuple[Spread, Process, Process, Process]],
) -> None:
    run, host, west, _ = goals(wait=0.02, distance=1000.0, on_failure="restart", tries=1)
    west.send(signal.SIGKILL)
    host.wait_for("is gone")
    back = run.member("west", "robot.0")
    back.wait_for("west is back")
    back.send(signal.SIGKILL)
    assert run.end() == [1, -signal.SIGKILL, 1, -signal.SIGKILL]
    assert [len(events(open_log(host.log), name)) for name in ("lost", "rejoined", "failed")] == [2, 1, 1]


def test_members_outlive_their_host_for_a_while_and_finish_their_logs(
    goals: Callable[..., tuple[Spread, Process, Process, Process]],
) -> None:
    run, host, west, east = goals(wait=0.02, timeout=0.8, distance=1000.0)
    host.send(signal.SIGKILL)
    assert run.end() == [-signal.SIGKILL, 1, 1]
    for process in (west, east):
        log = open_log(process.log)
        assert (present(log.outcome)["status"], log.damage) == ("failed", None)
        assert [source for _, _, source in events(log, "lost")] == ["processes.host"]
        assert "did not come back within 4 s" in process.text


def test_ctrl_c_of_the_host_ends_all(goals: Callable[..., tuple[Spread, Process, Process, Process]]) -> None:
    run, host, *_ = goals(wait=0.02, distance=1000.0)
    host.send(signal.SIGINT)
    assert run.end() == [130, 130, 130]
    for process in run.processes:
        log = open_log(process.log)
        assert (present(log.outcome)["status"], log.damage) == ("interrupted", None)


@pytest.mark.slow
def test_ctrl_c_of_a_member_is_a_loss(goals: Callable[..., tuple[Spread, Process, Process, Process]]) -> None:
    run, _, west, east = goals(wait=0.02, distance=2.0, on_failure="isolate")
    west.send(signal.SIGINT)
    assert "west, which runs robot.0, is gone: it was interrupted" in east.wait_for("is gone")
    run.member("west", "robot.0")
    assert run.end() == [0, 130, 0, 0]
    assert present(open_log(west.log).outcome)["status"] == "interrupted"


def test_a_component_that_fails_in_a_member_fails_the_run(spread: Callable[..., Spread], doubles: Path) -> None:
    document = goal_seekers(distance=1000.0)
    document["agents"]["robot"]["components"]["trip"] = {"use": "doubles.fault", "with": {"at": 0.5}}
    run = spread(document)
    host, west = run.host("--only", "ticker,robot.1"), run.member("west", "robot.0")
    assert run.end() == [1, 1]
    for process in (host, west):
        [failed] = [each for each in open_log(process.log).events() if each.name == "failed"]
        assert failed.time == 10 * STEP
        assert failed.source == "agents.robot.0.trip"
        assert "ZeroDivisionError: a fault on purpose" in failed.text
        assert "agents.robot.0.trip" in process.text


def with_odd(way: str, duration: float = 0.3) -> dict[str, Any]:
    document = goal_seekers(distance=1000.0)
    document["run"] = {"duration": duration}
    document["agents"]["robot"]["components"]["odd"] = {"use": "doubles.odd", "with": {"way": way}}
    return document


def test_events_may_tell_what_no_frame_can_hold(spread: Callable[..., Spread], doubles: Path, tmp_path: Path) -> None:
    run = spread(with_odd("event"))
    run.host("--only", "ticker,robot.1")
    run.member("west", "robot.0")
    run.finish()
    assert differences(alone(tmp_path, run.scenario), run.merged()) == {}


def test_a_message_that_cannot_be_sent_is_the_failure_of_who_says_it(
    spread: Callable[..., Spread], doubles: Path
) -> None:
    run = spread(with_odd("message"))
    run.host("--only", "ticker,robot.1")
    run.member("west", "robot.0")
    assert run.end() == [1, 1]
    for process in run.processes:
        assert "agents.robot.0.odd" in process.text
        assert "TypeError: a frozenset cannot be sent" in process.text


@pytest.mark.slow
def test_frames_that_are_too_long_end_the_run_and_say_so(spread: Callable[..., Spread], scenarios: Path) -> None:
    short = "transport={use: tcp, with: {maximum_frame: 1024}}"
    run = spread(scenarios / "rumour.yaml", "--set", "run.duration=1", "--set", short)
    run.host("--only", "listener")
    run.member("one", "teller")
    assert run.end() == [1, 1]
    for process in run.processes:
        assert "other processes cannot be told: a frame of" in process.text
        assert "is longer than `maximum_frame`: 1024" in process.text


def test_the_host_knows_where_everybody_is(spread: Callable[..., Spread], tmp_path: Path) -> None:
    run = spread(goal_seekers(distance=1000.0), "--set", "run.until=position['robot.0'][0] > 1.0")
    run.host("--only", "ticker,robot.1")
    run.member("west", "robot.0")
    run.finish()
    whole, merged = alone(tmp_path, run.scenario, "--set", "run.until=position['robot.0'][0] > 1.0"), run.merged()
    assert differences(whole, merged) == {}
    assert whole.outcome == merged.outcome


def test_the_host_knows_the_greatest_risk_that_anybody_sees(
    spread: Callable[..., Spread], scenarios: Path, tmp_path: Path
) -> None:
    until = ("--set", "run.until=highest_risk > 0.05")
    run = spread(scenarios / "crossing.yaml", *until)
    run.host("--only", "robot.0")
    run.member("west", "robot.[1-5]")
    run.member("east", "robot.[6-9],robot.1?")
    run.finish()
    whole, merged = alone(tmp_path, run.scenario, *until), run.merged()
    assert present(whole.outcome)["steps"] == 161
    assert differences(whole, merged) == {}
    assert whole.outcome == merged.outcome


def test_in_the_asynchronous_mode_the_host_waits_for_all_in_each_step(
    spread: Callable[..., Spread], scenarios: Path, tmp_path: Path
) -> None:
    # Without what depends on agents of other processes: the trigger, which would come with the next step, and the
    # condition, which may hold for one of them.
    alike: tuple[str, ...] = ("--set", "run.duration=4", "--set", "agents.robot.components.plan.trigger=null")
    alike += ("--set", "agents.robot.components.fear.condition=null")
    run = spread(scenarios / "asynchronous.yaml", *alike)
    run.host("--only", "robot.[45]")
    run.member("some", "robot.[0-3]")
    run.finish()
    assert differences(alone(tmp_path, run.scenario, *alike), run.merged()) == {}


@pytest.mark.slow
def test_an_asynchronous_run_is_repeatable(spread: Callable[..., Spread], scenarios: Path) -> None:
    port, logs = free_port(), []
    for folder in ("one", "other"):
        run = spread(scenarios / "asynchronous.yaml", folder=folder, port=port)
        run.host("--only", "robot.[45]")
        run.member("some", "robot.[01]")
        run.member("more", "robot.[23]")
        run.finish()
        logs.append([messages(open_log(each.log)) for each in run.processes])
    assert logs[0] == logs[1]


def paced(distance: float, duration: float | None = None, timeout: float = 2.0, **timing: Any) -> dict[str, Any]:
    """`goal_seekers` in real time, in which both groups write down when they take their turns."""
    document = goal_seekers(distance=distance, timeout=timeout, **timing)
    document["run"]["pace"] = 1.0
    if duration:
        document["run"] = {"pace": 1.0, "duration": duration}
    for group in document["agents"].values():
        group["components"]["note"] = {"use": "doubles.progress", **timing}
    return document


def test_in_real_time_all_keep_the_clock_of_the_host(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PROGRESS", str(tmp_path / "progress"))
    run = spread(paced(distance=1000.0, duration=2.0))
    host, west = run.host("--only", "ticker,robot.1"), run.member("west", "robot.0")
    run.finish()
    for process in (host, west):
        assert present(open_log(process.log).outcome)["steps"] == 40
    walls: dict[Any, Any] = {}
    for wall, now in Progress.read(tmp_path / "progress"):
        walls.setdefault(now, []).append(wall)
    apart = [max(each) - min(each) for each in walls.values() if len(each) == 3]
    assert len(apart) > 20
    assert np.median(apart) < 0.05
    # Control inputs come from the member.
    assert truth(open_log(host.log), 0)[-1, 0] > 1.0


@pytest.mark.slow
def test_a_member_that_stands_still_for_too_long_comes_back_by_itself(
    spread: Callable[..., Spread], doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PROGRESS", str(tmp_path / "progress"))
    document = paced(distance=10.0, timeout=1.0, on_failure="isolate")
    document["transport"]["with"]["hang_timeout"] = 1.0
    run = spread(document)
    host, west = run.host("--only", "ticker,robot.1"), run.member("west", "robot.0")
    west.wait_for("west takes part")
    west.send(signal.SIGSTOP)
    assert "is gone" in host.wait_for("is gone")
    west.send(signal.SIGCONT)
    for each in (host, west):
        each.wait_for("west is back")
    run.finish()
    positions = truth(open_log(host.log), 0)
    [lost], [again] = (when(open_log(host.log), name) for name in ("lost", "rejoined"))
    assert (positions[lost + 1 : again] == positions[lost + 1]).all()
    assert np.linalg.norm(positions[-1] - [10.0, 0.0]) < 0.3


@pytest.mark.slow
def test_a_host_that_stands_still_for_too_long_finds_its_members_again(
    goals: Callable[..., tuple[Spread, Process, Process, Process]],
) -> None:
    hang = ("--set", "transport.with.hang_timeout=1.0")
    run, host, west, east = goals(*hang, wait=0.02, timeout=1.0, distance=6.0, on_failure="isolate")
    host.send(signal.SIGSTOP)
    for each in (west, east):
        each.wait_for("waits 5 s for it")
    host.send(signal.SIGCONT)
    run.finish()
    for process in (west, east):
        assert ("lost", "processes.host") in {
            (name, source) for _, name, source in events(open_log(process.log), "lost")
        }
    assert [source for _, _, source in events(open_log(host.log), "rejoined")]


@pytest.mark.slow
def test_a_member_that_comes_back_continues_periods_and_faults_of_the_run(
    spread: Callable[..., Spread], doubles: Path
) -> None:
    document = copy.deepcopy(TALK)
    document["run"] = {"duration": 12.0}
    for group in document["agents"].values():
        for component in group["components"].values():
            component |= {"on_failure": "isolate"}
    document["agents"]["walker"]["components"]["tick"] = {"use": "doubles.sleeper", "with": {"duration": 0.02}}
    document["faults"]["late"] = {"at": 11.0, "for": 0.5, "bias": {"of": "robot.1.sense", "state": [0.5, 0.0]}}
    run = spread(document)
    host, west, east = run.host("--only", "walker"), run.member("west", "car.0,robot.[02]"), None
    east = run.member("east", "car.[12],robot.[13]")
    host.wait_for("east takes part")
    east.send(signal.SIGKILL)
    west.wait_for("is gone")
    back = run.member("east", "car.[12],robot.[13]")
    assert run.end() == [0, 0, -signal.SIGKILL, 0]
    [again] = (time for time, _, _ in events(open_log(host.log), "rejoined"))
    log, merged = open_log(back.log), run.merged()
    times = [message.time for message in log.messages() if message.channel.topic.startswith("/agents/")]
    assert times == sorted(times)
    assert times[0] == again
    thoughts = [time for time, _, source in events(log, "thought") if source == "agents.robot.1.think"]
    assert len(thoughts) == (12_000_000_000 - again) // (10 * STEP)
    heard = [each for each in merged.communications() if (each.receiver, each.stage) == ("robot.1", "DELIVERED")]
    assert [each for each in heard if each.time > again]


def test_garbage_at_the_port_changes_nothing_but_is_counted(
    goals: Callable[..., tuple[Spread, Process, Process, Process]], tmp_path: Path
) -> None:
    run, host, *_ = goals(wait=0.02, distance=2.0)
    random = np.random.default_rng(1)
    for number in range(20):
        with socket.create_connection(("127.0.0.1", run.port)) as stranger, suppress(OSError):
            stranger.sendall(b"GET / HTTP/1.1\r\n\r\n" if number % 2 else random.bytes(200))
    run.finish()
    found = differences(alone(tmp_path, run.scenario), run.merged())
    assert found.keys() == {"/events"}
    only_alone, only_shared = found["/events"]
    assert not only_alone
    assert {(name, source) for _, name, source, *_ in only_shared} == {("rejected", "run")}
    last = [each for each in open_log(host.log).events() if each.name == "rejected"][-1]
    assert last.data["total"]["garbage"] == 20
    assert "garbage" in last.text


def _inputs(row: int, value: float = 0.0) -> dict[str, tuple[NDArray[np.intp], NDArray[np.float64]]]:
    return {"robot": (np.array([row], np.intp), np.full((1, 2), value))}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "objection"),
    [
        (Report(0, _inputs(1)), "control inputs of agents of `robot` that are not its own"),
        (Report(0, _inputs(9)), "control inputs of agents of `robot` that are not its own"),
        (Report(0, _inputs(0, np.nan)), "control inputs of `robot` that cannot be"),
        (Report(0, {"ghost": _inputs(0)["robot"]}), "control inputs of `ghost` that cannot be"),
        (Report(0, {}, (Post(MessageBatch(np.array([1]), {}), 0),)), "messages of agents that are not its own"),
        (Report(0, {}, (Post(MessageBatch(np.array([4]), {}), 0),)), "messages of agents that are not its own"),
        (Report(0, {}, (Post(MessageBatch(np.array([0]), {}, receivers=np.array([4])), 0),)), "that do not exist"),
        (Report(0, {}, (), (1.0, "robot.1")), "a risk that none of its agents can see"),
        (Report(0, {}, (), (np.nan, "robot.0")), "a risk that none of its agents can see"),
        (Welcome(0, 0, 0.0, 0.0), "a member does not say Welcome"),
    ],
)
def test_a_member_with_an_impossible_message_is_disconnected_and_the_run_goes_on(
    spread: Callable[..., Spread], frame: Report, objection: str
) -> None:
    document = goal_seekers(distance=1000.0, on_failure="isolate")
    document["run"] = {"duration": 1.0}
    run = spread(document)
    host = run.host("--only", "ticker,robot.1")
    digest = hashlib.sha256(build(run.scenario).resolved).digest()
    with Tcp().join("127.0.0.1", run.port) as port:
        peer = came(port, "came").peer
        port.send(peer, encode(Hello("liar", digest, __version__, ("robot.0",))))
        assert isinstance(decode(came(port, "frame").frame), Welcome)
        port.send(peer, encode(frame))
        assert objection in host.wait_for("what liar said is not taken")
        run.finish()
    log = open_log(host.log)
    assert present(log.outcome)["steps"] == 20
    assert [source for _, _, source in events(log, "lost")] == ["processes.liar"]


def came(port: Any, kind: str) -> Any:
    while (happening := port.receive(60.0)) is not None:
        if happening.kind == kind:
            return happening
    raise AssertionError(f"nothing of kind {kind}")


@pytest.mark.slow
def test_a_host_keeps_no_mail_of_agents_that_run_elsewhere(spread: Callable[..., Spread]) -> None:
    document = goal_seekers(distance=1e6)
    document["run"] = {"duration": 100.0}
    robot = document["agents"]["robot"]
    robot |= {"count": 5, "state": {"circle": {"radius": 9.0}}, "knowledge": {"goal": [0.0, 0.0]}}
    robot["components"] |= {"tell": {"use": "communication.broadcast"}, "hear": {"use": "communication.inbox"}}
    run = spread(document, "--set", "recording.messages=none")
    host, _ = run.host("--only", "ticker"), run.member("all", "robot")
    host.wait_for("takes part")
    resident = []
    while host.is_running:
        resident.append(host.memory)
        time.sleep(0.1)
    run.finish()
    assert present(open_log(host.log).outcome)["steps"] == 2000
    used = [each for each in resident if each]
    assert used[-1] - used[len(used) // 3] < 8e6, used


@pytest.mark.slow
def test_crossing_over_zenoh_is_the_same(
    spread: Callable[..., Spread], scenarios: Path, crossings: tuple[Log, list[Spread]]
) -> None:
    pytest.importorskip("zenoh")
    run = spread(scenarios / "crossing.yaml", *SHORT, "--set", "transport.use=zenoh")
    run.host("--only", "robot.[6-9],robot.1?")
    run.member("west", "robot.[0-5]")
    run.finish()
    assert differences(crossings[0], run.merged()) == {}


@pytest.mark.slow
def test_a_death_is_noticed_over_zenoh(goals: Callable[..., tuple[Spread, Process, Process, Process]]) -> None:
    pytest.importorskip("zenoh")
    run, host, west, east = goals("--set", "transport.use=zenoh", wait=0.02, timeout=1.0, distance=1000.0)
    west.send(signal.SIGKILL)
    assert run.end() == [1, -signal.SIGKILL, 1]
    for process in (host, east):
        assert "west, which runs robot.0, is gone: " in process.text


@pytest.mark.slow
def test_all_verbs_take_the_log_of_a_run_that_was_spread(crossings: tuple[Log, list[Spread]], command: Command) -> None:
    _, runs = crossings
    logs = [each.log for each in runs[0].processes]
    assert command("merge", *logs, "-o", "crossing.mcap").returncode == 0
    for arguments in (
        ("inspect", "crossing.mcap"),
        ("replay", "crossing.mcap", "--save", "crossing.rrd"),
        ("plot", "crossing.mcap", "-o", "risk.png"),
    ):
        done = command(*arguments)
        assert done.returncode == 0, (arguments, done.stderr)
