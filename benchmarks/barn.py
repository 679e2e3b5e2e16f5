"""Drives robots through the worlds of the BARN challenge, by their lidars, and prints the metric of the challenge.

`python benchmarks/barn.py PLACE` reads the 300 worlds and reference paths of github.com/Daffan/the-barn-challenge. They
are not part of this repository: PLACE is a folder with the files, or a git directory of that repository. The bodies,
the lidar and the dynamics are those of this program, not of Gazebo, so the figures are not entries of the challenge.

The metric is that of its `run.py`: success times OT / clip(AT, 2 OT, 8 OT), at most 0.5. OT is the length of the
reference path from start to goal at 2 m/s; AT is the time from the first 0.1 m until the robot is within 1 m of the
goal, looked at every 0.1 s. A contact, or 100 s, is a failure; a robot that stays within 0.25 m for 20 s is taken to be
out of time without waiting for the rest. The start is that of `run.py`, (-2.25, 3), where `report_test.py` computes OT
from (-2, 3); the goal is 10 m ahead.

The runs of one world are made together, in copies of it that are too far apart to be seen from each other; each has
its own draws of the start and of the errors of the lidar.

Reasons: docs/decisions/0098-barn-and-shared-maps.md
"""

from __future__ import annotations

import argparse
import io
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import symaware_cli as sa  # before NumPy, so that it selects NumPy's kernels

# isort: split
import numpy as np
from numpy.typing import NDArray

from symaware_cli.assets.asset_error import AssetError
from symaware_cli.assets.xml_tree import XmlElement, xml_tree
from symaware_cli.studies.statistics.interval_estimate import clopper_pearson

FOLDER = "jackal_helper/worlds/BARN"
START, HEADING, AHEAD = (-2.25, 3.0), 1.57, 10.0
#: The cells of reference paths, and where the first one is [m]; `path_coord_to_gazebo_coord` of `run.py`.
CELL, CORNER = 0.15, (-4.575, 5.075)
#: Speed of the optimal time [m/s], the limit [s], the distance of the goal that counts [m].
FASTEST, LIMIT, NEAR = 2.0, 100.0, 1.0
#: The length and width of the shapes with which a Jackal collides, chassis and wheels (jackal.urdf.xacro) [m].
LENGTH, WIDTH = 0.458, 0.416
#: A robot that stays within this distance [m] for this time [s] is taken to be out of time.
STILL, PATIENCE = 0.25, 20.0
#: The distance between copies of a world [m], and the range of the lidar [m].
APART, RANGE = 16.0, 5.0
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

#: The components of each controller, besides the perception of the own state and the lidar `scan`.
CONTROLLERS: dict[str, dict[str, Any]] = {
    "histogram": {
        "steer": {
            "use": "control.vector-field-histogram",
            "with": {**_STEERING, "radius": 0.23, "margin": 0.05, "range": 1.5, "headway": 0.5},
        },
    },
    "window": {"steer": {"use": "control.dynamic-window", "with": _WINDOW}},
    "map-window": {
        "belief": {
            "use": "perception.map",
            "with": {"scan": "scan", "resolution": 0.1, "within": "AREA", "record": 0.5},
        },
        "plan": {
            "use": "planning.grid",
            "with": {
                "on": "belief",
                "resolution": 0.1,
                "within": "AREA",
                "radius": 0.5 * WIDTH,
                "margin": 0.02,
                "comfort": 0.4,
            },
        },
        "steer": {"use": "control.dynamic-window", "with": {**_WINDOW, "lookahead": 0.8}},
    },
}


