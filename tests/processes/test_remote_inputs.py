"""The control inputs of agents that run in other processes."""

import numpy as np
from simulating import Team, simulation

from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.processes.remote_inputs import RemoteInputs


def test_agents_that_slow_down_have_control_inputs_of_the_shape_of_before() -> None:
    """Also where they are all agents of their group; the world moves under these."""
    team = Team({}, count=2, state=[[0.0, 0.0], [1.0, 1.0]], model=SingleIntegrator())
    ready = simulation({"robot": team})
    group = ready.groups[0]
    group.control_input = np.ones((2, 2))
    for away in (["robot.0", "robot.1"], ["robot.1"]):
        inputs = RemoteInputs(ready, away)
        inputs.slow_down(group, np.array([1]))
        present = inputs.exchange()
        np.testing.assert_array_equal(group.control_input, [[1, 1], [0, 0]])
        inputs.restore(present)
        np.testing.assert_array_equal(group.control_input, np.ones((2, 2)))


def test_a_single_agent_that_slows_down_has_one_control_input() -> None:
    ready = simulation({"robot": Team({}, count=None, state=[[0.0, 0.0]], model=SingleIntegrator())})
    group = ready.groups[0]
    group.control_input = np.ones((1, 2))
    inputs = RemoteInputs(ready, group.ids)
    inputs.slow_down(group, np.array([0]))
    inputs.exchange()
    np.testing.assert_array_equal(group.control_input, [[0, 0]])
