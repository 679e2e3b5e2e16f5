"""Drives robots through the worlds of the BARN challenge, by their lidars, and prints the metric of the challenge.

`python benchmarks/barn.py PLACE` reads the 300 worlds and reference paths of github.com/Daffan/the-barn-challenge. They
are not part of this repository: PLACE is a folder with the files, or a git directory of that repository. The bodies,
the lidar and the dynamics are those of this program, not of Gazebo, so the figures are not entries of the challenge.

The metric is that of its `run.py`: success times OT / clip(AT, 2 OT, 8 OT), at most 0.5. OT is the length of the
reference path from start to goal at 2 m/s; AT is the time from the first 0.1 m until the robot is within 1 m of the
goal, looked at every 0.1 s. A contact, or 100 s, is a failure; a robot that stays within 0.25 m for 20 s is taken to be
out of time without waiting for the rest. The start is that of `run.py`, (-2.25, 3), where `report_test.py` computes OT
from (-2, 3); the goal is 10 m ahead.

A seed draws the start and the errors of the lidar. There are `--runs` runs in each world, and `--draws` of pairs of
a world and a seed that are drawn independently and uniformly: for these, the interval of Clopper and Pearson is exact.
`--output` continues a file of outcomes, and `--read` prints the tables of such files.

Reasons: docs/decisions/0098-barn-and-shared-maps.md
"""

from __future__ import annotations

import argparse
import io
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TextIO, TypeAlias

import symaware_cli as sa  # before NumPy, so that it selects NumPy's kernels

# isort: split
import numpy as np
from numpy.typing import NDArray

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.xml_tree import XmlElement, xml_tree
from symaware_cli.studies.statistics.interval_estimate import clopper_pearson

FOLDER = "jackal_helper/worlds/BARN"
#: How many worlds there are, and the least seed that is drawn: smaller ones are those of `--runs`.
WORLDS, FIRST_DRAWN = 300, 1_000
START, HEADING, AHEAD = (-2.25, 3.0), 1.57, 10.0
#: The cells of reference paths, and where the first one is [m]; `path_coord_to_gazebo_coord` of `run.py`.
CELL, CORNER = 0.15, (-4.575, 5.075)
#: Speed of the optimal time [m/s], the limit [s], the distance of the goal that counts [m].
FASTEST, LIMIT, NEAR = 2.0, 100.0, 1.0
#: The length and width of the shapes with which a Jackal collides, chassis and wheels (jackal.urdf.xacro) [m].
LENGTH, WIDTH = 0.458, 0.416
#: A robot that stays within this distance [m] for this time [s] is taken to be out of time.
STILL, PATIENCE = 0.25, 20.0
#: The range of the lidar [m].
RANGE = 5.0
#: Standard deviation of the start: x and y [m], heading [rad].
SPREAD = 0.02
#: The largest file that is read, and the most cylinders and positions in one.
LARGEST_FILE, MOST = 4_000_000, 2_000
#: What the challenge's README reports for its example of move_base with DWA, on 50 worlds.
DWA = 0.1693

Array = NDArray[np.float64]


class BarnError(ValueError):
    """A file is not like those of the challenge."""


@dataclass(frozen=True)
class BarnWorld:
    """A world of the challenge.

    Attributes:
        centres: The centres of its cylinders [m]; shape (n, 2).
        radii: Their radii [m]; shape (n,).
        path: The reference path from the start to the goal [m]; shape (m, 2).
    """

    centres: Array
    radii: Array
    path: Array

    @property
    def optimal_time(self) -> float:
        """The time that the reference path takes at the greatest speed [s]."""
        legs = np.diff(self.path, axis=0)
        return float(np.sqrt((legs * legs).sum(axis=1)).sum()) / FASTEST


