"""Channels that many entities share, read as if each had its own."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import CSV, export_tables
from simulating import Team, simulate, untyped

from symaware_cli import Log, open_log
from symaware_cli.core import Obstacle
from symaware_cli.engine.environments.column_environment import ColumnEnvironment
from symaware_cli.engine.environments.kinematic import KinematicEnvironment
from symaware_cli.log import wire
from symaware_cli.log.error import LogError
from symaware_cli.log.shared_channel import SHARED, shared_metadata
from symaware_cli.log.writer import LogWriter
from symaware_cli.views.chunk import ChunkReader
from symaware_cli.worlds.planar import PymunkEnvironment
from symaware_cli.worlds.spatial import PyBulletEnvironment

BALL = {"circle": {"radius": 0.1}}
STEPS = 12


def path(*positions: Sequence[int], **more: Sequence[float]) -> Obstacle:
    return Obstacle(shape=BALL, path={"times": list(range(len(positions))), "positions": positions, **more})


OBSTACLES = {
    "bus": path([50, 0], [51, 0], headings=[0.0, 2.0]),
    "crane": path([60, 0, 2], [60, 1, 3]),
    "post": Obstacle(shape=BALL, position=[70, 0]),
    **{
        f"ball{number}": Obstacle(
            shape=BALL, position=[number, 0.0, 1.0], velocity=[0.5 * number, 0.1, 0.0], turn_rate=number, mass=1.0
        )
        for number in range(3)
    },
}


class Watched:
    """Records the entities of a world at each instant, without the log."""

    def __init__(self, environment: ColumnEnvironment) -> None:
        self.environment = environment
        self.seen: list[dict[str, tuple[list[Any], Any]]] = []
        take = environment.step

        def step() -> None:
            self.note()
            take()

        untyped(environment).step = step

    def note(self) -> None:
        environment = self.environment
        moving = [name for name in environment.obstacles if environment.moves(name)]
        self.seen.append(
            {
                name: ([*environment.pose(name).position, environment.pose(name).heading], environment.body_poses(name))
                for name in moving
            }
        )


def recorded(
    kind: type[ColumnEnvironment], obstacles: Mapping[str, Any], log: Path, steps: int = STEPS, **parameters: Any
) -> tuple[Log, list[dict[str, tuple[Any, Any]]]]:
    environment = kind(kind.Parameters(time_step=0.05, **parameters))
    watched = Watched(environment)
    simulate({"robot": Team()}, steps, log, environment=environment, obstacles=obstacles)
    return open_log(log), watched.seen


def flat(obstacles: Mapping[str, Any]) -> dict[str, Obstacle]:
    """The same in a plane."""
    found = {}
    for name, each in obstacles.items():
        content = each.model_dump(exclude_none=True)
        for key in ("position", "velocity"):
            if key in content:
                content[key] = content[key][:2]
        if each.path:
            content["path"]["positions"] = [position[:2] for position in each.path.positions]
        found[name] = Obstacle.model_validate(content)
    return found


LED = {name: OBSTACLES[name] for name in ("bus", "crane", "post")}
WORLDS: dict[str, tuple[Any, Mapping[str, Any], set[str]]] = {
    "kinematic": (KinematicEnvironment, LED, {"/world/plane", "/world/space"}),
    "pymunk": (PymunkEnvironment, flat(OBSTACLES), {"/world/plane"}),
    "pybullet": (PyBulletEnvironment, OBSTACLES, {"/world/plane", "/world/space", "/world/bodies"}),
}


@pytest.mark.parametrize("use", WORLDS)
def test_one_message_has_the_values_of_all_entities(use: str, tmp_path: Path) -> None:
    kind, obstacles, topics = WORLDS[use]
    log, seen = recorded(kind, obstacles, tmp_path / "log.mcap")
    assert {topic for topic in log.channels if topic in SHARED} == topics
    for topic in topics:
        assert log.channels[topic].count <= STEPS + 1
    for name in seen[0]:
        series = log.series(name, "world")
        known = np.searchsorted(series.times, np.arange(STEPS) * 50_000_000, side="right") - 1
        assert series.columns == (*"xyz"[: len(seen[0][name][0]) - 1], "heading")
        assert series.units[-1] == "rad"
        np.testing.assert_array_equal(series.values[known], [said[name][0] for said in seen])
        if seen[0][name][1] is not None:
            pose = log.series(name, "pose")
            assert pose.columns == ("x", "y", "z", "qx", "qy", "qz", "qw")
            np.testing.assert_array_equal(pose.values[known], [said[name][1][0] for said in seen])
        elif use == "pybullet":
            with pytest.raises(LogError, match="has no pose"):
                log.series(name, "pose")
    assert "/world/post/state" not in log.topics


def test_a_resting_entity_is_left_out(tmp_path: Path) -> None:
    obstacles = {
        "still": Obstacle(shape=BALL, position=[9, 9], mass=1.0),
        "moves": Obstacle(shape=BALL, position=[5, 5], velocity=[1, 0], mass=1.0),
    }
    log, _ = recorded(PymunkEnvironment, obstacles, tmp_path / "log.mcap")
    assert len(log.series("still", "world").times) == 1
    assert len(log.series("moves", "world").times) == STEPS + 1
    rows = [message.decode().rows for message in log.messages("/world/plane")]
    assert rows[0] is None
    assert all(list(row) == [0] for row in rows[1:])


@pytest.mark.parametrize("use", ["pymunk", "pybullet"])
def test_observing_a_world_does_not_change_it(use: str) -> None:
    kind, obstacles, _ = WORLDS[use]
    top = obstacles["ball1"].model_copy(update={"turn_rate": 9.0, "heading": 4.0})
    ends = []
    for looks in (True, False):
        environment = kind(kind.Parameters(time_step=0.05))
        environment.initialise([Team().group("robot")], {**obstacles, "top": top}, 1)
        with environment:
            assert environment.pose("top").heading == pytest.approx(4.0, abs=1e-12)
            for _ in range(60):
                environment.step()
                if looks:
                    environment.entity_poses(["top"]), environment.pose("ball0"), environment.scenery.pieces
            ends.append({name: environment.pose(name) for name in environment.obstacles})
    assert ends[0] == ends[1]


def written(path: Path, *messages: tuple[str, dict[str, str], int, bytes]) -> Log:
    with LogWriter(path) as writer:
        channels = {}
        for topic, metadata, time, content in messages:
            if topic not in channels:
                channels[topic] = writer.channel(topic, "Rows", metadata)
            writer.add(channels[topic], time, content)
    return open_log(path)


BOTH = shared_metadata(["one", "other"], SHARED["/world/plane"])


def test_channels_of_single_entities_are_read_as_before(tmp_path: Path) -> None:
    own = {"columns": "x,y,heading", "units": "m,m,rad"}
    values = [[[float(time), 2.0, 0.5]] for time in range(3)]
    old = written(
        tmp_path / "old.mcap",
        *(("/world/one/state", own, time, wire.encode_rows(row)) for time, row in enumerate(values)),
    )
    new = written(
        tmp_path / "new.mcap",
        *(("/world/plane", BOTH, time, wire.encode_rows(row, [0])) for time, row in enumerate(values)),
    )
    for log in (old, new):
        series = log.series("one", "world")
        assert series.values.tolist() == values
        assert (series.columns, series.units) == (("x", "y", "heading"), ("m", "m", "rad"))
        assert [message.channel.topic for message in log.messages("/world/one/state")] == ["/world/one/state"] * 3
        (chunk,) = ChunkReader({}).chunks(log.messages())
        assert chunk.frames["/world/one/state"].values[:, 0].tolist() == [row[0] for row in values]
    assert "/world/other/state" not in old.topics


def test_a_channel_of_an_entity_wins_over_one_that_it_shares(tmp_path: Path) -> None:
    own = {"columns": "x,y,heading", "units": "m,m,rad"}
    log = written(
        tmp_path / "log.mcap",
        ("/world/one/state", own, 0, wire.encode_rows([[1, 1, 1]])),
        ("/world/plane", BOTH, 0, wire.encode_rows([[2, 2, 2], [3, 3, 3]])),
    )
    assert log.series("one", "world").values.tolist() == [[[1, 1, 1]]]
    assert log.series("other", "world").values.tolist() == [[[3, 3, 3]]]


@pytest.mark.parametrize(
    "content",
    [
        wire.encode_rows([[1, 1, 1]], [2]),
        wire.encode_rows([[1, 1, 1]] * 3),
        wire.encode_rows([[1, 1]] * 2),
    ],
)
def test_a_message_that_does_not_fit_its_entities_is_reported(content: bytes, tmp_path: Path) -> None:
    log = written(tmp_path / "log.mcap", ("/world/plane", BOTH, 7, content))
    with pytest.raises(LogError, match=r"/world/plane at 7 ns in .*log.mcap does not fit"):
        log.series("one", "world")


@pytest.mark.parametrize("entities", ["", "{}", "[" * 100_000, "[[]]", '["one", 3]', "nonsense"])
def test_metadata_that_name_no_entity_are_accepted(entities: str, tmp_path: Path) -> None:
    metadata = {**BOTH, "entities": entities}
    log = written(tmp_path / "log.mcap", ("/world/plane", metadata, 0, wire.encode_rows([[1, 1, 1]])))
    assert isinstance(log.topics, dict)
    with pytest.raises(LogError):
        log.series("two", "world")


def test_tables_have_each_entity(tmp_path: Path) -> None:
    kind, obstacles, _ = WORLDS["pybullet"]
    log, seen = recorded(kind, obstacles, tmp_path / "log.mcap")
    export_tables(log, tmp_path / "tables", CSV)
    lines = (tmp_path / "tables" / "world" / "ball1.csv").read_text().splitlines()
    assert len(lines) == STEPS + 2
    first = lines[1].split(",")
    assert [float(each) for each in first[-4:]] == pytest.approx(seen[0]["ball1"][0])
    assert json.dumps(sorted(path.stem for path in (tmp_path / "tables" / "world").iterdir())).count("ball") == 3
