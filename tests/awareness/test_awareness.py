"""Awareness: nothing that was read or written aliases anything else."""

import numpy as np
import pytest
from simulating import Team, simulation

from symaware_cli import Agent, AwarenessVector, Environment, TimeSeries


@pytest.fixture
def pair() -> tuple[tuple[Agent, ...], Environment]:
    """Two agents of one group, and the world they are in."""
    ready = simulation({"robot": Team(count=2)})
    return ready.groups[0].agents, ready.environment


def test_two_vectors_share_no_default() -> None:
    one, other = AwarenessVector("a", [0.0]), AwarenessVector("b", [0.0])
    one.intent = TimeSeries({0.0: [1.0]})
    assert len(other.intent) == len(other.risk) == len(other.uncertainty) == 0


def test_a_vector_does_not_follow_the_array_it_was_made_from() -> None:
    state = np.zeros(2)
    vector = AwarenessVector("a", state)
    state[:] = 5
    assert vector.state.tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        vector.state[0] = 1


def test_an_agent_reads_a_copy_of_its_own_values(pair: tuple[tuple[Agent, ...], Environment]) -> None:
    (agent, _), _ = pair
    agent.self_state[:] = 9
    agent.self_awareness.state[:] = 9
    agent.awareness_database["robot.0"].state[:] = 9
    agent.control_input[:] = 9
    assert agent.self_state.tolist() == [0.0, 0.0]
    assert agent.control_input.tolist() == [0.0, 0.0]


def test_values_that_an_agent_writes_about_itself_are_copied_and_reach_no_other_agent(
    pair: tuple[tuple[Agent, ...], Environment],
) -> None:
    (agent, other), _ = pair
    state, control = np.array([3.0, 4.0]), np.array([1.0, 1.0])
    agent.self_awareness.state = state
    agent.model.control_input = control
    state[:], control[:] = 9, 9
    assert agent.self_state.tolist() == [3.0, 4.0]
    assert agent.model.control_input.tolist() == [1.0, 1.0]
    assert other.self_state.tolist() == [1.0, 0.0]
    assert other.model.control_input.tolist() == [0.0, 0.0]


def test_beliefs_do_not_move_agents(pair: tuple[tuple[Agent, ...], Environment]) -> None:
    (agent, _), world = pair
    agent.self_awareness.state = [100.0, 100.0]
    world.step()
    assert world.state(agent.group).tolist() == [[0.0, 0.0], [1.0, 0.0]]


def test_the_truth_cannot_be_written_by_a_perception(
    pair: tuple[tuple[Agent, ...], Environment],
) -> None:
    (agent, _), world = pair
    snapshot = world.snapshot()
    truths = [world.state(agent.group), snapshot.state("robot.0"), snapshot.positions, snapshot.velocities]
    for truth in [*truths, *snapshot.states, agent.group.initial_state]:
        with pytest.raises(ValueError, match="read-only"):
            truth[...] = 5


def test_a_snapshot_is_not_changed_by_later_steps(pair: tuple[tuple[Agent, ...], Environment]) -> None:
    (agent, _), world = pair
    before = world.snapshot()
    agent.model.control_input = [1.0, 0.0]
    states, positions = [state.copy() for state in before.states], before.positions.copy()
    for _ in range(3):
        world.step()
    assert before.states[0].tolist() == states[0].tolist()
    assert before.positions.tolist() == positions.tolist()
    assert world.snapshot().positions[0, 0] == pytest.approx(0.15)
    assert (before.time, world.snapshot().time) == (0, 150_000_000)


def test_the_initial_state_never_changes(pair: tuple[tuple[Agent, ...], Environment]) -> None:
    (agent, _), world = pair
    agent.self_awareness.state = [5.0, 5.0]
    agent.model.control_input = [1.0, 0.0]
    world.step()
    assert agent.group.initial_state.tolist() == [[0.0, 0.0], [1.0, 0.0]]


def test_the_database_initially_has_only_the_agent_itself(
    pair: tuple[tuple[Agent, ...], Environment],
) -> None:
    (agent, _), _ = pair
    database = agent.awareness_database
    assert list(database) == ["robot.0"]
    assert len(database) == 1
    assert "robot.1" not in database
    with pytest.raises(KeyError):
        database["robot.1"]


def test_values_written_about_others_are_in_the_own_database_only(
    pair: tuple[tuple[Agent, ...], Environment],
) -> None:
    (agent, other), _ = pair
    agent.awareness_database["robot.1"] = AwarenessVector("robot.1", [7.0, 7.0])
    agent.awareness_database["ghost"] = AwarenessVector("ghost", [8.0, 8.0, 0.0, 0.0])
    assert sorted(agent.awareness_database) == ["ghost", "robot.0", "robot.1"]
    assert list(other.awareness_database) == ["robot.1"]
    assert other.self_state.tolist() == [1.0, 0.0]
    del agent.awareness_database["ghost"]
    assert "ghost" not in agent.awareness_database


def test_an_omniscient_agent_has_one_snapshot_and_its_own_values_take_precedence(
    pair: tuple[tuple[Agent, ...], Environment],
) -> None:
    (agent, other), world = pair
    agent.group.awareness.world = world.snapshot()
    assert list(agent.awareness_database) == ["robot.0", "robot.1"]
    assert list(other.awareness_database) == ["robot.1", "robot.0"]
    assert agent.awareness_database["robot.1"].state.tolist() == [1.0, 0.0, 0.0, 0.0]
    agent.awareness_database["robot.1"] = AwarenessVector("robot.1", [7.0, 7.0, 1.0, 2.0])
    assert agent.awareness_database["robot.1"].state.tolist() == [7.0, 7.0, 1.0, 2.0]
    with pytest.raises(KeyError):
        agent.awareness_database["ghost"]


def test_writing_the_own_entry_writes_the_own_awareness(pair: tuple[tuple[Agent, ...], Environment]) -> None:
    (agent, _), _ = pair
    risk = TimeSeries({0.0: 0.5})
    agent.awareness_database["robot.0"] = AwarenessVector("robot.0", [2.0, 2.0], risk=risk)
    assert agent.self_state.tolist() == [2.0, 2.0]
    assert agent.self_awareness.risk == risk


def test_the_order_of_others_does_not_depend_on_the_order_of_perception(
    pair: tuple[tuple[Agent, ...], Environment],
) -> None:
    (agent, _), _ = pair
    for id in ("z", "a", "m"):
        agent.awareness_database[id] = AwarenessVector(id, [0.0, 0.0])
    assert list(agent.awareness_database) == ["robot.0", "a", "m", "z"]
