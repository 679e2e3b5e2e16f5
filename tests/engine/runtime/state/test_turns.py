"""States taken while computations are to land or run elsewhere, faults are under way, agents enter, or turns wait."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import symaware_cli as sa

ROBOT = {
    "count": 3,
    "model": {"use": "single-integrator"},
    "state": {"uniform": [-5, 5]},
    "knowledge": {"goal": [0, 0]},
}
SEE = {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.1}}


@pytest.fixture
def scenario(doubles: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., sa.Scenario]:
    """Make a scenario of robots with a second component."""
    monkeypatch.chdir(tmp_path)

    def make(
        component: Mapping[str, Any], mode: str = "asynchronous", robot: Mapping[str, Any] | None = None, **more: Any
    ) -> sa.Scenario:
        robot = {**ROBOT, "components": {"see": SEE, "think": component}, **(robot or {})}
        document = {
            "symaware": 1,
            "name": "turns",
            "seed": 5,
            "run": {"mode": mode, "duration": 3.0, "workers": 1},
            "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
            "agents": {"robot": robot},
            **more,
        }
        (tmp_path / "turns.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        return sa.load(tmp_path / "turns.yaml")

    return make


def messages(path: Path | str, since: int = 0) -> list[tuple[int, int, str, bytes]]:
    return [
        (each.sequence, each.time, each.channel.topic, each.data)
        for each in sa.open_log(path).messages()
        if each.channel.topic != "/timing" and each.sequence >= since
    ]


def check(scenario: sa.Scenario, step: int) -> None:
    """Go on from a state, here and in another simulation, and compare the logs."""
    with scenario.start(output="whole.mcap") as simulation:
        simulation.step(step + 8)
    with scenario.start(output="again.mcap") as simulation:
        simulation.step(step)
        state = simulation.capture()
        simulation.step(5)
        simulation.restore(state)
        simulation.step(8)
    with scenario.start(output="other.mcap") as simulation:
        simulation.restore(sa.SimulationState.from_bytes(state.to_bytes()))
        simulation.step(8)
    whole = messages("whole.mcap")
    assert messages("again.mcap") == whole
    rest = [each for each in messages("other.mcap") if each[1] >= state.time]
    assert len(rest) > 20
    assert rest == whole[rest[0][0] :]


@pytest.mark.parametrize("where", ["home", "process"])
def test_computations_that_are_to_land_are_part_of_the_state(scenario: Callable[..., sa.Scenario], where: str) -> None:
    elsewhere = {"run_in": "process"} if where == "process" else {}
    check(scenario({"use": "doubles.thinker", "period": 0.08, "latency": 0.03, "jitter": 0.01, **elsewhere}), 9)


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_faults_under_way_are_part_of_the_state(scenario: Callable[..., sa.Scenario], mode: str) -> None:
    faults = {
        "still": {"stop": "robot.1", "at": 0.2, "for": 0.5},
        "slow": {"slow": {"of": "robot.0.think", "latency": 0.1}, "at": 0.3, "for": 0.6},
    }
    check(scenario({"use": "control.go-to-goal"}, mode, faults=faults), 9)


@pytest.mark.parametrize("where", ["home", "process"])
@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
@pytest.mark.parametrize("step", [2, 7, 9, 12])
def test_the_presence_of_agents_is_part_of_the_state(
    scenario: Callable[..., sa.Scenario], mode: str, step: int, where: str
) -> None:
    """By a time, on a condition and with an event; before, between and behind what happens in steps 8 to 11."""
    elsewhere = {"run_in": "process"} if where == "process" else {}
    present = [
        {"until": 0.5},
        {"from": 0.4, "until": "time > 0.52"},
        {"from": {"event": "removed", "of": "agents.robot.0"}},
    ]
    check(scenario({"use": "risk.collision", "with": {"reach": 9.0}, **elsewhere}, mode, {"present": present}), step)


def test_a_turn_that_waits_is_refused_and_one_that_is_over_is_not(scenario: Callable[..., sa.Scenario]) -> None:
    with scenario({"use": "doubles.napper", "period": 0.4}).start() as simulation:
        simulation.step(2)
        with pytest.raises(sa.StateError, match=r"cannot be captured: .* suspended coroutine"):
            simulation.capture()
        simulation.step(3)
        state = simulation.capture()
        simulation.step()
        after = simulation.state("robot")
        simulation.restore(state)
        simulation.step()
        assert np.array_equal(simulation.state("robot"), after)
