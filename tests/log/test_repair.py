"""A damaged log becomes a sound one with all readable data and a record of the loss."""

import hashlib
import os
import random
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from simulating import present, untyped

from symaware_cli.log import symaware_v1_pb2 as v1
from symaware_cli.log import wire
from symaware_cli.log.digest import digest
from symaware_cli.log.error import LogError, OutputError
from symaware_cli.log.index import FRAME, frames
from symaware_cli.log.log_schema import descriptor_set
from symaware_cli.log.reader import open_log
from symaware_cli.log.repair import recover
from symaware_cli.log.writer import LogWriter

STEP = 50_000_000
MAGIC_SIZE = 8


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, sample_writer: Callable[..., Path]) -> bytes:
    return sample_writer(tmp_path_factory.mktemp("sound") / "log.mcap").read_bytes()


def places(whole: bytes, opcode: int) -> list[tuple[int, int]]:
    """Start and end of the content of every record of a kind."""
    body = whole[MAGIC_SIZE:-MAGIC_SIZE]
    return [(start + MAGIC_SIZE, end + MAGIC_SIZE) for found, start, end in frames(body) if found == opcode]


def chunk_data(path: Path) -> list[bytes]:
    """The compressed data of every chunk, as in the file."""
    data, log = path.read_bytes(), open_log(path)
    # Behind frame, times, size, checksum, the name of the compression, and the length.
    return [data[span.offset + 9 + 28 + 4 + 4 + 8 : span.offset + span.length] for span in log.index.spans]


def check(path: Path, new: Path) -> None:
    """Recover a log, and check that exactly the readable data of it can be read from the new one."""
    log = open_log(path)
    before = path.read_bytes()
    recovery = recover(log, new)
    assert path.read_bytes() == before
    damage = open_log(path).verify()
    found = open_log(new)
    assert found.verify() is None
    assert digest(found) == digest(open_log(path))
    key = [(m.channel.topic, m.time, m.sequence, m.data) for m in log.messages()]
    assert [(m.channel.topic, m.time, m.sequence, m.data) for m in found.messages()] == key
    assert found.message_count == recovery.messages == len(key)
    assert (found.start_time, found.end_time) == (recovery.start_time, recovery.end_time)
    assert found.attachments == log.attachments
    assert found.outcome == log.outcome
    assert found.header == log.header
    assert recovery.size == new.stat().st_size
    assert (recovery.damage is None) == (damage is None) == (found.recovery is None)
    if damage:
        assert recovery.damage == damage
        assert found.recovery is not None
        assert found.recovery["text"] == str(damage)
        assert found.recovery["lost"] == damage.lost
        assert found.recovery["log"] == path.name
    with open(new, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == len(key)
        assert {each.name for each in reader.iter_attachments()} == set(log.attachments)


def test_of_a_log_cut_at_200_random_places_everything_before_the_cut_is_recovered(tmp_path: Path, whole: bytes) -> None:
    path, new = tmp_path / "cut.mcap", tmp_path / "new.mcap"
    header = places(whole, Opcode.HEADER)[0][1]
    for cut in random.Random(8).sample(range(header, len(whole)), 200):
        path.write_bytes(whole[:cut])
        check(path, new)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["cut.mcap", "new.mcap"]


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_after_any_damage_the_readable_part_is_recovered(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(whole) - 1))
        patch = data.draw(st.binary(min_size=1, max_size=12))
        broken[place : place + len(patch)] = patch
    if data.draw(st.booleans()):
        del broken[data.draw(st.integers(0, len(whole))) :]
    path = tmp_path / "broken.mcap"
    path.write_bytes(broken)
    try:
        log = open_log(path)
    except LogError:
        return
    recover(log, tmp_path / "new.mcap")
    found = open_log(tmp_path / "new.mcap")
    assert found.verify() is None
    assert digest(found) == digest(log)


def test_sound_chunks_are_copied_as_they_are(tmp_path: Path, whole: bytes) -> None:
    path, new = tmp_path / "cut.mcap", tmp_path / "new.mcap"
    path.write_bytes(whole[:-1])
    recover(open_log(path), new)
    assert len(chunk_data(path)) == 8
    assert chunk_data(new) == chunk_data(path)


