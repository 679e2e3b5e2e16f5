"""Simulations that are stepped, watched and controlled."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkout import CHECKOUT
from numpy.typing import ArrayLike
from simulating import Command, present

import symaware_cli as sa
from symaware_cli import Event, Scenario
from symaware_cli.api.scenario import Mode
from symaware_cli.log.digest import digest


@pytest.fixture
def scenario(path: Path) -> Scenario:
    return sa.load(path)


def identity(path: Path | str) -> tuple[list[tuple[str, int, int, bytes]], dict[str, bytes], dict[str, Any] | None]:
    """All that a log holds of a run, byte by byte, but its wall time, and the libraries that the process has loaded."""
    log = sa.open_log(path)
    messages = [(each.channel.topic, each.time, each.sequence, each.data) for each in log.messages()]
    attachments = {name: content for name, content in log.attachments.items() if name != "versions.json"}
    return [each for each in messages if each[0] != "/timing"], attachments, log.outcome


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_a_log_is_the_same_by_the_command_by_a_run_and_by_steps(
    scenario: Scenario, process: Command, mode: Mode
) -> None:
    assert process("run", "swap.yaml", "-o", "command.mcap", "--set", f"run.mode={mode}").returncode == 0
    scenario.run(output="run.mcap", mode=mode)
    with scenario.start(output="steps.mcap", mode=mode) as simulation:
        while not simulation.done:
            simulation.step()
    with scenario.start(output="odd.mcap", mode=mode) as simulation:
        simulation.step(7)
        simulation.finish()
    first = identity("command.mcap")
    assert len(first[0]) > 100
    assert all(identity(path) == first for path in ("run.mcap", "steps.mcap", "odd.mcap"))


def test_two_simulations_take_turns_and_neither_knows_of_the_other(scenario: Scenario) -> None:
    with scenario.start(seed=1, output="a.mcap") as one, scenario.start(seed=2, output="b.mcap") as other:
        while not (one.done and other.done):
            for simulation in (one, other, other):
                if not simulation.done:
                    simulation.step()
    for seed, path in ((1, "a.mcap"), (2, "b.mcap")):
        alone = scenario.run(seed=seed, output="alone.mcap")
        assert digest(sa.open_log(path)).combined == digest(alone.log).combined


def test_a_step_is_one_of_the_world(scenario: Scenario) -> None:
    with scenario.start() as simulation:
        assert (simulation.time, simulation.now, simulation.steps, simulation.done) == (0.0, 0, 0, False)
        before = simulation.state("robot")
        assert simulation.step() == 1
        assert (simulation.time, simulation.now, simulation.steps) == (0.05, 50_000_000, 1)
        assert not (simulation.state("robot") == before).any(axis=0).all()
        assert simulation.step(100) == 39
        assert simulation.done
        with pytest.raises(RuntimeError, match="the run of swap is over: finished"):
            simulation.step()
        with pytest.raises(ValueError, match="at least 1, not 0"):
            simulation.step(0)
    assert os.listdir() == ["swap.yaml"]


def test_states_are_those_of_the_log(scenario: Scenario) -> None:
    states = []
    with scenario.start(output="a.mcap") as simulation:
        while not simulation.done:
            states.append(simulation.state("robot"))
            simulation.step()
        states.append(simulation.state("robot"))
    assert (sa.open_log("a.mcap").series("robot", "world").values == np.array(states)).all()


def test_a_state_is_that_of_a_group_or_an_agent_by_columns(scenario: Scenario) -> None:
    with scenario.start() as simulation:
        simulation.step(3)
        assert simulation.groups == {"lone": ("lone",), "robot": ("robot.0", "robot.1", "robot.2")}
        assert simulation.state_columns("robot") == ("x", "y", "heading")
        everything = simulation.state("robot")
        assert everything.shape == (3, 3)
        assert not everything.flags.writeable
        assert (simulation.state("robot.1") == everything[1]).all()
        assert (simulation.state("robot", "heading", "x") == everything[:, [2, 0]]).all()
        assert simulation.state("lone").shape == (2,)
        assert not np.array_equal(simulation.belief("robot"), everything)  # it is noisy
        assert simulation.control("robot.0").shape == (2,)
        assert (simulation.awareness("robot", "state") == simulation.belief("robot")).all()
        assert simulation.awareness("robot.1", "intent", "x", "y").shape == (2,)
        with pytest.raises(KeyError, match="there is no part of awareness 'rsk'; did you mean 'risk'"):
            simulation.awareness("robot", "rsk")
        with pytest.raises(KeyError, match="there is no group or agent 'robto'; did you mean 'robot'"):
            simulation.state("robto")
        with pytest.raises(KeyError, match="there is no column 'headin'; did you mean 'heading'"):
            simulation.state("robot", "headin")


def test_control_from_outside_replaces_the_controller_until_it_is_given_back(scenario: Scenario) -> None:
    with scenario.start(output="a.mcap") as simulation:
        simulation.step()
        simulation.set_control("robot", [0.5, 0.0])
        simulation.set_control("robot.1", [0.0, 2.0])
        before = simulation.state("robot.1", "heading")
        simulation.step(10)
        assert simulation.control("robot").tolist() == [[0.5, 0.0], [0.0, 2.0], [0.5, 0.0]]
        assert simulation.state("robot.1", "heading") == pytest.approx(before + 2.0 * 0.5)
        simulation.set_control("robot.0", None)
        simulation.step()
        assert simulation.control("robot.0")[0] != 0.5
        assert simulation.control("robot.1").tolist() == [0.0, 2.0]
        simulation.set_control("robot", None)
        simulation.step()
        assert simulation.control("robot.1").tolist() != [0.0, 2.0]
    log = sa.open_log("a.mcap")
    requested, applied = log.series("robot.1", "requested_control"), log.series("robot.1", "applied_control")
    assert [requested.values[np.searchsorted(requested.times, 50_000_000 * step)].tolist() for step in (1, 10)] == [
        [0.0, 2.0]
    ] * 2
    assert (applied.values == [0.0, 2.0]).all(axis=1).sum() == 11


@pytest.mark.parametrize("mode", ["synchronous", "asynchronous"])
def test_control_of_an_agent_without_components_moves_it(scenario: Scenario, mode: Mode) -> None:
    with scenario.start(mode=mode) as simulation:
        simulation.set_control("lone", [1.0, -1.0])
        simulation.step(20)
        assert simulation.state("lone") == pytest.approx([10.0, 8.0])


def test_the_model_limits_control_from_outside(scenario: Scenario) -> None:
    with scenario.start(output="a.mcap") as simulation:
        simulation.set_control("robot.0", [99.0, 0.0])
        simulation.step()
    log = sa.open_log("a.mcap")
    assert log.series("robot.0", "requested_control").values[0].tolist() == [99.0, 0.0]
    assert log.series("robot.0", "applied_control").values[-1].tolist() == [3.0, 0.0]


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("robot", np.zeros((2, 2)), r"robot \(speed, turn_rate\) has shape \(3, 2\) or \(2,\), not \(2, 2\)"),
        ("robot.0", np.zeros((1, 2)), r"has shape \(2,\), not \(1, 2\)"),
        ("robot.0", 1.0, r"has shape \(2,\), not \(\)"),
        ("robot.0", [np.nan, 0.0], "is not finite"),
    ],
)
def test_control_that_does_not_fit_is_refused_and_changes_nothing(
    scenario: Scenario, name: str, values: ArrayLike, said: str
) -> None:
    with scenario.start() as simulation:
        with pytest.raises(ValueError, match=said):
            simulation.set_control(name, values)
        assert "outside" not in str(simulation)
        with pytest.raises(KeyError):
            simulation.set_control("robots", [0.0, 0.0])


def test_control_from_outside_holds_at_instants_between_steps_too(path: Path) -> None:
    late = {"agents.robot.components.steer.period": 0.03}
    with sa.load(path, late).start(mode="asynchronous") as simulation:
        simulation.set_control("robot", [0.0, 2.0])
        start = simulation.state("robot", "x", "y")
        simulation.step(10)
        assert (simulation.state("robot", "x", "y") == start).all()


def test_events_are_those_of_the_last_call(scenario: Scenario) -> None:
    with scenario.start() as simulation:
        assert [event.name for event in simulation.events] == ["started"]
        simulation.step()
        assert "started" not in [event.name for event in simulation.events]
        simulation.finish()
        assert simulation.events[-1].name == "finished"


def test_who_leaves_early_has_a_log_that_is_finished_and_ends_with_the_last_state(scenario: Scenario) -> None:
    with scenario.start(output="a.mcap") as simulation:
        simulation.step(5)
        with pytest.raises(RuntimeError, match="goes on"):
            _ = simulation.result
    assert simulation.result.status == "interrupted"
    log = sa.open_log("a.mcap")
    assert log.verify() is None
    outcome = {"status": "interrupted", "steps": 5, "time": 250_000_000, "specifications": []}
    assert log.outcome == {**outcome, "evaluated": 200_000_000, "complete": False}
    assert (log.series("robot", "world").values[-1] == simulation.state("robot")).all()
    assert len(log.series("robot", "world").times) == 6


def test_an_exception_that_leaves_the_block_finishes_the_log_and_goes_on(scenario: Scenario) -> None:
    def leave() -> None:
        with scenario.start(output="a.mcap") as simulation:
            simulation.step(5)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        leave()
    log = sa.open_log("a.mcap")
    assert log.outcome is not None
    assert log.outcome["status"] == "interrupted"
    assert list(log.events())[-1].text == "ended between two steps by ZeroDivisionError"


def test_without_a_block_it_is_closed_by_hand(scenario: Scenario) -> None:
    simulation = scenario.start(output="a.mcap")
    simulation.step()
    simulation.close()
    simulation.close()
    assert present(sa.open_log("a.mcap").outcome)["steps"] == 1
    assert simulation.done


def test_a_failure_in_a_step_is_raised_and_finishes_the_log(path: Path, doubles: Path) -> None:
    path.write_text(path.read_text().replace("steer:", "bad: {use: doubles.fault, with: {at: 0.5}}\n      steer:"))
    with pytest.raises(sa.RunFailedError) as caught, sa.load(path).start(output="a.mcap") as simulation:
        simulation.step(40)
    assert caught.value.time == 0.5
    assert simulation.result.status == present(sa.open_log("a.mcap").outcome)["status"] == "failed"


def test_between_two_steps_signals_are_the_callers(scenario: Scenario) -> None:
    before = signal.getsignal(signal.SIGINT)
    with scenario.start(output="a.mcap") as simulation:
        simulation.step()
        assert signal.getsignal(signal.SIGINT) is before
        with pytest.raises(KeyboardInterrupt) as caught:
            signal.raise_signal(signal.SIGINT)
        assert not isinstance(caught.value, sa.RunInterrupted)
        assert simulation.finish().status == "finished"


def test_ctrl_c_within_a_step_ends_the_run(path: Path) -> None:
    def press(event: Event) -> None:
        if event.name == "contact":
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(sa.RunInterrupted), sa.load(path).start(output="a.mcap", on_event=press) as simulation:
        simulation.step(40)
    assert simulation.done
    assert present(sa.open_log("a.mcap").outcome)["status"] == "interrupted"


def test_ctrl_c_as_a_step_ends_is_not_kept_for_the_next(scenario: Scenario) -> None:
    with scenario.start(output="a.mcap") as simulation:
        simulation._simulation.events.subscribe("stepped", lambda event: signal.raise_signal(signal.SIGINT))
        with pytest.raises(sa.RunInterrupted):
            simulation.step()
    assert present(sa.open_log("a.mcap").outcome)["status"] == "interrupted"


def test_a_run_that_ends_by_its_condition_is_done_then(path: Path) -> None:
    scenario = sa.load(path, {"run.until": "time >= 0.5"})
    with scenario.start(output="steps.mcap") as simulation:
        made = simulation.step(40)
    assert (made, simulation.result.status) == (10, "finished")
    assert identity("steps.mcap") == identity(present(scenario.run(output="run.mcap").log_path))


def test_what_is_shown_tells_where_it_stands(scenario: Scenario) -> None:
    with scenario.start() as simulation:
        simulation.step(2)
        simulation.set_control("robot.0", [0.0, 0.0])
        assert repr(simulation) == "<SteppedSimulation swap: stands at 0.1 s, step 2 of 40>"
        assert "1 controlled from outside" in simulation._repr_html_()


def test_a_signal_of_a_component_is_read_like_a_part_of_awareness() -> None:
    with sa.load(CHECKOUT / "scenarios" / "market.yaml").start() as simulation:
        assert np.isnan(simulation.awareness("robot", "keep.barrier")).all()
        simulation.step(2)
        assert np.isfinite(simulation.awareness("robot", "keep.barrier")).all()
