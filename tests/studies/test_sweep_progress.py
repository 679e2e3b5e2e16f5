"""A sweep reports its progress on a terminal, and nowhere else."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
from pathlib import Path

from simulating import COMMAND
from sweeping import tiny

_WIDTH = 80


def on_a_terminal(arguments: list[str], folder: Path) -> str:
    """Run the command with a terminal as stderr, and return the text shown there."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, _WIDTH, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS")}
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=theirs,
        cwd=folder,
        env={**environment, "TERM": "xterm-256color"},
    )
    os.close(theirs)
    shown = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # the other end was closed
            break
        if not part:
            break
        shown += part
    os.close(ours)
    assert process.wait() == 0
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())


def test_progress_in_a_narrow_terminal_shows_rate_time_left_and_interval(tmp_path: Path) -> None:
    tiny(tmp_path)
    name = "a-name-that-is-rather-long-for-a-folder"
    shown = on_a_terminal(["sweep", "tiny.yaml", "-o", name, "--runs", "60", "-j", "0", "--batch", "off"], tmp_path)
    frames = [frame for frame in re.split(r"[\r\n]+", shown) if frame.strip()]
    assert max(map(len, frames)) <= _WIDTH
    assert re.match(
        r"a-name-that-is-… (\S+ +)?60 of 60 runs, [\d.]+/s, 0:00:00 left, satisfied\.near 0\.\d+ to 0", frames[-1]
    )


def test_without_a_terminal_there_is_no_progress(tmp_path: Path) -> None:
    arguments = ["sweep", str(tiny(tmp_path)), "-o", str(tmp_path / "out"), "--runs", "5", "-j", "0"]
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert done.stdout.splitlines()[0].endswith("finished; 5 of 5 runs done")
