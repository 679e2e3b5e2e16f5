"""JaxMARL: ``MPE_simple_spread_v3`` in many environments, compiled; prints CPU time and agent-steps."""

import argparse
import json
import time
from typing import Any

import jax
import jaxmarl

parser = argparse.ArgumentParser()
parser.add_argument("agents", type=int)
parser.add_argument("steps", type=int)
parser.add_argument("--environments", type=int, default=1)
arguments = parser.parse_args()
count = arguments.environments
env = jaxmarl.make("MPE_simple_spread_v3", num_agents=arguments.agents, num_landmarks=arguments.agents)
keys = jax.random.split(jax.random.PRNGKey(0), count)
_, states = jax.vmap(env.reset)(keys)
actions = {agent: jax.numpy.ones(count, int) for agent in env.agents}


def run(keys: Any, states: Any) -> Any:
    """Make all steps."""

    def step(states: Any, _: None) -> tuple[Any, Any]:
        observations, states, rewards, _, _ = jax.vmap(env.step_env)(keys, states, actions)
        return states, (observations, rewards)

    return jax.lax.scan(step, states, None, length=arguments.steps)


compiled = jax.jit(run)
jax.block_until_ready(compiled(keys, states))
started = time.process_time()
jax.block_until_ready(compiled(keys, states))
cpu = time.process_time() - started
print(json.dumps({"cpu": cpu, "agent_steps": count * arguments.agents * arguments.steps}))
