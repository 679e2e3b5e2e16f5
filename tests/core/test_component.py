"""The component families, as authors of plugins use them."""

import asyncio
import inspect
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulating import STEP, Command, Team, execute, simulate, simulation, untyped

from symaware_cli import (
    Agent,
    AwarenessDatabase,
    CommunicationReceiver,
    CommunicationSender,
    Component,
    Controller,
    Event,
    GroupComponent,
    KnowledgeDatabase,
    Message,
    PerceptionSystem,
    RiskEstimator,
    Snapshot,
    TimeSeries,
    UncertaintyEstimator,
    open_log,
)

PAPER = """\
class MyController(Controller):
    def _compute(self):
        state = self._agent.self_state
        goal = self._agent.self_knowledge["goal"]
        return goal - state, TimeSeries()
    def _update(self, value):
        control_input, intent = value
        self._agent.model.control_input = control_input
        self._agent.self_awareness.intent = intent
"""


def test_the_papers_controller_runs_unchanged_from_a_scenario(doubles: Path, command: Command, tmp_path: Path) -> None:
    assert PAPER in doubles.with_name("paper_controller.py").read_text()
    (tmp_path / "paper.yaml").write_text(
        """
symaware: 1
name: paper
run: {duration: 5.0}
environment: {use: kinematic}
agents:
  robot:
    count: 2
    model: {use: single-integrator}
    knowledge: {goal: [[8.0, 0.0], [0.0, 8.0]]}
    components: {see: {use: perception.self}, steer: {use: doubles.paper}}
"""
    )
    done = command("run", "paper.yaml")
    assert done.returncode == 0, done.stderr
    series = open_log(tmp_path / "paper.mcap").series("robot", "world")
    # x' = goal - x, from the origin: x = goal (1 - exp(-t)), sampled and held for 0.05 s.
    assert np.allclose(series.values[-1], np.array([[8.0, 0.0], [0.0, 8.0]]) * (1 - 0.95**100))


def test_a_component_without_abstract_methods_implemented_cannot_be_made() -> None:
    families: list[Any] = [PerceptionSystem, RiskEstimator, UncertaintyEstimator, CommunicationSender, Controller]
    for family in families:
        with pytest.raises(TypeError, match="_compute"):
            family()
    with pytest.raises(TypeError, match="_update"):
        untyped(CommunicationReceiver)()


class SeesAhead(PerceptionSystem):
    def _compute(self) -> dict[str, NDArray[np.float64] | list[float]]:
        return {self._agent.id: self.perceive_self_state() + 1, "ghost": [3.0, 4.0]}


class SeesAll(PerceptionSystem):
    def _compute(self) -> Snapshot:
        return self.environment.snapshot()


class Fears(RiskEstimator):
    def _compute(self) -> TimeSeries:
        return TimeSeries({self.time: 0.25 + self.agent.row})


class Doubts(UncertaintyEstimator):
    def _compute(self) -> TimeSeries:
        return TimeSeries({self.time: [0.1, 0.2]})


def test_perception_writes_the_agents_own_state_and_those_of_others() -> None:
    ready = simulation({"robot": Team({"see": SeesAhead}, count=2)})
    execute(ready, 1)
    agent = ready.groups[0].agents[1]
    assert agent.self_state.tolist() == [2.0, 1.0]
    assert np.array_equal(agent.awareness_database["ghost"].state, [3.0, 4.0, np.nan, np.nan], equal_nan=True)
    assert ready.environment.state(ready.groups[0]).tolist() == [[0.0, 0.0], [1.0, 0.0]]


def test_perceiving_others_again_keeps_other_beliefs_about_them() -> None:
    ready = simulation({"robot": Team({"see": SeesAhead})})
    ready.initialise()
    see = ready.entries[0].components[0]
    see.compute_and_update()
    database = ready.groups[0].agents[0].awareness_database
    database["ghost"].risk = TimeSeries({0.0: 0.7})
    see.compute_and_update()
    assert database["ghost"].risk == TimeSeries({0.0: 0.7})


def test_one_agent_of_a_group_may_perceive_everything() -> None:
    ready = simulation({"robot": Team({"see": SeesAll}, count=2), "car": Team()})
    execute(ready, 1)
    agents = {agent.id: agent for group in ready.groups for agent in group.agents}
    assert list(agents["robot.1"].awareness_database) == ["robot.1", "car", "robot.0"]
    assert list(agents["car"].awareness_database) == ["car"]


def test_risk_and_uncertainty_reach_the_awareness_and_the_summary() -> None:
    ready = simulation({"robot": Team({"fear": Fears, "doubt": Doubts}, count=2)})
    summary = execute(ready, 3)
    agent = ready.groups[0].agents[1]
    assert agent.self_awareness.risk == TimeSeries({0.1: 1.25})
    assert agent.self_awareness.uncertainty == TimeSeries({0.1: [0.1, 0.2]})
    assert summary.highest_risk is not None
    assert (summary.highest_risk.value, summary.highest_risk.who) == (1.25, ("robot.1",))


class Counts(Component):
    def _compute(self) -> int:
        return 41

    def _update(self, value: int) -> None:
        self.result = value + 1


