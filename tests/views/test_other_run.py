"""A second run in a replay."""

from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT
from rerun_files import saved

from symaware_cli import Log, branch, open_log
from symaware_cli.language.build import build
from symaware_cli.language.execution import execute
from symaware_cli.log.error import LogError
from symaware_cli.views.replay_session import replay_session

HELLO = CHECKOUT / "scenarios" / "hello.yaml"
BODY, TRAIL = "/other/agents/robot/body", "/other/agents/robot/trail"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    path = tmp_path_factory.mktemp("logs") / "hello.mcap"
    execute(build(HELLO, ["run.duration=3"]), path)
    return open_log(path)


def branched(log: Log, tmp_path: Path) -> Log:
    branch(log.path, 2.0, ["agents.robot.components.steer.with.speed=0.1"], tmp_path / "slow.mcap")
    return open_log(tmp_path / "slow.mcap")


def test_a_branch_is_drawn_in_grey_from_where_it_differs(log: Log, tmp_path: Path) -> None:
    recording = saved(log, tmp_path, against=branched(log, tmp_path))
    times = recording.times(BODY, "Points3D:positions")
    assert times[0] == 2_000_000_000
    assert times[-1] == recording.times("/world/agents/robot/body", "Points3D:positions")[-1]
    colours = {colour for each in recording.values(BODY, "Points3D:colors") for colour in each or []}
    assert len(colours) == 1
    assert recording.times(TRAIL, "LineStrips3D:strips")
    assert not [entity for entity in recording.entities if entity.startswith("/other") and "heading" in entity]


def test_a_branch_is_drawn_at_its_own_positions(log: Log, tmp_path: Path) -> None:
    other = branched(log, tmp_path)
    recording = saved(log, tmp_path, against=other)
    last = list(other.messages(["/world/robot/state"]))[-1].decode().values
    drawn = recording.values(BODY, "Points3D:positions")[-1]
    assert drawn is not None
    assert np.array(drawn)[:, :2] == pytest.approx(last[:, :2], abs=1e-5)


def test_an_equal_run_is_not_drawn_and_that_is_said(log: Log, tmp_path: Path) -> None:
    execute(build(HELLO, ["run.duration=3"]), tmp_path / "again.mcap")
    again = open_log(tmp_path / "again.mcap")
    assert replay_session(log, against=again).words.endswith("; again.mcap has the same messages")
    recording = saved(log, tmp_path, against=again)
    assert not [entity for entity in recording.entities if entity.startswith("/other")]


def test_a_foreign_log_cannot_be_shown_beside_it(log: Log, tmp_path: Path) -> None:
    from mcap.writer import Writer

    with open(tmp_path / "foreign.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(LogError, match=r"foreign\.mcap was not written by SymAware"):
        replay_session(log, against=open_log(tmp_path / "foreign.mcap"))
