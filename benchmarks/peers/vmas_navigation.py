"""VMAS: ``navigation`` in one environment or many, without lidar; prints CPU time and agent-steps."""

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
parser.add_argument("--environments", type=int, default=1)
arguments = parser.parse_args()
count = arguments.environments
env = vmas.make_env(
    "navigation",
    num_envs=count,
    device="cpu",
    continuous_actions=True,
    seed=0,
    n_agents=arguments.agents,
    collisions=False,
)
env.reset()
actions = [torch.full((count, 2), 0.5) for _ in range(arguments.agents)]
env.step(actions)
started = time.process_time()
for _ in range(arguments.steps):
    env.step(actions)
cpu = time.process_time() - started
print(json.dumps({"cpu": cpu, "agent_steps": count * arguments.agents * arguments.steps}))