def read_world(world: bytes, path: bytes) -> BarnWorld:
    """Read a `.world` file and the `.npy` file of its reference path.

    Raises:
        BarnError: They are no such files.
    """
    if max(len(world), len(path)) > LARGEST_FILE:
        raise BarnError(f"it is larger than {LARGEST_FILE:,} bytes")
    try:
        cylinders = list(_cylinders(xml_tree(world)))
    except AssetError as error:
        raise BarnError(str(error)) from error
    if not 0 < len(cylinders) <= MOST:
        raise BarnError(f"it has {len(cylinders)} cylinders, and has to have 1 to {MOST:,}")
    found = np.array(cylinders, float)
    goal = (START[0], START[1] + AHEAD)
    return BarnWorld(found[:, :2], found[:, 2], np.concatenate([[START], _path(path), [goal]]))


def _cylinders(root: XmlElement) -> Iterator[tuple[float, float, float]]:
    """Yield x, y and the radius of each model that is a cylinder."""
    for world in root.iter("world"):
        for model in world.findall("model"):
            radius = model.find("link/collision/geometry/cylinder/radius")
            if radius is None:
                continue
            pose = model.find("pose")
            numbers = [*(pose.text if pose is not None and pose.text else "").split(), radius.text or ""]
            try:
                values = [float(each) for each in numbers]
            except ValueError:
                values = []
            if len(values) != 7 or not np.isfinite(values).all() or not values[6] > 0.0:
                assert isinstance(model, XmlElement)
                model.refuse("it is no cylinder with a pose of six numbers and a radius")
            yield values[0], values[1], values[6]


def _path(content: bytes) -> Array:
    """Return the positions of a reference path [m]; shape (m, 2)."""
    try:
        cells = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise BarnError(f"the path cannot be read: {error}") from error
    if not isinstance(cells, np.ndarray) or cells.ndim != 2 or cells.shape[1] != 2 or not 0 < len(cells) <= MOST:
        raise BarnError(f"the path is no array of 1 to {MOST:,} cells with two numbers")
    if cells.dtype.kind not in "iuf" or not np.isfinite(cells).all():
        raise BarnError("the path has values that are no finite numbers")
    return np.asarray(CORNER + CELL * cells)


class Source(NamedTuple):
    """Where the files of the challenge are.

    Attributes:
        place: A folder that contains them, or a git directory.
    """

    place: Path

    def world(self, number: int) -> BarnWorld:
        """Read a world.

        Raises:
            BarnError: It is not there, or not as expected.
        """
        name = f"{FOLDER}/world_{number}.world"
        try:
            return read_world(self._content(name), self._content(f"{FOLDER}/path_files/path_{number}.npy"))
        except BarnError as error:
            raise BarnError(f"{name}: {error}") from error

    def _content(self, name: str) -> bytes:
        if (self.place / "HEAD").is_file():
            command = ["git", "--git-dir", str(self.place), "show", f"HEAD:{name}"]
            shown = subprocess.run(command, capture_output=True, check=False)
            if shown.returncode:
                raise BarnError(shown.stderr.decode(errors="replace").strip())
            return shown.stdout
        try:
            return (self.place / name).read_bytes()
        except OSError as error:
            raise BarnError(f"{error.filename}: {error.strerror}") from error


#: The options of both controllers by the lidar.
_STEERING = {"scan": "scan", "deviation": 0.005, "speed": 1.5, "radius": 0.5 * WIDTH}
_WINDOW = {**_STEERING, "footprint": "rectangle", "margin": 0.04, "range": 2.0}

#: What the robot's map and its paths cover [m]: a world.
AREA = [-5.0, 0.5, 0.0, 14.0]

#: The components of each controller, besides the perception of the own state and the lidar `scan`.
CONTROLLERS: dict[str, dict[str, Any]] = {
    "histogram": {
        "steer": {
            "use": "control.vector-field-histogram",
            "with": {
                **_STEERING,
                "radius": 0.23,
                "margin": 0.05,
                "range": 1.5,
                "headway": 0.5,
                # As when the published figures were measured, before there were these options.
                "speed_margin": 1.0,
                "last_resort": None,
                "limit_by_heading": False,
            },
        },
    },
    "window": {"steer": {"use": "control.dynamic-window", "with": _WINDOW}},
    "map-window": {
        "belief": {
            "use": "perception.map",
            "with": {"scan": "scan", "resolution": 0.1, "within": AREA, "record": 0.5},
        },
        "plan": {
            "use": "planning.grid",
            "with": {
                "on": "belief",
                "resolution": 0.1,
                "within": AREA,
                "radius": 0.5 * WIDTH,
                "margin": 0.02,
                "comfort": 0.4,
            },
        },
        "steer": {"use": "control.dynamic-window", "with": {**_WINDOW, "lookahead": 0.8}},
    },
}


