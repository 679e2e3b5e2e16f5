"""Fuzzes whole runs with components that raise, return invalid values, block, recurse, start threads or exit."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from random import Random

from fuzzing.target import Finding, Target

_SCENARIO = """symaware: 1
name: faulty
run: {{mode: {mode}, duration: 0.3}}
environment: {{use: kinematic, with: {{time_step: 0.05}}}}
agents:
  robot:
    count: 2
    model: {{use: unicycle}}
    state: {{circle: {{radius: 3.0}}}}
    knowledge: {{goal: {{all: [1, 1]}}}}
    components:
      sense: {{use: perception.omniscient}}
      bad: {{use: {use}, with: {parameters}{timing}}}
      steer: {{use: control.go-to-goal}}
"""

#: Acts after which a process may end by a signal or by a status of its own.
_ENDINGS = (
    "kill",
    "abort",
    "exit-",
    "hang-up",
    "interrupt-twice",
    "default-signals",
    "interrupt",
    "terminate",
    "sys-exit",
)
#: Acts that may take all the time there is, after which the process ends without an outcome.
_LONG = ("sleep", "busy", "native", "know-much")

#: Acts after which nothing can be said any more, or whose own words are a traceback.
_MUTE = ("close-", "no-output", "no-modules", "shallow", "raising-thread", "no-environment")
#: How long a run may take that is asked to end after `_TIMEOUT`.
_TIMEOUT, _PATIENCE = 3.0, 30.0


class Components(Target):
    """A case describes what a component does, when and in which method, as JSON."""

    time_limit = 90.0

    def prepare(self, folder: Path) -> None:
        """Install the plugin whose components misbehave."""
        plugin = Path(__file__).parents[1] / "plugin"
        information = folder / "faulty-1.dist-info"
        information.mkdir()
        (information / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty\nVersion: 1\n")
        names = {"controller": "FaultyController", "component": "FaultyComponent", "group": "FaultyGroup"}
        lines = [f"faulty.{name} = faulty:{kind}" for name, kind in names.items()]
        (information / "entry_points.txt").write_text("[symaware.components]\n" + "\n".join(lines) + "\n")
        paths = [str(plugin), str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
        os.environ["PYTHONPATH"] = os.pathsep.join(paths)
        sys.path[:0] = paths[:2]
        import faulty

        self._acts, self._values, self._where = sorted(faulty.ACTS), sorted(faulty.VALUES), faulty.WHERE

    def make(self, chance: Random) -> bytes:
        """Choose the misbehaviour."""
        wrong = {"value": chance.choice(self._values)} if chance.random() < 0.25 else {"act": chance.choice(self._acts)}
        where = chance.choice(["compute", "compute", "compute", "update", "update", *self._where])
        if wrong.get("act") in ("sleep", "busy", "native") and where not in ("compute", "update"):
            where = "initialise"  # before the run begins, only Ctrl-C ends what takes too long
        parameters = {**wrong, "where": where, "turn": chance.choice([1, 1, 2, 4])}
        mode = chance.choice(["synchronous", "asynchronous"])
        timing: dict[str, object] = {}
        if chance.random() < 0.3:
            timing["on_failure"] = chance.choice(["stop", "restart", "retire", "coast"])
        if chance.random() < 0.2:
            timing["latency"] = 0.1
        if chance.random() < 0.15:
            timing["run_in"] = "process"
        case = {
            "mode": mode,
            "use": f"faulty.{chance.choice(['controller', 'controller', 'component', 'group'])}",
            "parameters": parameters,
            "timing": timing,
            "record": chance.random() < 0.8,
            "json": chance.random() < 0.3,
        }
        return json.dumps(case).encode()

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Run the scenario as a user would, and check the output and the log."""
        asked = json.loads(case)
        act = asked["parameters"].get("act", "")
        timing = "".join(f", {key}: {value}" for key, value in asked["timing"].items())
        text = _SCENARIO.format(
            mode=asked["mode"], use=asked["use"], parameters=json.dumps(asked["parameters"]), timing=timing
        )
        (folder / "faulty.yaml").write_text(text)
        log = folder / "faulty.mcap"
        options = ["-o", str(log)] if asked["record"] else ["--no-record"]
        options += ["--json"] if asked["json"] else []
        status, out, err = run(["run", "faulty.yaml", "--timeout", str(_TIMEOUT), *options], folder)
        ended = act.startswith(_ENDINGS)
        # An interpreter without its modules may crash; its log must be readable all the same.
        if status not in (0, 1, 2, 3, 130) and not ended and act != "no-modules":
            raise Finding("status", f"exit status {status}\n{err}", f"{status} after {act}")
        # Without a log, the traceback of a component is printed below what became of the run.
        told = not asked["record"] and re.search(r"^symaware: agents\..* failed at .* s: ", err, re.MULTILINE)
        if "Traceback (most recent call last)" in err and not told and not act.startswith((*_MUTE, *_ENDINGS)):
            raise Finding("traceback", err, err.strip().splitlines()[-1][:80])
        if asked["json"] and status in (0, 1, 3) and not ended and not act.startswith((*_MUTE, *_LONG)):
            try:
                json.loads(out)
            except ValueError as error:
                raise Finding("json", f"what is printed is not JSON: {error}\n{out[:500]}", act) from error
        if log.exists():
            _look_at(log, act, status, ended)
        return Counter({f"status {status}": 1})


def _look_at(log: Path, act: str, status: int, ended: bool) -> None:
    """Check that the log can be read and contains the outcome of the run."""
    from symaware_cli.log import LogError, open_log

    try:
        read = open_log(log)
        list(read.events())
    except LogError as error:
        if not act.startswith(("close-files", *_ENDINGS)):
            raise Finding("unreadable", f"{error}", act) from error
        return
    if read.outcome is None and status in (0, 1, 130) and not ended and act not in ("close-files", *_LONG):
        raise Finding("unreadable", f"status {status}, and the log has no outcome", act)


def run(arguments: list[str], folder: Path, patience: float = _PATIENCE) -> tuple[int, str, str]:
    """Run `symaware` in a process of its own.

    Returns:
        Exit status, and what it printed to either stream.

    Raises:
        Finding: It did not end.
    """
    command = [sys.executable, "-m", "symaware_cli", *arguments]
    with (folder / "out").open("wb") as out, (folder / "err").open("wb") as err:
        process = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err, start_new_session=True
        )
        try:
            status = process.wait(patience)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise Finding("hang", f"{' '.join(arguments)} does not end\n{_read(folder / 'err')}", "run") from None
    if status >= 0 and _anybody(process.pid):
        os.killpg(process.pid, signal.SIGKILL)
        raise Finding("left behind", f"a process outlives {' '.join(arguments)}", "a process outlives the run")
    return status, _read(folder / "out"), _read(folder / "err")


def _anybody(group: int) -> bool:
    """Whether a process of a group is left, a moment later."""
    for _ in range(30):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.1)
    return True


def _read(path: Path) -> str:
    return path.read_text(errors="replace")


TARGET = Components()
