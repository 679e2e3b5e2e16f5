"""Computations in worker processes give the same as at home, and whatever happens to a worker, the run knows."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import yaml
from simulating import COMMAND, present

from symaware_cli import CommunicationReceiver, GroupCommunicationReceiver, Log, load, open_log
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest

ROBOT: dict[str, Any] = {
    "count": 5,
    "model": {"use": "single-integrator"},
    "state": {"uniform": [-5, 5]},
    "knowledge": {"goal": [0, 0]},
    "components": {
        "see": {"use": "perception.omniscient"},
        "think": {"use": "doubles.thinker", "run_in": "process", "period": 0.1},
        "steer": {"use": "control.go-to-goal", "run_in": "process", "condition": "time < 0.2"},
    },
}


def document(
    mode: str = "asynchronous",
    duration: float = 1.0,
    workers: int | None = None,
    think: Mapping[str, Any] | None = None,
    **run: Any,
) -> dict[str, Any]:
    components = {**ROBOT["components"]}
    components["think"] = {**components["think"], **(think or {})}
    return {
        "symaware": 1,
        "name": "think",
        "seed": 5,
        "run": {"mode": mode, "duration": duration, "workers": workers or 2, **run},
        "environment": {"use": "kinematic"},
        "agents": {"robot": {**ROBOT, "components": components}},
    }


@pytest.fixture
def ran(doubles: Path, tmp_path: Path) -> Callable[..., tuple[RunSummary, Log]]:
    """Run a scenario, and return its summary and its log."""

    def run(content: Mapping[str, Any], name: str = "run") -> tuple[RunSummary, Log]:
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
        summary = execute(build(tmp_path / f"{name}.yaml"), tmp_path / f"{name}.mcap")
        return summary, open_log(tmp_path / f"{name}.mcap")

    return run


def channels(log: Log) -> dict[str, str]:
    return digest(log).channels


@pytest.mark.parametrize(("mode", "latency"), [("synchronous", 0.0), ("asynchronous", 0.03)])
def test_one_worker_or_two_or_none_give_the_same_bytes(
    mode: str, latency: float, ran: Callable[..., tuple[RunSummary, Log]]
) -> None:
    logs = []
    for name, where, workers in (("here", "here", 1), ("one", "process", 1), ("two", "process", 2)):
        content = document(mode, workers=workers, think={"run_in": where, "latency": latency})
        summary, log = ran(content, name)
        assert summary.status == "finished", summary.failure
        logs.append(channels(log))
        assert [event.name for event in log.events() if event.source == "agents.robot.3.think"] == ["thought"] * 2
    assert logs[0] == logs[1] == logs[2]


def test_measurements_of_further_sensors_are_known_there_too(ran: Callable[..., tuple[RunSummary, Log]]) -> None:
    logs = []
    for where in ("here", "process"):
        content = document(duration=0.5)
        look = {"use": "perception.lidar", "with": {"range": 9.0, "rays": 12}}
        components = {"see": {"use": "perception.self"}, "look": look, "go": {"use": "doubles.gaze", "run_in": where}}
        content["agents"]["robot"] |= {"components": components, "entity": {"shape": {"circle": {"radius": 0.3}}}}
        summary, log = ran(content, where)
        assert summary.status == "finished", summary.failure
        logs.append(channels(log))
    assert logs[0] == logs[1]


def test_statuses_of_specifications_are_known_there_too(ran: Callable[..., tuple[RunSummary, Log]]) -> None:
    logs = []
    for where in ("here", "process"):
        content = document(duration=2.0)
        components = {"see": {"use": "perception.self"}, "go": {"use": "doubles.cautious", "run_in": where}}
        content["agents"]["robot"] |= {"count": 3, "state": [[0, 0], [1, 0], [5, 5]], "components": components}
        content["agents"]["robot"]["knowledge"] = {"goal": [[0.5, 0], [-0.5, 0], [0, 0]]}
        content["specifications"] = {"apart": {"pairs": "robot", "formula": "always distance > 0.5"}}
        summary, log = ran(content, where)
        assert summary.status == "finished", summary.failure
        assert summary.specifications[0].counts == {"violated": 1, "undecided": 0, "satisfied": 2}
        logs.append(channels(log))
    assert logs[0] == logs[1]


@pytest.mark.slow
def test_hundreds_of_agents_give_the_same_bytes_under_load_and_with_one_worker_or_two(
    ran: Callable[..., tuple[RunSummary, Log]],
) -> None:
    def hundreds(name: str, where: str = "here", workers: int = 1) -> dict[str, str]:
        components = {
            "see": {"use": "perception.self"},
            "think": {"use": "doubles.thinker", "period": 0.01, "run_in": where},
        }
        content = document(duration=0.1, workers=workers)
        content["agents"]["robot"] |= {"count": 300, "components": components}
        summary, log = ran(content, name)
        assert (summary.status, summary.turns) == ("finished", 2 + 300 * 10), summary.failure
        return channels(log)

    quiet = hundreds("quiet")
    burn = [sys.executable, "-c", "while True: pass"]
    load = [subprocess.Popen(burn) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        assert hundreds("loaded") == quiet
        assert hundreds("one", "process", 1) == quiet
    finally:
        for each in load:
            each.kill()
            each.wait()
    assert hundreds("two", "process", 2) == quiet


def test_all_events_of_a_turn_are_the_same_too(ran: Callable[..., tuple[RunSummary, Log]]) -> None:
    logs = []
    for where in ("here", "process"):
        content = document(think={"run_in": where}, duration=0.4) | {"recording": {"events": "all"}}
        logs.append(channels(ran(content, where)[1]))
    assert logs[0] == logs[1]


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("exit", "its worker process ended with exit status 3"),
        ("kill", "its worker process was killed by SIGKILL"),
        ("raise", "ZeroDivisionError: on purpose"),
        ("nan", "its control input is not finite"),
    ],
)
def test_a_failed_worker_is_a_failure_of_the_component(
    how: str, said: str, ran: Callable[..., tuple[RunSummary, Log]]
) -> None:
    think = {"with": {"at": 0.3, "how": how, "agent": "robot.2"}}
    summary, log = ran(document(think=think))
    assert summary.status == "failed"
    assert log.verify() is None
    failed = [event for event in log.events() if event.name == "failed"]
    assert len(failed) == 1
    assert said in failed[0].data["problem"]
    assert failed[0].time == 300_000_000
    assert failed[0].source.startswith("agents.robot.")
    if how == "raise":
        assert failed[0].source == "agents.robot.2.think"
        assert "on purpose" in failed[0].data["traceback"]
        assert "symaware_doubles.py" in failed[0].data["traceback"]


def test_an_attribute_that_cannot_be_taken_is_a_failure_that_names_it(
    ran: Callable[..., tuple[RunSummary, Log]],
) -> None:
    summary, log = ran(document(think={"use": "doubles.keeper", "with": {"hidden": False}}))
    assert summary.status == "failed"
    (failed,) = [event for event in log.events() if event.name == "failed"]
    assert failed.source == "agents.robot.0.think"
    assert "the state of agents.robot.0.think._lock cannot be captured: it is a _thread.lock" in failed.data["problem"]
    assert "`uncaptured`" in failed.data["problem"]


def test_the_captured_state_of_a_component_goes_to_its_worker_and_back(
    ran: Callable[..., tuple[RunSummary, Log]],
) -> None:
    logs = []
    for where in ("here", "process"):
        summary, log = ran(document(think={"use": "doubles.keeper", "run_in": where}, duration=0.5), where)
        assert summary.status == "finished", summary.failure
        logs.append(channels(log))
    assert logs[0] == logs[1]


def test_a_hang_is_a_failure_after_the_limit_of_wall_time(ran: Callable[..., tuple[RunSummary, Log]]) -> None:
    think = {"with": {"at": 0.3, "how": "hang", "agent": "robot.2"}}
    summary, log = ran(document(think=think, turn_limit=0.5))
    assert summary.status == "failed"
    assert "did not come back within 0.5 s of wall time" in list(log.events())[-1].data["problem"]


def test_a_worker_that_died_is_replaced_where_the_component_is_restarted(
    ran: Callable[..., tuple[RunSummary, Log]],
) -> None:
    think = {"with": {"at": 0.3, "how": "kill", "agent": "robot.2"}, "on_failure": "isolate"}
    summary, log = ran(document(think=think))
    assert summary.status == "finished", summary.failure
    names = [event.name for event in log.events()]
    # With two workers, two or three of the five computed in the one that died.
    assert 2 <= names.count("terminated") <= 3
    series = log.series("robot.1", "intent")
    assert series is not None


def test_a_kill_of_the_run_takes_its_workers_with_it(
    doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    think = {"with": {"at": 0.3, "how": "hang"}}
    Path("run.yaml").write_text(yaml.safe_dump(document(think=think), sort_keys=False))
    process = subprocess.Popen([*COMMAND, "run", "run.yaml", "--quiet"])
    try:
        end = time.monotonic() + 60
        while len(workers := children(process.pid)) < 2:
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.02)
        time.sleep(0.5)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    end = time.monotonic() + 20
    while any(alive(pid) for pid in workers):
        assert time.monotonic() < end, "a worker outlived its run"
        time.sleep(0.02)


def children(pid: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except FileNotFoundError:
        return []


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not os.path.exists("/proc"), reason="looks at processes as Linux shows them")
def test_an_interrupt_ends_the_workers_and_finishes_the_log(
    doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    think = {"with": {"at": 0.3, "how": "hang"}}
    Path("run.yaml").write_text(yaml.safe_dump(document(think=think), sort_keys=False))
    process = subprocess.Popen([*COMMAND, "run", "run.yaml", "--quiet", "--output", "run.mcap"])
    try:
        end = time.monotonic() + 60
        while len(workers := children(process.pid)) < 2:
            assert time.monotonic() < end
            time.sleep(0.02)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=30) == 130
    finally:
        process.kill()
        process.wait()
    assert present(open_log(tmp_path / "run.mcap").outcome)["status"] == "interrupted"
    end = time.monotonic() + 20
    while any(alive(pid) for pid in workers):
        assert time.monotonic() < end
        time.sleep(0.02)


LOOKING: dict[str, dict[str, Any]] = {
    "uncertainty.gaussian": {"belief": {"use": "uncertainty.gaussian"}},
    "risk.collision": {"risk": {"use": "risk.collision", "with": {"reach": 9.0}}},
    "risk.time-to-collision": {"risk": {"use": "risk.time-to-collision", "with": {"reach": 9.0}}},
    "control.velocity-obstacle": {"steer": {"use": "control.velocity-obstacle", "with": {"speed": 1.0}}},
    "control.mpc": {"steer": {"use": "control.mpc", "with": {"speed": 1.0, "steps": 6, "horizon": 1.5}}},
    "control.risk-aware": {
        "risk": {"use": "risk.time-to-collision", "with": {"reach": 9.0}},
        "brake": {"use": "control.risk-aware", "with": {"caution": 0.01, "bound": 0.9}},
    },
    "perception.range": {"see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.1}}},
    "perception.lidar": {"scan": {"use": "perception.lidar", "with": {"range": 9.0, "rays": 12}}},
}


FAR = 30.0
"""Places of `LOOKING` are so far from each other that nobody sees across, m."""


def moved(rows: list[list[float]], place: int) -> list[list[float]]:
    return [[x + FAR * place, *rest] for x, *rest in rows]


@pytest.mark.parametrize("environment", ["kinematic", "pymunk", "pybullet"])
def test_components_that_read_the_world_give_the_same_bytes_in_workers(
    environment: str, ran: Callable[..., tuple[RunSummary, Log]]
) -> None:
    """The process follows the world, with all that moves in it, and knows what it has seen and written before.

    Each kind has a place of its own in one world, with agents, a wall and a cart: one pair of runs tells of all.
    """
    logs = []
    for where in ("here", "process"):
        agents: dict[str, Any] = {}
        entities: dict[str, Any] = {}
        for place, (use, looking) in enumerate(sorted(LOOKING.items())):
            name = use.replace(".", "-")
            components: dict[str, Any] = {
                "see": {"use": "perception.range", "with": {"range": 9.0, "self_noise": 0.02, "position_noise": 0.05}},
                "belief": {"use": "uncertainty.gaussian"},
                "steer": {"use": "control.go-to-goal"},
            }
            # What the others look at is not new at each of their turns.
            components = {key: {**each, "period": 0.3} for key, each in components.items()}
            for key, component in looking.items():
                components[key] = {**component, "run_in": where, "period": 0.1}
            agents[name] = {
                "count": 3,
                "model": {"use": "unicycle"},
                "entity": {"shape": {"circle": {"radius": 0.3}}},
                "state": moved([[0, 0, 0], [4, 1, 3], [2, -3, 1.5]], place),
                "knowledge": {"goal": moved([[0.3, 0.05], [0, 0], [2, 3]], place)},  # one of which is reached
                "components": components,
            }
            agents[f"{name}-alone"] = {
                "model": {"use": "single-integrator"},
                "state": moved([[2, 4]], place)[0],
                "entity": {"shape": {"circle": {"radius": 0.5}}},
            }
            (wall,) = moved([[2.0, 2.0]], place)
            entities[f"{name}-wall"] = {"shape": {"box": {"length": 0.2, "width": 2.0}}, "position": wall}
            path = {"times": [0, 4], "positions": moved([[0, 3], [4, 3]], place)}
            entities[f"{name}-cart"] = {"shape": {"circle": {"radius": 0.3}}, "path": path}
        content = document(mode="synchronous", duration=1.0)
        content["environment"] = {"use": environment, "with": {"time_step": 0.1}, "entities": entities}
        content["agents"] = agents
        summary, log = ran(content, where)
        assert summary.status == "finished", summary.failure
        logs.append(channels(log))
    assert logs[0] == logs[1]
    assert len(logs[0]) > 8 * len(LOOKING)


@pytest.mark.parametrize("environment", ["kinematic", "pymunk", "pybullet"])
def test_agents_enter_and_leave_in_workers_too(environment: str, ran: Callable[..., tuple[RunSummary, Log]]) -> None:
    """Those who are there see one enter late and one leave, in front of them; so does one who enters itself."""
    logs = []
    for where in ("here", "process"):
        agents: dict[str, Any] = {}
        for place, (use, looking) in enumerate(sorted(LOOKING.items())):
            name = use.replace(".", "-")
            components: dict[str, Any] = {
                "see": {"use": "perception.range", "with": {"range": 9.0, "self_noise": 0.02}},
                "belief": {"use": "uncertainty.gaussian"},
                "steer": {"use": "control.go-to-goal"},
            }
            for key, component in looking.items():
                components[key] = {**component, "run_in": where, "period": 0.1}
            agents[name] = {
                "count": 3,
                "model": {"use": "unicycle"},
                "entity": {"shape": {"circle": {"radius": 0.3}}},
                "state": moved([[0, 0, 0], [4, 0.5, 3], [2, -3, 1.5]], place),
                "knowledge": {"goal": moved([[4, 0], [0, 0], [2, 3]], place)},
                "components": components,
                "present": [{}, {"until": 0.7}, {"from": 0.3}],
            }
            agents[f"{name}-alone"] = {
                "count": 2,
                "model": {"use": "single-integrator"},
                "state": moved([[2, 0.2], [1, -0.4]], place),
                "entity": {"shape": {"circle": {"radius": 0.3}}},
                "present": [{"from": 0.5}, {"until": 0.4}],
            }
        content = document(mode="synchronous", duration=1.0)
        content["environment"] = {"use": environment, "with": {"time_step": 0.1}}
        content["agents"] = agents
        summary, log = ran(content, where)
        assert summary.status == "finished", summary.failure
        logs.append(channels(log))
    assert logs[0] == logs[1]


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_components_that_read_awareness_alone_follow_agents_that_enter_and_leave(
    mode: str, ran: Callable[..., tuple[RunSummary, Log]]
) -> None:
    logs = []
    for where in ("here", "process"):
        content = document(mode, think={"run_in": where, "latency": 0.03})
        content["agents"]["robot"]["components"]["steer"]["run_in"] = where
        content["agents"]["robot"]["present"] = [{}, {"from": 0.3}, {"until": 0.45}, {"from": 0.2, "until": 0.6}, {}]
        summary, log = ran(content, where)
        assert summary.status == "finished", summary.failure
        logs.append(channels(log))
    assert logs[0] == logs[1]


def test_components_that_read_a_world_without_replicas_stay_in_the_main_process(doubles: Path, tmp_path: Path) -> None:
    content = document()
    content["environment"] = {"use": "doubles.lonely-world"}
    content["agents"]["robot"]["components"] = {"see": {"use": "perception.self", "run_in": "process"}}
    (tmp_path / "lonely.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ScenarioError) as raised:
        build(tmp_path / "lonely.yaml")
    (problem,) = raised.value.problems
    assert "`doubles.lonely-world` cannot be copied to worker processes" in problem.message


RECEIVERS = sorted(
    point.name
    for point in entry_points(group="symaware.components")
    if point.value.startswith("symaware_cli.")
    and issubclass(point.load(), CommunicationReceiver | GroupCommunicationReceiver)
)

#: Their parameters that have no defaults.
REQUIRED = {
    "communication.consensus": {"weights": "metropolis"},
    "communication.map": {"scan": "lidar", "resolution": 0.5, "within": [0, 1, 0, 1]},
}


@pytest.mark.parametrize("name", RECEIVERS)
def test_whoever_reads_messages_is_refused_in_a_worker_process(name: str, tmp_path: Path) -> None:
    path = tmp_path / "receiver.yaml"
    path.write_text(
        "symaware: 1\nname: receiver\nrun: {duration: 1.0}\nenvironment: {use: kinematic}\n"
        "agents: {robot: {model: {use: single-integrator}, state: [0, 0], knowledge: {value: 1.0}, components: "
        f"{{receive: {{use: {name}, run_in: process, with: {REQUIRED.get(name, {})}}}}}}}}}\n"
    )
    with pytest.raises(ScenarioError, match=f"`{name}` reads messages, which worker processes do not receive"):
        load(path)