def scenario(world: BarnWorld, controller: str, seed: int = 0) -> dict[str, Any]:
    """Return the scenario of a world, with a robot at the start."""
    entities = {
        f"cylinder_{number}": {"shape": {"circle": {"radius": radius}}, "position": centre}
        for number, (centre, radius) in enumerate(zip(world.centres.tolist(), world.radii.tolist(), strict=True))
    }
    return {
        "symaware": 1,
        "name": f"barn-{controller}",
        "seed": seed,
        "run": {"duration": LIMIT + 5.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1, "on_contact": "stop"}, "entities": entities},
        "agents": {
            "robot": {
                "entity": {"shape": {"box": {"length": LENGTH, "width": WIDTH}}},
                "model": {"use": "unicycle", "with": {"max_speed": FASTEST, "max_turn_rate": 2.0}},
                "state": [{"normal": [mean, SPREAD]} for mean in (*START, HEADING)],
                "knowledge": {
                    "goal": [START[0], START[1] + AHEAD],
                    **({"waypoints": [[0, 0]]} if "plan" in CONTROLLERS[controller] else {}),
                },
                "components": {
                    "sense": {"use": "perception.self"},
                    "scan": {
                        "use": "perception.lidar",
                        "with": {"rays": 181, "field_of_view": 1.5 * np.pi, "range": RANGE, "noise": 0.005},
                    },
                    **CONTROLLERS[controller],
                },
            }
        },
    }


class Outcome(NamedTuple):
    """How a robot fared.

    Attributes:
        status: "succeeded", "collided" or "timeout".
        time: The actual time [s].
        metric: The value of the metric.
    """

    status: str
    time: float
    metric: float


def drive(world: BarnWorld, controller: str, seeds: Sequence[int]) -> Iterator[Outcome]:
    """Drive through a world, once with each seed."""
    # Its text is written once for all seeds.
    given = sa.scenario(scenario(world, controller))
    for seed in seeds:
        status, taken = _driven_once(given, seed)
        optimal = world.optimal_time
        metric = optimal / np.clip(taken, 2.0 * optimal, 8.0 * optimal) if status == "succeeded" else 0.0
        yield Outcome(status, taken, float(metric))


def _driven_once(given: sa.Scenario, seed: int) -> tuple[str, float]:
    """Return the status and the actual time [s] of one run."""
    goal = np.array([START[0], START[1] + AHEAD])
    collided: list[sa.Event] = []
    began, taken, since = None, 0.0, 0.0
    with given.start(seed=seed) as simulation:
        simulation.subscribe("contact", collided.append)
        start = base = simulation.state("robot", "x", "y").copy()
        while not simulation.done:
            simulation.step()
            place = simulation.state("robot", "x", "y").copy()
            if began is None and _distance(place, start) >= 0.1:
                began = simulation.time
            taken = simulation.time - (began or 0.0)
            if _distance(place, base) > STILL:
                base, since = place, simulation.time
            if collided:
                return "collided", taken
            if _distance(place, goal) <= NEAR:
                return "succeeded", taken
            if taken >= LIMIT or simulation.time - since >= PATIENCE:
                break
    return "timeout", taken


def _distance(place: Array, other: Array) -> float:
    way = place - other
    return float(np.sqrt(way @ way))


class Pair(NamedTuple):
    """What a run is of.

    Attributes:
        world: The number of the world.
        seed: The seed of the run.
    """

    world: int
    seed: int


