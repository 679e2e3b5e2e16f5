"""Benchmark of monitoring ``always[0,5] (a implies eventually[0,2] b)`` at 20 Hz, given the robustness of a and b.

``python benchmarks/specifications.py [--rounds N]`` prints the CPU time per agent and instant, for one agent and for
1,000, of monitors with and without the interval, which also return exact robustness at each instant; and for one agent
that of rtamt and sentil. The cases alternate, round after round; the minimum counts.
"""

import argparse
import json
import statistics
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from symaware_cli.specification import Monitor
from symaware_cli.specification.formula import Always, Array, Eventually, Not, Or, Predicate

FORMULA = Always(0, 100, Or((Not(Predicate(0)), Eventually(0, 40, Predicate(1)))))
WRITTEN = "{always}[0,100] ((a >= 0) {implies} ({eventually}[0,40] (b >= 0)))"


def signals(agents: int, instants: int) -> list[tuple[Array, Array]]:
    """Return the robustness of a and b at each instant: a holds at times, and b soon after."""
    generator = np.random.default_rng(1)
    phases = generator.uniform(0.0, 2.0 * np.pi, agents)
    times = 0.05 * np.arange(instants)
    return [(np.sin(0.9 * t + phases) - 0.5, np.sin(2.9 * t + phases) + 0.1) for t in times]


def ours(agents: int, interval: bool) -> Callable[[Sequence[tuple[Array, Array]]], None]:
    """Return a function that runs a monitor of the given number of agents."""

    def run(samples: Sequence[tuple[Array, Array]]) -> None:
        monitor = Monitor(FORMULA, agents, interval=interval)
        for each in samples:
            monitor.update(each)
            monitor.exact()

    return run


def rtamt_online() -> Callable[[Sequence[tuple[Array, Array]]], None]:
    """Return a function that runs the monitor of rtamt for the same formula, rewritten in past operators."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import rtamt

    def run(samples: Sequence[tuple[Array, Array]]) -> None:
        for i, (a, b) in enumerate(samples):
            specification.update(i, [("a", float(a[0])), ("b", float(b[0]))])

    specification = rtamt.StlDiscreteTimeOnlineSpecification()
    for name in ("a", "b"):
        specification.declare_var(name, "float")
    specification.spec = WRITTEN.format(always="always", eventually="eventually", implies="implies")
    specification.parse()
    specification.pastify()
    return run


def sentil_online() -> Callable[[Sequence[tuple[Array, Array]]], None]:
    """Return a function that runs the monitor of sentil for the same formula."""
    import sentil

    monitor = sentil.OnlineMonitor(WRITTEN.format(always="G", eventually="F", implies="->"))

    def run(samples: Sequence[tuple[Array, Array]]) -> None:
        monitor.reset()
        for i, (a, b) in enumerate(samples):
            monitor.update(float(i), {"a": float(a[0]), "b": float(b[0])})

    return run


SWARM = Path(__file__).parents[1] / "scenarios" / "swarm.yaml"
THREE: Mapping[str, Mapping[str, str]] = {
    "safe": {"each": "vehicle", "formula": "always inside(position, arena)"},
    "arrive": {"each": "vehicle", "formula": "eventually[0, 60] distance(position, goal) < 1"},
    "apart": {"pairs": "vehicle", "formula": "always distance > 0.6"},
}


def swarm(seconds: float, rounds: int) -> dict[str, float]:
    """Return the CPU time of a recorded run of a thousand vehicles, without specifications and with three [s]."""
    from symaware_cli import load

    arena = {"arena": {"box": [-80, 80, -80, 80]}}
    cases: dict[str, dict[str, Any]] = {"no specification": {}}
    for name, interval in (("three without intervals", False), ("three with intervals", True)):
        stated = {key: {**each, "interval": interval} for key, each in THREE.items()}
        cases[name] = {"regions": arena, "specifications": stated}
    least = dict.fromkeys(cases, np.inf)
    with TemporaryDirectory() as folder:
        for _ in range(rounds):
            for name, changes in cases.items():
                scenario = load(SWARM, {"run.duration": seconds, **changes})
                began = time.process_time()
                scenario.run(output=Path(folder) / "swarm.mcap")
                least[name] = min(least[name], time.process_time() - began)
    return least


def main() -> None:
    """Measure, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--instants", type=int, default=1000)
    parser.add_argument("--no-peers", action="store_true", help="measure SymAware alone")
    parser.add_argument("--json", action="store_true", help="print the least nanoseconds")
    parser.add_argument("--swarm", type=float, metavar="SECONDS", help="run scenarios/swarm.yaml with and without")
    arguments = parser.parse_args()
    if arguments.swarm:
        least = swarm(arguments.swarm, arguments.rounds)
        for name, spent in least.items():
            print(f"{name}: {spent:.2f} s, {spent / least['no specification']:.3f} times that of none")
        return
    cases = {
        "one agent": (1, ours(1, False), 5000.0),
        "one agent, interval": (1, ours(1, True), 15000.0),
        "1,000 agents": (1000, ours(1000, False), 25.0),
        "1,000 agents, interval": (1000, ours(1000, True), 400.0),
    }
    if not arguments.no_peers:
        cases["one agent, rtamt"] = (1, rtamt_online(), np.nan)
        cases["one agent, sentil, interval"] = (1, sentil_online(), np.nan)
    samples = {agents: signals(agents, arguments.instants) for agents in (1, 1000)}
    found: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(arguments.rounds):
        for name, (agents, run, _) in cases.items():
            began = time.process_time()
            run(samples[agents])
            found[name].append(1e9 * (time.process_time() - began) / agents / arguments.instants)
    if arguments.json:
        print(json.dumps({name: min(each) for name, each in found.items()}))
        return
    print("| | ns for each agent and instant, least (median) | aim |\n|---|---:|---:|")
    for name, each in found.items():
        aim = cases[name][2]
        limit = "" if np.isnan(aim) else f"<= {aim:,.0f}"
        print(f"| {name} | {min(each):,.0f} ({statistics.median(each):,.0f}) | {limit} |")


if __name__ == "__main__":
    main()
