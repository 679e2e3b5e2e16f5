"""Processes that share a run, for tests."""

from __future__ import annotations

import copy
import json
import subprocess
import threading
import time
from collections import Counter
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from parts import contents
from ports import free_port
from simulating import COMMAND, in_process

from symaware_cli.log import others_message
from symaware_cli.log.reader import Log, open_log
from symaware_cli.processes.merging import merge
from symaware_cli.processes.process_log import open_process_logs

PATIENCE = 180
"""The longest wait of a test for an event that should happen soon [s]."""

GATHERING = frozenset({"started", "finished", "waiting", "joined", "lost", "rejoined", "restored", "not-restored"})
"""The events about the membership of processes."""


TALK: dict[str, Any] = {
    "symaware": 1,
    "name": "talk",
    "seed": 3,
    "run": {"duration": 3.0},
    "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
    "agents": {
        "car": {
            "count": 3,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "single-integrator"},
            "state": [[20.0, 1.0], [20.5, -0.2], [20.5, 0.2]],
            "components": {
                "tell": {"use": "communication.broadcast", "period": 0.2},
                "hear": {"use": "communication.inbox"},
            },
        },
        "robot": {
            "count": 4,
            "entity": {"shape": {"circle": {"radius": 0.3}}},
            "model": {"use": "single-integrator"},
            "state": {"circle": {"radius": 1.0}},
            "knowledge": {"goal": {"circle": {"radius": 1.0, "phase": 3.0}}},
            "components": {
                "sense": {"use": "perception.self"},
                "tell": {"use": "communication.state", "period": 0.1, "with": {"knowledge": ["goal"]}},
                "hear": {"use": "communication.inbox"},
                "think": {"use": "doubles.thinker", "period": 0.1},
            },
        },
        "walker": {
            "count": 3,
            "model": {"use": "unicycle", "with": {"process_noise": [0.02, 0.02, 0.01]}},
            "state": [[-20.0, 0.0, 0.0], [-20.0, 5.0, 1.0], [-18.0, 0.0, 2.0]],
            "components": {
                "see": {"use": "perception.range", "with": {"range": 9.0, "position_noise": 0.1}},
                "believe": {"use": "uncertainty.gaussian", "with": {"acceleration_noise": 0.5}},
            },
        },
    },
    "topology": {
        "use": "range",
        "with": {"range": 1.5, "hysteresis": 0.2},
        "channel": {"delay": {"exponential": 0.04}, "jitter": 0.02, "loss": 0.2, "duplication": 0.1},
        "links": [{"sender": "car.0", "channel": {"loss": 0.5}}, {"receiver": "robot.3", "channel": {"delay": 0.3}}],
    },
    "faults": {
        "rest": {"at": 1.0, "for": 0.5, "stop": "walker.1"},
        "silence": {"at": 1.0, "for": 0.5, "stop": "car.2"},
        "drift": {"at": 1.2, "for": 0.5, "bias": {"of": "robot.1.sense", "state": [0.5, 0.0]}},
        "cut": {"at": 1.5, "for": 0.5, "drop": {"sender": "robot.2"}},
    },
}
"""Three groups that talk over a bad network, move by chance and have faults."""


def busy(document: dict[str, Any]) -> dict[str, Any]:
    """`TALK` with components whose turns take time, are triggered by events, and are taken between the steps.

    Every agent reaches all others without a delay, so that messages arrive at steps only, in one process as in several.
    """
    document = copy.deepcopy(document)
    del document["topology"]
    robot, car, walker = (document["agents"][name]["components"] for name in ("robot", "car", "walker"))
    robot["think"] |= {"period": 0.07, "latency": {"uniform": [0.02, 0.12]}, "overrun": "queue"}
    robot["listen"] = {"use": "doubles.ear", "trigger": {"event": "thought", "of": "think"}, "period": 0.04}
    car["tell"] |= {"period": 0.11, "jitter": 0.02}
    walker["see"] |= {"period": 0.03}
    return document


