"""A parameter of one agent's component: the agent alone has it, and all others compute and draw as before."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import symaware_cli as sa
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.language.problem import ScenarioError
from symaware_cli.log.digest import digest
from symaware_cli.log.others_message import Awareness
from symaware_cli.log.reader import Log, open_log
from symaware_cli.log.wire import SeriesRows

#: A component of every kind, for the group and for each agent: its name, its use, its parameters, and what one has too.
COMPONENTS: Mapping[str, tuple[str, str, Mapping[str, Any], Mapping[str, Any]]] = {
    "range": ("see", "perception.range", {"range": 6, "position_noise": 0.2, "dropout": 0.2}, {"dropout": 0.2}),
    "lidar": ("scan", "perception.lidar", {"rays": 8, "noise": 0.1}, {"rays": 8}),
    "contact": ("touch", "perception.contact", {"noise": 0.1}, {"noise": 0.1}),
    "gaussian": ("doubt", "uncertainty.gaussian", {"acceleration_noise": 0.4}, {"acceleration_noise": 0.4}),
    "collision": ("fear", "risk.collision", {"horizon": 2.0}, {"horizon": 2.0}),
    "state": ("tell", "communication.state", {"threshold": 0.1}, {"threshold": 0.1}),
    "broadcast": ("tell", "communication.broadcast", {}, {"awareness": True}),
    "go-to-goal": ("steer", "control.go-to-goal", {"speed": 0.8}, {"speed": 0.8}),
    "velocity-obstacle": ("steer", "control.velocity-obstacle", {"perturbation": 0.1}, {"perturbation": 0.1}),
    "mpc": ("steer", "control.mpc", {"horizon": 5}, {"horizon": 5}),
    "random": ("steer", "control.random", {"inputs": [[1, 0], [0, 1]]}, {"inputs": [[1, 0], [0, 1]]}),
}

#: Those that are one for each agent. A group component takes its turn if a condition or a trigger is that of any of its
#: agents, and here these are fewer.
SINGLE = ("broadcast", "mpc", "lidar")

#: How turns may be taken.
TURNS: Mapping[str, Mapping[str, Any]] = {
    "each step": {},
    "period and jitter": {"period": 0.2, "jitter": 0.05},
    "latency": {"latency": {"uniform": [0.02, 0.15]}},
    "condition": {"condition": "x > 0.1"},
    "trigger": {"trigger": {"event": "goal-reached"}, "period": 0.3},
    "restart": {"on_failure": "restart"},
}


def document(
    components: Mapping[str, Any], mode: str = "asynchronous", faults: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    robot = {
        "count": 4,
        "model": {"use": "single-integrator"},
        "entity": {"shape": {"circle": {"radius": 0.2}}},
        "state": {"circle": {"radius": 2}},
        "knowledge": {"goal": {"each": [[-2.0, 0.1], [0.1, -2.0], [2.0, 0.1], [0.1, 2.0]]}},
        "components": components,
    }
    return {
        "symaware": 1,
        "name": "own",
        "seed": 7,
        "run": {"duration": 1.0, "mode": mode},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
        "agents": {"robot": robot},
        "faults": faults or {},
    }


def ran(folder: Path, name: str, tree: Mapping[str, Any], *changes: str) -> Log:
    path = folder / "s.yaml"
    path.write_text(yaml.safe_dump(tree, sort_keys=False))
    summary = execute(build(path, changes), folder / f"{name}.mcap")
    assert summary.status == "finished", summary.failure
    return open_log(folder / f"{name}.mcap")


def told(log: Log, *omitted: str) -> list[tuple[int, str, Any]]:
    """All messages, with series in one form: those of all agents may share their times, or not."""
    # What several agents do at one instant may be told in another order.
    found: list[tuple[int, str, Any]] = []
    for each in log.messages():
        if each.channel.topic in ("/timing", *omitted):
            continue
        content = each.decode()
        if isinstance(content, SeriesRows):
            rows = content.rows.tolist() if content.rows is not None else []
            series = [(times.tolist(), values.tolist()) for times, values in content]
            found.append((each.time, each.channel.topic, (rows, series)))
        elif isinstance(content, Awareness) and not np.any(content.covariances):
            # No covariances and those that are all zero are the same.
            found.append((each.time, each.channel.topic, repr(replace(content, covariances=content.covariances[:0]))))
        else:
            found.append((each.time, each.channel.topic, each.data))
    return sorted(found, key=repr)


def chain(kind: str, turns: Mapping[str, Any]) -> dict[str, Any]:
    """A component of a kind among those that it needs."""
    name, use, parameters, _ = COMPONENTS[kind]
    needed = {
        "see": {"use": "perception.omniscient"},
        "doubt": {"use": "uncertainty.gaussian"},
        "steer": {"use": "control.go-to-goal"},
    }
    return {**needed, name: {"use": use, "with": {**parameters}, **turns}}


@pytest.mark.parametrize(
    ("kind", "turns"),
    [
        (kind, turns)
        for kind in COMPONENTS
        for turns in TURNS
        if kind in SINGLE or turns not in ("condition", "trigger")
    ],
)
def test_parameters_of_an_agent_equal_to_the_common_ones_change_no_value(kind: str, turns: str, tmp_path: Path) -> None:
    common = chain(kind, TURNS[turns])
    name, _, _, own = COMPONENTS[kind]
    some = {**common, name: {**common[name], "own": {"0": own, "2": own}}}
    one, other = ran(tmp_path, "one", document(common)), ran(tmp_path, "other", document(some))
    # A group component sends one message for its agents, and is overdue once.
    omitted = [*(["/messages"] if kind == "state" else []), *(["/events"] if turns == "latency" else [])]
    assert told(one, *omitted) == told(other, *omitted)


@pytest.mark.parametrize("kind", ["go-to-goal", "mpc", "gaussian"])
def test_parameters_of_single_agents_apply_in_worker_processes(kind: str, tmp_path: Path) -> None:
    common = chain(kind, {"run_in": "process"})
    name, _, _, own = COMPONENTS[kind]
    some = {**common, name: {**common[name], "own": {"0": own, "2": own}}}
    one, other = ran(tmp_path, "one", document(common)), ran(tmp_path, "other", document(some))
    # As for `latency`, an overdue group component is told of once.
    assert told(one, "/events") == told(other, "/events")


@pytest.mark.parametrize("kind", ["range", "velocity-obstacle", "mpc", "collision"])
def test_parameters_of_single_agents_apply_to_restarted_and_replaced_components(kind: str, tmp_path: Path) -> None:
    name, _, _, own = COMPONENTS[kind]
    other = {"see": "perception.self", "steer": "control.go-to-goal", "fear": "risk.time-to-collision"}[name]
    faults = {
        "gone": {"at": 0.2, "for": 0.3, "stop": "robot.1"},
        "still": {"at": 0.2, "for": 0.3, "freeze": f"robot.2.{name}"},
        "swapped": {"at": 0.3, "for": 0.3, "replace": {"of": f"robot.0.{name}", "use": other}},
        "all": {"at": 0.7, "for": 0.1, "replace": {"of": f"robot.{name}", "use": other}},
        "anew": {"at": 0.9, "restart": f"robot.{name}"},
    }
    common = chain(kind, {})
    some = {**common, name: {**common[name], "own": {"0": own, "2": own}}}
    one = ran(tmp_path, "one", document(common, faults=faults))
    two = ran(tmp_path, "two", document(some, faults=faults))
    # There, a component that begins anew is told of once for each set of parameters.
    assert told(one, "/events") == told(two, "/events")


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_one_agent_sees_without_noise_and_the_others_with_the_noise_that_they_had(mode: str, tmp_path: Path) -> None:
    components = {"see": {"use": "perception.range", "with": {"range": 9, "self_noise": [0.1, 0.1]}}}
    tree = document(components, mode)
    before = ran(tmp_path, "before", tree)
    after = ran(tmp_path, "after", tree, "agents.robot[2].components.see.with.self_noise=[0, 0]")
    for row in range(4):
        one, other = (log.series(f"robot.{row}", "state").values for log in (before, after))
        assert np.array_equal(one, other) == (row != 2)
    seen, truth = after.series("robot.2", "state").values, after.series("robot.2", "world").values
    assert np.array_equal(seen[:5], truth[:5])
    assert sa.verify_log(str(tmp_path / "after.mcap")).is_equal


def test_each_agent_has_its_own_parameters_or_else_the_common_ones(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(document(chain("go-to-goal", {}))))
    changes = (
        "agents.robot[1].components.steer.with.speed=2",
        "agents.robot[1].components.steer.with.gain=3",
        "agents.robot[3].components.steer.with.speed=2",
        "agents.robot[3].components.steer.with.gain=3",
        "agents.robot[0].components.steer.with.speed=null",
        "agents.robot.components.steer.with.tolerance=0.3",
    )
    entries = [each for each in build(tmp_path / "s.yaml", changes).simulation.entries if each.name == "steer"]
    given = {row: each.components[0].parameters for each in entries for row in each.rows or ()}
    assert [(given[row].speed, given[row].gain, given[row].tolerance) for row in range(4)] == [
        (1.0, 1.0, 0.3),  # null stands for the default
        (2.0, 3.0, 0.3),
        (0.8, 1.0, 0.3),
        (2.0, 3.0, 0.3),
    ]
    # Agents with the same parameters share a group component.
    assert [each.rows for each in entries] == [(2,), (0,), (1, 3)]


def test_a_single_agent_of_a_group_has_the_parameters_directly(tmp_path: Path) -> None:
    tree = document(chain("go-to-goal", {}))
    tree["agents"]["robot"] |= {"state": [0, 0], "knowledge": {"goal": [1, 1]}}
    del tree["agents"]["robot"]["count"]
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(tree))
    built = build(tmp_path / "s.yaml", ["agents.robot[0].components.steer.with.speed=2"])
    assert built.document.agents["robot"].components["steer"].with_["speed"] == 2
    assert not built.document.agents["robot"].components["steer"].own


@pytest.mark.parametrize(
    ("changes", "said", "place"),
    [
        (["agents.robot[4].components.steer.with.speed=2"], "`robot` has no agent 4", "agents.robot"),
        (["agents.robot[1].components.stear.with.speed=2"], "no `stear`", "agents.robot"),
        (["agents.robot[1].components.steer.with.sped=2"], "sped", "agents.robot.components.steer.own.1.sped"),
        (["agents.robot[1].components.steer.with.speed=-2"], "speed", "agents.robot.components.steer.own.1.speed"),
        (["agents.robot[1].components.steer.period=1"], "one for all agents of `robot`", "agents.robot"),
        (["agents.robot[1].components.steer.with={}"], "one for all agents of `robot`", "agents.robot"),
        (["agents.robot.components.steer.own={7: {speed: 1}}"], "no agent 7", "agents.robot.components.steer.own.7"),
        (["agents.robot.components.steer.own={x: {speed: 1}}"], "x", "agents.robot.components.steer.own"),
        (
            ["agents.robot[1].components.tell.with.fanout=1"],
            "messages to all agents",
            "agents.robot.components.tell.own.1",
        ),
    ],
)
def test_a_parameter_that_no_agent_can_have_alone_is_refused_at_its_place(
    changes: list[str], said: str, place: str, tmp_path: Path
) -> None:
    components = {**chain("go-to-goal", {}), "tell": {"use": "communication.gossip", "with": {"name": "goal"}}}
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(document(components)))
    with pytest.raises(ScenarioError) as caught:
        build(tmp_path / "s.yaml", changes)
    (problem,) = caught.value.problems
    assert said in f"{problem.path} {problem.message}"
    assert problem.path.startswith(place)
    assert problem.span is not None
    assert problem.span.file.startswith("--set")


def test_a_file_of_one_agents_own_is_checked_and_goes_into_the_log(tmp_path: Path) -> None:
    tree = document({**chain("gaussian", {}), "bound": {"use": "uncertainty.conformal"}})
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(tree))
    change = "agents.robot[1].components.bound.with.calibration={file: none.parquet}"
    with pytest.raises(ScenarioError, match=r"none\.parquet"):
        build(path, [change])


def test_a_sweep_varies_a_parameter_of_one_agent(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(document(chain("go-to-goal", {}), "synchronous")))
    made = sa.sweep(
        tmp_path / "s.yaml",
        output=tmp_path / "out",
        over={"agents.robot[1].components.steer.with.speed": [0.5, 1.0]},
        jobs=0,
    )
    assert made is not None
    assert sa.verify_sweep(str(tmp_path / "out"), "all").is_sound


@pytest.mark.parametrize("kind", ["go-to-goal", "mpc"])
def test_a_run_continues_from_its_state_and_branches_with_another_parameter(kind: str, tmp_path: Path) -> None:
    name, _, _, own = COMPONENTS[kind]
    common = chain(kind, {})
    tree = document({**common, name: {**common[name], "own": {"0": own, "2": {**own, "speed": 0.3}}}})
    log = ran(tmp_path, "log", tree)
    with sa.load(tmp_path / "s.yaml").start(output=tmp_path / "again.mcap") as simulation:
        simulation.step(4)
        state = simulation.capture()
        simulation.step(3)
        simulation.restore(sa.SimulationState.from_bytes(state.to_bytes()))
        simulation.finish()
    assert digest(open_log(tmp_path / "again.mcap")).channels == digest(log).channels
    sa.branch(
        tmp_path / "log.mcap", 0.5, {f"agents.robot[1].components.{name}.with.speed": 0.2}, tmp_path / "branch.mcap"
    )
    other = open_log(tmp_path / "branch.mcap")
    for row in range(4):
        one, two = (each.series(f"robot.{row}", "world").values for each in (log, other))
        assert np.array_equal(one[:6], two[:6])
        if kind == "go-to-goal":
            assert np.array_equal(one, two) == (row != 1)
