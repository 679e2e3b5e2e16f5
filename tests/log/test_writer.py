"""The writer writes sound MCAP files, also if writing fails."""

import errno
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader
from simulating import present, untyped

from symaware_cli.log import wire
from symaware_cli.log.error import LogError
from symaware_cli.log.log_schema import CHUNK_SIZE
from symaware_cli.log.reader import open_log
from symaware_cli.log.writer import LogWriter


def chunks(path: Path) -> list[Chunk]:
    with open(path, "rb") as file:
        return [record for record in StreamReader(file, emit_chunks=True).records if isinstance(record, Chunk)]


def records(path: Path) -> list[Any]:
    with open(path, "rb") as file:
        return list(StreamReader(file, validate_crcs=True).records)


def test_a_foreign_tool_decodes_every_message_from_the_schemas_in_the_file(sample: Path) -> None:
    decoded = []
    with open(sample, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
            pool = descriptor_pool.DescriptorPool()
            for each in files.file:
                pool.Add(each)
            kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            decoded.append((channel.topic, message.log_time, kind.FromString(message.data)))
    assert len(decoded) == open_log(sample).message_count
    topic, time, rows = next(entry for entry in decoded if entry[0] == "/agents/robot/state")
    assert (topic, time, untyped(rows).columns, len(untyped(rows).values)) == ("/agents/robot/state", 0, 3, 9)
    event: Any = next(message for topic, _, message in decoded if topic == "/events")
    assert event.source == "agents.robot.1.steer"


def test_the_summary_agrees_with_the_records(sample: Path) -> None:
    with open(sample, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        attachments = {each.name for each in reader.iter_attachments()}
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
        count = sum(1 for _ in reader.iter_messages())
    everything = records(sample)
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == count == sum(isinstance(each, Message) for each in everything)
    assert summary.statistics.chunk_count == len(chunks(sample)) == len(summary.chunk_indexes)
    assert summary.statistics.channel_count == sum(isinstance(each, Channel) for each in everything) / 2
    assert summary.statistics.schema_count == sum(isinstance(each, Schema) for each in everything) / 2
    assert summary.statistics.message_end_time == 39 * 50_000_000
    assert attachments == {"manifest.json", "scenario/hello.yaml", "resolved.yaml", "versions.json"}
    assert metadata == {"symaware.outcome": {"status": '"done"', "steps": "40"}}


def test_the_message_indexes_point_at_the_messages(sample: Path) -> None:
    topics = ["/events", "/agents/car/state"]
    with open(sample, "rb") as file:
        found = [message.data for _, _, message in make_reader(file).iter_messages(topics=topics)]
    assert len(found) == 44


def test_channel_records_are_outside_of_chunks(sample: Path) -> None:
    with open(sample, "rb") as file:
        outside = [each for each in StreamReader(file, emit_chunks=True).records if isinstance(each, Channel)]
    assert len({channel.topic for channel in outside}) == 12
    assert outside[0].topic == "/timing"


def test_no_chunk_exceeds_its_bound_except_one_with_a_single_larger_message(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    sizes = [100, 30_000, CHUNK_SIZE - 31, CHUNK_SIZE, 5, 3 * CHUNK_SIZE, *random.integers(1, 60_000, 200).tolist()]
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/state", "Rows")
        for time, size in enumerate(sizes):
            writer.add(channel, time, bytes(size))
        writer.finish({})
    with open(writer.path, "rb") as file:
        indexes = present(make_reader(file).get_summary()).chunk_indexes
    large = [index for index in indexes if index.uncompressed_size > CHUNK_SIZE]
    assert [index.message_start_time for index in large] == [3, 5]
    assert all(index.message_start_time == index.message_end_time for index in large)
    assert [len(message.data) for message in open_log(writer.path).messages()] == sizes
    assert len(indexes) < sum(sizes) / CHUNK_SIZE * 1.5


def test_equal_runs_make_equal_files(tmp_path: Path, sample_writer: Callable[..., Path]) -> None:
    first, second = sample_writer(tmp_path / "1.mcap"), sample_writer(tmp_path / "2.mcap")
    assert first.read_bytes() == second.read_bytes()


def test_timing_does_not_shift_the_sequences_of_the_others(tmp_path: Path) -> None:
    sequences = []
    for timings in (0, 5):
        with LogWriter(tmp_path / f"{timings}.mcap") as writer:
            channel = writer.channel("/state", "Rows")
            for time in range(10):
                writer.add(channel, time, b"")
                if time < timings:
                    writer.add_timing(time, wall_time=0.1, cpu_time=0.1, steps=time)
            writer.finish({})
        sequences.append([(m.time, m.sequence) for m in open_log(writer.path).messages("/state")])
    assert sequences[0] == sequences[1] == [(time, time) for time in range(10)]


def test_flushed_messages_are_in_the_file(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "log.mcap")
    channel = writer.channel("/state", "Rows")
    writer.add(channel, 0, wire.encode_rows([[1.0]]))
    before = os.path.getsize(writer.path)
    writer.flush()
    assert os.path.getsize(writer.path) == writer.size > before
    assert [message.time for message in open_log(writer.path).messages("/state")] == [0]
    size = writer.size
    writer.flush()
    assert writer.size == size, "an empty chunk was written"
    writer.abort()


def test_added_messages_reach_the_disk_without_further_ones(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap", flush_interval=0.01) as writer:
        channel = writer.channel("/state", "Rows")
        writer.flush_in_background()
        for time_ns in range(3):
            before = writer.size
            writer.add(channel, time_ns, b"")
            patience = time.monotonic() + 30
            while writer.size == before:
                assert time.monotonic() < patience
                time.sleep(0.001)
    assert [message.time for message in open_log(writer.path).messages("/state")] == [0, 1, 2]


def test_flushing_in_the_background_neither_loses_nor_duplicates_messages(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap", flush_interval=0.0001) as writer:
        channel = writer.channel("/state", "Rows")
        writer.flush_in_background()
        for time_ns in range(20_000):
            writer.add(channel, time_ns, b"")
        writer.finish({})
    assert [message.time for message in open_log(writer.path).messages("/state")] == list(range(20_000))


def test_the_count_of_messages_includes_those_in_the_chunk(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/state", "Rows")
        for time in range(3):
            writer.add(channel, time, b"")
        assert writer.messages == 3
        writer.flush()
        writer.add(channel, 3, b"")
        assert writer.messages == 4


def test_time_does_not_go_back(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/state", "Rows")
        writer.add(channel, 5, b"")
        with pytest.raises(ValueError, match="4 ns after one at 5 ns"):
            writer.add(channel, 4, b"")
        writer.finish({})
    assert [message.time for message in open_log(writer.path).messages()] == [5]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ((1, 2**64, b""), ValueError),
        ((99, 9, b""), KeyError),
        ((0, 9, b""), KeyError),
        ((1, 9, "text"), TypeError),
        ((1, 9, 7), TypeError),
    ],
)
def test_a_message_that_fails_to_be_added_leaves_the_log_unchanged(
    tmp_path: Path, arguments: tuple[int, int, Any], error: type[KeyError | TypeError | ValueError]
) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/state", "Rows")
        writer.add(channel, 1, b"one")
        with pytest.raises(error):
            writer.add(*arguments)
        writer.add(channel, 2, b"two")
        writer.finish({})
    log = open_log(writer.path)
    assert log.verify() is None
    assert [(m.sequence, m.time, m.data) for m in log.messages()] == [(0, 1, b"one"), (1, 2, b"two")]


def test_leaving_early_keeps_the_messages_but_writes_no_outcome(tmp_path: Path) -> None:
    def fail(writer: LogWriter) -> None:
        writer.add(writer.channel("/state", "Rows"), 1, b"")
        raise RuntimeError("the run")

    with pytest.raises(RuntimeError, match="the run"), LogWriter(tmp_path / "log.mcap") as writer:
        fail(writer)
    log = open_log(writer.path)
    assert log.damage is None
    assert log.outcome is None
    assert log.message_count == 1


def test_a_closed_log_accepts_no_messages(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/state", "Rows")
        writer.finish({})
        size = os.path.getsize(writer.path)
        call: Callable[[], object]
        for call in (
            lambda: writer.add(channel, 1, b""),
            lambda: writer.finish({}),
            lambda: writer.attach("a", "b", b""),
            writer.flush,
        ):
            with pytest.raises(LogError, match="is closed"):
                call()
    assert os.path.getsize(writer.path) == size


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda folder: folder, "it is a directory"),
        (lambda folder: folder / "missing" / "log.mcap", "its folder does not exist"),
        (lambda folder: folder / "file" / "log.mcap", "part of its path is not a folder"),
        (lambda folder: folder / ("x" * 300), "its name is too long"),
    ],
)
def test_a_log_that_cannot_be_created_is_reported_with_the_reason(
    tmp_path: Path, make: Callable[..., Any], sentence: str
) -> None:
    (tmp_path / "file").touch()
    path = make(tmp_path)
    with pytest.raises(LogError) as caught:
        LogWriter(path)
    assert str(caught.value) == f"cannot create the log {path}: {sentence}"


@pytest.mark.usefixtures("ordinary_rights")
def test_missing_permission_for_a_log_is_reported(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(LogError, match="permission denied"):
        LogWriter(tmp_path / "log.mcap")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has /dev/full")
def test_a_full_disk_is_reported_at_once() -> None:
    with pytest.raises(LogError, match="cannot write the log /dev/full: the disk is full"):
        LogWriter("/dev/full")


FILL = """
import resource, signal, sys
from symaware_cli.log.writer import LogWriter
from symaware_cli.log.error import LogError
import random

random.seed(1)
limit, path = int(sys.argv[1]), sys.argv[2]
writer = None
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
try:
    with LogWriter(path) as writer:
        channel = writer.channel("/state", "Rows")
        for time in range(1000):
            writer.add(channel, time, random.randbytes(1000))
            if time % 10 == 9:
                writer.flush()
                print(time, flush=True)
        writer.finish({})
except LogError as error:
    print(error)
    if writer is None:
        sys.exit(1)
    for again in (lambda: writer.add(channel, 2000, b""), writer.flush, lambda: writer.finish({})):
        try:
            again()
        except LogError as other:
            assert other is error
    writer.abort()
    sys.exit(1)
"""


@pytest.mark.parametrize("limit", [100_000, 54_321, 30_000])
def test_a_disk_that_fills_up_is_reported_once_and_flushed_messages_stay_readable(tmp_path: Path, limit: int) -> None:
    path = tmp_path / "log.mcap"
    run = subprocess.run([sys.executable, "-c", FILL, str(limit), str(path)], capture_output=True, text=True)
    *flushed, sentence = run.stdout.splitlines()
    assert run.returncode == 1, run.stderr
    assert sentence.startswith(f"cannot write the log {path}: the file would be larger than allowed here; ")
    assert path.stat().st_size <= limit
    log = open_log(path)
    assert [message.time for message in log.messages()] == list(range(int(flushed[-1]) + 1))
    assert log.damage is not None
    assert log.damage.end_missing
    assert log.damage.unread_bytes == 0, "the writer left half a record"


def test_a_limit_that_stops_even_the_beginning_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    run = subprocess.run([sys.executable, "-c", FILL, "20", str(path)], capture_output=True, text=True)
    assert run.returncode == 1, run.stderr
    assert run.stdout.startswith(f"cannot write the log {path}: the file would be larger than allowed here; ")
    with pytest.raises(LogError, match="is empty"):
        open_log(path)


def test_a_device_that_fails_while_finishing_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = LogWriter(tmp_path / "log.mcap")
    writer.add(writer.channel("/state", "Rows"), 1, b"data")
    writer.flush()
    writer._file.close()
    writer._file = open(os.open("/dev/full", os.O_WRONLY), "wb", buffering=0)  # noqa: SIM115
    with pytest.raises(LogError, match="the disk is full") as caught, writer:
        writer.finish({})
    assert caught.value.__cause__ is not None
    assert untyped(caught.value.__cause__).errno == errno.ENOSPC
    assert open_log(writer.path).message_count == 1


def test_a_write_that_is_interrupted_is_done_again_when_the_log_is_closed(tmp_path: Path) -> None:
    class Interrupted:
        """A file that is interrupted once, after a part of what it was given."""

        def __init__(self, file: FileIO) -> None:
            self.file = file
            self.pending = True

        def __getattr__(self, name: str) -> Callable[..., Any]:
            result: Callable[..., Any] = getattr(self.file, name)
            return result

        def write(self, data: memoryview) -> int:
            if not self.pending:
                return self.file.write(data)
            if len(data) > 50:
                return self.file.write(data[:50])
            self.pending = False
            raise KeyboardInterrupt

    writer = LogWriter(tmp_path / "log.mcap")
    writer.add(writer.channel("/state", "Rows"), 1, b"data")
    untyped(writer)._file = Interrupted(writer._file)
    with pytest.raises(KeyboardInterrupt), writer:
        writer.flush()
    log = open_log(writer.path)
    assert log.verify() is None
    assert [message.data for message in log.messages()] == [b"data"]


def test_the_outcome_is_read_back_as_it_was_given(tmp_path: Path) -> None:
    outcome = {"status": "failed", "error": None, "minimum_separation": 0.25, "between": ["a", "b"], "steps": 3}
    with LogWriter(tmp_path / "log.mcap") as writer:
        writer.finish(outcome)
    log = open_log(writer.path)
    assert log.outcome == outcome
    assert list(log.metadata["symaware.outcome"]) == sorted(outcome)
    assert json.loads(log.metadata["symaware.outcome"]["between"]) == ["a", "b"]
