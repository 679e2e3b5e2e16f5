"""Equal runs have equal digests, and unequal ones do not."""

import hashlib
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from altered_logs import altered

from symaware_cli.log import attachment_differences
from symaware_cli.log.digest import digest
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter


def test_runs_whose_chunks_were_cut_elsewhere_have_equal_digests(
    tmp_path: Path, sample_writer: Callable[..., Path]
) -> None:
    often = sample_writer(tmp_path / "often.mcap", flush_every=1)
    seldom = sample_writer(tmp_path / "seldom.mcap", flush_every=1000)
    assert often.read_bytes() != seldom.read_bytes()
    first, second = digest(open_log(often)), digest(open_log(seldom))
    assert first == second
    assert first.differences(second) == []
    assert "/timing" not in first.channels
    assert set(first.attachments) == {"manifest.json", "resolved.yaml", "scenario/hello.yaml"}


def test_a_log_without_its_summary_keeps_its_digest(tmp_path: Path, sample: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(sample.read_bytes()[:-10])
    assert digest(open_log(cut)) == digest(open_log(sample))


def test_the_digest_follows_its_definition_in_the_document(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.attach("manifest.json", "application/json", b'{"format": 1}')
        channel, empty = writer.channel("/b", "Rows"), writer.channel("/a", "Event")
        assert empty
        writer.add(channel, 5, b"one")
        writer.add(channel, 7, b"")
        writer.finish({})
    found = digest(open_log(writer.path))
    name = b"symaware.v1.Rows"
    content = b""
    for time, sequence, data in ((5, 0, b"one"), (7, 1, b"")):
        content += struct.pack("<QII", time, sequence, len(data)) + struct.pack("<I", len(name)) + name + data
    expected = {"/a": hashlib.sha256().hexdigest(), "/b": hashlib.sha256(content).hexdigest()}
    manifest = hashlib.sha256(b'{"format": 1}').hexdigest()
    assert found.channels == expected
    assert found.attachments == {"manifest.json": manifest}
    text = f"/a {expected['/a']}\n/b {expected['/b']}\nmanifest.json {manifest}\n"
    assert found.combined == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize(
    ("change", "topics"),
    [
        (lambda writer, state, event: writer.add(state, 6, b"x"), ["/state"]),
        (lambda writer, state, event: writer.add(event, 5, b"x"), ["/events"]),
        (lambda writer, state, event: writer.attach("scenario/b.yaml", "", b""), ["scenario/b.yaml"]),
        (lambda writer, state, event: writer.channel("/new", "Rows"), ["/new"]),
        (lambda writer, state, event: writer.attach("versions.json", "", b""), []),
        (lambda writer, state, event: writer.metadata("note", {}), []),
        (lambda writer, state, event: writer.flush(), []),
        (lambda writer, state, event: writer.add_timing(5, wall_time=1, cpu_time=1, steps=1), []),
    ],
)
def test_a_difference_is_reported_at_its_place(tmp_path: Path, change: Callable[..., Any], topics: list[str]) -> None:
    digests = []
    acts: list[Callable[..., Any]] = [lambda *_: None, change]
    for number, act in enumerate(acts):
        with LogWriter(tmp_path / f"{number}.mcap") as writer:
            state, event = writer.channel("/state", "Rows"), writer.channel("/events", "Event")
            writer.add(state, 5, b"a")
            act(writer, state, event)
            writer.finish({})
        digests.append(digest(open_log(writer.path)))
    assert digests[0].differences(digests[1]) == topics
    assert (digests[0].combined == digests[1].combined) == (not topics)


def test_messages_in_another_order_change_the_digest(tmp_path: Path) -> None:
    digests = []
    for number, order in enumerate([(b"a", b"b"), (b"b", b"a")]):
        with LogWriter(tmp_path / f"{number}.mcap") as writer:
            state = writer.channel("/state", "Rows")
            for data in order:
                writer.add(state, 5, data)
            writer.finish({})
        digests.append(digest(open_log(writer.path)))
    assert digests[0] != digests[1]


def test_a_difference_in_the_metadata_of_a_channel_names_both(sample: Path, tmp_path: Path) -> None:
    altered(sample, tmp_path / "feet.mcap", metadata=lambda topic, content: {**content, "unit": "ft"})
    one, other = open_log(sample), open_log(tmp_path / "feet.mcap")
    found = [each for each in attachment_differences(one, other) if each.element == "metadata"]
    assert {each.topic for each in found} == {*one.channels} - {"/timing"}
    for each in found:
        assert each.values == tuple(
            str((log.channels[each.topic].schema, log.channels[each.topic].metadata)) for log in (one, other)
        )
