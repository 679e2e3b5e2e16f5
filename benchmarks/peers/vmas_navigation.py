"""VMAS: ``navigation`` in one environment, without lidar; prints CPU time and agent-steps."""

import argparse
import json
import time
import warnings

import torch
import vmas

warnings.filterwarnings("ignore")
torch.set_num_threads(1)

parser = argparse.ArgumentParser()
parser.add_argument("agents", type=int)
parser.add_argument("steps", type=int)
arguments = parser.parse_args()
env = vmas.make_env(
    "navigation", num_envs=1, device="cpu", continuous_actions=True, seed=0, n_agents=arguments.agents, collisions=False
)
env.reset()
actions = [torch.full((1, 2), 0.5) for _ in range(arguments.agents)]
env.step(actions)
started = time.process_time()
for _ in range(arguments.steps):
    env.step(actions)
cpu = time.process_time() - started
print(json.dumps({"cpu": cpu, "agent_steps": arguments.agents * arguments.steps}))