class Row(NamedTuple):
    """The figures of a controller on some worlds.

    Attributes:
        controller: The name of the controller.
        worlds: In how many worlds it drove.
        runs: How many runs there were.
        succeeded: How many of them reached the goal.
        collided: How many touched something.
        timeout: How many did neither within the limit.
        time: The mean time of those that succeeded [s].
        metric: The mean of the metric.
    """

    controller: str
    worlds: int
    runs: int
    succeeded: int
    collided: int
    timeout: int
    time: float
    metric: float

    def text(self) -> str:
        """Return the row of a table, with the interval of the probability of success."""
        interval = clopper_pearson(self.succeeded, self.runs)
        shares = " | ".join(f"{each / self.runs:.3f}" for each in (self.succeeded, self.collided, self.timeout))
        return (
            f"| {self.controller} | {self.worlds} | {self.runs} | {self.metric:.4f} | {shares} | {self.time:.1f} |"
            f" {interval.lower:.4f} to {interval.upper:.4f} |"
        )


def row_of(controller: str, outcomes: Mapping[Pair, Outcome]) -> Row:
    """Return the figures of a controller, from its outcomes."""
    every = list(outcomes.values())
    succeeded, collided, timeout = (
        sum(each.status == status for each in every) for status in ("succeeded", "collided", "timeout")
    )
    times = [each.time for each in every if each.status == "succeeded"]
    mean = float(np.mean(times)) if times else float("nan")
    metric = float(np.mean([each.metric for each in every]))
    return Row(
        controller, len({each.world for each in outcomes}), len(every), succeeded, collided, timeout, mean, metric
    )


class Batch(NamedTuple):
    """Runs that are made one after the other.

    Attributes:
        controller: The name of the controller.
        world: The number of the world.
        seeds: The seeds.
    """

    controller: str
    world: int
    seeds: tuple[int, ...]


Outcomes: TypeAlias = dict[tuple[str, Pair], Outcome]
"""The outcome of each controller and pair."""


def drawn_pairs(count: int, seed: int) -> list[Pair]:
    """Draw pairs of a world and a seed, independently and uniformly."""
    numbers = np.random.Generator(np.random.PCG64(seed)).integers([0, FIRST_DRAWN], [WORLDS, 2**32], (count, 2))
    return [Pair(*each) for each in numbers.tolist()]


def read_outcomes(files: Iterable[Path]) -> Outcomes:
    """Return the outcomes in files of `--output`; a line that was not finished is left out."""
    found: Outcomes = {}
    for file in files:
        for line in file.read_text(encoding="utf-8").splitlines(keepends=True):
            if line.endswith("\n"):
                row = json.loads(line)
                pair = Pair(row["world"], row["seed"])
                found[row["controller"], pair] = Outcome(row["status"], row["time"], row["metric"])
    return found


def batches(worlds: Sequence[int], seeds: range, drawn: Sequence[Pair], controllers: Sequence[str]) -> Iterator[Batch]:
    """Yield the runs: the first seed in all worlds, the drawn pairs, and the other seeds, three at a time."""
    first, others = seeds[:1], seeds[1:]
    yield from (Batch(each, world, tuple(first)) for world in worlds if first for each in controllers)
    yield from (Batch(each, pair.world, (pair.seed,)) for pair in drawn for each in controllers)
    for begin in range(0, len(others), 3):
        some = tuple(others[begin : begin + 3])
        yield from (Batch(each, world, some) for world in worlds for each in controllers)


def _job(source: Source, batch: Batch) -> tuple[list[Outcome], float]:
    began = time.process_time()
    outcomes = list(drive(source.world(batch.world), batch.controller, batch.seeds))
    return outcomes, time.process_time() - began


