"""Logs of other software."""

import json
from pathlib import Path

import pytest
from mcap.writer import Writer
from rerun_files import needs_graphics
from simulating import untyped

from symaware_cli import Log, open_log
from symaware_cli.log.error import LogError
from symaware_cli.views.foreign import ForeignReplaySession
from symaware_cli.views.replay_session import replay_session


@pytest.fixture
def foreign(tmp_path: Path) -> Log:
    path = tmp_path / "foreign.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start("", "somebody else")
        schema = writer.register_schema("foxglove.Log", "jsonschema", b"{}")
        channel = writer.register_channel("/rosout", "json", schema)
        for number in range(5):
            time = number * 10**9
            writer.add_message(channel, time, json.dumps({"message": "hello"}).encode(), time, number)
        untyped(writer).finish()
    return open_log(path)


def test_it_is_converted_as_far_as_rerun_knows_it_and_that_is_said(foreign: Log, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    shown = ForeignReplaySession(foreign)
    assert "not written by SymAware" in shown.words
    shown.save(tmp_path / "a.rrd")
    entities = {str(chunk.entity_path) for chunk in RrdReader(tmp_path / "a.rrd").stream()}
    assert "/rosout" in entities


def test_it_has_no_agents(foreign: Log) -> None:
    with pytest.raises(LogError, match="was not written by SymAware"):
        replay_session(foreign)


@needs_graphics
@pytest.mark.parametrize("moment", [None, 2_000_000_000])
def test_a_picture_of_it_can_be_taken(foreign: Log, tmp_path: Path, moment: int | None) -> None:
    ForeignReplaySession(foreign).picture(tmp_path / "a.png", moment, "600x400")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
