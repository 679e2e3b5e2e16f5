"""Damaged logs are read as far as possible, with a description of the damage."""

import contextlib
import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from simulating import present

from symaware_cli.log.error import LogError
from symaware_cli.log.index import FRAME, frames
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.reader import Log, open_log

STEP = 50_000_000
MAGIC_SIZE = 8


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, sample_writer: Callable[..., Path]) -> Path:
    return sample_writer(tmp_path_factory.mktemp("sound") / "log.mcap")


@pytest.fixture(scope="module")
def whole(sound: Path) -> bytes:
    return sound.read_bytes()


@pytest.fixture(scope="module")
def places(whole: bytes) -> list[tuple[int, int, int]]:
    """Opcode, start and end of every record."""
    body = whole[MAGIC_SIZE:-MAGIC_SIZE]
    return [(opcode, start - FRAME.size + MAGIC_SIZE, end + MAGIC_SIZE) for opcode, start, end in frames(body)]


@pytest.fixture(scope="module")
def chunks(sound: Path) -> list[tuple[int, list[LogMessage]]]:
    """End and messages of every chunk."""
    log = open_log(sound)
    messages = list(log.messages())
    result = []
    for span in log.index.spans:
        inside = [m for m in messages if span.start <= m.time <= span.end]
        result.append((span.offset + span.length, inside))
    assert sum(len(inside) for _, inside in result) == len(messages)
    return result


def use(log: Log) -> list[LogMessage]:
    """Read all content of a log, and return its messages."""
    messages = list(log.messages())
    for message in messages:
        if message.channel.schema.startswith("symaware"):
            message.decode()
    _ = (log.attachments, log.metadata, log.outcome, log.start_time, log.end_time, log.verify(), str(log.damage))
    if log.manifest and "/agents/robot/state" in log.channels:
        assert log.series("robot", "state").values.shape[1:] in ((3, 3), (3, 0))
    _ = (list(log.events()), list(log.communications()), list(log.contacts()))
    return messages


def same(one: Sequence[LogMessage], other: Sequence[LogMessage]) -> bool:
    return [(m.time, m.sequence, m.data) for m in one] == [(m.time, m.sequence, m.data) for m in other]


def check_cut(
    path: Path,
    whole: bytes,
    places: Sequence[tuple[int, int, int]],
    chunks: Sequence[tuple[int, list[LogMessage]]],
    cut: int,
) -> None:
    """Cut the log, and check that everything up to the break is read and the loss is reported."""
    path.write_bytes(whole[:cut])
    header_end = places[0][2]
    if cut < header_end:
        with pytest.raises(LogError, match=r"is empty|breaks off|ends in the middle"):
            open_log(path)
        return
    log = open_log(path)
    read = use(log)
    expected = [message for end, inside in chunks if end <= cut for message in inside]
    assert same(read, expected)
    damage = log.damage
    data_end = next(end for opcode, _, end in places if opcode == Opcode.DATA_END)
    outcome = next(end for opcode, _, end in places if opcode == Opcode.METADATA)
    assert damage is not None
    assert damage.end_missing == (cut < outcome)
    assert damage.lost == (cut < outcome)
    assert damage.summary_missing
    assert damage.last_time == (expected[-1].time if expected else None)
    whole_records = [end for _, _, end in places if end <= cut]
    assert damage.unread_bytes == cut - max(whole_records)
    assert ("breaks off" in str(damage)) == (cut < outcome)
    assert (log.outcome is None) == (cut < outcome)
    assert data_end > outcome


def test_a_log_cut_at_200_random_places_is_read_up_to_the_break(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]], chunks: list[tuple[int, list[LogMessage]]]
) -> None:
    for cut in random.Random(4).sample(range(len(whole)), 200):
        check_cut(tmp_path / "cut.mcap", whole, places, chunks, cut)


def test_a_log_cut_at_every_boundary_is_read_up_to_the_break(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]], chunks: list[tuple[int, list[LogMessage]]]
) -> None:
    for _, start, end in places:
        for cut in {start, start + 1, start + 8, start + 9, start + 10, end - 1, end}:
            check_cut(tmp_path / "cut.mcap", whole, places, chunks, cut)


@pytest.mark.slow
def test_a_log_cut_anywhere_is_read_up_to_the_break(tmp_path: Path, whole: Any, places: Any, chunks: Any) -> None:
    # 37 divides no length of records for long, so that every kind of record is cut at many offsets.
    for cut in range(0, len(whole), 37):
        check_cut(tmp_path / "cut.mcap", whole, places, chunks, cut)


