"""Fuzzes every command that reads a log with damaged or malicious logs."""

from __future__ import annotations

import json
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random

import zstandard
from mcap.records import Attachment, Channel, Metadata, Schema

from fuzzing.anatomy import Anatomy, Packing, Told, put_together, take_apart
from fuzzing.damage import damaged
from fuzzing.log_verbs import VERBS, called
from fuzzing.oddities import NAMES, document, odd_value
from fuzzing.protobuf import altered_message
from fuzzing.target import Finding, Target

_SCENARIOS = Path(__file__).parents[2] / "scenarios"

#: What is recorded: small logs that have a bit of everything.
_RUNS = {
    "head-on": ["run.duration=4"],
    "crossing": ["run.duration=0.5"],
    "rumour": ["run.duration=2"],
    "drones": ["run.duration=0.2"],
}

#: Beside those of `VERBS`.
_MORE: dict[str, Callable[[Path, Path], list[object]]] = {
    "log series control": lambda log, folder: ["log", "series", log, "robot.0:applied_control", "--json"],
    "log series risk": lambda log, folder: ["log", "series", log, "robot:risk", "--from", 1, "--limit", 5],
    "log events filtered": lambda log, folder: ["log", "events", log, "--agents", "*", "--level", "info"],
    "export --from": lambda log, folder: ["export", log, "--format", "csv", "--output", folder / "t", "--from", 0.1],
    "run": lambda log, folder: ["run", log, "--quiet", "--timeout", 2, "--output", folder / "again.mcap"],
}


