"""The recorded beliefs of an agent about another."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from simulating import Team, simulate

from symaware_cli import Log
from symaware_cli.engine.components.perception import OmniscientPerception
from symaware_cli.log import others_message, wire
from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log.error import LogError, UnknownNameError
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter

STEP = 50_000_000
UNICYCLE = [["x", "m"], ["y", "m"], ["heading", "rad"]]
BICYCLE = [*UNICYCLE, ["speed", "m/s"]]


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Log]:
    """Write a log of three robots and a car that know each other as (time, message) say; robots have four states."""

    def write(entries: Sequence[tuple[int, bytes]], world: Sequence[tuple[int, bytes]] = ()) -> Log:
        manifest = {
            "format": 1,
            "groups": {
                "car": {"agents": ["car"], "model": {"state": UNICYCLE}},
                "robot": {"agents": ["robot.0", "robot.1", "robot.2"], "model": {"state": BICYCLE}},
            },
            "entities": {"wall": {}},
            "roster": ["car", "robot.0", "robot.1", "robot.2", "wall"],
        }
        with LogWriter(tmp_path / "log.mcap") as writer:
            writer.attach("manifest.json", "application/json", json.dumps(manifest).encode())
            awareness = writer.channel("/agents/robot/awareness", "Awareness")
            truth = writer.channel("/world/car/state", "Rows")
            both = [(time, awareness, data) for time, data in entries] + [(time, truth, data) for time, data in world]
            for time, channel, data in sorted(both):
                writer.add(channel, time, data)
            writer.finish({})
        return open_log(writer.path)

    return write


def test_beliefs_are_found_among_those_of_others_with_covariances_and_ages(write: Callable[..., Log]) -> None:
    everything = np.arange(24.0).reshape(4, 6)
    covariances = np.arange(4 * 36.0).reshape(4, 6, 6)
    # robot.0 knows the car and robot.2, robot.1 nobody, robot.2 both other robots.
    first = others_message.encode_awareness(
        [2, 0, 2], [0, 3, 1, 2], [6], everything, covariances=covariances, ages=[0.0, 0.5, 1.0, 1.5]
    )
    # Then only robot.2 says something: that it knows the car alone.
    second = others_message.encode_awareness([1], [0], [6], [np.arange(6.0)], [2])
    log = write([(5, first), (9, second)])
    beliefs = log.beliefs("robot.0", "robot.2")
    assert beliefs.times.tolist() == [5]
    assert beliefs.values.tolist() == [everything[1].tolist()]
    assert beliefs.covariances.tolist() == [covariances[1].tolist()]
    assert beliefs.ages.tolist() == [0.5]
    assert (beliefs.columns, beliefs.units) == (("x", "y", "z", "vx", "vy", "vz"), ("m",) * 3 + ("m/s",) * 3)
    beliefs = log.beliefs("robot.2", "robot.1")
    assert beliefs.times.tolist() == [5, 9]
    assert np.array_equal(beliefs.values, [everything[3], np.full(6, np.nan)], equal_nan=True)
    assert np.array_equal(beliefs.ages, [1.5, np.nan], equal_nan=True)
    assert np.isnan(beliefs.covariances[1]).all()
    assert np.isnan(log.beliefs("robot.1", "car").values).all()
    assert log.beliefs("robot.2", "car").values[1].tolist() == list(range(6))


def test_others_may_be_known_by_more_or_fewer_numbers(write: Callable[..., Log]) -> None:
    message = others_message.encode_awareness(
        [2, 0, 1], [0, 3, 2], [3, 4, 4], np.arange(11.0), covariances=np.arange(9 + 16 + 16.0)
    )
    log = write([(0, message)])
    assert log.beliefs("robot.0", "car").values.tolist() == [[0, 1, 2]]
    assert log.beliefs("robot.0", "robot.2").values.tolist() == [[3, 4, 5, 6]]
    assert log.beliefs("robot.2", "robot.1").covariances[0].ravel().tolist() == list(range(25, 41))


def test_an_omniscient_agent_knows_the_truth_at_that_instant(write: Callable[..., Log]) -> None:
    world = [(time, wire.encode_rows([[time, 0.0, 0.0]])) for time in (2, 4)]
    beliefs = write([(time, others_message.WHOLE_WORLD) for time in (1, 2, 3, 4)], world).beliefs("robot.1", "car")
    assert np.array_equal(beliefs.values[:, 0], [np.nan, 2, 2, 4], equal_nan=True)
    assert (beliefs.columns, beliefs.units) == (("x", "y", "vx", "vy"), ("m", "m", "m/s", "m/s"))
    assert np.isnan(beliefs.values[:, 2:]).all()  # what the log does not tell of a unicycle
    assert beliefs.ages.tolist() == [0, 0, 0, 0]
    assert np.isnan(beliefs.covariances).all()


@pytest.mark.parametrize(
    ("other", "columns", "covariances", "names"),
    [
        ("car", 3, False, ()),
        ("car", 4, False, ("x", "y", "vx", "vy")),
        ("car", 5, False, ()),
        ("robot.1", 4, True, ("x", "y", "vx", "vy")),
        ("robot.1", 4, False, ("x", "y", "vx", "vy")),
        ("robot.1", 6, False, ("x", "y", "z", "vx", "vy", "vz")),
    ],
)
def test_columns_have_names_if_the_log_contains_them(
    write: Callable[..., Log], other: str, columns: int, covariances: bool, names: tuple[str, ...]
) -> None:
    spread = np.eye(columns) if covariances else ()
    entity = {"car": 0, "robot.1": 2}[other]
    message = others_message.encode_awareness([1], [entity], [columns], np.zeros(columns), [0], covariances=spread)
    assert write([(0, message)]).beliefs("robot.0", other).columns == names


def test_beliefs_in_a_run_are_those_that_the_components_had(tmp_path: Path) -> None:
    simulate({"point": Team({"see": OmniscientPerception}, count=3)}, steps=4, log=tmp_path / "log.mcap")
    log = open_log(tmp_path / "log.mcap")
    beliefs = log.beliefs("point.0", "point.2")
    assert beliefs.times.tolist() == [step * STEP for step in range(4)]
    assert np.array_equal(beliefs.values[:, :2], log.series("point.2", "world").values[:4])


@pytest.mark.parametrize(
    ("agent", "other", "sentence"),
    [
        ("robto", "car", "has no agent, group or entity 'robto'; there are car, robot, wall"),
        ("robot", "car", "'robot' is a group of 3: name one of its agents"),
        ("wall", "car", "'wall' is an entity"),
        ("robot.0", "wall", "'wall' is an entity"),
        ("robot.0", "robot.0", "has no beliefs of 'robot.0' about 'robot.0'"),
        ("car", "robot.0", r"has no awareness of 'car' \(no channel /agents/car/awareness\)"),
    ],
)
def test_missing_beliefs_are_reported(write: Callable[..., Log], agent: str, other: str, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence) as caught:
        write([]).beliefs(agent, other)
    assert isinstance(caught.value, UnknownNameError) == (agent == "robto")


def test_an_inconsistent_message_is_reported(write: Callable[..., Log]) -> None:
    message = v1.Awareness(rows=[0], lengths=[1], entities=[0], columns=[3], values=[1, 2])
    with pytest.raises(LogError, match=r"/agents/robot/awareness .* do not fit together: .* 2 numbers where 3"):
        write([(0, message.SerializeToString())]).beliefs("robot.0", "car")
