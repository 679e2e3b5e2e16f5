"""Study of promises: what they save, how often a kept promise is believed to be broken, and a broken one is not.

    python benchmarks/promises.py [--runs N]

It prints the tables of docs/promises.md. The first is about `scenarios/promises.yaml`. In each run of the others, Bob
sees Adam for 4.5 s, with errors of a given standard deviation, filters what he sees, assuming a given noise of Adam's
acceleration, and monitors Adam's promise to stay left of a line.
In *kept* runs Adam drives up to the line, or stops a gap before it, at about 1 m/s, and turns back, so each alarm is a
false one. In *broken* runs he crosses the line at 2 s, at 1 m/s; an alarm before that is a false one, and the delay
counts from then on. He stops and turns at once, unlike anything that the filter assumes. The seeds are 0, 1, 2, ... for
all rows.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator
from itertools import chain
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

import symaware_cli as sa
from symaware_cli import Event

SCENARIO = {
    "symaware": 1,
    "name": "alarms",
    "run": {"duration": 4.5},
    "environment": {"use": "kinematic", "with": {"time_step": 0.1}},
    "regions": {"left": {"box": [-100.0, 0.0, -100.0, 100.0]}},
    "agents": {
        "adam": {
            "model": {"use": "single-integrator"},
            "state": [-2.0, 0.0],
            "components": {"drive": {"use": "control.schedule", "with": {"inputs": []}}},
        },
        "bob": {
            "model": {"use": "single-integrator"},
            "state": [5.0, 0.0],
            "components": {
                "see": {"use": "perception.range", "with": {"range": 20.0}},
                "filter": {"use": "uncertainty.gaussian"},
                "promises": {"use": "promises.monitor"},
            },
        },
    },
    "promises": {"stay": {"of": "adam", "formula": "always inside(position, left)", "to": "bob"}},
}


#: The rows of kept promises: errors [m], assumed noise of accelerations, gap before the line [m].
KEPT = (
    (0.1, 0.5, 0.0),
    (0.1, 0.5, 0.1),
    (0.1, 0.5, 0.2),
    (0.1, 2.0, 0.0),
    (0.1, 2.0, 0.1),
    (0.3, 2.0, 0.0),
    (0.3, 2.0, 0.1),
)
#: Those of broken ones: errors [m], assumed noise of accelerations.
BROKEN = ((0.1, 0.5), (0.1, 2.0), (0.3, 2.0))


class Alarms(NamedTuple):
    """What became of the runs of one row.

    Attributes:
        runs: How many there were.
        false: How many had an alarm while the promise was kept.
        missed: How many had none, though it was broken.
        delays: The time from the breach to the alarm of each other run [s].
    """

    runs: int
    false: int
    missed: int
    delays: list[float]


def _input(time: float, speed: float) -> dict[str, object]:
    return {"time": time, "input": [speed, 0.0]}


def kept(gap: float) -> list[dict[str, object]]:
    """Return how Adam drives up to a gap before the line [m], stands there for half a second, and drives back."""
    speed = 0.5 * (2.0 - gap)
    return [_input(0.0, speed), _input(2.0, 0.0), _input(2.5, -speed)]


def broken() -> list[dict[str, object]]:
    """Return how Adam crosses the line at 2 s, and stops 1 m beyond it."""
    return [_input(0.0, 1.0), _input(3.0, 0.0)]


def alarms(
    inputs: list[dict[str, object]], noise: float, acceleration: float, runs: int, breach: float | None
) -> Alarms:
    """Run a row.

    Args:
        inputs: What Adam does.
        noise: The standard deviation of what Bob sees of his position [m], and of his velocity [m/s].
        acceleration: The noise of accelerations that Bob's filter assumes [m/s^2/sqrt(Hz)].
        runs: The number of runs.
        breach: When the promise is broken [s]; None if it is kept.
    """
    changes = {
        "agents.adam.components.drive.with.inputs": inputs,
        "agents.bob.components.see.with": {"range": 20.0, "position_noise": noise, "velocity_noise": noise},
        "agents.bob.components.filter.with": {"acceleration_noise": acceleration},
    }
    scenario = sa.scenario(SCENARIO, changes)
    false, missed, delays = 0, 0, []
    for seed in range(runs):
        times: list[float] = []
        scenario.run(seed=seed, record=False, on_event={"promise-broken": _appending(times)})
        if times and (breach is None or times[0] < breach):
            false += 1
        elif breach is not None and not times:
            missed += 1
        elif breach is not None:
            delays.append(times[0] - breach)
    return Alarms(runs, false, missed, delays)


def _appending(times: list[float]) -> Callable[[Event], object]:
    """Return a function that appends the time of an event [s]."""
    return lambda event: times.append(event.seconds)


#: Scenario and changes in which Bob promises to stay in his lane, so that the two may not meet.
WAREHOUSE = Path(__file__).parents[1] / "scenarios" / "promises.yaml"
BOTH = {
    "agents.bob.components.map": None,
    "regions.aisle": {"box": [1.05, 2.6, -5.0, 5.0]},
    "promises.own": {"of": "bob", "formula": "always inside(position, aisle)", "to": "adam"},
    "agents.adam.components.see": {"use": "perception.range", "with": {"range": 12.0}},
    "agents.adam.components.watch": {"use": "promises.monitor"},
}
#: What happens to the promises, and the changes for it.
MEETINGS: tuple[tuple[str, dict[str, object]], ...] = (
    ("known and kept", {}),
    (
        "told, with a delay of 3 s",
        {
            "agents.adam.components.tell": {"use": "promises.tell"},
            "topology": {"use": "complete", "channel": {"delay": 3.0}},
        },
    ),
    ("broken by Adam", {"agents.adam.knowledge.waypoints": [[-1.0, 0.0], [2.0, 0.0]]}),
)


def evaluations(changes: dict[str, object]) -> int:
    """Return in how many steps Bob evaluates the risk."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "run.mcap"
        sa.Scenario(WAREHOUSE, changes).run(output=path)
        series = sa.open_log(path).series("bob", "risk")
        return int(np.isfinite(series.values).sum())


