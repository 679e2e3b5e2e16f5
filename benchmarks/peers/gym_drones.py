"""gym-pybullet-drones: drones that its PID holds in place; prints CPU time and agent-steps of the controller.

``gym_pybullet_drones`` must be importable (repository utiasDSL/gym-pybullet-drones, version 2.1).
"""

import argparse
import json
import time

import numpy as np
from gym_pybullet_drones.control.DSLPIDControl import DSLPIDControl
from gym_pybullet_drones.envs.CtrlAviary import CtrlAviary
from gym_pybullet_drones.utils.enums import DroneModel, Physics

parser = argparse.ArgumentParser()
parser.add_argument("agents", type=int)
parser.add_argument("steps", type=int)
arguments = parser.parse_args()
count = arguments.agents
places = np.column_stack([np.arange(count), np.zeros(count), np.ones(count)]).astype(float)
world = CtrlAviary(
    drone_model=DroneModel.CF2X,
    num_drones=count,
    initial_xyzs=places,
    physics=Physics.PYB,
    pyb_freq=240,
    ctrl_freq=48,
    gui=False,
)
control = [DSLPIDControl(drone_model=DroneModel.CF2X) for _ in range(count)]
velocity = np.array([0.3, 0.1, 0.05])
action = np.zeros((count, 4))


def steps(first: int, number: int) -> None:
    """Make some steps: the physics, then a turn of each controller."""
    for step in range(first, first + number):
        seen, *_ = world.step(action)
        for row in range(count):
            target = places[row] + velocity * step / 48
            action[row], _, _ = control[row].computeControlFromState(
                control_timestep=1 / 48, state=seen[row], target_pos=target, target_vel=velocity
            )


steps(0, 2)
started = time.process_time()
steps(2, arguments.steps)
cpu = time.process_time() - started
world.close()
print(json.dumps({"cpu": cpu, "agent_steps": count * arguments.steps}))