def test_a_sound_log_is_copied_without_a_record_of_a_recovery(tmp_path: Path, whole: bytes) -> None:
    path, new = tmp_path / "log.mcap", tmp_path / "new.mcap"
    path.write_bytes(whole)
    check(path, new)
    assert open_log(new).recovery is None
    assert len(new.read_bytes()) == len(whole)


@pytest.mark.parametrize("summary", [True, False])
def test_a_damaged_chunk_and_attachment_are_left_out_and_reported_with_their_times(
    tmp_path: Path, whole: bytes, summary: bool
) -> None:
    broken = bytearray(whole)
    for number in (2, 3, 6):
        broken[places(whole, Opcode.CHUNK)[number][1] - 50] ^= 0xFF
    broken[places(whole, Opcode.ATTACHMENT)[1][1] - 6] ^= 0xFF
    path, new = tmp_path / "log.mcap", tmp_path / "new.mcap"
    path.write_bytes(broken if summary else broken[:-1])
    check(path, new)
    told = open_log(new).recovery
    assert told is not None
    assert (told["chunks_skipped"], told["attachments_skipped"], told["end_missing"]) == (3, 1, False)
    sizes = [places(whole, Opcode.CHUNK)[number] for number in (2, 3, 6)] + [places(whole, Opcode.ATTACHMENT)[1]]
    assert told["bytes_skipped"] == sum(end - start + FRAME.size for start, end in sizes)
    # Chunks hold five steps each. What stands behind a chunk is known without a summary, too, but not its own times.
    first, second = [[10 * STEP, 14 * STEP], [15 * STEP, 19 * STEP]], [[30 * STEP, 34 * STEP]]
    around = [[9 * STEP, 20 * STEP], [29 * STEP, 35 * STEP]]
    assert told["gaps"] == (first + second if summary else around)
    until = "between 0.5 s and 1.7 s" if summary else "between 0.45 s and 1.75 s"
    assert f"3 damaged chunks left out, {until}; 1 damaged attachment left out" in told["text"]
    assert present(open_log(path).verify()).missing_from == (10 * STEP if summary else 9 * STEP)


def test_the_unprotected_times_in_the_head_of_a_chunk_are_corrected(tmp_path: Path, whole: bytes) -> None:
    broken = bytearray(whole[:-1])
    start, _ = places(whole, Opcode.CHUNK)[3]
    broken[start : start + 16] = bytes(range(16))
    path, new = tmp_path / "log.mcap", tmp_path / "new.mcap"
    path.write_bytes(broken)
    check(path, new)
    start, _ = places(new.read_bytes(), Opcode.CHUNK)[3]
    times = new.read_bytes()[start : start + 16]
    assert times == (15 * STEP).to_bytes(8, "little") + (19 * STEP).to_bytes(8, "little")


def test_a_log_that_is_damaged_again_reports_both_losses(tmp_path: Path, whole: bytes) -> None:
    path, new, again, last = (tmp_path / f"{name}.mcap" for name in ("cut", "new", "again", "last"))
    path.write_bytes(whole[: places(whole, Opcode.CHUNK)[6][0]])
    recover(open_log(path), new)
    broken = bytearray(new.read_bytes())
    broken[places(bytes(broken), Opcode.CHUNK)[0][1] - 50] ^= 0xFF
    again.write_bytes(broken)
    recover(open_log(again), last)
    told = open_log(last).recovery
    assert told is not None
    assert (told["log"], told["end_missing"], told["chunks_skipped"]) == ("again.mcap", False, 1)
    assert (told["earlier"]["log"], told["earlier"]["end_missing"]) == ("cut.mcap", True)
    assert open_log(last).start_time == 5 * STEP


