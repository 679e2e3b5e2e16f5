"""Processes that share a run, for tests."""

import json
import subprocess
import threading
import time
from pathlib import Path

from simulating import COMMAND

PATIENCE = 60


class Process:
    """`symaware run` with some arguments, in a process of its own."""

    def __init__(self, folder: Path, scenario: Path, name: str, *arguments: object, quiet: bool = True) -> None:
        self.log = folder / f"{name}.mcap"
        line = [*COMMAND, "run", scenario, "--output", self.log, "--name", name, *arguments]
        self.said: list[str] = []
        self._popen = subprocess.Popen(
            list(map(str, line)),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with self._popen.stderr as stream:
            for line in stream:
                self.said.append(line.rstrip())

    def wait_for(self, word: str) -> str:
        """Wait until a line with a word is written to stderr."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            for line in list(self.said):
                if word in line:
                    return line
            if self._popen.poll() is not None and not self._reader.is_alive():
                break
            time.sleep(0.01)
        raise AssertionError(f"no `{word}` in {self.said}")

    @property
    def address(self) -> str:
        """Where a host listens."""
        return self.wait_for("waits at").split("waits at ")[1].split()[0]

    def send(self, signal: int) -> None:
        """Send a signal."""
        self._popen.send_signal(signal)

    def end(self) -> int:
        """Wait for its end; its exit status."""
        status = self._popen.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return status

    def close(self) -> None:
        """Make sure that it is over."""
        if self._popen.poll() is None:
            self._popen.kill()
        self.end()


def events(log, *names):
    """The events of some names in a log: their time, name, source and text."""
    return [(each.time, each.name, each.source, each.text) for each in log.events() if each.name in names]


def contents(log):
    """What each channel of a log holds: instants and bytes, those of one instant sorted."""
    found: dict[str, list[tuple[int, bytes]]] = {}
    for message in log.messages():
        if message.channel.topic != "/timing":
            found.setdefault(message.channel.topic, []).append((message.time, message.data))
    return {topic: sorted(entries) for topic, entries in found.items()}


def written(path: Path, document: dict) -> Path:
    """Write a scenario."""
    path.write_text(json.dumps(document))
    return path
