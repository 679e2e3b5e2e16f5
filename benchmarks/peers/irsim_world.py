"""IR-SIM: one of its worlds without a picture; prints the CPU time of its steps."""

import argparse
import json
import os
import time

os.environ["MPLBACKEND"] = "Agg"
import irsim

parser = argparse.ArgumentParser()
parser.add_argument("world")
parser.add_argument("steps", type=int)
arguments = parser.parse_args()
env = irsim.make(arguments.world, display=False, disable_all_plot=True, log_level="ERROR")
env.step()
started = time.process_time()
for _ in range(arguments.steps):
    env.step()
print(json.dumps({"cpu": time.process_time() - started}))
