"""A run that is ready to begin."""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from simulating import Team, execute, present, simulate, simulation

from symaware_cli import Agent, AwarenessDatabase, Component, Entity, GroupComponent, KnowledgeDatabase, Obstacle
from symaware_cli.core.entity_group import EntityGroup
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.engine.runtime.failure import RunError


class Idle(Component):
    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        pass


class GroupIdle(GroupComponent):
    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        pass


def test_every_component_knows_its_path() -> None:
    ready = simulation({"robot": Team({"own": Idle, "shared": GroupIdle}, count=2), "car": Team({"own": Idle})})
    assert [component.path for entry in ready.entries for component in entry.components] == [
        "agents.car.own",
        "agents.robot.0.own",
        "agents.robot.1.own",
        "agents.robot.shared",
    ]
    assert {component.use for entry in ready.entries for component in entry.components} == {"test.own", "test.shared"}


def test_components_begin_with_the_awareness_and_knowledge_of_their_agent() -> None:
    given = []

    class Notes(Idle):
        def initialise_component(
            self,
            agent: Agent,
            initial_awareness_database: AwarenessDatabase,
            initial_knowledge_database: Mapping[str, KnowledgeDatabase],
        ) -> None:
            super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
            given.append((agent.id, list(initial_awareness_database), dict(initial_knowledge_database)))

    simulation({"robot": Team({"note": Notes}, count=2, knowledge=[{"a": 1}, {"a": 2}])}).initialise()
    assert given == [
        ("robot.0", ["robot.0"], {"robot.0": {"a": 1}}),
        ("robot.1", ["robot.1"], {"robot.1": {"a": 2}}),
    ]


def test_events_of_a_run_are_announced_in_order() -> None:
    ready = simulation({"robot": Team({"own": Idle})})
    seen = []
    for name in (
        *("started", "initialising", "initialised", "iterating", "computing", "computed", "updating", "updated"),
        *("iterated", "stepping", "stepped", "finished"),
    ):
        ready.events.subscribe(name, lambda event: seen.append(event.name))
    execute(ready, 2)
    step = [
        *("iterating", "computing", "computed", "updating", "updated", "iterated", "stepping", "stepped"),
    ]
    assert seen == ["started", "initialising", "initialised", *step, *step, "finished"]


def test_a_world_that_cannot_be_set_up_is_a_located_failure() -> None:
    class Broken(KinematicEnvironment):
        def initialise(self, groups: Sequence[EntityGroup], obstacles: Mapping[str, Obstacle], seed: int) -> None:
            raise ValueError("no room")

    with pytest.raises(RunError, match=r"environment \(test-world\) failed at 0 s: ValueError: no room"):
        simulation({"robot": Team()}, environment=Broken())


def test_the_summary_counts_agents_steps_and_contacts() -> None:
    body = Entity.model_validate({"shape": {"circle": {"radius": 0.6}}})
    wall = Obstacle.model_validate({"shape": {"circle": {"radius": 0.5}}, "position": [3.9, 0.0]})
    team = Team(count=4, entity=body, state=[[0, 0], [1, 0], [3, 0], [100, 0]])
    summary = simulate({"robot": team}, steps=4, obstacles={"wall": wall})
    assert (summary.agents, summary.steps, summary.simulated_time, summary.status) == (4, 4, 0.2, "finished")
    assert summary.contacts == 2
    assert present(summary.minimum_separation).value == pytest.approx(1.0 - 2 * 0.6), "from outline to outline"
    assert present(summary.minimum_separation).who == ("robot.0", "robot.1")


def test_agents_in_one_place_are_the_closest_two_and_not_one_with_itself() -> None:
    summary = simulate({"robot": Team(count=3, state=[[5, 0], [0, 0], [0, 0]])})
    assert present(summary.minimum_separation).value == 0.0
    assert present(summary.minimum_separation).who == ("robot.1", "robot.2")


@pytest.mark.parametrize("count", [3, 80])
def test_the_minimum_separation_is_the_least_of_all_steps_with_its_time_and_pair(count: int) -> None:
    class Falls(Component):
        def _compute(self) -> Any:
            return [1.0, 0.0] if self._agent.row == 0 else [0.0, 0.0]

        def _update(self, value: Any) -> None:
            self._agent.model.control_input = value

    # Agent 0 passes the third one at x = 0.2, 0.01 m beside it; the others stand a metre and more apart.
    state: list[list[float]] = [[0, 0], [-1, 0.0], [0.2, 0.01], *([float(row), 50.0] for row in range(count - 3))]
    summary = simulate({"robot": Team({"fall": Falls}, count=count, state=state)}, steps=10)
    assert present(summary.minimum_separation).value == pytest.approx(0.01)
    assert present(summary.minimum_separation).time == pytest.approx(0.2)
    assert present(summary.minimum_separation).who == ("robot.0", "robot.2")


def test_one_agent_alone_is_near_nobody() -> None:
    assert simulate({"robot": Team()}).minimum_separation is None
