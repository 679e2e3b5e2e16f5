"""Benchmark of messages delivered per second of CPU time: ``python communication.py [AGENTS] [--record]``.

Agents in a plane, each with about 20 others within range, send their states ten times a second and track the states
they receive. Only the CPU time of the run is counted, without imports and building the scenario.
"""

import argparse
import json
import math
import tempfile
import time
from pathlib import Path

from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

#: Average number of others within range of an agent.
_NEIGHBOURS = 20


def scenario(agents: int, duration: float, channel: str) -> str:
    """Return a scenario of moving agents, with a density that does not depend on their number."""
    reach = 5.0
    side = math.sqrt(agents * math.pi * reach * reach / _NEIGHBOURS)
    place = f"[{{uniform: [0, {side}]}}, {{uniform: [0, {side}]}}]"
    return f"""
symaware: 1
name: communication
seed: 1
run: {{duration: {duration}}}
environment: {{use: kinematic, with: {{time_step: 0.05}}}}
agents:
  robot:
    count: {agents}
    model: {{use: single-integrator, with: {{max_speed: 1.0}}}}
    state: {place}
    knowledge: {{goal: {place}}}
    components:
      sense: {{use: perception.self}}
      tell: {{use: communication.state, period: 0.1}}
      hear: {{use: communication.inbox, period: 0.1, offset: 0.05}}
      steer: {{use: control.go-to-goal}}
topology: {{use: range, with: {{range: {reach}, hysteresis: 0.5}}, channel: {channel}}}
"""


def main() -> None:
    """Run the benchmark and print its figures as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("agents", type=int, nargs="?", default=1000)
    parser.add_argument("--duration", type=float, default=10.0, help="simulated time [s]")
    parser.add_argument("--channel", default="{delay: 0.02, jitter: 0.01, loss: 0.05}")
    parser.add_argument("--record", action="store_true", help="also write a log")
    parser.add_argument("--profile", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path, log = Path(folder) / "benchmark.yaml", Path(folder) / "benchmark.mcap"
        # A short run first, so that imports and caches are not counted.
        path.write_text(scenario(100, 0.5, arguments.channel))
        execute(build(path), Path(folder) / "warm.mcap")
        path.write_text(scenario(arguments.agents, arguments.duration, arguments.channel))
        built = build(path)
        if arguments.profile:
            _profile(lambda: execute(built, log if arguments.record else None))
            return
        started = time.process_time()
        summary = execute(built, log if arguments.record else None)
        cpu = time.process_time() - started
        exchange = built.simulation.exchange
        print(
            json.dumps(
                {
                    "agents": arguments.agents,
                    "status": summary.status,
                    "cpu": round(cpu, 3),
                    "sent": exchange.sent,
                    "delivered": exchange.delivered,
                    "dropped": exchange.dropped,
                    "in_flight": exchange.in_flight,
                    "deliveries_per_cpu_second": round(exchange.delivered / cpu),
                    "log_bytes": log.stat().st_size if arguments.record else None,
                }
            )
        )


def _profile(call: object) -> None:
    import cProfile
    import pstats

    profile = cProfile.Profile()
    profile.runcall(call)  # type: ignore[arg-type]
    pstats.Stats(profile).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
