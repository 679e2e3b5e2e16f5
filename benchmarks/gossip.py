"""Benchmark of gossip messages delivered per second of CPU time: ``python gossip.py [AGENTS] [--record]``.

One agent knows a rumour at first; each agent that knows it sends it to one other at every step. Only the CPU time of
the run is counted, as in communication.py.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute


def scenario(agents: int, steps: int, channel: str) -> str:
    """Return a scenario of agents that can all reach each other."""
    place = "[{uniform: [0, 1000]}, {uniform: [0, 1000]}]"
    topology = f"topology: {{use: complete, channel: {channel}}}" if channel else ""
    return f"""
symaware: 1
name: gossip
seed: 1
run: {{duration: {0.05 * steps}}}
environment: {{use: kinematic, with: {{time_step: 0.05}}}}
agents:
  robot:
    count: {agents}
    model: {{use: single-integrator}}
    state: {place}
    components: {{tell: {{use: communication.gossip}}}}
  first:
    model: {{use: single-integrator}}
    state: {place}
    knowledge: {{rumour: fire}}
    components: {{tell: {{use: communication.gossip}}}}
{topology}
"""


def main() -> None:
    """Run the benchmark and print its figures as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("agents", type=int, nargs="?", default=1000)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--channel", default="", help="such as '{delay: 0.02, loss: 0.05}'; none by default")
    parser.add_argument("--record", action="store_true", help="also write a log")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path, log = Path(folder) / "benchmark.yaml", Path(folder) / "benchmark.mcap"
        # A short run first, so that imports and caches are not counted.
        path.write_text(scenario(200, 10, arguments.channel))
        execute(build(path), Path(folder) / "warm.mcap")
        path.write_text(scenario(arguments.agents - 1, arguments.steps, arguments.channel))
        built = build(path)
        started = time.process_time()
        summary = execute(built, log if arguments.record else None)
        cpu = time.process_time() - started
        exchange = built.simulation.exchange
        figures = {
            "agents": arguments.agents,
            "status": summary.status,
            "cpu": round(cpu, 3),
            "delivered": exchange.delivered,
            "dropped": exchange.dropped,
            "deliveries_per_cpu_second": round(exchange.delivered / cpu),
            "log_bytes": log.stat().st_size if arguments.record else None,
        }
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
