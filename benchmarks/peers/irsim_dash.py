"""IR-SIM: robots with the behaviour ``dash``; prints CPU time and agent-steps."""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"
import irsim

WORLD = """
world: {{height: {size}, width: {size}, step_time: 0.05}}
robot:
  - number: {agents}
    distribution: {{name: circle, radius: {radius}, center: [{half}, {half}]}}
    kinematics: {{name: diff}}
    shape: {{name: circle, radius: 0.1}}
    behavior: {{name: dash}}
"""

parser = argparse.ArgumentParser()
parser.add_argument("agents", type=int)
parser.add_argument("steps", type=int)
arguments = parser.parse_args()
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "world.yaml"
    path.write_text(WORLD.format(agents=arguments.agents, size=200, half=100, radius=90))
    env = irsim.make(str(path), display=False, disable_all_plot=True, log_level="ERROR")
    env.step()
    started = time.process_time()
    for _ in range(arguments.steps):
        env.step()
    cpu = time.process_time() - started
print(json.dumps({"cpu": cpu, "agent_steps": arguments.agents * arguments.steps}))