def interval(count: int, runs: int) -> str:
    """Return the interval of a share by Clopper and Pearson, of 95 %."""
    from scipy.stats import beta

    low = beta.ppf(0.025, count, runs - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, runs - count) if count < runs else 1.0
    return f"{low:.4f} to {high:.4f}"


def lines(runs: int) -> Iterator[str]:
    """Yield the lines of both tables."""
    yield "| error [m] | assumed acceleration | nearest to the line [m] | false alarms | 95 % |"
    yield "|---:|---:|---:|---:|---|"
    for noise, acceleration, gap in KEPT:
        found = alarms(kept(gap), noise, acceleration, runs, None)
        yield f"| {noise} | {acceleration} | {gap} | {found.false} of {runs} | {interval(found.false, runs)} |"
    yield ""
    yield "| error [m] | assumed acceleration | false alarms before | missed | 95 % | delay [s]: median | 95 % | most |"
    yield "|---:|---:|---:|---:|---|---:|---:|---:|"
    for noise, acceleration in BROKEN:
        found = alarms(broken(), noise, acceleration, runs, 2.0)
        delays = sorted(found.delays)
        median, most, greatest = (delays[max(0, ceil(share * len(delays)) - 1)] for share in (0.5, 0.95, 1.0))
        said = f"| {noise} | {acceleration} | {found.false} of {runs} | {found.missed} of {runs} "
        yield f"{said}| {interval(found.missed, runs)} | {median:.1f} | {most:.1f} | {greatest:.1f} |"


def meetings() -> Iterator[str]:
    """Yield the lines of the table about `may_meet`."""
    yield "| the promises are | always | `condition: may_meet(adam, bob)` | saved |"
    yield "|---|---:|---:|---:|"
    for title, changes in MEETINGS:
        always = evaluations({**BOTH, **changes})
        some = evaluations({**BOTH, **changes, "agents.bob.components.risk.condition": "may_meet(adam, bob)"})
        yield f"| {title} | {always} | {some} | {1.0 - some / always:.0%} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=400)
    for line in chain(meetings(), [""], lines(parser.parse_args().runs)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