def scenario(world: BarnWorld, controller: str, copies: int = 1, seed: int = 0) -> dict[str, Any]:
    """Return the scenario of a world, with a robot in each of some copies of it side by side."""
    offsets = APART * np.arange(copies)
    entities = {
        f"cylinder_{copy}_{number}": {"shape": {"circle": {"radius": radius}}, "position": [x + offset, y]}
        for copy, offset in enumerate(offsets.tolist())
        for number, ((x, y), radius) in enumerate(zip(world.centres.tolist(), world.radii.tolist(), strict=True))
    }
    area = [-5.0, float(offsets[-1]) + 0.5, 0.0, 14.0]
    steering = json.loads(json.dumps(CONTROLLERS[controller]).replace('"AREA"', json.dumps(area)))
    start = [
        [{"normal": [START[0] + offset, SPREAD]}, {"normal": [START[1], SPREAD]}, {"normal": [HEADING, SPREAD]}]
        for offset in offsets.tolist()
    ]
    return {
        "symaware": 1,
        "name": f"barn-{controller}",
        "seed": seed,
        "run": {"duration": LIMIT + 5.0},
        "environment": {"use": "kinematic", "with": {"time_step": 0.1, "on_contact": "stop"}, "entities": entities},
        "agents": {
            "robot": {
                "count": copies,
                "entity": {"shape": {"box": {"length": LENGTH, "width": WIDTH}}},
                "model": {"use": "unicycle", "with": {"max_speed": FASTEST, "max_turn_rate": 2.0}},
                "state": start,
                "knowledge": {
                    "goal": [[START[0] + offset, START[1] + AHEAD] for offset in offsets.tolist()],
                    **({"waypoints": {"all": [[0, 0]]}} if "plan" in steering else {}),
                },
                "components": {
                    "sense": {"use": "perception.self"},
                    "scan": {
                        "use": "perception.lidar",
                        "with": {"rays": 181, "field_of_view": 1.5 * np.pi, "range": RANGE, "noise": 0.005},
                    },
                    **steering,
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


def drive(world: BarnWorld, controller: str, copies: int, seed: int = 0) -> list[Outcome]:
    """Drive through copies of a world, and return how each robot fared."""
    document = scenario(world, controller, copies, seed)
    goal = np.array(document["agents"]["robot"]["knowledge"]["goal"])
    statuses, times = [""] * copies, np.full(copies, np.nan)
    began, collided = np.full(copies, np.nan), set[str]()
    since = np.zeros(copies)

    with sa.scenario(document).start() as simulation:
        start = simulation.state("robot", "x", "y").copy()
        base = start.copy()
        simulation.subscribe("contact", lambda event: collided.update((event.value.first, event.value.second)))
        while not simulation.done and not all(statuses):
            simulation.step()
            places = simulation.state("robot", "x", "y")
            moved, left = _distance(places, start) >= 0.1, _distance(places, goal)
            began = np.where(np.isnan(began) & moved, simulation.time, began)
            taken = np.where(np.isnan(began), simulation.time, simulation.time - began)
            away = _distance(places, base) > STILL
            base[away], since[away] = places[away], simulation.time
            still = simulation.time - since >= PATIENCE
            for row in range(copies):
                if statuses[row]:
                    continue
                if f"robot.{row}" in collided:
                    statuses[row] = "collided"
                elif left[row] <= NEAR:
                    statuses[row] = "succeeded"
                elif taken[row] >= LIMIT or still[row]:
                    statuses[row] = "timeout"
                times[row] = taken[row]
    optimal = world.optimal_time
    return [
        Outcome(
            status or "timeout",
            float(taken),
            float(optimal / np.clip(taken, 2.0 * optimal, 8.0 * optimal)) if status == "succeeded" else 0.0,
        )
        for status, taken in zip(statuses, times.tolist(), strict=True)
    ]


def _distance(places: Array, others: Array) -> Array:
    way = places - others
    return np.asarray(np.sqrt((way * way).sum(axis=1)))


class Row(NamedTuple):
    """The figures of a controller on some worlds.

    Attributes:
        controller: The name of the controller.
        worlds: In how many worlds it drove.
        runs: How many runs there were.
        succeeded: How many of them reached the goal.
        collided: How many touched something.
        timeout: How many did neither within the limit.
        time: The mean time of those that succeeded, as the mean over worlds of the means [s].
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
            f" {interval.lower:.3f} to {interval.upper:.3f} |"
        )


def row_of(controller: str, outcomes: Mapping[int, list[Outcome]]) -> Row:
    """Return the figures of a controller, from its outcomes in each world; the same number in each."""
    every = [each for world in outcomes.values() for each in world]
    succeeded, collided, timeout = (
        sum(each.status == status for each in every) for status in ("succeeded", "collided", "timeout")
    )
    times = [[each.time for each in world if each.status == "succeeded"] for world in outcomes.values()]
    mean = float(np.mean([np.mean(each) for each in times if each])) if any(times) else float("nan")
    metric = float(np.mean([each.metric for each in every]))
    return Row(controller, len(outcomes), len(every), succeeded, collided, timeout, mean, metric)


def _job(source: Source, number: int, controller: str, copies: int, seed: int) -> tuple[list[Outcome], float]:
    began = time.process_time()
    world = source.world(number)
    # An agent's map covers one world.
    abreast = 1 if "belief" in CONTROLLERS[controller] else copies
    outcomes = [each for index in range(copies // abreast) for each in drive(world, controller, abreast, seed + index)]
    return outcomes, time.process_time() - began


def main(arguments: list[str] | None = None) -> int:
    """Drive through the worlds, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("place", type=Path, help="a folder with the files of the challenge, or a git directory of it")
    parser.add_argument(
        "--read", nargs="+", type=Path, metavar="FILE", help="print tables of such files, without driving"
    )
    parser.add_argument(
        "--worlds", default="0:300", metavar="FIRST:END[:STEP]", help="which worlds; 0:300:6 are those of its README"
    )
    parser.add_argument("--runs", type=int, default=10, help="how many runs in each world")
    parser.add_argument("--seed", type=int, default=0, help="the seed of the draws")
    parser.add_argument("--controllers", nargs="+", choices=list(CONTROLLERS), default=list(CONTROLLERS))
    parser.add_argument("--jobs", type=int, default=2, help="how many processes")
    parser.add_argument("--output", type=Path, help="a file for all outcomes, in JSON lines")
    parser.add_argument(
        "--write", type=Path, metavar="FILE", help="write the scenario of the first world and controller, and end"
    )
    given = parser.parse_args(arguments)
    source = Source(given.place)
    worlds = list(range(300))[slice(*(int(each) for each in given.worlds.split(":")))]
    try:
        if given.write:
            document = scenario(source.world(worlds[0]), given.controllers[0], 1, given.seed)
            given.write.write_text(json.dumps(document, indent=1), encoding="utf-8")
            return 0
        found = _read(given.read) if given.read else _driven(source, worlds, given)
    except BarnError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    head = (
        "| controller | worlds | runs | metric | succeeded | collided | out of time | time [s] | success, 95 % |\n|---|"
        + "---:|" * 8
    )
    for title, some in (("all worlds", worlds), ("worlds of the README", [each for each in worlds if each % 6 == 0])):
        print(f"\n{title} (DWA of the README, in Gazebo, on its 50: {DWA})\n\n{head}")
        for controller in given.controllers:
            those = {number: found[controller, number] for number in some if (controller, number) in found}
            if those:
                print(row_of(controller, those).text())
    return 0


def _read(files: list[Path]) -> dict[tuple[str, int], list[Outcome]]:
    """Return the outcomes in files of `--output`; those of one world are joined."""
    found: dict[tuple[str, int], list[Outcome]] = {}
    for file in files:
        for line in file.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            found.setdefault((row["controller"], row["world"]), []).extend(Outcome(*each) for each in row["outcomes"])
    return found


def _driven(source: Source, worlds: list[int], given: argparse.Namespace) -> dict[tuple[str, int], list[Outcome]]:
    """Drive through all worlds with all controllers; report the outcomes as they are known."""
    found: dict[tuple[str, int], list[Outcome]] = {}
    output = given.output.open("w", encoding="utf-8") if given.output else None
    with ProcessPoolExecutor(given.jobs) as pool:
        jobs = [
            (controller, number, pool.submit(_job, source, number, controller, given.runs, given.seed))
            for controller in given.controllers
            for number in worlds
        ]
        spent = 0.0
        for controller, number, job in jobs:
            found[controller, number], seconds = job.result()
            spent += seconds
            if output is not None:
                row = {"controller": controller, "world": number, "outcomes": found[controller, number]}
                print(json.dumps(row), file=output, flush=True)
    print(f"{sum(map(len, found.values()))} runs, {spent:.0f} s of CPU time")
    return found


if __name__ == "__main__":
    sys.exit(main())
