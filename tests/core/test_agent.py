"""Agents are views of the rows of their group."""

from typing import Any

import numpy as np
import pytest
from simulating import Team, simulation

from symaware_cli import AgentGroup, Entity
from symaware_cli.engine.models.integrator import SingleIntegrator


def group(count: int = 2, **options: Any) -> AgentGroup:
    ids = [f"robot.{row}" for row in range(count)]
    return AgentGroup("robot", ids, SingleIntegrator(), Entity(), np.zeros((count, 2)), **options)


def test_an_agent_reads_and_writes_the_data_of_its_group() -> None:
    robots = group()
    first, second = robots.agents
    robots.control_input = [[1.0, 2.0], [3.0, 4.0]]
    assert second.model.control_input.tolist() == [3.0, 4.0]
    first.model.control_input = [9.0, 9.0]
    assert robots.control_input.tolist() == [[9.0, 9.0], [3.0, 4.0]]
    assert [agent.id for agent in robots.agents] == ["robot.0", "robot.1"]
    assert repr(first) == "Agent('robot.0')"


def test_an_agents_model_has_the_dynamics_of_its_group() -> None:
    agent = group().agents[0]
    assert agent.model.state[0].name == "x"
    assert agent.model.follow_velocity(np.zeros((1, 2)), np.ones((1, 2))).tolist() == [[1.0, 1.0]]


def test_agents_do_not_share_knowledge_that_is_given_once() -> None:
    shared: dict[str, Any] = {"places": ["a", "b"], "map": {"a": [0.0, 0.0]}}
    first, second = group(knowledge=[shared, shared]).agents
    first.self_knowledge["places"] = [*first.self_knowledge["places"], "c"]
    first.self_knowledge["extra"] = 1
    shared["map"]["a"][0] = 5.0
    assert second.self_knowledge == {"places": ["a", "b"], "map": {"a": [0.0, 0.0]}}
    assert second.knowledge_database == {"robot.1": second.self_knowledge}


def test_without_knowledge_each_agent_has_a_separate_empty_database() -> None:
    first, second = group().agents
    first.self_knowledge["goal"] = 1
    assert "goal" not in second.self_knowledge


def test_the_knowledge_of_a_group_is_one_array() -> None:
    robots = group(knowledge=[{"goal": [1, 2]}, {"goal": np.array([3.0, 4.0])}])
    assert robots.known("goal").tolist() == [[1.0, 2.0], [3.0, 4.0]]
    with pytest.raises(KeyError, match="does not know `home`"):
        robots.known("home")


def test_agents_of_one_run_share_their_surroundings() -> None:
    ready = simulation({"robot": Team(count=2), "car": Team()})
    seen = {id(agent.surroundings) for members in ready.groups for agent in members.agents}
    assert len(seen) == 1
