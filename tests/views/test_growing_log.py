"""A log is followed while it grows: what is drawn in the end is what a finished log has."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import pytest
from mcap.writer import Writer
from plot_logs import YARD, log_of
from simulating import untyped

from symaware_cli.log import Log, LogError, open_log
from symaware_cli.views import following
from symaware_cli.views.chunk import Chunk, ChunkReader
from symaware_cli.views.following import FollowingAbandoned, await_beginning, follow


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return log_of(tmp_path_factory.mktemp("yard"), YARD, "run.duration=0.5")


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "_INTERVAL", 0.0)


def growing(whole: bytes, path: Path, pieces: int) -> Callable[[], bool]:
    """A function that appends a further piece of a log to a file at each call; false after the last."""
    size = -(-len(whole) // pieces)
    left = [whole[start : start + size] for start in range(0, len(whole), size)]

    def grow() -> bool:
        if not left:
            return False
        with path.open("ab") as file:
            file.write(left.pop(0))
        return True

    return grow


def frames(chunks: list[Chunk]) -> dict[str, list[tuple[int, bytes]]]:
    """The instants and values of each topic with columns, chunk by chunk."""
    found: dict[str, list[tuple[int, bytes]]] = {}
    for chunk in chunks:
        for topic in chunk.frames:
            each = chunk.frames[topic]
            pairs = zip(each.times.tolist(), each.values, strict=True)
            found.setdefault(topic, []).extend((time, values.tobytes()) for time, values in pairs)
    return found


@pytest.mark.parametrize("pieces", [1, 100])
def test_a_log_that_grows_piece_by_piece_is_drawn_like_a_finished_one(log: Log, pieces: int, tmp_path: Path) -> None:
    path, drawn = tmp_path / "growing.mcap", list[Chunk]()
    grow = growing(log.path.read_bytes(), path, pieces)
    grow()
    follow(path, ChunkReader({}), drawn.append, grow)
    assert frames(drawn) == frames(list(ChunkReader({}).chunks(log.messages())))


def test_following_ends_when_it_is_no_longer_wanted(log: Log, tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(log.path.read_bytes()[:-2000])
    with pytest.raises(FollowingAbandoned):
        follow(tmp_path / "cut.mcap", ChunkReader({}), lambda chunk: None, lambda: False)
    with pytest.raises(FollowingAbandoned):
        await_beginning(tmp_path / "none.mcap", iter([True, True, False]).__next__)


def test_a_log_begins_with_its_manifest_and_first_messages(log: Log, tmp_path: Path) -> None:
    path = tmp_path / "growing.mcap"
    begun = await_beginning(path, growing(log.path.read_bytes(), path, 20))
    assert begun.manifest == open_log(log.path).manifest
    assert 0 < begun.message_count <= log.message_count


def test_a_damaged_log_and_one_by_another_program_are_reported(log: Log, tmp_path: Path) -> None:
    path, whole = tmp_path / "damaged.mcap", bytearray(log.path.read_bytes())
    whole[8] = 250
    whole[9:17] = (1 << 62).to_bytes(8, "little")
    path.write_bytes(whole)
    with pytest.raises(LogError, match="is damaged"):
        follow(path, ChunkReader({}), lambda chunk: None, lambda: False)
    (tmp_path / "other.mcap").write_bytes(foreign(b"ros2"))
    with pytest.raises(LogError, match="was not written by SymAware"):
        await_beginning(tmp_path / "other.mcap", lambda: True)


def foreign(profile: bytes) -> bytes:
    """A log by another program, with a profile of its own."""
    output = BytesIO()
    writer = untyped(Writer(output))
    writer.start(profile.decode(), "other")
    writer.finish()
    return output.getvalue()
