"""The time and memory to read any log are bounded by its size and that of our chunks."""

import gc
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import lz4.frame
import pytest
import zstandard
from mcap.records import Attachment, Channel, Metadata, Schema
from sample_log import write_sample
from simulating import present

from fuzzing.anatomy import Anatomy, Packing, Told, put_together, take_apart
from fuzzing.protobuf import altered_message
from symaware_cli.log.error import LogError
from symaware_cli.log.json_text import MAX_DEPTH, read_json, read_yaml
from symaware_cli.log.log_message import LogMessage
from symaware_cli.log.log_schema import LARGEST_CHUNK
from symaware_cli.log.overview import overview_of
from symaware_cli.log.reader import open_log
from symaware_cli.log.repair import recover
from symaware_cli.log.writer import LogWriter


@pytest.fixture
def sample(tmp_path: Path) -> Anatomy:
    return take_apart(write_sample(tmp_path / "sample.mcap").read_bytes())


def written(tmp_path: Path, anatomy: Anatomy) -> Path:
    path = tmp_path / "log.mcap"
    path.write_bytes(put_together(anatomy))
    return path


def peak(work: Callable[..., Any]) -> int:
    """The peak memory of a function, as allocated by Python and NumPy [bytes]."""
    gc.collect()
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def zeros(size: int, *, told: bool = True) -> bytes:
    """Zeros compressed by zstd, with or without their size."""
    packer = zstandard.ZstdCompressor(level=1, write_content_size=told).compressobj(size=size if told else -1)
    pieces = [packer.compress(bytes(min(1 << 20, size - at))) for at in range(0, size, 1 << 20)]
    return b"".join([*pieces, packer.flush()])


@pytest.mark.parametrize("claimed", [1 << 16, 1 << 20, 1 << 27, 1 << 30, 1 << 62])
@pytest.mark.parametrize("kind", ["zstd", "zstd, size unknown", "lz4"])
@pytest.mark.parametrize("summary", [True, False])
def test_a_chunk_that_unpacks_to_a_large_size_takes_bounded_memory(
    sample: Anatomy, tmp_path: Path, kind: str, claimed: int, summary: bool
) -> None:
    content = lz4.frame.compress(bytes(1 << 28)) if kind == "lz4" else zeros(1 << 28, told=kind == "zstd")
    for place in range(4):
        sample.packing[place] = Packing(compression=kind.split(",")[0], data=content, size=claimed, crc=0)
    sample.summary = summary
    path = written(tmp_path, sample)
    assert peak(lambda: open_log(path).verify()) < 2.2 * LARGEST_CHUNK + 8 * path.stat().st_size
    assert present(open_log(path).verify()).chunks_skipped == 4


def test_a_chunk_of_ours_is_large_only_with_one_message(sample: Anatomy, tmp_path: Path) -> None:
    sample.chunks = [[Told(1, 0, 0, bytes(1 << 20))], [Told(1, k, 5, b"") for k in range(20_000)]]
    log = open_log(written(tmp_path, sample))
    assert [len(message.data) for message in log.messages()] == [1 << 20]
    assert log.damage is not None
    assert log.damage.chunks_skipped == 1
    sample.header.library = "other"
    assert len(list(open_log(written(tmp_path, sample)).messages())) == 20_001


