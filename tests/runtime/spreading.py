"""Processes that share a run, for tests."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

from parts import contents
from simulating import COMMAND

from symaware_cli.recording.merging import merge
from symaware_cli.recording.part import open_parts
from symaware_cli.recording.reader import Log, open_log

PATIENCE = 60
"""So long a test waits for what should happen soon, s."""

GATHERING = frozenset({"started", "finished", "waiting", "joined"})
"""The events that tell who took part and until when."""


class Process:
    """`symaware run` with some arguments, in a process of its own."""

    def __init__(self, folder: Path, scenario: Path, name: str, *arguments: object) -> None:
        self.name = name
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
        self.pid = self._popen.pid
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

    def send(self, signal: int) -> None:
        """Send a signal."""
        self._popen.send_signal(signal)

    def end(self) -> int:
        """Wait for its end; its exit status."""
        status = self._popen.wait(PATIENCE)
        self._reader.join(PATIENCE)
        assert not any("Traceback (most recent call last)" in line for line in self.said), self.said
        return status

    def close(self) -> None:
        """Make sure that it is over."""
        if self._popen.poll() is None:
            self._popen.kill()
            self._popen.wait(PATIENCE)
        self._reader.join(PATIENCE)

    @property
    def text(self) -> str:
        """All that it said to people."""
        return "\n".join(self.said)


class Spread:
    """A run that several processes share, at a port of its own."""

    def __init__(self, folder: Path, scenario: Path, *arguments: object) -> None:
        self.folder = folder
        self.scenario = scenario
        self.port = free_port()
        self.processes: list[Process] = []
        self._arguments = arguments

    def host(self, *arguments: object) -> Process:
        """Start the host."""
        return self._start("host", "--listen", self.port, *arguments)

    def member(self, name: str, only: str, *arguments: object) -> Process:
        """Start a member."""
        return self._start(name, "--join", f"127.0.0.1:{self.port}", "--only", only, *arguments)

    def _start(self, name: str, *arguments: object) -> Process:
        process = Process(self.folder, self.scenario, name, *self._arguments, *arguments)
        self.processes.append(process)
        return process

    def end(self) -> dict[str, int]:
        """Wait until all are over; their exit statuses by name."""
        return {each.name: each.end() for each in self.processes}

    def finish(self) -> None:
        """Wait until all are over, as they should be."""
        statuses = self.end()
        assert set(statuses.values()) == {0}, (statuses, [each.text for each in self.processes])

    def close(self) -> None:
        """Make sure that all are over."""
        for each in self.processes:
            each.close()

    def merged(self) -> Log:
        """The log of the whole run."""
        path = self.folder / "merged.mcap"
        merge(open_parts([each.log for each in self.processes]), path)
        return open_log(path)


def free_port() -> int:
    """A port of the loopback that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def alone(folder: Path, scenario: Path, *arguments: object) -> Log:
    """The log of the same run in one process."""
    path = folder / "alone.mcap"
    line = [*COMMAND, "run", scenario, "--quiet", "--output", path, *arguments]
    subprocess.run(list(map(str, line)), cwd=folder, check=True, timeout=PATIENCE, env=os.environ)
    return open_log(path)


def differences(log: Log, other: Log) -> dict[str, tuple[Counter[Any], Counter[Any]]]:
    """What each topic of either log says that the other does not, but for who took part and how fast they were."""
    said = [contents(each) for each in (log, other)]
    found = {}
    for topic in sorted(said[0].keys() | said[1].keys()):
        one, two = (each.get(topic, Counter()) for each in said)
        if topic == "/events":
            one, two = (_of_the_run(each) for each in (log, other))
        if one != two:
            found[topic] = one - two, two - one
    return found


def _of_the_run(log: Log) -> Counter[Any]:
    return Counter(
        (event.time, event.name, event.source, event.level, event.text, repr(event.data))
        for event in log.events()
        if event.name not in GATHERING
    )


def events(log: Log, *names: str) -> list[tuple[int, str, str]]:
    """The events of some names: time, name and source."""
    return [(each.time, each.name, each.source) for each in log.events() if each.name in names]


def written(path: Path, document: dict[str, Any]) -> Path:
    """Write a scenario."""
    path.write_text(json.dumps(document))
    return path