class Logs(Target):
    """Each case is a log."""

    time_limit = 120.0
    memory_limit = 700 << 20
    cases_per_worker = 100

    def prepare(self, folder: Path) -> None:
        """Write valid logs to start from."""
        self._bases: list[Anatomy] = []
        for name, overrides in _RUNS.items():
            path = folder / f"{name}.mcap"
            line = ["run", _SCENARIOS / f"{name}.yaml", "--quiet", "--output", path]
            for each in overrides:
                line += ["--set", each]
            status, _, trouble = called(line)
            assert status == 0, trouble
            self._bases.append(take_apart(path.read_bytes()))
        self._sound = [put_together(base) for base in self._bases]

    def make(self, chance: Random) -> bytes:
        """Damage a log, or write a malicious one."""
        if chance.random() < 0.35:
            content = chance.choice(self._sound)
            for _ in range(chance.choice([1, 1, 1, 2, 4])):
                content = damaged(content, self._sound, chance) or b"\0"
            return content
        anatomy = chance.choice(self._bases).copy()
        for _ in range(chance.choice([1, 1, 1, 2, 3])):
            chance.choice(_HOSTILITIES)(anatomy, chance)
        content = put_together(anatomy)
        return _with_summary(content, chance) if chance.random() < 0.15 else content

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Read the log with every command."""
        tally = Counter(logs=1)
        log, written = folder / "log.mcap", folder / "written"
        log.write_bytes(case)
        for verb, line in (VERBS | _MORE).items():
            written.mkdir()
            try:
                status = self._call(verb, line(log, written), log, written)
            except BaseException as error:
                error.add_note(f"in: symaware {verb}")
                raise
            tally[f"x {status}"] += 1
            for path in sorted(written.rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
            written.rmdir()
        if sorted(path.name for path in folder.iterdir()) != ["log.mcap"] or log.read_bytes() != case:
            raise Finding("overwritten", "the log, or what stands beside it, is not what it was")
        return tally

    def _call(self, verb: str, line: list[object], log: Path, written: Path) -> int:
        status, output, trouble = called(line)

        def wrong(what: str) -> Finding:
            return Finding("wrong", f"{what} (symaware {verb}): {output[-500:]}{trouble[-2000:]}", f"{verb}: {what}")

        failures = (1, 130) if verb == "run" else ()  # 130: the time is up
        if status not in (0, 2, 3, *failures):
            raise wrong(f"exit status {status}")
        if "Traceback (most recent call last)" in trouble and verb != "run":
            raise wrong("a traceback")
        if status == 2 and verb != "run" and [*written.iterdir()]:
            raise wrong("refused, and wrote something")
        if status == 2 and not (output + trouble).strip():
            raise wrong("refused without a word")
        for path in written.glob("*.mcap") if verb in ("recover", "merge") else ():
            from symaware_cli import open_log

            damage = open_log(path).verify()
            if damage is not None:
                raise Finding("unreadable", f"what {verb} wrote is damaged: {damage}", f"what {verb} wrote")
        return status


def _attachment_name(anatomy: Anatomy, chance: Random) -> None:
    name = chance.choice(NAMES)
    if chance.random() < 0.6:
        content = chance.choice([b"", b"hello", chance.randbytes(50), b"symaware: 1\n"])
        place = chance.randrange(len(anatomy.attachments) + 1)
        anatomy.attachments.insert(place, Attachment(0, 0, name, chance.choice([*NAMES, "text/plain"])[:999], content))
    elif anatomy.attachments:
        chance.choice(anatomy.attachments).name = name


def _attachment_content(anatomy: Anatomy, chance: Random) -> None:
    if anatomy.attachments:
        # Most code depends on the manifest.
        first = [each for each in anatomy.attachments if each.name in ("manifest.json", "geometry.json")]
        attachment = chance.choice(anatomy.attachments + first * 3)
        attachment.data = document(attachment.data, chance)


def _metadata(anatomy: Anatomy, chance: Random) -> None:
    if not anatomy.metadata or chance.random() < 0.3:
        values = {name: json.dumps(odd_value(chance)) for name in chance.sample(["earlier", "text", "log", "lost"], 3)}
        anatomy.metadata.append(Metadata("symaware.recovery", values))
        return
    record = chance.choice(anatomy.metadata)
    match chance.randrange(4):
        case 0:
            record.name = chance.choice([name for name in NAMES if len(name) < 1000])
        case 1:
            record.metadata[chance.choice(NAMES)] = chance.choice(NAMES)
        case _ if record.metadata:
            key = chance.choice(list(record.metadata))
            record.metadata[key] = document(record.metadata[key].encode(), chance).decode(errors="replace")


def _schema(anatomy: Anatomy, chance: Random) -> None:
    if not anatomy.schemas:
        return
    schema = chance.choice(anatomy.schemas)
    names = [each.name for each in anatomy.schemas]
    match chance.randrange(6):
        case 0 | 1:
            schema.name = chance.choice([*names, *names, *NAMES])
        case 2:
            schema.encoding = chance.choice(["protobuf", "jsonschema", "", "ros2msg", "a\0"])
        case 3:
            schema.data = chance.choice([b"", chance.randbytes(100), schema.data[:-3]])
        case 4:
            schema.id = chance.choice([0, 1, 2, 65_535])
        case 5:
            count = chance.choice([100, 5_000, 20_000])
            anatomy.schemas += [Schema(k % 65_536, b"", "", f"{chance.random()}") for k in range(50, 50 + count)]


def _channel(anatomy: Anatomy, chance: Random) -> None:
    if not anatomy.channels:
        return
    channel = chance.choice(anatomy.channels)
    topics = [each.topic for each in anatomy.channels]
    match chance.randrange(8):
        case 0 | 1:
            channel.topic = chance.choice([*topics, *NAMES, "/agents//state", "/world/robot/", "/world/wall/pose"])
        case 2 | 3:
            channel.schema_id = chance.choice([0, 1, 65_535, *(each.id for each in anatomy.schemas)])
        case 4:
            channel.metadata = {
                "columns": chance.choice(["", "x", "x," * 50, ",,", "a\n,b", "x" * 70_000]),
                "units": "",
            }
        case 5:
            channel.message_encoding = chance.choice(["json", "", "protobuf2"])
        case 6:
            channel.id = chance.choice([0, 1, 2, 3, 65_535])
        case 7:
            count = chance.choice([100, 5_000, 20_000])
            anatomy.channels += [
                Channel(k, f"/{k % chance.choice([3, 10**6])}", "protobuf", {}, chance.choice([0, 1]))
                for k in range(100, 100 + count)
            ]


def _message(anatomy: Anatomy, chance: Random) -> None:
    """Change messages of one channel, as kinds differ in how often they occur."""
    there = sorted({told.channel for chunk in anatomy.chunks for told in chunk})
    if not there:
        return
    channel = chance.choice(there)
    places = [(chunk, place) for chunk in anatomy.chunks for place, told in enumerate(chunk) if told.channel == channel]
    for chunk, place in chance.sample(places, min(len(places), chance.choice([1, 1, 3, 1000]))):
        chunk[place] = chunk[place]._replace(data=altered_message(chunk[place].data, chance))


def _times(anatomy: Anatomy, chance: Random) -> None:
    chunks = [chunk for chunk in anatomy.chunks if chunk]
    if not chunks:
        return
    chunk = chance.choice(chunks)
    for _ in range(chance.choice([1, 5])):
        place = chance.randrange(len(chunk))
        time = chance.choice([0, 1, chunk[0].time, 10**12, 2**62, 2**63 - 1, 2**63, 2**64 - 1])
        told = chunk[place]._replace(time=time, sequence=chance.choice([0, chunk[place].sequence, 2**32 - 1]))
        chunk[place] = told if chance.random() < 0.7 else told._replace(channel=chance.choice([0, 1, 2, 3, 65_535]))


def _packing(anatomy: Anatomy, chance: Random) -> None:
    """Falsify a chunk, or make it a decompression bomb."""
    if not anatomy.chunks:
        return
    number = chance.randrange(len(anatomy.chunks))
    channel = anatomy.channels[0].id if anatomy.channels else 1
    size = chance.choice([0, 1, 1 << 18, 1 << 20, 1 << 26, 1 << 28, 1 << 30, (1 << 30) + 1, 1 << 62, (1 << 64) - 1])
    match chance.randrange(7):
        case 0:
            anatomy.packing[number] = Packing(size=size, crc=chance.choice([None, 0]))
        case 1:
            anatomy.packing[number] = Packing(compression=chance.choice(["", "lz4", "none", "zstd\0", "br"]))
        case 2:
            big = min(size, 1 << 28)
            zeros = zstandard.ZstdCompressor(level=1, write_content_size=chance.random() < 0.5)
            packer = zeros.compressobj()
            data = b"".join([*(packer.compress(bytes(1 << 20)) for _ in range(big >> 20)), packer.flush()])
            anatomy.packing[number] = Packing(data=data, size=size, crc=0)
        case 3:
            # Sound, but for one message that is far larger than a log needs.
            anatomy.chunks[number] = [Told(channel, 0, 0, bytes(min(size, 1 << 25)))]
        case 4:
            anatomy.chunks[number] = [Told(channel, k, k, b"") for k in range(chance.choice([10_000, 100_000]))]
        case 5:
            anatomy.packing[number] = Packing(start=chance.choice([0, 2**64 - 1]), end=chance.choice([0, 2**63]))
        case 6:
            anatomy.packing[number] = Packing(crc=chance.choice([0, 1]))


def _arrangement(anatomy: Anatomy, chance: Random) -> None:
    part: list[object] = chance.choice(
        [anatomy.schemas, anatomy.channels, anatomy.attachments, anatomy.chunks, anatomy.metadata]  # type: ignore[list-item]
    )
    if not part:
        return
    match chance.randrange(5):
        case 0:
            part.pop(chance.randrange(len(part)))
        case 1:
            part.clear()
        case 2:
            part.append(chance.choice(part))
        case 3:
            chance.shuffle(part)
        case 4:
            part += [chance.choice(part) for _ in range(chance.choice([10, 300]))]


def _head(anatomy: Anatomy, chance: Random) -> None:
    match chance.randrange(4):
        case 0:
            anatomy.header.profile = chance.choice(["", "ros2", "symaware\0"])
        case 1:
            anatomy.header.library = chance.choice(["", "other", "symaware" * 1000])
        case 2:
            anatomy.summary = False
        case 3:
            anatomy.chunks = [[told] for chunk in anatomy.chunks for told in chunk]


_HOSTILITIES: tuple[Callable[[Anatomy, Random], None], ...] = (
    *(_attachment_name, _attachment_name, _attachment_content, _attachment_content, _attachment_content, _metadata),
    *(_schema, _channel, _channel, _message, _message, _message, _message, _times, _packing, _packing),
    *(_arrangement, _head),
)


def _with_summary(content: bytes, chance: Random) -> bytes:
    """Change a record of the summary, and make its checksum anew."""
    footer = len(content) - 8 - 20 - 9
    start, offsets, _ = struct.unpack_from("<QQI", content, footer + 9)
    if content[footer] != 2 or not 0 < start < footer:
        return content
    records, place = [], start
    while place < footer:
        length = 9 + struct.unpack_from("<Q", content, place + 1)[0]
        records.append(bytearray(content[place : place + length]))
        place += length
    for _ in range(chance.choice([1, 2])):
        record = chance.choice(records)
        match chance.randrange(5):
            case 0:
                records.remove(record)
            case 1:
                records += [record] * chance.choice([1, 1000])
            case 2 | 3 if len(record) > 17:
                at = chance.randrange(9, len(record) - 8)
                number = chance.choice([0, 1, footer, start, len(content), 2**31, 2**32, 2**63, 2**64 - 1])
                record[at : at + 8] = number.to_bytes(8, "little")
            case _:
                record[chance.randrange(9, max(len(record), 10)) % len(record)] ^= 1 << chance.randrange(8)
        if not records:
            break
    section = b"".join(records)
    if chance.random() < 0.1:
        start = chance.choice([0, 8, footer, 2**64 - 1])
    end = content[footer : footer + 9] + struct.pack("<QQ", start, offsets)
    checksum = zlib.crc32(section + end)
    return (
        content[: struct.unpack_from("<Q", content, footer + 9)[0]]
        + section
        + end
        + struct.pack("<I", checksum)
        + content[-8:]
    )


TARGET = Logs()
