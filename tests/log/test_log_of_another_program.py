"""Of a log by another program only facts in the file are shown: its own times, channels and counts."""

import json
import re
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from simulating import untyped
from typer.testing import CliRunner

from symaware_cli import open_log, write_report
from symaware_cli.cli.application import application
from symaware_cli.log.overview import overview_of

#: As rosbag2 counts: nanoseconds since 1970.
BEGIN = 1_585_866_235_112_411_371


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A log of 4.5 s, with a channel that has no messages."""
    path = tmp_path / "talker.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="another")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        topics = [writer.register_channel(topic, "cdr", schema) for topic in ("/topic", "/rosout", "/none")]
        for number in range(10):
            for channel in topics[: 1 + number % 2]:
                writer.add_message(channel, BEGIN + number * 500_000_000, b"\0\1\0\0\0\0\0\0", BEGIN)
        untyped(writer).finish()
    return path


def shown(*arguments: object) -> str:
    done = CliRunner().invoke(application, [*map(str, arguments)])
    assert done.exit_code == 0, done.output
    return done.output


def test_figures_equal_the_statistics_in_the_file(bag: Path) -> None:
    with open(bag, "rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    statistics = summary.statistics
    found = overview_of(open_log(bag))
    assert found.start_time == statistics.message_start_time / 1e9
    assert found.simulated_time == statistics.message_end_time / 1e9
    assert sum(each.messages for each in found.channels) == statistics.message_count
    topics = {each.id: each.topic for each in summary.channels.values()}
    counted = {topics[channel]: count for channel, count in statistics.channel_message_counts.items()}
    assert {each.topic: each.messages for each in found.channels if each.messages} == counted


def test_inspect_reports_the_duration_and_no_unknown_facts(bag: Path) -> None:
    text = shown("inspect", bag)
    assert "time      4.5 s, from 1585866235.1124115 s to 1585866239.6124115 s" in text
    assert not re.search(r"None|unknown|0 to |scenario|seed|steps|agents", text)
    content = json.loads(shown("inspect", bag, "--json"))
    assert content["start_time"] == pytest.approx(BEGIN / 1e9)


def test_a_report_offers_no_repetition(bag: Path) -> None:
    page = write_report(bag, bag.with_suffix(".html")).read_text()
    words = re.sub("<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    assert "4.5 s, from 1585866235.1124115 s" in words
    assert "/topic" in words
    assert not re.search(r"None|unknown|seed|steps|symaware (run|verify)|How to repeat", words)


def test_a_log_of_another_program_without_messages(tmp_path: Path) -> None:
    with open(tmp_path / "empty.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        untyped(writer).finish()
    assert "time" not in shown("inspect", tmp_path / "empty.mcap").replace("first time", "")
    write_report(tmp_path / "empty.mcap", tmp_path / "empty.html")