@pytest.mark.parametrize("tail", [b"\0" * 4096, b"\0", b"\xa5" * 999, random.Random(1).randbytes(5000)])
def test_a_tail_of_zeros_or_noise_does_not_affect_earlier_data(
    tmp_path: Path,
    whole: bytes,
    places: list[tuple[int, int, int]],
    chunks: list[tuple[int, list[LogMessage]]],
    tail: bytes,
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(whole + tail)
    log = open_log(path)
    assert len(use(log)) == sum(len(inside) for _, inside in chunks)
    assert log.outcome == {"status": "done", "steps": 40}
    assert log.damage is not None
    assert not log.damage.lost
    assert f"{len(tail):,} byte" in str(log.damage)
    for count in (1, 4, 8):
        path.write_bytes(whole[: chunks[count - 1][0]] + tail)
        log = open_log(path)
        assert same(use(log), [message for _, inside in chunks[:count] for message in inside])
        assert log.damage is not None
        assert log.damage.end_missing
        assert log.damage.unread_bytes == len(tail)


def test_a_chunk_whose_tail_is_zeros_is_left_out(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]], chunks: list[tuple[int, list[LogMessage]]]
) -> None:
    """As after a power failure, the file has its length, but not all blocks reached the disk."""
    path = tmp_path / "log.mcap"
    third = [place for place in places if place[0] == Opcode.CHUNK][2]
    cut = third[2] - 100
    path.write_bytes(whole[:cut] + bytes(len(whole) - cut))
    log = open_log(path)
    assert same(use(log), [message for _, inside in chunks[:2] for message in inside])
    assert log.damage is not None
    assert log.damage.chunks_skipped == 1
    assert log.damage.lost


@pytest.mark.parametrize("summary", [True, False])
def test_a_damaged_chunk_is_left_out_and_counted(
    tmp_path: Path,
    whole: bytes,
    places: list[tuple[int, int, int]],
    chunks: list[tuple[int, list[LogMessage]]],
    summary: bool,
) -> None:
    path = tmp_path / "log.mcap"
    broken = bytearray(whole)
    for number in (1, 4):
        _, _, end = [place for place in places if place[0] == Opcode.CHUNK][number]
        broken[end - 50] ^= 0xFF
    path.write_bytes(broken if summary else broken[:-1])
    log = open_log(path)
    expected = [message for number, (_, inside) in enumerate(chunks) if number not in (1, 4) for message in inside]
    assert same(list(log.messages()), expected)
    assert same(list(log.messages()), expected)
    assert log.damage is not None
    assert log.damage.chunks_skipped == 2
    assert log.damage.lost
    assert not log.damage.end_missing
    assert "2 damaged chunks left out" in str(log.damage)


@pytest.mark.parametrize("number", [4, -1])
def test_a_damaged_chunk_that_is_read_twice_is_counted_once(
    tmp_path: Path,
    whole: bytes,
    places: list[tuple[int, int, int]],
    chunks: list[tuple[int, list[LogMessage]]],
    number: int,
) -> None:
    path = tmp_path / "log.mcap"
    broken = bytearray(whole)
    _, _, end = [place for place in places if place[0] == Opcode.CHUNK][number]
    broken[end - 50] ^= 0xFF
    path.write_bytes(broken)
    log = open_log(path)
    one, other = log.messages(), log.messages()
    first = next(one), next(other)
    assert [message.sequence for message in first] == [0, 0]
    expected = sum(len(inside) for _, inside in chunks) - len(chunks[number][1]) - 1
    assert len(list(one)) == len(list(other)) == expected
    assert log.damage is not None
    assert log.damage.chunks_skipped == 1


def test_verify_finds_damage_before_anything_is_read(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]]
) -> None:
    broken = bytearray(whole)
    _, _, end = next(place for place in places if place[0] == Opcode.CHUNK)
    broken[end - 1] ^= 1
    path = tmp_path / "log.mcap"
    path.write_bytes(broken)
    log = open_log(path)
    assert log.damage is None
    assert present(log.verify()).chunks_skipped == 1
    assert present(log.verify()).chunks_skipped == 1


@pytest.mark.parametrize("summary", [True, False])
def test_a_damaged_attachment_is_left_out_and_counted(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]], summary: bool
) -> None:
    path = tmp_path / "log.mcap"
    broken = bytearray(whole)
    _, _, end = [place for place in places if place[0] == Opcode.ATTACHMENT][1]
    broken[end - 6] ^= 0xFF
    path.write_bytes(broken if summary else broken[:-1])
    log = open_log(path)
    assert list(log.attachments) == ["manifest.json", "resolved.yaml", "versions.json"]
    assert log.damage is not None
    assert log.damage.attachments_skipped == 1
    assert "1 damaged attachment left out" in str(log.damage)


