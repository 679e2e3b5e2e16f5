"""Whatever a log looks like, every verb that reads one ends with a sentence and a fitting exit status."""

import os
import random
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from mcap.records import Attachment
from mcap.writer import CompressionType, Writer
from simulating import COMMAND, Command, untyped
from small_disk import on_a_small_disk

from fuzzing.anatomy import put_together, take_apart
from fuzzing.log_verbs import DRAWING, QUICK, VERBS, called
from fuzzing.oddities import BILLION_LAUGHS, NAMES, document
from symaware_cli import open_log
from symaware_cli.log.writer import LogWriter

SAVING = tuple(verb for verb in VERBS if not verb.startswith(("inspect", "log")))
"""These write what was asked for."""

verbs = pytest.mark.parametrize("verb", VERBS)
saving = pytest.mark.parametrize("verb", SAVING)


def started(names: Sequence[str]) -> pytest.MarkDecorator:
    """Try verbs in processes of their own; what draws takes seconds to start, and is left to the second stage."""
    return pytest.mark.parametrize(
        "verb", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in names]
    )


class Outcome(NamedTuple):
    """What came of a verb: exit status, standard output, standard error, and what was written."""

    status: int
    output: str
    trouble: str
    files: Sequence[str]


@pytest.fixture
def attempt(tmp_path: Path) -> Callable[[str, Path], Outcome]:
    """Run a verb on a log, and see to what must hold whatever comes of it."""

    def run(verb: str, log: Path) -> Outcome:
        folder = tmp_path / "written"
        folder.mkdir(exist_ok=True)
        beside = sorted(os.listdir(tmp_path))
        content = log.read_bytes() if log.parent == tmp_path and log.name == "log.mcap" and log.is_file() else b""
        status, output, trouble = called(VERBS[verb](log, folder))
        files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
        assert status in (0, 2, 3), trouble
        assert "Traceback (most recent call last)" not in output + trouble
        if status == 2:
            assert str(log) in output + trouble
            assert len(trouble.splitlines()) == ("--json" not in VERBS[verb](log, folder))
            assert files == []
        if status == 3:
            assert "breaks off" in output + trouble or "left out" in output + trouble
        assert sorted(os.listdir(tmp_path)) == beside
        assert not content or log.read_bytes() == content
        if verb == "recover" and files:
            assert open_log(folder / files[0]).verify() is None
        for name in reversed(files):
            path = folder / name
            path.rmdir() if path.is_dir() else path.unlink()
        return Outcome(status, output, trouble, files)

    return run


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory, scenarios: Path) -> bytes:
    """The log of a real run, with contacts and other events, in several chunks."""
    path = tmp_path_factory.mktemp("real") / "hello.mcap"
    options = ["--set", "run.duration=6", "--set", "agents.robot.count=20", "--quiet", "--output", path]
    assert called(["run", scenarios / "head-on.yaml", *options]) == (0, "", "")
    assert len(open_log(path).index.spans) > 1
    return path.read_bytes()


@verbs
def test_a_sound_log_is_no_trouble(
    verb: str, attempt: Callable[[str, Path], Outcome], real: bytes, tmp_path: Path
) -> None:
    (tmp_path / "log.mcap").write_bytes(real)
    outcome = attempt(verb, tmp_path / "log.mcap")
    assert outcome.status == 0, outcome.trouble
    assert bool(outcome.files) == (not verb.startswith(("inspect", "log")))


def cut(verb: str, attempt: Callable[[str, Path], Outcome], real: bytes, path: Path, count: int) -> None:
    found = set()
    for place in random.Random(11).sample(range(len(real)), count):
        path.write_bytes(real[:place])
        outcome = attempt(verb, path)
        found.add(outcome.status)
        assert outcome.status == 2 or place > 40
    assert found >= {0, 3} or count < 100


def flip(verb: str, attempt: Callable[[str, Path], Outcome], real: bytes, path: Path, count: int) -> None:
    chance = random.Random(12)
    for place in chance.sample(range(len(real)), count):
        path.write_bytes(real[:place] + bytes([real[place] ^ 1 << chance.randrange(8)]) + real[place + 1 :])
        attempt(verb, path)


@verbs
@pytest.mark.parametrize(("damage", "count"), [(cut, 200), (flip, 100)])
def test_damage_at_a_random_place_is_reported_and_never_raises(
    verb: str,
    damage: Callable[..., None],
    count: int,
    attempt: Callable[[str, Path], Outcome],
    real: bytes,
    tmp_path: Path,
) -> None:
    damage(verb, attempt, real, tmp_path / "log.mcap", count if verb in QUICK else 3)


@pytest.mark.slow
@verbs
@pytest.mark.parametrize("damage", [cut, flip])
def test_damage_at_many_random_places_is_reported_and_never_raises(
    verb: str, damage: Callable[..., None], attempt: Callable[[str, Path], Outcome], real: bytes, tmp_path: Path
) -> None:
    count = 10 if verb in DRAWING else 60 if verb in QUICK else 25
    damage(verb, attempt, real, tmp_path / "log.mcap", count)


