"""Fuzzes frames of the wire protocol: decodes them, and sends them to a real host while a real member takes part."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

from fuzzing.target import Finding, Target

_SCENARIO = """symaware: 1
name: frames
seed: 1
run: {{duration: {duration}{pace}}}
environment: {{use: kinematic, with: {{time_step: 0.05}}}}
agents:
  robot:
    count: 3
    model: {{use: single-integrator}}
    state: {{circle: {{radius: 9.0}}}}
    knowledge: {{goal: {{circle: {{radius: 9.0, phase: 3.0}}}}}}
    components:
      sense: {{use: perception.self, on_failure: isolate}}
      tell: {{use: communication.broadcast, period: 0.5, on_failure: isolate}}
      hear: {{use: communication.inbox, on_failure: isolate}}
      steer: {{use: control.go-to-goal, on_failure: isolate}}
transport: {{use: tcp, with: {{hang_timeout: 5.0, members: 8}}}}
"""

_KEY = b"a key of the fuzzing tool"

#: One case in so many starts processes; all others decode.
_LIVE = 200

#: How many strangers come in a live case.
_STRANGERS = 40

#: So long the processes of a live case may take [s], and so much memory a host may have [bytes].
_PATIENCE, _MEMORY = 90.0, 400 << 20

_HABITS = ("noise", "silent", "half", "slow", "open", "hello", "insider", "order", "replay", "long", "reset")


class Frames(Target):
    """A case is `D` and a frame to decode, or `L` and the actions of strangers on a live host, as JSON."""

    time_limit = 180.0
    cases_per_worker = 2000

    def prepare(self, folder: Path) -> None:
        """Create some valid frames."""
        self._sound = _sound()

    def make(self, chance: Random) -> bytes:
        """Damage a frame, or choose the actions of strangers."""
        if chance.randrange(_LIVE):
            return b"D" + _damaged(chance, chance.choice(self._sound))
        strangers = [
            {
                "habit": chance.choice(_HABITS),
                "frames": [_damaged(chance, chance.choice(self._sound)).hex() for _ in range(chance.randint(1, 4))],
                "wait": round(chance.uniform(0.0, 0.2), 3),
            }
            for _ in range(_STRANGERS)
        ]
        kind = {"key": chance.random() < 0.3, "paced": chance.random() < 0.3, "late": chance.random() < 0.5}
        return b"L" + json.dumps({**kind, "strangers": strangers}).encode()

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Run the case."""
        if case[:1] == b"D":
            return Counter({_decoded(case[1:]): 1})
        return _Siege(json.loads(case[1:]), folder).held()


def _sound() -> list[bytes]:
    """Valid frames: one of each kind, and several of the large kinds."""
    import numpy as np

    from symaware_cli.core import AwarenessVector, Contact, Delivery, MessageBatch, TimeSeries
    from symaware_cli.core.message import objects
    from symaware_cli.processes.codec import encode
    from symaware_cli.processes.frame import (
        End,
        Frame,
        Hello,
        Notice,
        Post,
        Refusal,
        Report,
        Step,
        Welcome,
    )

    series = TimeSeries.sampled([0, 10], [[1.0, 2.0], [3.0, 4.0]])
    values = {"none": None, "yes": True, "whole": -5, "large": 2**63, "number": 0.5, "text": "word", "raw": b"\0\1",
              "array": np.eye(3), "scalar": np.float32(2.5), "list": [1, [2, "three"]], "tuple": (1, 2),
              "mapping": {"a": {"b": [1.5]}}, "series": series,
              "awareness": AwarenessVector("robot.1", [1.0, 2.0], series, series, series)}  # fmt: skip
    batch = MessageBatch(np.array([0, 2]), {"position": np.ones((2, 2)), "word": np.arange(2)}, "state", None)
    numbers = np.array([0, 1])
    delivery = Delivery(batch, numbers, numbers, numbers, 0, np.array([50, 60]))
    columns = {name: objects([value]) for name, value in values.items()}
    single = MessageBatch(np.array([0]), columns, "word", np.array([1]))
    heard = Delivery(single, numbers[:1], numbers[:1], numbers[:1], 100, np.array([150]))
    world = {"state/robot": np.zeros((3, 2)), "input/robot": np.zeros((3, 2))}
    contact = Contact("robot.0", "robot.1", (0.0, 1.0), 0.1, True, 2.0)
    inputs = {"robot": (np.array([0]), np.ones((1, 2)))}
    frames: list[Frame] = [
        Hello("stranger", bytes(32), "0.1.0", ("robot.0", "robot.1")),
        Welcome(0, 0, 0.0, float("nan")),
        Refusal("no", final=False),
        Step(3, 150, world, (contact,), (heard, delivery, delivery)),
        Report(3, inputs, (Post(single, 100), Post(batch, 100)), (0.5, "robot.0")),
        Report(0, {}),
        Notice("thought", "agents.robot.0.steer", "INFO", "it thought", values),
        End("failed", "because", "agents.robot.0.steer"),
    ]
    return [encode(frame) for frame in frames]


