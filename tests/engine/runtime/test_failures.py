"""What a scenario says about failures: stop the run, isolate the agent, or restart the component, in both modes."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Team, execute, present, simulate, simulation, untyped

from symaware_cli import (
    Agent,
    AwarenessDatabase,
    Component,
    Controller,
    GroupComponent,
    TimeSeries,
    open_log,
)
from symaware_cli.engine.models.unicycle import Unicycle
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run_summary import RunSummary
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import Timing
from symaware_cli.world.probability_distribution import always

MODES = pytest.mark.parametrize(
    "options", [RunOptions(), RunOptions(mode="asynchronous")], ids=["synchronous", "asynchronous"]
)


class Drives(Controller):
    """Drives ahead, and comes to grief at some time."""

    at = 3 * STEP
    until = 10**18
    row = 1
    how = "raise"

    def initialise_component(self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, Any]) -> None:
        super().initialise_component(agent, awareness, knowledge)
        self.turns = 0

    def _compute(self) -> tuple[list[float], TimeSeries]:
        self.turns += 1
        if self.at <= self.now < self.until and self._agent.row == self.row:
            if self.how == "raise":
                raise ZeroDivisionError("on purpose")
            return [np.nan, 0.0], TimeSeries()
        return [1.0, 0.0], TimeSeries()


class Feels(GroupComponent):
    def _compute(self) -> NDArray[np.float64]:
        return self.environment.state(self.group)

    def _update(self, value: NDArray[np.float64]) -> None:
        self.group.awareness.state = value


def drive(
    timing: Timing, log: Path, options: RunOptions, steps: int = 10, model: Unicycle | None = None, **attributes: Any
) -> tuple[Simulation, RunSummary, list[tuple[int, str, str]]]:
    kind = type("Drives", (Drives,), attributes)
    team = Team({"feel": Feels, "drive": kind}, count=3, timings={"drive": timing})
    if model:
        team.model = model
    ready = simulation({"a": team})
    summary = execute(ready, steps, log, options)
    return ready, summary, [(event.time // STEP, event.name, event.source) for event in open_log(log).events()]


@MODES
@pytest.mark.parametrize("how", ["raise", "nan"])
@pytest.mark.parametrize("coast", ["safe", "last"])
def test_an_isolated_agent_coasts_and_the_others_go_on(
    how: str, coast: Literal["last", "safe"], options: RunOptions, tmp_path: Path
) -> None:
    timing = Timing(on_failure="isolate", coast=coast)
    ready, summary, events = drive(timing, tmp_path / "run.mcap", options, how=how)
    assert (summary.status, summary.failures) == ("finished", 1)
    assert events == [
        (0, "started", "run"),
        (3, "failed", "agents.a.1.drive"),
        (3, "terminated", "agents.a.1"),
        (10, "finished", "run"),
    ]
    travelled = ready.environment.state(ready.groups[0])[:, 0] - [0, 1, 2]
    assert travelled == pytest.approx([0.5, 0.5 if coast == "last" else 0.15, 0.5])
    control = open_log(tmp_path / "run.mcap").series("a.1", "applied_control")
    assert np.isfinite(control.values).all()


@MODES
def test_an_isolated_agent_takes_no_turns_in_any_component(options: RunOptions, tmp_path: Path) -> None:
    ready, _, _ = drive(Timing(on_failure="isolate"), tmp_path / "run.mcap", options)
    assert [untyped(component).turns for component in ready.entries[1].components] == [10, 4, 10]
    believed = ready.groups[0].awareness.state
    # Nobody tells it any more where it is.
    assert believed[1, 0] == pytest.approx(1.15)
    assert believed[0, 0] == pytest.approx(0.45)


@MODES
def test_a_component_is_restarted_so_often_and_no_more(options: RunOptions, tmp_path: Path) -> None:
    timing = Timing(on_failure="restart", tries=2)
    _, summary, events = drive(timing, tmp_path / "run.mcap", options)
    assert summary.status == "failed"
    assert [name for _, name, _ in events] == ["started", "failed", "restarted", "failed", "restarted", "failed"]
    assert [time for time, name, _ in events if name == "failed"] == [3, 4, 5]


@MODES
def test_a_component_that_recovers_goes_on_and_was_initialised_anew(options: RunOptions, tmp_path: Path) -> None:
    timing = Timing(on_failure="restart", tries=3)
    ready, summary, _ = drive(timing, tmp_path / "run.mcap", options, until=5 * STEP)
    assert (summary.status, summary.failures) == ("finished", 2)
    # The turns are counted from the last new beginning on.
    assert [untyped(component).turns for component in ready.entries[1].components] == [10, 5, 10]


def test_an_agent_that_cannot_restart_ends_the_run(tmp_path: Path) -> None:
    class Once(Drives):
        begun = False

        def initialise_component(
            self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, Any]
        ) -> None:
            super().initialise_component(agent, awareness, knowledge)
            if self.begun:
                raise RuntimeError("never again")
            self.begun = True

    team = Team({"drive": Once}, count=2, timings={"drive": Timing(on_failure="restart")})
    summary = simulate({"a": team}, 9, tmp_path / "run.mcap")
    assert summary.status == "failed"
    assert "RuntimeError: never again" in present(summary.failure)
    assert list(open_log(tmp_path / "run.mcap").events())[-1].time == 3 * STEP


class Collective(GroupComponent):
    """Drives everybody, and writes what is not finite for some."""

    def _compute(self) -> NDArray[np.float64]:
        values = np.tile([1.0, 0.0], (3, 1))
        if self.now == 3 * STEP:
            values[1] = np.inf
        return values

    def _update(self, value: NDArray[np.float64]) -> None:
        self.group.control_input = value


@MODES
def test_a_failed_group_component_isolates_only_the_agents_that_it_failed(options: RunOptions, tmp_path: Path) -> None:
    team = Team({"drive": Collective}, count=3, timings={"drive": Timing(on_failure="isolate")})
    ready = simulation({"a": team})
    summary = execute(ready, 10, tmp_path / "run.mcap", options)
    assert summary.status == "finished"
    travelled = ready.environment.state(ready.groups[0])[:, 0] - [0, 1, 2]
    assert travelled == pytest.approx([0.5, 0.15, 0.5])
    events = [(event.name, event.source) for event in open_log(tmp_path / "run.mcap").events()]
    assert ("failed", "agents.a.1.drive") in events
    assert [source for name, source in events if name == "terminated"] == ["agents.a.1"]


def test_a_vehicle_that_cannot_stand_still_coasts_within_its_limits(tmp_path: Path) -> None:
    model = Unicycle(Unicycle.Parameters(max_speed=2.0))
    ready, summary, _ = drive(Timing(on_failure="isolate"), tmp_path / "run.mcap", RunOptions(), model=model)
    assert summary.status == "finished"
    assert ready.groups[0].control_input[1] == pytest.approx([0.0, 0.0])


@MODES
def test_a_turn_that_hangs_is_a_failure_after_the_limit_of_wall_time(options: RunOptions, tmp_path: Path) -> None:
    class Hangs(Drives):
        def _compute(self) -> tuple[list[float], TimeSeries]:
            if self.now == self.at and self._agent.row == 1:
                while True:
                    time.sleep(0.001)
            return super()._compute()

    limited = RunOptions(mode=options.mode, turn_limit=0.2)
    team = Team({"drive": Hangs}, count=3, timings={"drive": Timing(on_failure="stop")})
    summary = simulate({"a": team}, 10, tmp_path / "run.mcap", limited)
    assert summary.status == "failed"
    assert "OverdueError: it did not come back within 0.2 s of wall time" in present(summary.failure)
    assert open_log(tmp_path / "run.mcap").verify() is None


def test_a_failure_that_does_not_end_the_run_drops_the_turn_under_way(tmp_path: Path) -> None:
    landed = []

    class Thinks(Component):
        def _compute(self) -> Any:
            return self.now

        def _update(self, value: Any) -> None:
            landed.append((self._agent.row, value // STEP))

    timings = {
        "think": Timing(period=2 * STEP, latency=always(0.075)),
        "drive": Timing(on_failure="isolate"),
    }
    team = Team({"think": Thinks, "drive": Drives}, count=2, timings=timings)
    simulate({"a": team}, 6, options=RunOptions(mode="asynchronous"))
    # Agent 1 fails at 3; what it began to compute at 2 and would land at 3.5 is given up.
    assert [value for row, value in landed if row == 1] == [0]
    assert [value for row, value in landed if row == 0] == [0, 2, 4]
