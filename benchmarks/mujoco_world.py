"""Benchmark of the MuJoCo world against its bare engine: ``python benchmarks/mujoco_world.py`` prints a table.

100 balls roll on the ground of a yard, and push each other and its walls. A whole run of SymAware goes from reading the
scenario's file to closing the log. The bare program makes the same bodies from MJCF, with the same settings, and after
each engine step reads all contacts: the pairs, distances, points and normal forces; after each run step it copies all
positions and velocities. Both must end with bit-identical positions, or the benchmark stops.

Every figure is a ratio of CPU times, of the bare program to the whole run, in the same round; the median and the range
over the rounds are shown. ``CASES`` takes further cases.
"""

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import symaware_cli  # noqa: F401 (before NumPy: it decides which of its kernels are used)

# isort: split
import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray
from symaware_mujoco.bounce import IMPEDANCE, solref
from symaware_mujoco.scene import MARGIN, NEAR

from symaware_cli import open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute

Array = NDArray[np.float64]

BODIES, RADIUS, STEP = 100, 0.2, 0.005
FRICTION, ELASTICITY = 0.5, 0.0
#: The walls of the yard: position of the centre, and length along x and y [m]. All are 1 m high.
WALLS = {
    "east": ((2.6, 0.0), (0.2, 5.4)),
    "north": ((0.0, 2.6), (5.4, 0.2)),
    "south": ((0.0, -2.6), (5.4, 0.2)),
    "west": ((-2.6, 0.0), (0.2, 5.4)),
}


class Case(NamedTuple):
    """A comparison: its name, the goal of the ratio, and two programs that return CPU time and final positions."""

    name: str
    goal: float
    ours: Callable[[Path], tuple[float, Array | None]]
    bare: Callable[[], tuple[float, Array]]


def starts() -> tuple[Array, Array]:
    """Return where the balls are at the start, on a grid [m], and how they move [m/s]; shape (n, 3) each."""
    number = np.arange(BODIES)
    grid = 0.47 * (np.column_stack([number % 10, number // 10]) - 4.5)
    velocity = np.column_stack([np.sin(7.0 * number), np.cos(11.0 * number), np.zeros(BODIES)])
    return np.column_stack([grid, np.full(BODIES, RADIUS)]), velocity.round(3)


def our_yard(engine_steps: int, steps: int, recorded: bool, folder: Path) -> tuple[float, Array | None]:
    """Measure a whole run; the final positions are those of the log, if it has one."""
    surface = {"friction": FRICTION, "elasticity": ELASTICITY}
    ball: dict[str, Any] = {"shape": {"circle": {"radius": RADIUS}}, "mass": 1.0, **surface}
    entities = {
        f"b{number:03}": {**ball, "position": place.tolist(), "velocity": velocity.tolist()}
        for number, (place, velocity) in enumerate(zip(*starts(), strict=True))
    }
    for name, (place, (length, width)) in WALLS.items():
        box = {"length": length, "width": width, "height": 1.0}
        entities[name] = {"shape": {"box": box}, "position": [*place, 0.5], **surface}
    time_step = STEP * engine_steps
    scenario = {
        "symaware": 1,
        "name": "yard",
        "run": {"duration": time_step * steps},
        "environment": {
            "use": "mujoco",
            "with": {"time_step": time_step, "substeps": engine_steps, "ground": surface},
            "entities": entities,
        },
    }
    file, log = folder / "yard.yaml", folder / "yard.mcap" if recorded else None
    file.write_text(yaml.safe_dump(scenario))
    started = time.process_time()
    summary = execute(build(file), log)
    used = time.process_time() - started
    if summary.status != "finished":
        raise SystemExit(f"the run {summary.status}: nothing can be compared")
    if log is None:
        return used, None
    read = open_log(log)
    ends = np.array([read.series(f"b{number:03}", "world").values[-1, :3] for number in range(BODIES)])
    log.unlink()
    return used, ends


def bare_yard(engine_steps: int, steps: int) -> tuple[float, Array]:
    """Measure the bare engine, with the creation of its model."""
    started = time.process_time()
    stiffness, damping = solref(ELASTICITY**2, STEP)
    surface = (
        f'friction="{FRICTION**2} 0.005 0.0001" solref="{stiffness} {damping}" margin="{0.5 * MARGIN}" '
        f'gap="{0.5 * NEAR}" solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"'
    )
    parts = [f'<geom type="plane" size="0 0 1" {surface}/>']
    parts += [
        f'<body pos="{x!r} {y!r} {z!r}"><freejoint/><geom type="sphere" size="{RADIUS}" mass="1" {surface}/></body>'
        for x, y, z in starts()[0].tolist()
    ]
    parts += [
        f'<body pos="{x} {y} 0.5"><geom type="box" size="{0.5 * length} {0.5 * width} 0.5" {surface}/></body>'
        for (x, y), (length, width) in WALLS.values()
    ]
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP}" gravity="0 0 -9.81" iterations="100" cone="elliptic" impratio="100"/>'
        f"<worldbody>{''.join(parts)}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qvel.reshape(-1, 6)[:, :3] = starts()[1]
    read: list[Array] = []
    for _ in range(steps):
        for _ in range(engine_steps):
            mujoco.mj_step(model, data)
            contacts = data.contact
            address = contacts.efc_address
            forces = data.efc_force[address[address >= 0]].copy()
            met = contacts.geom.copy(), contacts.dist.copy(), contacts.pos.copy(), forces
        read = [data.qpos.copy(), data.qvel.copy()]
    used = time.process_time() - started
    del met
    return used, read[0].reshape(-1, 7)[:, :3]


def yard_cases(steps: int) -> Iterator[Case]:
    """Yield whole runs at one and at ten engine steps per run step."""
    for engine_steps, goals in ((1, (0.6, 0.4)), (10, (0.8, 0.5))):
        for recorded, goal in zip((False, True), goals, strict=True):
            count = steps // engine_steps
            yield Case(
                f"100 balls in contact, {engine_steps} engine step{'s' * (engine_steps > 1)} per run step"
                f"{', recorded' * recorded}",
                goal,
                partial(our_yard, engine_steps, count, recorded),
                partial(bare_yard, engine_steps, count),
            )


#: Functions that yield cases, given the number of engine steps of each.
CASES: list[Callable[[int], Iterator[Case]]] = [yard_cases]


def measured(case: Case, rounds: int) -> list[float]:
    """Return the ratios of the rounds."""
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(rounds):
            own, ends = case.ours(Path(folder))
            theirs, expected = case.bare()
            if ends is not None and not np.array_equal(ends, expected):
                apart = float(np.abs(ends - expected).max())
                raise SystemExit(f"{case.name}: both differ by {apart:.2g} m: nothing can be compared")
            ratios.append(theirs / own)
    return ratios


def main() -> None:
    """Measure and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=20_000, help="engine steps of a run")
    parser.add_argument("--json", action="store_true", help="print figures only")
    arguments = parser.parse_args()
    found = {}
    if not arguments.json:
        print("| what | median (least to greatest) | goal |\n|---|---:|---:|", flush=True)
    for cases in CASES:
        for case in cases(arguments.steps):
            ratios = measured(case, arguments.rounds)
            found[case.name] = ratios
            if not arguments.json:
                shown = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"
                print(f"| {case.name} | {shown} | >= {case.goal:g} |", flush=True)
    if arguments.json:
        print(json.dumps(found))


if __name__ == "__main__":
    main()