def test_a_turn_computes_then_updates_with_events_around_both() -> None:
    ready = simulation({"robot": Team({"count": Counts})})
    seen = []
    for name in ("computing", "computed", "updating", "updated"):
        ready.events.subscribe(name, lambda event: seen.append((event.name, event.source, event.time)))
    ready.initialise()
    component: Any = ready.entries[0].components[0]
    assert component.compute_and_update() == 41
    assert component.result == 42
    expected = [(name, "agents.robot.count", 0) for name in ("computing", "computed", "updating", "updated")]
    assert seen == expected
    seen.clear()
    assert asyncio.run(component.async_compute_and_update()) == 41
    assert seen == expected


def test_the_asynchronous_turn_of_a_component_may_wait() -> None:
    class Waits(Component):
        def _compute(self) -> None:
            raise NotImplementedError

        def _update(self, value: Any) -> None:
            raise NotImplementedError

        async def _async_compute(self) -> str:
            await asyncio.sleep(0)
            return "answer"

        async def _async_update(self, value: str) -> None:
            await asyncio.sleep(0)
            self.result = value

    ready = simulation({"robot": Team({"wait": Waits})})
    ready.initialise()
    component: Any = ready.entries[0].components[0]
    assert asyncio.run(component.async_compute_and_update()) == "answer"
    assert component.result == "answer"


def test_a_component_needs_no_constructor_with_parameters() -> None:
    class Bare(Component):
        def __init__(self) -> None:
            self.turns = 0

        def _compute(self) -> None:
            self.turns += 1

        def _update(self, value: Any) -> None:
            assert self.agent.id == "robot"
            assert self.path == "agents.robot.bare"
            assert self.time == self.now / 1e9

    assert simulate({"robot": Team({"bare": Bare})}).status == "finished"


class Draws(Component):
    def _compute(self) -> float:
        return self.random.random()

    def _update(self, value: float) -> None:
        self._agent.self_awareness.risk = TimeSeries({self.time: value})


class GroupDraws(GroupComponent):
    def _compute(self) -> NDArray[np.float64]:
        return self.random.uniform(1)[:, 0]

    def _update(self, value: NDArray[np.float64]) -> None:
        self._group.awareness.risk.set(self.now, value)


@pytest.mark.parametrize("kind", [Draws, GroupDraws])
def test_draws_of_an_agent_depend_only_on_its_path_and_the_seed(kind: type[Component | GroupComponent]) -> None:
    def drawn(teams: Mapping[str, Team], seed: int = 7) -> dict[str, float]:
        ready = simulation(teams, seed=seed)
        execute(ready, 2)
        return {agent.id: agent.self_awareness.risk[0.05][0] for group in ready.groups for agent in group.agents}

    plain = drawn({"robot": Team({"draw": kind}, count=2)})
    more = drawn({"car": Team({"draw": kind}), "robot": Team({"idle": Counts, "draw": kind}, count=3)})
    assert len(set(more.values())) == 4
    assert {id: more[id] for id in plain} == plain
    assert drawn({"robot": Team({"draw": kind}, count=2)}, seed=8) != plain
    assert drawn({"robot": Team({"other": kind}, count=2)}) != plain


class Speaks(CommunicationSender):
    def _compute(self) -> list[Message]:
        return [Message(self._agent.id, "robot.1", {"state": self._agent.self_state})]


class Listens(CommunicationReceiver):
    def _update(self, value: Sequence[Message]) -> None:
        self.heard = [*getattr(self, "heard", []), [(self.now, message.sent_time) for message in value]]


def test_a_message_sent_in_a_step_is_read_in_the_next() -> None:
    ready = simulation({"robot": Team({"speak": Speaks, "listen": Listens}, count=2)})
    execute(ready, 3)
    assert untyped(ready.entries[1].components[1]).heard == [
        [],
        [(STEP, 0), (STEP, 0)],
        [(2 * STEP, STEP), (2 * STEP, STEP)],
    ]


class Tells(GroupComponent):
    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        self.emit_for(1, "noticed", "saw it", distance=2.0)
        self.emit("counted", number=len(self.group))


def test_events_of_a_group_component_name_the_agent_they_are_about() -> None:
    ready = simulation({"robot": Team({"tell": Tells}, count=2)})
    seen: list[Event] = []
    ready.events.subscribe("*", seen.append, "agents.*")
    execute(ready, 1)
    told = [(event.name, event.source, event.text, dict(event.data)) for event in seen]
    assert ("noticed", "agents.robot.1.tell", "saw it", {"distance": 2.0}) in told
    assert ("counted", "agents.robot.tell", "", {"number": 2}) in told


def test_a_component_can_subscribe_to_its_own_events() -> None:
    heard = []

    class Echo(Component):
        def initialise_component(
            self, agent: Agent, awareness: AwarenessDatabase, knowledge: Mapping[str, KnowledgeDatabase]
        ) -> None:
            super().initialise_component(agent, awareness, knowledge)
            self.subscribe("shout", lambda event: heard.append(event.source))

        def _compute(self) -> None:
            return None

        def _update(self, value: Any) -> None:
            self.emit("shout")

    simulate({"robot": Team({"echo": Echo}, count=2)}, steps=1)
    assert heard == ["agents.robot.0.echo", "agents.robot.1.echo"]


def test_the_core_imports_nothing_above_it() -> None:
    source = Path(inspect.getfile(Component)).parent
    imports = {
        name
        for file in source.glob("*.py")
        for name in re.findall(r"from (symaware_cli[\w.]*) import", file.read_text())
    }
    rooms = {name.split(".")[1] for name in imports}
    assert rooms == {"core", "awareness", "world", "geometry"}
