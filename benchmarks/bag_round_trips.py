"""Exports shipped scenarios as bags of ROS 2 and lets their agents move as recorded in another run.

`python benchmarks/bag_round_trips.py [NAME...]` runs each scenario for up to 3 s, exports the log as a bag (every
second one is written as a database, as earlier versions of ROS 2 do), and runs a scenario whose `recordings` are the
odometry of all agents. It prints how far these bodies are from where they were at the same instants, and ends with
status 1 if one of them is elsewhere.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from symaware_cli import Log, open_log
from symaware_cli.assets import AssetFolders
from symaware_cli.bags.bag import Bag
from symaware_cli.bags.ros_names import topic_names
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.views import installed_format

TOP = Path(__file__).parents[1]
SCENARIOS = (
    *("aisles", "asynchronous", "auction", "billiards", "circle-swap", "convoy", "court", "crossing", "dock", "drones"),
    *("field", "floor", "formation", "gusts", "hello", "junction", "noisy", "patrol", "racecars", "traffic"),
)
DURATION = 3.0


class RoundTrip(NamedTuple):
    """How bodies moved that were recorded.

    Attributes:
        bodies: How many there were.
        instants: How many poses were compared.
        apart: The greatest distance between a body and where it was in the run that was recorded [m].
    """

    bodies: int
    instants: int
    apart: float


def round_trip(scenario: Path, folder: Path, *, as_database: bool = False, duration: float = DURATION) -> RoundTrip:
    """Export a run as a bag, and run what was recorded.

    Args:
        scenario: The scenario.
        folder: An empty folder for logs and the bag.
        as_database: Whether the bag is an SQLite database, not an MCAP file.
        duration: How long the run is at most [s].
    """
    execute(build(scenario, [f"run.duration={duration}"], None), folder / "run.mcap")
    log = open_log(folder / "run.mcap")
    installed_format("rosbag2").export(log, folder / "bag")
    if as_database:
        copied(folder / "bag", folder / "bag.db3")
    names = topic_names(log.manifest["roster"])
    bag = Bag("bag", AssetFolders(folder))
    there = [id for id in log.manifest["roster"] if f"/{names[id]}/odom" in bag.topics]
    (folder / "recorded.yaml").write_text(
        yaml.safe_dump(
            {
                "symaware": 1,
                "name": "recorded",
                "run": {"duration": (log.end_time or 0) / 1e9},
                "environment": {"use": "kinematic", "with": {"time_step": log.manifest["time_step"] / 1e9}},
                "recordings": {
                    "past": {
                        "file": "bag.db3" if as_database else "bag",
                        "in_space": any(
                            len(each["model"]["position"]) == 3 for each in log.manifest["groups"].values()
                        ),
                        "bodies": {
                            names[id]: {"topic": f"/{names[id]}/odom", "shape": {"circle": {"radius": 0.1}}}
                            for id in there
                        },
                    }
                },
                "agents": {"far": {"model": {"use": "unicycle"}, "state": [0, -1000, 0], "entity": {"shape": None}}},
            }
        )
    )
    execute(build(folder / "recorded.yaml", [], None), folder / "recorded.mcap")
    return compared(log, open_log(folder / "recorded.mcap"), {id: names[id] for id in there})


def compared(log: Log, recorded: Log, names: Mapping[str, str]) -> RoundTrip:
    """Compare the positions of agents with those of the bodies that repeat them, by their names."""
    instants, apart = 0, 0.0
    for id, name in names.items():
        model = log.manifest["groups"][id.partition(".")[0]]["model"]
        true, body = log.series(id, "world"), recorded.series(name, "world")
        places = dict(zip(body.times.tolist(), body.values, strict=True))
        for time, state in zip(true.times.tolist(), true.values, strict=True):
            at = state[model["position"]]
            # Steps at which a body rests are not written anew.
            if np.isfinite(at).all() and time in places:
                instants += 1
                apart = max(apart, float(np.abs(places[time][: len(at)] - at).max()))
    return RoundTrip(len(names), instants, apart)


def copied(bag: Path, database: Path) -> None:
    """Write a bag as a database."""
    store = get_typestore(Stores.ROS2_JAZZY)
    inner = database.with_name("database")
    with Reader(bag) as reader, Writer(inner, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        copies = {
            each.topic: writer.add_connection(each.topic, each.msgtype, typestore=store) for each in reader.connections
        }
        for connection, time, data in reader.messages():
            writer.write(copies[connection.topic], time, data)
    (inner / f"{inner.name}.db3").rename(database)


def main() -> int:
    """Make the round trip of each scenario, or of those that are named."""
    chosen = [name for name in SCENARIOS if name in sys.argv[1:]] or SCENARIOS
    right = 0
    for number, name in enumerate(chosen):
        with tempfile.TemporaryDirectory() as folder:
            found = round_trip(TOP / "scenarios" / f"{name}.yaml", Path(folder), as_database=number % 2 == 1)
        right += found.bodies > 0 and found.instants > found.bodies and found.apart == 0.0
        kind = "database" if number % 2 else "MCAP"
        print(
            f"{name}: {kind}, {found.bodies} bodies, {found.instants} poses, at most {found.apart:g} m apart",
            flush=True,
        )
    print(f"{right} of {len(chosen)} move as they did")
    return 0 if right == len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
