"""MPE2: ``simple_spread`` under constant actions; prints CPU time and agent-steps."""

import argparse
import json
import time

import numpy as np
from mpe2 import simple_spread_v3

parser = argparse.ArgumentParser()
parser.add_argument("agents", type=int)
parser.add_argument("steps", type=int)
arguments = parser.parse_args()
env = simple_spread_v3.parallel_env(N=arguments.agents, max_cycles=10**9, continuous_actions=True)
env.reset(seed=1)
actions = {agent: np.full(5, 0.5, dtype=np.float32) for agent in env.agents}
env.step(actions)
started = time.process_time()
for _ in range(arguments.steps):
    env.step(actions)
cpu = time.process_time() - started
print(json.dumps({"cpu": cpu, "agent_steps": arguments.agents * arguments.steps}))