def main(arguments: list[str] | None = None) -> int:
    """Drive through the worlds, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("place", type=Path, help="a folder with the files of the challenge, or a git directory of it")
    parser.add_argument(
        "--read", nargs="+", type=Path, metavar="FILE", help="print tables of such files, without driving"
    )
    parser.add_argument(
        "--worlds",
        default=f"0:{WORLDS}",
        metavar="FIRST:END[:STEP]",
        help="which worlds; 0:300:6 as in its README",
    )
    parser.add_argument("--runs", type=int, default=10, help="how many runs in each world")
    parser.add_argument("--seed", type=int, default=0, help="the first seed, which also draws the pairs")
    parser.add_argument("--draws", type=int, default=0, help="how many pairs of a world and a seed are drawn")
    parser.add_argument("--controllers", nargs="+", choices=list(CONTROLLERS), default=list(CONTROLLERS))
    parser.add_argument("--jobs", type=int, default=2, help="how many processes")
    parser.add_argument("--output", type=Path, help="a file of outcomes, in JSON lines, to continue")
    parser.add_argument(
        "--write", type=Path, metavar="FILE", help="write the scenario of the first world and controller, and end"
    )
    given = parser.parse_args(arguments)
    source = Source(given.place)
    worlds = list(range(WORLDS))[slice(*(int(each) for each in given.worlds.split(":")))]
    seeds, drawn = range(given.seed, given.seed + given.runs), drawn_pairs(given.draws, given.seed)
    try:
        if given.write:
            document = scenario(source.world(worlds[0]), given.controllers[0], given.seed)
            given.write.write_text(json.dumps(document, indent=1), encoding="utf-8")
            return 0
        if given.read:
            found = read_outcomes(given.read)
        else:
            found = _driven(source, batches(worlds, seeds, drawn, given.controllers), given.output, given.jobs)
    except BarnError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    _print_tables(found, worlds, seeds, drawn, given.controllers)
    return 0


def _print_tables(
    found: Outcomes, worlds: Sequence[int], seeds: range, drawn: Sequence[Pair], controllers: Sequence[str]
) -> None:
    head = (
        "| controller | worlds | runs | metric | succeeded | collided | out of time | time [s] | success, 95 % |\n|---|"
        + "---:|" * 8
    )
    # Only seeds with which a controller drove in all worlds, so that each world counts as much as another.
    readme = [each for each in worlds if each % 6 == 0]
    tables = {
        "all worlds": [[Pair(world, seed) for world in worlds] for seed in seeds],
        f"worlds of the README (DWA of the README, in Gazebo: {DWA})": [
            [Pair(world, seed) for world in readme] for seed in seeds
        ],
        # Those drawn so far, in the order in which they were drawn.
        "drawn pairs": [[pair] for pair in drawn],
    }
    for title, parts in tables.items():
        print(f"\n{title}\n\n{head}")
        for controller in controllers:
            those: dict[Pair, Outcome] = {}
            for pairs in parts:
                if not all((controller, pair) in found for pair in pairs):
                    break
                those.update((pair, found[controller, pair]) for pair in pairs)
            if those:
                print(row_of(controller, those).text())


def _driven(source: Source, wanted: Iterable[Batch], output: Path | None, jobs: int) -> Outcomes:
    """Make the runs that a file does not have yet; append their outcomes to it as they are known."""
    found: Outcomes = {}
    if output is not None and output.exists():
        found = read_outcomes([output])
    with ExitStack() as stack:
        file = None if output is None else stack.enter_context(_continued(output))
        pool = stack.enter_context(ProcessPoolExecutor(jobs))
        left = (
            Batch(each.controller, each.world, seeds)
            for each in wanted
            if (seeds := tuple(s for s in each.seeds if (each.controller, Pair(each.world, s)) not in found))
        )
        waiting = [(batch, pool.submit(_job, source, batch)) for batch in left]
        spent, count = 0.0, 0
        for batch, job in waiting:
            outcomes, seconds = job.result()
            spent, count = spent + seconds, count + len(outcomes)
            for seed, outcome in zip(batch.seeds, outcomes, strict=True):
                found[batch.controller, Pair(batch.world, seed)] = outcome
                if file is not None:
                    row = {"controller": batch.controller, "world": batch.world, "seed": seed, **outcome._asdict()}
                    print(json.dumps(row), file=file, flush=True)
    print(f"{count} runs, {spent:.0f} s of CPU time")
    return found


def _continued(output: Path) -> TextIO:
    """Open a file to append to, without a line that was not finished."""
    file = output.open("a+", encoding="utf-8")
    file.seek(0)
    content = file.read()
    file.truncate(len(content[: content.rfind("\n") + 1].encode()))
    return file


if __name__ == "__main__":
    sys.exit(main())