def _damaged(chance: Random, frame: bytes) -> bytes:
    """A frame in which some bytes are replaced, removed or repeated."""
    damaged = bytearray(frame)
    for _ in range(chance.choice((0, 1, 1, 2, 4, 16))):
        place = chance.randrange(len(damaged) + 1)
        match chance.randrange(5):
            case 0 if damaged:
                damaged[place % len(damaged)] = chance.randrange(256)
            case 1:
                damaged[place:place] = chance.randbytes(chance.randint(1, 8))
            case 2:
                del damaged[place : place + chance.randint(1, 16)]
            case 3:
                damaged[place:place] = damaged[place : place + chance.randint(1, 64)]
            case 4 if damaged:
                damaged[place % len(damaged)] ^= 1 << chance.randrange(8)
    return bytes(damaged)


def _decoded(data: bytes) -> str:
    """Decode a frame, and check that an accepted frame is equal after encoding it again."""
    from symaware_cli.engine import FrameError
    from symaware_cli.processes.codec import decode, encode

    try:
        frame = decode(data)
    except FrameError:
        return "decoded: refused"
    once = encode(frame)
    if encode(decode(once)) != once:
        raise Finding("changed", f"{data.hex()} is another frame when it is sent on", "not the same again")
    return f"decoded: {type(frame).__name__}"


class _Siege:
    """A host among strangers, and a member that finishes with it."""

    def __init__(self, asked: dict[str, Any], folder: Path) -> None:
        self._asked = asked
        self._folder = folder
        self._key = _KEY if asked["key"] else None
        pace, duration = (", pace: 1.0", 4.0) if asked["paced"] else ("", 100.0)
        (folder / "frames.yaml").write_text(_SCENARIO.format(pace=pace, duration=duration))
        (folder / "run.key").write_bytes(_KEY)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._tally: Counter[str] = Counter({"live: runs": 1})

    def held(self) -> Counter[str]:
        """Let them come; all must end well."""
        is_over = False
        try:
            host = self._start("host", "--listen", str(self._port), "--only", "robot.2")
            self._wait_for("waits at")
            if not self._asked["late"]:
                self._start_member()
            self._visit()
            if self._asked["late"] and host.poll() is None:
                self._check(host.pid)
                self._start_member()
            for name, process in self._processes.items():
                try:
                    status = process.wait(_PATIENCE)
                except subprocess.TimeoutExpired:
                    raise Finding("hang", f"{name} does not end\n{self._said(name)}", f"the {name} hangs") from None
                said = self._said(name)
                if "Traceback (most recent call last)" in said:
                    raise Finding("traceback", said, said.strip().splitlines()[-1][:80])
                # A stranger that was taken in, as there is no key or it has it, may say that it failed; that ends it.
                if name == "host" and status == 1 and " in stranger " in said.replace("\n", " "):
                    self._tally["live: ended by a stranger that was taken in"] += 1
                    is_over = True
                elif status and not (is_over and status == 1):
                    raise Finding("status", f"{name} ends with {status}\n{said}", f"{name} {status}")
        finally:
            for process in self._processes.values():
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return self._tally

    def _start(self, name: str, *arguments: str) -> subprocess.Popen[bytes]:
        keyed = ["--key-file", "run.key"] if self._key else []
        line = [sys.executable, "-m", "symaware_cli", "run", "frames.yaml", "-o", f"{name}.mcap", "--name", name]
        with (self._folder / f"{name}.err").open("wb") as error:
            process = self._processes[name] = subprocess.Popen(
                [*line, *arguments, *keyed],
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=error,
                start_new_session=True,
            )
        return process

    def _start_member(self) -> None:
        self._start("member", "--join", f"127.0.0.1:{self._port}", "--only", "robot.0,robot.1", "--wait", "30")

    def _said(self, name: str) -> str:
        return (self._folder / f"{name}.err").read_text(errors="replace")

    def _wait_for(self, word: str) -> None:
        end = time.monotonic() + _PATIENCE
        while word not in self._said("host"):
            if self._processes["host"].poll() is not None or time.monotonic() > end:
                raise Finding("status", f"the host does not begin\n{self._said('host')}", "no beginning")
            time.sleep(0.02)

    def _visit(self) -> None:
        """Let the strangers come, some of them at the same time."""
        guests = []
        for each in self._asked["strangers"]:
            if self._processes["host"].poll() is not None:
                break
            with contextlib.suppress(OSError):
                guests.append(_Stranger(self._port, self._key, self._digest()))
                self._tally[f"live: {each['habit']}"] += 1
                self._tally["live: frames"] += guests[-1].act(each["habit"], [bytes.fromhex(f) for f in each["frames"]])
            time.sleep(each["wait"])
            while len(guests) > 12:
                guests.pop(0).close()
        for guest in guests:
            guest.close()

    def _digest(self) -> bytes:
        if not hasattr(self, "_known"):
            from symaware_cli.language.build import build

            self._known: bytes = build(self._folder / "frames.yaml").digest
        return self._known

    def _check(self, pid: int) -> None:
        """When all strangers are gone, nothing is left of them."""
        end = time.monotonic() + 20.0
        while (count := _sockets(pid)) > 1 and time.monotonic() < end:
            time.sleep(0.1)
        if count > 1:
            raise Finding("leak", f"{count} sockets are open when all strangers are gone", "sockets")
        status = Path(f"/proc/{pid}/status").read_text()
        peak = next(int(line.split()[1]) << 10 for line in status.splitlines() if line.startswith("VmHWM"))
        if peak > _MEMORY:
            raise Finding("memory", f"the host needs {peak >> 20} MB", "the host's memory")