def not_a_log(folder: Path, kind: str) -> Path:
    path = folder / "log.mcap"
    match kind:
        case "folder":
            path.mkdir()
        case "pipe":
            os.mkfifo(path)
        case "below a file":
            path.write_bytes(b"\x89MCAP0\r\n")
            return path / "log.mcap"
        case "loop":
            path.symlink_to(path)
        case "long name":
            return folder / f"{'long' * 100}.mcap"
        case "device":
            return Path("/dev/zero")
        case "empty":
            path.touch()
        case "magic":
            path.write_bytes(b"\x89MCAP0\r\n")
        case "text":
            path.write_text("symaware: 1\nname: hello\n")
        case "noise":
            path.write_bytes(random.Random(1).randbytes(5000))
        case "zeros":
            path.write_bytes(bytes(5000))
        case "later":
            with LogWriter(path) as writer:
                writer.attach("manifest.json", "application/json", b'{"format": 2}')
                writer.finish({})
    return path


@verbs
@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("missing", "there is no file"),
        ("folder", "it is not a file|is a folder, not a log"),
        ("pipe", "it is not a file"),
        ("device", "it is not a file"),
        ("below a file", "part of its path is not a folder"),
        ("loop", "its links lead in a circle"),
        ("long name", "too long"),
        ("empty", "is empty"),
        ("magic", "is not a log: it breaks off in its first record"),
        ("text", "is not a log: it does not begin like an MCAP"),
        ("noise", "is not a log: it does not begin like an MCAP"),
        ("zeros", "is not a log: it does not begin like an MCAP"),
        ("later", "was written by a newer SymAware: its format is 2, this one reads up to 1"),
    ],
)
def test_a_file_that_is_no_log_of_symaware_is_wrong_input(
    verb: str, kind: str, sentence: str, attempt: Callable[[str, Path], Outcome], tmp_path: Path
) -> None:
    outcome = attempt(verb, not_a_log(tmp_path, kind))
    assert outcome.status == 2
    assert any(each in outcome.output + outcome.trouble for each in sentence.split("|"))


NEEDING_A_MANIFEST = ("merge", "replay", "plot", "export csv", "export parquet", "export foxglove")


@verbs
def test_a_damaged_manifest_is_reported_and_the_rest_is_shown(
    verb: str, attempt: Callable[[str, Path], Outcome], real: bytes, tmp_path: Path
) -> None:
    anatomy = take_apart(real)
    chance = random.Random(5)
    for _ in range(20 if verb in QUICK else 3):
        hostile = anatomy.copy()
        (manifest,) = [each for each in hostile.attachments if each.name == "manifest.json"]
        manifest.data = document(manifest.data, chance)
        (tmp_path / "log.mcap").write_bytes(put_together(hostile))
        outcome = attempt(verb, tmp_path / "log.mcap")
        if open_log(tmp_path / "log.mcap").damage:
            assert outcome.status == (2 if verb in NEEDING_A_MANIFEST else 3), outcome.trouble
            assert verb not in NEEDING_A_MANIFEST or "the manifest in" in outcome.trouble


@verbs
@pytest.mark.parametrize("content", [b"[" * 100_000, b"{a: " * 50_000, BILLION_LAUGHS, b"\xff\0"])
def test_attachments_that_nobody_should_read_harm_no_verb(
    verb: str, content: bytes, attempt: Callable[[str, Path], Outcome], real: bytes, tmp_path: Path
) -> None:
    hostile = take_apart(real)
    for names in (["resolved.yaml", "versions.json", "scenario/hello.yaml"], ["geometry.json"]):
        hostile.attachments = [each for each in hostile.attachments if each.name not in names]
        hostile.attachments += [Attachment(0, 0, name, "", content) for name in names]
        (tmp_path / "log.mcap").write_bytes(put_together(hostile))
        outcome = attempt(verb, tmp_path / "log.mcap")
        assert outcome.status == (2 if "geometry.json" in outcome.trouble else 0), outcome.trouble


@pytest.mark.parametrize("verb", [*QUICK, "log digest", "export csv", "run"])
def test_attachments_may_be_called_anything(verb: str, real: bytes, tmp_path: Path) -> None:
    log, folder = tmp_path / "log.mcap", tmp_path / "written"
    hostile = take_apart(real)
    taken = {each.name for each in hostile.attachments} | {"geometry.json"}
    for content in (b"", b"symaware: 1\n"):
        hostile.attachments += [Attachment(0, 0, name, name, content) for name in NAMES if name not in taken]
    log.write_bytes(put_together(hostile))
    folder.mkdir()
    line = ["run", log, "--quiet", "--no-record"] if verb == "run" else VERBS[verb](log, folder)
    status, output, trouble = called(line)
    assert (status, trouble) == (0, "")
    assert all(line.isprintable() for line in output.splitlines())
    assert sorted(os.listdir(tmp_path)) == ["log.mcap", "written"]


