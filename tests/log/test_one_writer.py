"""A log has one writer at a time; a second one is refused before it changes anything."""

import subprocess
import sys
from pathlib import Path

import pytest

from symaware_cli.log.error import OutputError
from symaware_cli.log.writer import LogWriter

WRITE = """
import sys
from symaware_cli.log.error import OutputError
from symaware_cli.log.writer import LogWriter
try:
    LogWriter(sys.argv[1])
except OutputError as error:
    print(error)
"""


def test_a_log_that_is_being_written_is_not_opened_by_another_process(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path) as writer:
        writer.attach("a.txt", "text/plain", b"content")
        before = path.read_bytes()
        done = subprocess.run([sys.executable, "-c", WRITE, path], capture_output=True, text=True, check=True)
        assert done.stdout == f"cannot create the log {path}: another run is writing it\n"
        assert path.read_bytes() == before
        with pytest.raises(OutputError, match="another run is writing it"):
            LogWriter(path)
        assert path.read_bytes() == before
        writer.finish({})
    with LogWriter(path) as again:
        again.finish({})


@pytest.mark.parametrize("end", ["finish", "abort"])
def test_a_log_can_be_overwritten_once_its_writer_has_closed_it(end: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"something longer than a log that has no messages" * 1000)
    for _ in range(2):
        with LogWriter(path) as writer:
            if end == "finish":
                writer.finish({})
    assert path.stat().st_size < 30_000
