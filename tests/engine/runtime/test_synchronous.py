"""The order of things within a step."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulating import STEP, Team, execute, simulate, simulation

from symaware_cli import (
    CommunicationReceiver,
    CommunicationSender,
    Component,
    Controller,
    GroupComponent,
    Message,
    TimeSeries,
)


def test_components_run_in_declared_order_and_each_for_every_agent() -> None:
    turns = []

    class Notes(Component):
        def _compute(self) -> None:
            turns.append((self.now, self.path))

        def _update(self, value: Any) -> None:
            pass

    simulate({"robot": Team({"one": Notes, "two": Notes}, count=2), "car": Team({"one": Notes})}, steps=2)
    order = ["car.one", "robot.0.one", "robot.1.one", "robot.0.two", "robot.1.two"]
    assert turns == [(step * STEP, f"agents.{path}") for step in range(2) for path in order]


class Drives(GroupComponent):
    def _compute(self) -> Any:
        return np.tile([1.0, 0.0], (len(self.group), 1))

    def _update(self, value: Any) -> None:
        self.group.control_input = value


def test_the_world_moves_after_the_components_by_their_choices() -> None:
    ready = simulation({"robot": Team({"drive": Drives})})
    execute(ready, 4)
    assert ready.environment.state(ready.groups[0])[0, 0] == pytest.approx(0.2)
    assert ready.clock.now == 4 * STEP


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_a_run_makes_as_many_steps_as_asked_and_the_last_state_is_recorded(steps: int, tmp_path: Path) -> None:
    from symaware_cli import open_log

    log = tmp_path / "run.mcap"
    summary = simulate({"robot": Team({"drive": Drives})}, steps=steps, log=log)
    assert summary.steps == steps
    series = open_log(log).series("robot", "world")
    assert series.times.tolist() == [step * STEP for step in range(steps + 1)]
    assert np.allclose(series.values[:, 0], np.arange(steps + 1) * 0.05)
    assert open_log(log).outcome == {"status": "finished", "steps": steps, "time": steps * STEP, "specifications": []}


class Tells(CommunicationSender):
    """Tells everybody where it believes to be."""

    ids = ("a.0", "a.1", "b.0", "b.1")

    def _compute(self) -> Any:
        me = self._agent.id
        return [Message(me, id, {"state": self._agent.self_state}) for id in self.ids if id != me]


class Gathers(CommunicationReceiver):
    """Remembers all it heard, in order; what it does depends on that order."""

    def _update(self, value: Any) -> None:
        known = self._agent.self_knowledge
        heard = [(message.sender, message.sent_time, message.payload["state"].tolist()) for message in value]
        known["heard"] = [*known.get("heard", ()), heard]


class Follows(Controller):
    """Moves by what was heard last, so that what was heard in which order shows in the state."""

    def _compute(self) -> Any:
        heard = self._agent.self_knowledge.get("heard", [[]])[-1]
        pull = np.array([0.3, 0.1]) * (1 + self._agent.row)
        for _, _, state in heard:
            pull = pull / 3 + np.sin(state)
        return pull, TimeSeries()


@settings(max_examples=20)
@given(
    groups=st.permutations(["a", "b"]),
    listening_first=st.booleans(),
)
def test_the_outcome_does_not_depend_on_the_order_of_agents(groups: list[str], listening_first: bool) -> None:
    def outcome(groups: Sequence[str], names: Sequence[str]) -> dict[str, Any]:
        kinds = {"tell": Tells, "gather": Gathers, "follow": Follows}
        teams = {
            name: Team({each: kinds[each] for each in names}, count=2, state=[[0, ord(name)], [1, ord(name)]])
            for name in groups
        }
        ready = simulation(teams)
        execute(ready, 6)
        return {
            agent.id: (agent.self_knowledge["heard"], ready.environment.state(group)[agent.row].tobytes())
            for group in ready.groups
            for agent in group.agents
        }

    names = ["gather", "tell", "follow"] if listening_first else ["tell", "gather", "follow"]
    assert outcome(groups, names) == outcome(["a", "b"], ["tell", "gather", "follow"])


def test_progress_is_reported_in_simulated_time() -> None:
    from symaware_cli.engine.runtime.run import run

    told: list[Any] = []
    run(simulation({"robot": Team()}), 5, on_progress=told.append)
    assert told
    assert told == sorted(told)
    assert set(told) <= {step * STEP for step in range(6)}