def _sockets(pid: int) -> int:
    """How many TCP sockets a process has open."""
    inodes = set()
    for each in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            inodes.add(os.readlink(each))
    tcp = Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]
    return sum(f"socket:[{line.split()[9]}]" in inodes for line in tcp)


class _Stranger:
    """Somebody who connects to a host; speaks the protocol as far as its habit lets it."""

    def __init__(self, port: int, key: bytes | None, digest: bytes) -> None:
        from symaware_cli.processes.protocol import PeerProtocol

        self._socket = socket.create_connection(("127.0.0.1", port), timeout=2.0)
        self._socket.settimeout(0.5)
        self._talk = PeerProtocol(False, key, 2**24, 2.0, 60.0, time.monotonic())
        self._digest = digest

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def act(self, habit: str, frames: list[bytes]) -> int:
        """Do what it does; returns how many frames it sent."""
        from symaware_cli.processes.protocol import FRAME

        talk = self._talk
        if habit == "silent":
            return 0
        if habit == "noise":
            self._socket.sendall(b"".join(frames))
            return len(frames)
        if habit == "half":
            self._socket.sendall(talk.preamble[: len(frames[0]) % 26])
            return 0
        if not self._introduce():
            return 0
        if habit == "open":
            return 0
        if habit in ("hello", "insider", "order"):
            self._say(self._hello(right=habit != "hello"))
        if habit == "slow":
            for byte in self._framed(talk.record(FRAME, frames[0]))[:40]:
                self._socket.sendall(bytes([byte]))
                time.sleep(0.005)
            return 1
        if habit == "long":
            self._socket.sendall((2**31).to_bytes(4) + b"".join(frames))
            return 1
        if habit == "order":
            frames = [each for each in frames for _ in range(2)][::-1]
        for frame in frames:
            record = self._framed(talk.record(FRAME, frame))
            self._socket.sendall(record if habit != "replay" else 2 * record)
        if habit == "reset":
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            self._socket.close()
        return len(frames)

    def _hello(self, *, right: bool) -> bytes:
        from symaware_cli import __version__
        from symaware_cli.processes.codec import encode
        from symaware_cli.processes.frame import Hello

        digest = self._digest if right else hashlib.sha256(self._digest).digest()
        return encode(Hello(f"stranger {self._socket.getsockname()[1]}", digest, __version__, ("robot.0",)))

    def _framed(self, record: bytes) -> bytes:
        return len(record).to_bytes(4) + record

    def _say(self, frame: bytes) -> None:
        from symaware_cli.processes.protocol import FRAME

        self._socket.sendall(self._framed(self._talk.record(FRAME, frame)))

    def _introduce(self) -> bool:
        """Become known to the host; False if it does not let us."""
        from symaware_cli.processes.protocol import PREAMBLE, ConnectionEnded

        talk, data = self._talk, b""
        self._socket.sendall(talk.preamble)
        end = time.monotonic() + 2.0
        with contextlib.suppress(ConnectionEnded, TimeoutError):
            while not talk.open and time.monotonic() < end:
                part = self._socket.recv(65536)
                if not part:
                    return False
                data += part
                while data:
                    start = 4 if talk.introduced else 0
                    length = int.from_bytes(data[:4]) if start else PREAMBLE
                    if len(data) < start + length:
                        break
                    record, data = data[start : start + length], data[start + length :]
                    talk.hear(record, time.monotonic())
                for kind, content in talk.outgoing:
                    self._socket.sendall(self._framed(talk.record(kind, content)))
                talk.outgoing.clear()
        return talk.open and bool(select.select([], [self._socket], [], 0.5)[1])


TARGET = Frames()
