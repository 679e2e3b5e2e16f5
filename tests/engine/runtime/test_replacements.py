"""A component replaced while a run goes on: the other one begins afresh, and nothing before is different."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from symaware_cli import Log, ScenarioError, SimulationState, load, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

MODES = pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])

#: A group component, one for each agent with signals, and another group component; with their parameters.
OTHERS: Mapping[str, Mapping[str, Any]] = {
    "control.velocity-obstacle": {},
    "control.mpc": {},
    "control.random": {"inputs": [[0.0, 1.0], [0.0, -1.0]]},
}


def scenario(folder: Path, faults: Mapping[str, Any], mode: str = "synchronous", **component: Any) -> Path:
    """Write a scenario of four robots that go to their goals."""
    document = {
        "symaware": 1,
        "name": "replaced",
        "seed": 3,
        "run": {"mode": mode, "duration": 2.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
        "agents": {
            "robot": {
                "count": 4,
                "model": {"use": "single-integrator"},
                "state": [[0, 0], [0, 1], [0, 2], [0, 3]],
                "knowledge": {"goal": [[5, 0], [5, 1], [5, 2], [5, 3]]},
                "components": {
                    "see": {"use": "perception.omniscient"},
                    "steer": {"use": "control.go-to-goal", **component},
                },
            }
        },
        "faults": faults,
    }
    path = folder / "replaced.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


def ran(folder: Path, faults: Mapping[str, Any], mode: str = "synchronous", **component: Any) -> Log:
    summary = execute(build(scenario(folder, faults, mode, **component)), folder / "run.mcap")
    assert summary.status == "finished", summary.failure
    return open_log(folder / "run.mcap")


def messages(log: Log, before: float = np.inf) -> list[tuple[int, int, str, bytes]]:
    return [
        (each.sequence, each.time, each.channel.topic, each.data)
        for each in log.messages()
        if each.channel.topic != "/timing" and each.time < before
    ]


def motion(log: Log, agent: int) -> Any:
    return log.series(f"robot.{agent}", "world").values


def swap(
    use: str = "control.velocity-obstacle",
    of: str = "robot.steer",
    parameters: Mapping[str, Any] | None = None,
    lasting: float | None = None,
) -> dict[str, Any]:
    chosen = OTHERS.get(use, {}) if parameters is None else parameters
    return {"at": 1.0, "replace": {"of": of, "use": use, "with": {**chosen}}, "for": lasting}


def constant(velocity: float) -> dict[str, Any]:
    return {"of": "robot.steer", "use": "control.random", "with": {"inputs": [[0.0, velocity]]}}


@MODES
@pytest.mark.parametrize("use", OTHERS)
@pytest.mark.parametrize("of", ["robot.steer", "robot.2.steer"])
def test_nothing_before_differs_by_a_byte_and_the_agents_move_otherwise_afterwards(
    use: str, of: str, mode: str, tmp_path: Path
) -> None:
    plain = ran(tmp_path, {}, mode)
    before, moved = messages(plain, 1e9), [motion(plain, agent) for agent in range(4)]
    log = ran(tmp_path, {"swap": swap(use, of)}, mode)
    assert messages(log, 1e9) == before
    assert len(before) > 60
    for agent in range(4):
        is_replaced = of == "robot.steer" or agent == 2
        # The next state is the first that depends on another control input.
        assert np.array_equal(motion(log, agent)[:21], moved[agent][:21])
        assert np.array_equal(motion(log, agent), moved[agent]) != is_replaced


@MODES
def test_the_replacement_is_initialised_then_and_the_component_begins_anew_when_it_is_over(
    mode: str, tmp_path: Path
) -> None:
    faults = {"swap": {"at": 1.0, "for": 0.5, "replace": constant(2.0)}}
    log = ran(tmp_path, faults, mode)
    velocity = np.diff(motion(log, 1), axis=0) / 0.05
    assert velocity[:20] == pytest.approx(velocity[[0] * 20])
    assert velocity[20:30] == pytest.approx(np.tile([0.0, 2.0], (10, 1)))
    assert np.all(velocity[30:, 0] > 0.5)
    said = [(each.time / 1e9, each.name) for each in log.events() if each.source.endswith("robot.steer")]
    assert said == [(1.0, "fault"), (1.0, "restarted"), (1.5, "restarted"), (1.5, "fault-over")]


def test_of_two_replacements_the_later_one_acts_and_the_earlier_one_again_when_that_is_over(tmp_path: Path) -> None:
    faults = {
        "one": {"at": 0.5, "replace": constant(1.0)},
        "two": {"at": 1.0, "for": 0.5, "replace": constant(-1.0)},
    }
    velocity = np.diff(motion(ran(tmp_path, faults), 0)[:, 1]) / 0.05
    assert velocity[10:20] == pytest.approx(1.0)
    assert velocity[20:30] == pytest.approx(-1.0)
    assert velocity[30:] == pytest.approx(1.0)


def test_other_faults_act_on_the_replacement_and_a_stopped_agent_restarts_with_it(tmp_path: Path) -> None:
    faults = {
        "dead": {"at": 1.2, "for": 0.2, "stop": "robot.3"},
        "frozen": {"at": 1.6, "for": 0.2, "freeze": "robot.0.steer"},
        "swap": swap("control.mpc"),
    }
    log = ran(tmp_path, faults)
    restarted = [(each.time / 1e9, each.source) for each in log.events() if each.name == "restarted"]
    assert (1.4, "agents.robot.3.steer") in restarted
    planned = {
        round(each.time / 1e9, 2): each.decode().rows.tolist()
        for each in log.messages(["/agents/robot/intent"])
        if each.time >= 1e9
    }
    # It plans every 0.2 s.
    assert planned == {1.0: [0, 1, 2, 3], 1.2: [0, 1, 2], 1.4: [0, 1, 2, 3], 1.6: [1, 2, 3], 1.8: [0, 1, 2, 3]}


@MODES
@pytest.mark.parametrize("step", [10, 25, 38])
@pytest.mark.parametrize("use", OTHERS)
def test_a_state_before_within_and_after_a_replacement_can_be_captured(
    use: str, step: int, mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    loaded = load(scenario(tmp_path, {"swap": swap(use, "robot.2.steer", lasting=0.6)}, mode))
    loaded.run(output="whole.mcap")
    whole = messages(open_log("whole.mcap"))
    with loaded.start(output="other.mcap") as simulation:
        simulation.step(step)
        state = simulation.capture()
        simulation.finish()
    with loaded.start(output="again.mcap") as simulation:
        simulation.restore(SimulationState.from_bytes(state.to_bytes()))
        simulation.finish()
    rest = [each for each in messages(open_log("again.mcap")) if each[1] >= state.time]
    assert rest
    assert rest == whole[rest[0][0] :]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (swap("control.velocity-obstacl"), "did you mean `control.velocity-obstacle`"),
        (swap(of="robot.stear"), "no component `robot.stear`"),
        (swap(parameters={"sped": 1.0}), "unknown key `sped`"),
        (swap(parameters={"speed": -1.0}), "speed"),
        (swap("communication.inbox"), "reads messages broadcast, state, which `control.go-to-goal` does not read"),
        (swap("control.waypoints"), "needs the knowledge `waypoints`"),
        (
            swap("communication.consensus", parameters={"name": "height", "gain": 0.1}),
            "reads messages consensus:height",
        ),
        (swap("uncertainty.conformal"), "writes the part `region`"),
        (swap("risk.specification", parameters={"specifications": ["safe"]}), "no specification `safe`"),
        (swap("perception.camera"), "needs images"),
        ({**swap(), "at": None}, "give its beginning"),
    ],
)
def test_a_replacement_that_cannot_work_is_refused_at_its_place(
    change: Mapping[str, Any], said: str, tmp_path: Path
) -> None:
    path = scenario(tmp_path, {"change": change})
    with pytest.raises(ScenarioError, match=said) as caught:
        build(path)
    assert all(str(path) in str(each) for each in caught.value.problems)


def test_parameters_of_a_component_do_not_change_while_it_is_replaced(tmp_path: Path) -> None:
    faults = {
        "swap": swap(lasting=0.5),
        "slower": {"at": 1.2, "reconfigure": {"of": "robot.steer", "with": {"speed": 0.4}}},
    }
    with pytest.raises(ScenarioError, match=r"at 1.2 s `robot.steer` is replaced by the fault `swap`"):
        build(scenario(tmp_path, faults))
    faults["slower"]["at"] = 1.6
    build(scenario(tmp_path, faults))


def test_a_component_in_a_worker_process_is_not_replaced(tmp_path: Path) -> None:
    path = scenario(tmp_path, {"swap": swap()}, run_in="process")
    with pytest.raises(ScenarioError, match="runs in a process of its own"):
        build(path)
