"""Benchmark of plans with tubes: CPU time of bids, of searches and of steps, for the case study of the warehouse.

``python warehouse.py [--robots 4 8 16]`` plays the 40 steps of plugins/symaware-warehouse/scenarios/as-recorded.yaml
without a simulation: robots move by their plans and by noise. Of more robots each four do what the four of the scenario
do. At an event with m specifications, the m robots that take them over bid on all of them.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from symaware_warehouse import Commitment, PlannedTube, Planner, Progress, Tube

import symaware_cli  # noqa: F401 # selects the kernels of NumPy, before it is imported
from symaware_cli.engine.models.linear import Linear
from symaware_cli.geometry import Region
from symaware_cli.planning.optimal_control import LinearDynamics, predicate_sets, state_names
from symaware_cli.specification import formulate, parse

SCENARIO = Path(__file__).parent.parent / "plugins" / "symaware-warehouse" / "scenarios" / "as-recorded.yaml"
STEPS = 40


def main() -> None:
    """Print the figures of each number of robots."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", type=int, default=[4, 8, 16])
    for count in parser.parse_args().robots:
        measured = times(count)
        total = sum(sum(each) for each in measured.values())
        print(f"{count} robots, {STEPS} steps: {total:.1f} s of CPU time", flush=True)
        for kind, each in sorted(measured.items()):
            print(f"  {kind:7} {len(each):5}  median {np.median(each):.3f} s  worst {max(each):.3f} s", flush=True)


def times(count: int) -> dict[str, list[float]]:
    """Return the CPU times of the programs of a run, by what they were for [s]."""
    given = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    robot = given["agents"]["robot"]
    model = Linear(Linear.Parameters.model_validate({**robot["model"]["with"], "max_input": 7.0}))
    planner = Planner(LinearDynamics.of(model, 1.0), Tube.of("chebyshev", 0.0117082, 0.01), STEPS)
    regions = {name: Region.model_validate(each) for name, each in given["regions"].items()}
    arrivals = [arrival(model, regions, name, each) for name, each in given["specifications"].items()]
    progress = [Progress.beginning(robot["state"][number % 4]) for number in range(count)]
    accepted: list[list[Commitment]] = [[each for _, _, each in arrivals if each.epsilon is None] for _ in progress]
    plans: list[PlannedTube | None] = [None] * count
    noise = np.random.Generator(np.random.PCG64(3))
    measured: defaultdict[str, list[float]] = defaultdict(list)
    for step in range(STEPS):
        offers = [
            (holder + 4 * four, each)
            for four in range(count // 4)
            for at, holder, each in arrivals
            if at == step and each.epsilon is not None
        ]
        new = {holder for holder, _ in offers}
        for bidder in sorted(new):
            for _, offer in offers:
                begun = time.process_time()
                planner.bid(offer, accepted[bidder], progress[bidder])
                measured["bid"].append(time.process_time() - begun)
        for holder, offer in offers:
            accepted[holder].append(offer)
        for number in range(count):
            # What is over is not planned for, as in `warehouse.plan`.
            held = [each for each in accepted[number] if each.steps(STEPS).stop > step + 1]
            is_event, begun = step == 0 or number in new, time.process_time()
            plan = planner.solve(held, progress[number], plans[number], event=is_event)
            measured["search" if is_event else "step"].append(time.process_time() - begun)
            plans[number] = plan or plans[number]
            follow = plans[number]
            assert follow is not None
            state = progress[number].states[-1] + follow.input_at(step, progress[number].states[-1], 0.618)
            moved = state + 0.1 * noise.standard_normal(2)
            progress[number] = progress[number].after(moved, follow.risk_at(step + 1))
    return dict(measured)


def arrival(model: Linear, regions: dict[str, Region], name: str, given: dict[str, Any]) -> tuple[int, int, Commitment]:
    """Return when a specification arrives, which of four robots takes it over, and what it asks for."""
    formulation = formulate(parse(given["formula"], [*state_names(model), *regions], {"inside": 2}), 10**9)
    sets = predicate_sets(formulation, state_names(model), regions)
    offer = given.get("offer")
    if offer is None:
        return 0, 0, Commitment(name, formulation, sets, 0, None)
    at, holder = int(offer["at"]), int(offer["to"].partition(".")[2])
    return at, holder, Commitment(name, formulation, sets, int(given.get("from", at)), float(offer["epsilon"]))


if __name__ == "__main__":
    main()
