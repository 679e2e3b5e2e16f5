"""Kills every kind of run (kill -9) at a random instant: the log must be readable; no process may hang or remain."""

from __future__ import annotations

import contextlib
import json
import os
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
from fuzzing.targets.components import run

_SCENARIO = """symaware: 1
name: killed
seed: 3
run: {{mode: {mode}, duration: 3000.0{pace}}}
environment: {{use: {world}, with: {{time_step: 0.05}}{entities}}}
agents:
  robot:
    count: {count}
    entity: {{shape: {{circle: {{radius: 0.2}}}}}}
    model: {{use: single-integrator}}
    state: {{circle: {{radius: 9.0}}}}
    knowledge: {{goal: {{circle: {{radius: 9.0, phase: 3.0}}}}}}
    components:
      sense: {{use: perception.range, with: {{range: 5.0, position_noise: 0.1}}}}
      tell: {{use: communication.broadcast}}
      hear: {{use: communication.inbox}}
      steer: {{use: control.go-to-goal{remote}}}
topology: {{use: complete}}
"""

_KINDS = ("synchronous", "asynchronous", "paced", "workers", "pymunk", "pybullet", "host", "member", "many")

#: The greatest time until the log exists [s].
_START_UP = 30.0

#: So long a process waits for one that was killed before they met [s]; less than the other's end is waited for.
_PATIENCE = "20"


class Kills(Target):
    """A case describes which kind of run is killed, and when, as JSON."""

    time_limit = 90.0

    def make(self, chance: Random) -> bytes:
        """Choose a kind and an instant."""
        begun = chance.random() < 0.8
        when = round(chance.uniform(0.0, 2.5 if begun else 1.5), 3)
        return json.dumps({"kind": chance.choice(_KINDS), "begun": begun, "when": when}).encode()

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Start the run, kill it, and check the log."""
        asked = json.loads(case)
        kind = asked["kind"]
        (folder / "killed.yaml").write_text(_scenario(kind))
        log = folder / "killed.mcap"
        if kind in ("host", "member"):
            _shared(folder, asked)
        else:
            process = _start(["run", "killed.yaml", "-o", str(log)], folder, "run")
            _wait(asked, log, process)
            if process.poll() is not None:
                raise Finding("status", f"ended by itself with {process.returncode}", f"a run of kind {kind} ends")
            _kill(process)
        return Counter({f"{kind}: {_look_at(log, folder)}": 1})


def _scenario(kind: str) -> str:
    return _SCENARIO.format(
        mode="asynchronous" if kind == "asynchronous" else "synchronous",
        pace=", pace: 5.0" if kind == "paced" else "",
        world=kind if kind in ("pymunk", "pybullet") else "kinematic",
        entities=", entities: {ball: {shape: {circle: {radius: 0.5}}, position: [0, 0], mass: 1.0}}"
        if kind in ("pymunk", "pybullet")
        else "",
        count=400 if kind == "many" else 4,
        remote=", run_in: process" if kind == "workers" else "",
    )


def _start(arguments: list[str], folder: Path, name: str) -> subprocess.Popen[bytes]:
    with (folder / f"{name}.err").open("wb") as error:
        return subprocess.Popen(
            [sys.executable, "-m", "symaware_cli", *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=error,
            start_new_session=True,
        )


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill only the process; its child processes must notice and end."""
    process.send_signal(signal.SIGKILL)
    process.wait()
    for _ in range(100):
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGKILL)
    raise Finding("left behind", "a process that the run had started outlives it", "a child outlives the run")


def _wait(asked: dict[str, Any], log: Path, process: subprocess.Popen[bytes]) -> None:
    """Wait for the instant at which to kill: after the log has appeared, or after the process was started."""
    end = time.monotonic() + _START_UP
    while asked["begun"] and not log.exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(asked["when"])


def _shared(folder: Path, asked: dict[str, Any]) -> None:
    """Kill one of two processes of a run; the other must end by itself and report the reason."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    host = [
        "run",
        "killed.yaml",
        "--listen",
        port,
        "--wait",
        _PATIENCE,
        "--only",
        "robot.0,robot.1",
        "-o",
        "killed.mcap",
    ]
    member = [
        "run",
        "killed.yaml",
        "--join",
        f"127.0.0.1:{port}",
        "--wait",
        _PATIENCE,
        "--only",
        "robot.2,robot.3",
        "-o",
        "member.mcap",
    ]
    processes = {"host": _start(host, folder, "host")}
    time.sleep(0.3)
    processes["member"] = _start(member, folder, "member")
    _wait(asked, folder / "killed.mcap", processes["host"])
    killed = processes.pop(asked["kind"])
    _kill(killed)
    name, other = next(iter(processes.items()))
    try:
        other.wait(45.0)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(other.pid, signal.SIGKILL)
        other.wait()
        raise Finding("hang", f"the {name} goes on without the {asked['kind']}", f"{name} without the other") from None
    said = (folder / f"{name}.err").read_text(errors="replace")
    if "Traceback (most recent call last)" in said:
        raise Finding("traceback", said, said.strip().splitlines()[-1][:80])
    if other.returncode not in (1, 2):
        raise Finding("status", f"the {name} ends with {other.returncode}\n{said}", f"{name} {other.returncode}")


def _look_at(log: Path, folder: Path) -> str:
    """Check that the commands can read the log as far as it was written."""
    if not log.exists():
        return "no log yet"
    status, out, err = run(["inspect", str(log), "--json"], folder)
    if "Traceback (most recent call last)" in err or status not in (0, 2, 3):
        raise Finding("unreadable", f"inspect: {status}\n{err}", f"inspect {status}")
    if status == 2:
        if log.stat().st_size > 1 << 18:
            raise Finding("unreadable", f"nothing can be read of {log.stat().st_size} bytes\n{err}", "all is lost")
        return "nothing in it yet"
    json.loads(out)
    status, _, err = run(["recover", str(log), "-o", "sound.mcap"], folder)
    if status not in (0, 3):
        raise Finding("unreadable", f"recover: {status}\n{err}", f"recover {status}")
    return "read"


TARGET = Kills()