@pytest.mark.usefixtures("ordinary_rights")
@verbs
def test_a_log_that_one_may_not_read_is_wrong_input(verb: str, real: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(real)
    path.chmod(0)
    line = VERBS[verb](path, tmp_path)
    status, output, trouble = called(line)
    assert status == 2
    assert f"cannot read the log {path}: permission denied" in output + trouble
    assert os.listdir(tmp_path) == ["log.mcap"]


FOREIGN: dict[str, dict[str, Any]] = {
    "json": {"encoding": "json", "schema": ("thing", "jsonschema", b"{}")},
    "ros1": {"encoding": "ros1", "schema": ("std_msgs/String", "ros1msg", b"string data")},
    "ros2": {"encoding": "cdr", "schema": ("std_msgs/msg/String", "ros2msg", b"string data")},
    "no schema": {"encoding": "json", "schema": None},
    "names like ours": {"encoding": "json", "schema": ("symaware.v1.Event", "jsonschema", b"{}")},
    "unchunked": {"encoding": "json", "schema": None, "use_chunking": False},
    "lz4": {"encoding": "json", "schema": None, "compression": CompressionType.LZ4},
    "uncompressed": {"encoding": "json", "schema": None, "compression": CompressionType.NONE},
    "no summary": {"encoding": "json", "schema": None, "use_statistics": False, "repeat_channels": False},
    "no checksums": {"encoding": "json", "schema": None, "enable_crcs": False},
    "no messages": {"encoding": "json", "schema": None, "times": ()},
    "our profile": {"encoding": "json", "schema": None, "profile": "symaware"},
}


def foreign_log(
    path: Path,
    *,
    encoding: str,
    schema: tuple[str, str, bytes] | None,
    profile: str = "other",
    times: Sequence[int] = (5, 3, 9),
    **options: Any,
) -> Path:
    with open(path, "wb") as file:
        writer = Writer(file, **options)
        writer.start(profile=profile, library="somebody's")
        number = writer.register_schema(*schema) if schema else 0
        for topic in ("/events", "/timing", "/world/robot/state", "/agents/robot/risk", "/camera"):
            channel = writer.register_channel(topic, encoding, number)
            for time in times:
                writer.add_message(channel, time, b"{}", time)
        writer.add_attachment(0, 0, "resolved.yaml", "application/yaml", b"[")
        writer.add_metadata("symaware.outcome", {"status": "{"})
        untyped(writer).finish()
    return path


@verbs
@pytest.mark.parametrize("kind", FOREIGN)
def test_the_showable_part_of_a_log_of_another_program_is_shown(
    verb: str, kind: str, attempt: Callable[[str, Path], Outcome], tmp_path: Path
) -> None:
    path = foreign_log(tmp_path / "log.mcap", **FOREIGN[kind])
    outcome = attempt(verb, path)
    if verb == "inspect":
        # Metadata are not ours to judge; what has our name and cannot be read is told.
        assert outcome.status == 3
        assert ("not written by SymAware" in outcome.output) == (kind != "our profile")
        assert "/camera" in outcome.output
    if verb == "recover":
        assert outcome.files == ["recovered.mcap"]


@started(["inspect", *SAVING])
def test_a_process_of_its_own_says_the_same(verb: str, command: Command, real: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    for content, status in ((b"", 2), (real[: len(real) * 2 // 3], 3), (real, 0)):
        path.write_bytes(content)
        folder = tmp_path / str(status)
        folder.mkdir()
        done = command(*VERBS[verb](path, folder))
        assert done.returncode == status, done.stderr
        assert ("log.mcap" in done.stderr) >= (status == 2)


@started(SAVING)
def test_a_disk_that_fills_up_while_saving_is_a_failure_that_leaves_nothing(
    verb: str, real: bytes, tmp_path: Path
) -> None:
    (tmp_path / "log.mcap").write_bytes(real)
    (tmp_path / "disk").mkdir()
    line = [str(each) for each in VERBS[verb](tmp_path / "log.mcap", Path())]
    done = on_a_small_disk(tmp_path / "disk", [*COMMAND, *line], size="12k")
    assert (done.returncode, done.stdout) == (1, "old\n"), done.stderr
    assert "the disk is full" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@saving
def test_an_unwritable_place_is_reported_before_any_file_is_left(verb: str, real: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(real)
    for folder in (tmp_path / "missing", path):
        status, output, trouble = called(VERBS[verb](path, folder))
        assert (status, output) == (1, ""), trouble
        assert str(folder) in trouble
        assert len(trouble.splitlines()) == 1
    assert os.listdir(tmp_path) == ["log.mcap"]
    assert path.read_bytes() == real


@saving
def test_the_log_itself_is_not_overwritten(verb: str, real: bytes, tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(real)
    line = [path if isinstance(each, Path) and each.name != path.name else each for each in VERBS[verb](path, tmp_path)]
    status, _, trouble = called(line)
    assert status == 2
    assert len(trouble.splitlines()) == 1
    assert path.read_bytes() == real
    assert os.listdir(tmp_path) == ["log.mcap"]