def test_the_writer_refuses_a_message_that_readers_would_reject(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap") as writer:
        channel = writer.channel("/events", "Event")
        writer.add(channel, 0, b"")
        with pytest.raises(LogError, match="a message of 134,217,728 bytes on /events is larger than 134,217,728"):
            writer.add(channel, 1, bytes(LARGEST_CHUNK))
    assert open_log(tmp_path / "log.mcap").message_count == 1


def test_chunks_of_others_that_overlap_in_time_are_not_all_held(sample: Anatomy, tmp_path: Path) -> None:
    sample.header.library = "other"
    sample.chunks = [[Told(1, 0, 0, bytes(30 << 20))] for _ in range(14)]
    path = written(tmp_path, sample)
    with pytest.raises(LogError, match="overlap in time"):
        list(open_log(path).messages())


def many(sample: Anatomy, what: str, count: int) -> bytes:
    """A log with much of one kind of record."""
    anatomy = sample.copy()
    match what:
        case "schemas":
            anatomy.schemas += [Schema(k, b"", "", f"s{k}") for k in range(100, 100 + count)]
        case "channels":
            anatomy.channels += [Channel(k, f"/{k}", "json", {}, 0) for k in range(100, 100 + count)]
        case "attachments":
            anatomy.attachments += [Attachment(0, 0, f"a{k}", "", b"") for k in range(count)]
        case "damaged attachments":
            anatomy.attachments += [Attachment(0, 0, f"a{k}", "", b"damage") for k in range(count)]
        case "metadata":
            anatomy.metadata += [Metadata("symaware.outcome", {"status": "["}) for k in range(count)]
        case "chunks":
            anatomy.chunks = [[Told(1, k, k, b"")] for k in range(count)]
        case "damaged chunks":
            anatomy.chunks = [[Told(1, k, 7, b"")] for k in range(count)]
            anatomy.packing = {k: Packing(crc=1) for k in range(count)}
        case "chunks and channels":
            anatomy.channels += [Channel(k, f"/{k}", "json", {}, 0) for k in range(100, 100 + count)]
            anatomy.chunks = [[Told(1, k, k, b"")] for k in range(count)]
    content = put_together(anatomy)
    return content.replace(b"damage", b"DAMAGE") if what.startswith("damaged a") else content


@pytest.mark.parametrize("summary", [True, False])
@pytest.mark.parametrize(
    "what",
    [
        *("schemas", "channels", "attachments", "damaged attachments", "metadata", "chunks", "damaged chunks"),
        "chunks and channels",
    ],
)
def test_ten_times_as_many_records_cost_ten_times_as_much(
    what: str, summary: bool, sample: Anatomy, tmp_path: Path
) -> None:
    sample.summary = summary
    path = tmp_path / "log.mcap"

    def cost(count: int) -> float:
        path.write_bytes(many(sample, what, count))
        best = float("inf")
        for number in range(2):
            began = time.process_time()
            overview_of(open_log(path))
            recover(open_log(path), tmp_path / f"{number}.mcap")
            best = min(best, time.process_time() - began)
        return best

    # Quadratic would be 100 times as much.
    assert cost(3_000) < 35 * cost(300) + 0.2


def problem(message: LogMessage) -> str:
    """Why a message cannot be decoded; empty if it can."""
    try:
        message.decode()
    except LogError as error:
        return str(error)
    return ""


def test_every_altered_message_is_decoded_or_refused_in_a_sentence(sample: Anatomy, tmp_path: Path) -> None:
    """For any change of its bytes; decoded messages are consistent."""
    log = open_log(written(tmp_path, sample))
    messages = {message.channel.topic: message for message in log.messages()}
    chance, refused = Random(3), 0
    for topic, message in sorted(messages.items()):
        for _ in range(300):
            altered = type(message)(
                message.channel, message.time, 0, altered_message(message.data, chance), message.path
            )
            said = problem(altered)
            refused += bool(said)
            assert not said or (topic in said and str(log.path) in said)
    assert 300 < refused < 300 * len(messages)


@pytest.mark.parametrize("depth", [MAX_DEPTH + 1, 500, 100_000])
@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ('{"a": ', "}"), ('[{"a": ', "}]")])
@pytest.mark.parametrize("closed", [True, False])
def test_text_that_is_nested_too_deeply_is_refused(depth: int, opening: str, closing: str, closed: bool) -> None:
    text = opening * depth + ("1" + closing * depth) * closed
    for read in (read_json, read_yaml):
        with pytest.raises(ValueError, match=r"nested|not YAML|Expecting|more text"):
            read(text.encode())


def test_text_that_is_nested_as_deep_as_allowed_is_read() -> None:
    text = "[" * MAX_DEPTH + "]" * MAX_DEPTH
    assert repr(read_json(text)) == repr(read_yaml(text.encode())) == text
    wide = "[" + ", ".join(["[1]"] * 1000) + "]"
    assert repr(read_json(wide)) == wide


def test_numbers_are_no_longer_than_a_float_can_be() -> None:
    assert read_json("9" * 300) == 10**300 - 1
    with pytest.raises(ValueError, match="a number of 301 digits"):
        read_json("9" * 301)


def test_half_a_character_can_be_printed() -> None:
    assert read_json(r'["\ud800", "\ud83d\ude00", "\\ud800"]') == ["?", "\U0001f600", r"\ud800"]


def test_yaml_that_repeats_itself_is_refused() -> None:
    with pytest.raises(ValueError, match="aliases"):
        read_yaml(b"a: &a [1]\nb: *a\n")
    with pytest.raises(ValueError, match="more text"):
        read_yaml(b"#" * (5 << 20))