def test_an_outcome_that_is_no_json_is_left_out_and_counted(tmp_path: Path, whole: bytes) -> None:
    broken = bytearray(whole)
    place = whole.index(b'"done"')
    broken[place] = ord("!")
    path, new = tmp_path / "log.mcap", tmp_path / "new.mcap"
    path.write_bytes(broken)
    recovery = recover(open_log(path), new)
    assert recovery.damage is not None
    assert recovery.damage.attachments_skipped == 1
    assert open_log(new).outcome is None
    assert open_log(new).verify() is None


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("summary", [True, False])
def test_damaged_logs_of_other_programs_are_recovered_as_well(
    tmp_path: Path, compression: CompressionType, chunked: bool, summary: bool
) -> None:
    path, new = tmp_path / "foreign.mcap", tmp_path / "new.mcap"
    times = np.random.default_rng(3).integers(0, 500, 400).tolist()
    with open(path, "wb") as file:
        options: dict[str, Any] = (
            {} if summary else {"use_statistics": False, "repeat_channels": False, "repeat_schemas": False}
        )
        writer = Writer(file, chunk_size=500, compression=compression, use_chunking=chunked, **options)
        writer.start(profile="ros2")
        first = writer.register_schema("pkg/Thing", "ros2msg", b"int32 a")
        second = writer.register_schema("pkg/Thing", "ros2msg", b"int64 a")
        channels = [writer.register_channel(f"/thing/{schema}", "cdr", schema) for schema in (first, second, 0)]
        writer.add_attachment(3, 4, "picture.png", "image/png", b"\x89PNG")
        for sequence, time in enumerate(times):
            writer.add_message(channels[sequence % 3], time, b"{}", time, sequence)
        writer.add_metadata("m", {"a": "b"})
        untyped(writer).finish()
    sound = path.read_bytes()
    check(path, new)
    assert open_log(new).metadata == {"m": {"a": "b"}}
    for cut in random.Random(5).sample(range(100, len(sound)), 20):
        path.write_bytes(sound[:cut])
        check(path, new)


def test_messages_of_a_channel_that_is_missing_are_left_out_with_their_chunk(tmp_path: Path) -> None:
    """A checksum of zero, as written by some other programs, does not protect a chunk."""
    path, new = tmp_path / "foreign.mcap", tmp_path / "new.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=100, compression=CompressionType.NONE, enable_crcs=False)
        writer.start()
        schema = writer.register_schema("symaware.v1.Rows", "protobuf", descriptor_set())
        channel = writer.register_channel("/world/ball/state", "protobuf", schema)
        for time in range(30):
            writer.add_message(channel, time, v1.Rows(columns=1, values=[time]).SerializeToString(), time)
        untyped(writer).finish()
    broken = bytearray(path.read_bytes())
    length = 22 + len(v1.Rows(columns=1, values=[0]).SerializeToString())
    message = broken.rindex(bytes([Opcode.MESSAGE, length, 0, 0, 0, 0, 0, 0, 0]))
    broken[message + 9] = 77
    path.write_bytes(broken)
    recovery = recover(open_log(path), new)
    assert recovery.damage is not None
    assert recovery.damage.chunks_skipped == 1
    assert 0 < recovery.messages < 30
    assert open_log(new).verify() is None


def test_the_old_log_is_not_overwritten_and_a_new_one_only_when_it_is_complete(tmp_path: Path, whole: bytes) -> None:
    path, new = tmp_path / "log.mcap", tmp_path / "new.mcap"
    path.write_bytes(whole[:-1])
    new.write_bytes(b"kept")
    with pytest.raises(LogError, match="it is an input file"):
        recover(open_log(path), path)
    with pytest.raises(OutputError, match="its folder does not exist"):
        recover(open_log(path), tmp_path / "missing" / "new.mcap")
    log = open_log(path)
    path.unlink()
    with pytest.raises(LogError, match=f"there is no file {path}"):
        recover(log, new)
    assert new.read_bytes() == b"kept"
    assert os.listdir(tmp_path) == ["new.mcap"]


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    peaks = []
    for size in (1000, 8000):
        random = np.random.default_rng(0)
        with LogWriter(tmp_path / "log.mcap") as writer:
            channel = writer.channel("/state", "Rows")
            for time in range(size):
                writer.add(channel, time, wire.encode_rows(random.normal(size=(100, 3))))
            writer.finish({})
        os.truncate(writer.path, os.path.getsize(writer.path) - 1)
        tracemalloc.start()
        assert recover(open_log(writer.path), tmp_path / "new.mcap").messages == size
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0] + 100_000
    assert peaks[1] < 4_000_000


def test_equal_logs_are_recovered_to_equal_bytes(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    found = set()
    for number in range(2):
        recover(open_log(path), tmp_path / f"{number}.mcap")
        found.add(hashlib.sha256((tmp_path / f"{number}.mcap").read_bytes()).hexdigest())
    assert len(found) == 1