def test_a_damaged_manifest_that_is_read_repeatedly_is_counted_once(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]]
) -> None:
    path = tmp_path / "log.mcap"
    broken = bytearray(whole)
    _, _, end = next(place for place in places if place[0] == Opcode.ATTACHMENT)
    broken[end - 6] ^= 0xFF
    path.write_bytes(broken)
    log = open_log(path)
    assert (log.manifest, log.foreign) == ({}, False)
    use(log)
    assert "manifest.json" not in log.attachments
    assert log.damage is not None
    assert log.damage.attachments_skipped == 1


def test_metadata_that_are_no_json_are_left_out_and_counted(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(whole.replace(b'"done"', b"[done]", 1))
    log = open_log(path)
    assert present(log.verify()).attachments_skipped == 1
    assert log.outcome is None
    assert present(log.verify()).attachments_skipped == 1


def test_a_damaged_summary_loses_no_data(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]], chunks: list[tuple[int, list[LogMessage]]]
) -> None:
    path = tmp_path / "log.mcap"
    _, start, _ = next(place for place in places if place[0] == Opcode.CHUNK_INDEX)
    broken = bytearray(whole)
    broken[start + 20] ^= 0xFF
    path.write_bytes(broken)
    log = open_log(path)
    assert len(use(log)) == sum(len(inside) for _, inside in chunks)
    assert log.damage is not None
    assert log.damage.summary_missing
    assert not log.damage.lost
    assert str(log.damage) == "the summary at the end of the file is damaged, which loses nothing"


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_raises_only_log_errors(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    broken = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(whole) - 1))
        patch = data.draw(st.binary(min_size=1, max_size=12))
        broken[place : place + len(patch)] = patch
    if data.draw(st.booleans()):
        del broken[data.draw(st.integers(0, len(whole))) :]
    path = tmp_path / "log.mcap"
    path.write_bytes(broken)
    with contextlib.suppress(LogError):
        use(open_log(path))


def test_a_scan_agrees_with_the_summary(tmp_path: Path, sound: Path, whole: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(whole[:-1])
    scanned, summarised = open_log(path), open_log(sound)
    assert scanned.channels == summarised.channels
    assert scanned.index.spans == summarised.index.spans
    assert scanned.index.attachments == summarised.index.attachments
    assert scanned.index.metadata == summarised.index.metadata


def test_a_chunk_that_claims_to_be_huge_is_left_out(
    tmp_path: Path, whole: bytes, places: list[tuple[int, int, int]]
) -> None:
    path = tmp_path / "log.mcap"
    _, start, _ = next(place for place in places if place[0] == Opcode.CHUNK)
    broken = bytearray(whole)
    broken[start + 9 + 16 : start + 9 + 24] = (1 << 62).to_bytes(8, "little")
    path.write_bytes(broken)
    log = open_log(path)
    assert present(log.verify()).chunks_skipped == 1


RUN = """
import sys
from symaware_cli.log import wire
from symaware_cli.log.writer import LogWriter
import numpy as np, time
writer = LogWriter(sys.argv[1])
writer.attach("manifest.json", "application/json", b'{"format": 1, "groups": {"robot": {"agents": ["robot"]}}}')
channel = writer.channel("/agents/robot/state", "Rows")
random = np.random.default_rng(0)
step, due = 0, time.monotonic()
while True:
    writer.add(channel, step, wire.encode_rows(random.normal(size=(1, 3))))
    if time.monotonic() >= due:
        due += 0.02
        writer.flush()
        print(step, flush=True)
    step += 1
"""


def test_a_killed_run_leaves_everything_up_to_its_last_flush(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    for delay in (1, 3, 7):
        run = subprocess.Popen([sys.executable, "-c", RUN, str(path)], stdout=subprocess.PIPE, text=True)
        flushed = [int(present(run.stdout).readline()) for _ in range(delay)]
        os.kill(run.pid, signal.SIGKILL)
        rest, _ = run.communicate()
        assert run.returncode == -signal.SIGKILL
        flushed += [int(line) for line in rest.splitlines() if line]
        log = open_log(path)
        times = [message.time for message in log.messages()]
        assert times == list(range(len(times)))
        assert len(times) >= flushed[-1] + 1
        assert log.series("robot", "state").values.shape == (len(times), 3)
        assert log.damage is not None
        assert log.damage.end_missing
        assert f"breaks off after {times[-1] / 1e9:.9g} s of simulated time" in str(log.damage)
        assert log.outcome is None
