"""Benchmark of the asynchronous mode: ``python benchmarks/asynchronous.py`` prints a table.

It measures the turn of a trivial component, for 1,000 components at 100 Hz: all at the same instants, each at different
instants, and as coroutines that sleep. Figures are the CPU time of one process, the best of several rounds, compared
with SimPy's timeout event in the same session (``python benchmarks/run.py`` installs the peers). It then measures how
well a paced run keeps 100 agents at 100 Hz, in wall time, which is meaningful only on an otherwise idle machine.
"""

import argparse
import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

from symaware_cli.core import AgentGroup, Component, Entity
from symaware_cli.engine import ComponentEntry, KinematicEnvironment, RunOptions, RunSummary, Simulation, Timing
from symaware_cli.engine.models.integrator import SingleIntegrator
from symaware_cli.engine.runtime.run import run

Measured = tuple[float, list[int], RunSummary]

HERE = Path(__file__).parent
SIMPY = HERE / ".peers" / "new" / ("Scripts" if os.name == "nt" else "bin") / "python"
MILLISECOND = 1_000_000


class Trivial(Component):
    """Counts its turns."""

    count = 0
    offset: float

    def _compute(self) -> None:
        self.count += 1

    def _update(self, value: None) -> None:
        pass


class Sleeper(Trivial):
    """Sleeps between activations, within one turn that lasts for the whole run."""

    async def _async_compute(self) -> NoReturn:
        await self.sleep(self.offset)
        while True:
            self.count += 1
            await self.sleep(0.01)


def simulation(kind: type[Trivial], count: int, timing: Timing, time_step: float) -> Simulation:
    group = AgentGroup(
        "a",
        [f"a.{row}" for row in range(count)],
        SingleIntegrator(),
        Entity(),
        [[3.0 * row, 0.0] for row in range(count)],
    )
    components = [kind() for _ in range(count)]
    for row, component in enumerate(components):
        component.offset = 0.01 * row / count
    world = KinematicEnvironment(KinematicEnvironment.Parameters(time_step=time_step))
    return Simulation(
        name="benchmark",
        seed=1,
        environment=world,
        environment_use="kinematic",
        groups=[group],
        entries=[ComponentEntry(group, "it", "benchmark", components, timing)],
        obstacles={},
    )


def counts(ready: Simulation) -> list[int]:
    return [each.count for each in ready.entries[0].components if isinstance(each, Trivial)]


def measured(
    kind: type[Trivial], count: int, timing: Timing, duration: float, time_step: float = 0.1, pace: float | None = None
) -> Measured:
    """Run a simulation; return its CPU time, the number of turns of each component, and the summary."""
    ready = simulation(kind, count, timing, time_step)
    started = time.process_time()
    summary = run(ready, round(duration / time_step), options=RunOptions(mode="asynchronous", pace=pace))
    cpu = time.process_time() - started
    assert summary.status == "finished", summary.failure
    return cpu, counts(ready), summary


def cases(count: int, duration: float) -> Iterator[tuple[str, Callable[[], Measured]]]:
    """Yield every case by name, as a function that measures it."""
    together = Timing(period=10 * MILLISECOND)
    apart = Timing(period=10 * MILLISECOND, jitter=9 * MILLISECOND)
    yield "at the same instants", lambda: measured(Trivial, count, together, duration)
    yield "each at instants of its own", lambda: measured(Trivial, count, apart, duration)
    yield "coroutines that sleep", lambda: measured(Sleeper, count, Timing(), duration)
    yield "synchronous, for comparison", lambda: synchronous(count, duration)


def synchronous(count: int, duration: float) -> Measured:
    ready = simulation(Trivial, count, Timing(), 0.01)
    started = time.process_time()
    summary = run(ready, round(duration / 0.01))
    return time.process_time() - started, counts(ready), summary


def simpy(count: int, turns: int) -> Any:
    """Measure the same with SimPy; None if it is not installed."""
    if not SIMPY.exists():
        return None
    command = [str(SIMPY), str(HERE / "peers" / "simpy_timeout.py"), str(count), str(turns)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return json.loads(done.stdout) if done.returncode == 0 else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--agents", type=int, default=1000)
    parser.add_argument("--duration", type=float, default=10.0)
    arguments = parser.parse_args()
    best: dict[str, float] = {}
    for _ in range(arguments.rounds):
        for name, case in cases(arguments.agents, arguments.duration):
            cpu, turns, _ = case()
            expected = round(arguments.duration * 100)
            # At the end of the run, a sleeping component may still be before its last instant.
            assert set(turns) <= {expected - 1, expected}, (name, min(turns), max(turns))
            best[name] = min(best.get(name, 1e9), 1e6 * cpu / sum(turns))
        peer = simpy(arguments.agents, round(arguments.duration * 100))
        if peer is not None:
            best["SimPy's timeout event"] = min(
                best.get("SimPy's timeout event", 1e9), 1e6 * peer["cpu"] / peer["turns"]
            )
    print(f"{arguments.agents:,} components at 100 Hz for {arguments.duration:g} s, CPU time of a turn")
    for name, cost in best.items():
        print(f"  {name:<32} {cost:6.2f} us   {1e6 / cost:12,.0f} turns per CPU-second")
    timing = Timing(period=10 * MILLISECOND, jitter=9 * MILLISECOND)
    cpu, turns, summary = measured(Trivial, 100, timing, 5.0, pace=1.0)
    kept = summary.pace
    assert kept is not None
    rate, late = min(turns) / summary.wall_time, f"{kept.late:,} of {kept.instants:,} instants late"
    print(f"100 agents at 100 Hz, paced for 5 s: {rate:.2f} Hz kept, in {summary.wall_time:.3f} s")
    print(f"  {late}, by {1e3 * kept.worst:.2f} ms at most; {cpu:.2f} s of CPU time")


if __name__ == "__main__":
    main()