class Process:
    """`symaware run` with some arguments, in a process of its own."""

    def __init__(self, folder: Path, scenario: Path, name: str, log: Path, *arguments: object) -> None:
        self.name = name
        self.log = log
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
        assert self._popen.stderr
        with self._popen.stderr as stream:
            for line in stream:
                self.said.append(line.rstrip())

    def wait_for(self, word: str, count: int = 1) -> str:
        """Wait until some lines with a word are written to stderr; the last of them."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            found = [line for line in list(self.said) if word in line]
            if len(found) >= count:
                return found[count - 1]
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
    def is_running(self) -> bool:
        """Whether it is not over."""
        return self._popen.poll() is None

    @property
    def memory(self) -> int:
        """Its memory [bytes]; 0 if it has ended."""
        status = Path(f"/proc/{self._popen.pid}/status").read_text()
        return sum(int(line.split()[1]) * 1024 for line in status.splitlines() if line.startswith("VmRSS:"))

    @property
    def text(self) -> str:
        """All of its output to the standard error stream."""
        return "\n".join(self.said)


class Spread:
    """A run that several processes share, at a port of its own."""

    def __init__(self, folder: Path, scenario: Path, *arguments: object, port: int | None = None) -> None:
        folder.mkdir(exist_ok=True)
        self.folder = folder
        self.scenario = scenario
        self.port = port or free_port()
        self.processes: list[Process] = []
        self._arguments = arguments

    def host(self, *arguments: object) -> Process:
        """Start the host."""
        return self._start("host", "--listen", self.port, *arguments)

    def member(self, name: str, only: str, *arguments: object) -> Process:
        """Start a member; one that comes again records another part."""
        return self._start(name, "--join", f"127.0.0.1:{self.port}", "--only", only, *arguments)

    def _start(self, name: str, *arguments: object) -> Process:
        again = sum(each.name == name for each in self.processes)
        log = self.log(name + "-again" * again)
        process = Process(self.folder, self.scenario, name, log, *self._arguments, *arguments)
        self.processes.append(process)
        return process

    def end(self) -> list[int]:
        """Wait until all are over; their exit statuses."""
        return [each.end() for each in self.processes]

    def finish(self) -> None:
        """Wait until all are over, as they should be."""
        statuses = self.end()
        assert set(statuses) == {0}, (statuses, [each.text for each in self.processes])

    def close(self) -> None:
        """Make sure that all are over."""
        for each in self.processes:
            each.close()

    def log(self, name: str) -> Path:
        """Where a process records its part."""
        return self.folder / f"{name}.mcap"

    def merged(self) -> Log:
        """The log of the whole run."""
        path = self.folder / "merged.mcap"
        merge(open_process_logs([each.log for each in self.processes]), path)
        return open_log(path)


def alone(folder: Path, scenario: Path, *arguments: object) -> Log:
    """The log of the same run in one process."""
    folder.mkdir(exist_ok=True)
    path = folder / "alone.mcap"
    with chdir(folder):
        done = in_process("run", scenario, "--quiet", "--output", path, *arguments)
    assert done.returncode == 0, done.stderr
    return open_log(path)


def differences(log: Log, other: Log) -> dict[str, tuple[Counter[Any], Counter[Any]]]:
    """The content of each topic that only one of two logs has, except membership and speed.

    Messages are compared one by one: in columns, those of a group stand together as far as they come from one process.
    Of an agent it does not count how often the same is said: if one changes, others of its group may be told of again.
    A message that is sent or lost between two steps counts at the time of sending: a host records it when it takes it.
    """
    said = [contents(each) for each in (log, other)]
    for each, content in zip((log, other), said, strict=True):
        told = (one if one.stage == "DELIVERED" else replace(one, time=one.sent_time) for one in each.communications())
        content["/messages"] = Counter(map(repr, told))
    found = {}
    for topic in sorted(said[0].keys() | said[1].keys()):
        one, two = (each.get(topic, Counter()) for each in said)
        if topic.startswith("/agents/"):
            one, two = _without_repetition(one), _without_repetition(two)
        if topic == "/events":
            one, two = (_of_the_run(each) for each in (log, other))
        if one != two:
            found[topic] = one - two, two - one
    return found


def _without_repetition(said: Counter[Any]) -> Counter[Any]:
    last: dict[int, bytes] = {}
    kept: Counter[Any] = Counter()
    for instant, row, data in sorted(said):
        # Who is first said to be aware of nobody was so before.
        if last.get(row, others_message.encode_awareness([0], [], [], np.empty(0), [row])) != data:
            kept[instant, row, data] += 1
        last[row] = data
    return kept


def _of_the_run(log: Log) -> Counter[Any]:
    return Counter(
        (event.time, event.name, event.source, event.level, event.text, repr(event.data))
        for event in log.events()
        if event.name not in GATHERING
    )


def await_file(path: Path) -> None:
    """Wait until there is a file."""
    end = time.monotonic() + PATIENCE
    while not path.exists():
        assert time.monotonic() < end
        time.sleep(0.005)


def successor(processes: list[Process], name: str) -> Process:
    """Wait until one of several processes continues in the place of one that died."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for each in processes:
            if each.name == name and f"{name} continues from its state" in each.text:
                return each
        time.sleep(0.005)
    raise AssertionError([each.text for each in processes])


def events(log: Log, *names: str) -> list[tuple[int, str, str]]:
    """The events of some names: time, name and source."""
    return [(each.time, each.name, each.source) for each in log.events() if each.name in names]


def goal_seekers(wait: float = 0.0, timeout: float = 2.0, distance: float = 4.0, **timing: object) -> dict[str, Any]:
    """Two robots that go to their goals, and somebody who takes some wall time in each step [s], if that is wanted.

    Until both are there: then a test that kills one of them ends when it has come back, whatever the machine is like.
    """
    return {
        "symaware": 1,
        "name": "goals",
        "run": {"duration": 1000.0, "until": "all(goals_reached)"},
        "environment": {"use": "kinematic", "with": {"time_step": 0.05}},
        "agents": {
            "ticker": {
                "model": {"use": "single-integrator"},
                "state": [50.0, 50.0],
                "components": {"tick": {"use": "doubles.sleeper", "with": {"duration": wait}}} if wait else {},
            },
            "robot": {
                "count": 2,
                "model": {"use": "single-integrator", "with": {"max_speed": 2.0}},
                "state": [[0.0, 0.0], [0.0, 5.0]],
                "knowledge": {"goal": [[distance, 0.0], [distance, 5.0]]},
                "components": {
                    "sense": {"use": "perception.self", **timing},
                    "steer": {"use": "control.go-to-goal", "with": {"speed": 2.0}, **timing},
                },
            },
        },
        "transport": {"use": "tcp", "with": {"timeout": timeout}},
    }


def written(path: Path, document: dict[str, Any]) -> Path:
    """Write a scenario."""
    path.write_text(json.dumps(document))
    return path
