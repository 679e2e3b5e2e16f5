"""Runs every scenario and checks what became of it, on this processor and on emulated ones.

    .venv/bin/python .ci/scenarios.py [--quick] [--python INTERPRETER]... [--keep FOLDER] FOLDER...

Each scenario must be sound, run to its end with updates in its log and no failures, and give the same digest as on an
emulated processor of level x86-64-v3, with another interpreter; with further interpreters, the messages of its first
seconds must be the same. Which interpreter runs all of it differs from scenario to scenario; those that need PyBullet
run with this one alone.
On a processor of level x86-64-v2, of which less is promised, true positions of some of them must agree within a
tolerance, at least until the motion amplifies rounding (docs/repeatability.md). With --quick nothing is emulated.
--keep keeps the logs, of which docs/website/build.py makes a gallery.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from symaware_cli import Scenario, ScenarioError, open_log, processor
from symaware_cli.log.digest import digest
from symaware_cli.log.log_schema import MANIFEST, TIMING

TOLERANCE = 1e-6
"""Metres that a position may differ by on a processor of level x86-64-v2."""

AMPLIFIED = {"mpc.yaml": 3.5, "racecars.yaml": 0.5, "swarm.yaml": 30.0}
"""Scenarios whose motion amplifies rounding, and until when [s] they must agree all the same."""

LESSER = (*AMPLIFIED, "circle-swap.yaml", "crossing.yaml", "drones.yaml", "intent-avoidance.yaml", "rendezvous.toml")
"""Scenarios that are run as on a processor of level x86-64-v2, too."""

BEGINNING = 2.0
"""How much of each scenario runs with further interpreters [s], at least `FIRST` steps."""

FIRST = 40

BEGIN = """
import json, os, sys, symaware_cli
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # what scenarios print is no answer
for line in sys.stdin:
    scenario, steps, log = json.loads(line)
    try:
        with symaware_cli.load(scenario).start(output=log) as simulation:
            simulation.step(steps)
        failure = None
    except Exception as error:
        failure = f"{type(error).__name__}: {error}"
    print(json.dumps(failure), file=answers, flush=True)
"""
"""Runs, for each line of its input, a number of steps of a scenario with a log; answers with the failure, or null."""

VIOLATED = (
    *("learned.yaml", "lost-drone.yaml", "lost-link.yaml", "mist.yaml", "published.yaml", "random-walk.yaml"),
    *("shortcut.yaml", "simplex.yaml"),
)
"""Scenarios in which a specification is violated, so that they exit with 3."""


class FailedError(Exception):
    """Something is not as it should be."""


def main() -> None:
    """Try all scenarios, report on each, and exit with 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--python", action="append", default=[], metavar="INTERPRETER")
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    arguments = parser.parse_args()
    if arguments.keep is not None:
        arguments.keep.mkdir(parents=True, exist_ok=True)
    found = [path for folder in arguments.folders for path in folder.rglob("*") if path.suffix in (".yaml", ".toml")]
    # A name with an underscore before it belongs to a base that others extend.
    scenarios = sorted(path for path in found if not path.name.startswith("_"))
    failures = 0
    # As many at a time as there are cores, each in a process of its own: logs are read and compared in Python.
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for scenario, attempt in [
            (each, pool.submit(tried, each, arguments.quick, arguments.python, arguments.keep)) for each in scenarios
        ]:
            try:
                print(f"{scenario}: {attempt.result()}", flush=True)
            except (FailedError, ScenarioError) as failure:
                failures += 1
                print(f"{scenario}: FAILED: {failure}", flush=True)
    print(f"{len(scenarios)} scenarios, {failures} failed")
    sys.exit(bool(failures) or not scenarios)


def tried(scenario: Path, quick: bool, interpreters: Sequence[str], keep: Path | None = None) -> str:
    """Run a scenario and say what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        here, other = (Path(folder) / f"{name}.mcap" for name in ("here", "other"))
        outline = Scenario(scenario).validate()
        steps = outline.steps
        summary = ran(scenario, here, {"PYTHONHASHSEED": "1"})
        if summary["steps"] != steps and not ends_itself(here):
            raise FailedError(f"made {summary['steps']} of {steps} steps")
        if keep is not None:
            shutil.copyfile(here, keep / "-".join(scenario.with_suffix(".mcap").parts))
        said = f"{summary['steps']} steps, {summary['updates']} updates"
        if quick:
            return said
        if needs_pybullet(here):
            interpreters = ()
        # The order of sets and the addresses of objects differ as well.
        emulated = {"PYTHONHASHSEED": "2", "PYTHONMALLOC": "malloc", **processor.emulated("x86-64-v3")}
        found = digest(open_log(here))
        first = zlib.crc32(scenario.name.encode()) % max(len(interpreters), 1)
        whole, *others = [*interpreters[first:], *interpreters[:first]] or [sys.executable]
        alike = Path(folder) / "alike.mcap"
        ran(scenario, alike, emulated, whole)
        if differing := found.differences(digest(open_log(alike))):
            raise FailedError(f"differs on a processor of level x86-64-v3, with {whole}, in {', '.join(differing)}")
        said += f"; the same on x86-64-v3{' with another interpreter' * bool(interpreters)}"
        beginning = min(steps, max(FIRST, round(BEGINNING / outline.time_step)))
        for number, interpreter in enumerate(others):
            part = Path(folder) / f"beginning-{number}.mcap"
            begun(interpreter, scenario, beginning, part)
            if differing := differing_beginning(here, part):
                raise FailedError(f"its first {beginning} steps differ with {interpreter} in {', '.join(differing)}")
            said += f", {beginning} steps with one more"
        if scenario.name not in LESSER:
            return said
        until = AMPLIFIED.get(scenario.name, np.inf)
        shorter = ("--set", f"run.duration={until}") if until < outline.duration else ()
        ran(scenario, other, processor.emulated("x86-64-v2"), more=shorter)
        apart, since = distance(here, other, until)
        if apart > TOLERANCE:
            raise FailedError(
                f"positions differ by {apart:.2g} m on a processor of level x86-64-v2, from {since:g} s on"
            )
        return f"{said}; {f'off by {apart:.1g} m' if apart else 'the same'} on x86-64-v2"


def ran(
    scenario: Path,
    log: Path,
    variables: dict[str, str],
    interpreter: str = sys.executable,
    more: Sequence[str] = (),
) -> dict[str, object]:
    """Run a scenario as on some processor, and return its summary, which must be that of a sound run."""
    told = symaware("run", scenario, "--json", "--output", log, *more, variables=variables, interpreter=interpreter)
    summary: dict[str, object] = json.loads(told)
    for name, right in (("status", "finished"), ("failure", None), ("failures", 0)):
        if summary[name] != right:
            raise FailedError(f"{name} is {summary[name]!r} and not {right!r}")
    for name in ("steps", "updates", "simulated_time"):
        if not summary[name]:
            raise FailedError(f"{name} is {summary[name]!r}")
    if damage := open_log(log).damage:
        raise FailedError(f"its log is damaged: {damage}")
    return summary


def differing_beginning(whole: Path, part: Path) -> list[str]:
    """Return the topics and attachments in which a log differs from the beginning of another one."""
    logs = [open_log(each) for each in (whole, part)]
    # The messages that end a run are at its last instant, and are not in the whole one.
    end = max(message.time for message in logs[1].messages())
    told: list[dict[str, list[tuple[int, int, bytes]]]] = [{}, {}]
    for log, found in zip(logs, told, strict=True):
        for message in log.messages(end=end):
            if message.channel.topic != TIMING:
                kept = (message.time, message.sequence, message.data)
                found.setdefault(message.channel.topic, []).append(kept)
    one, other = ({name: log.attachments[name] for name in (MANIFEST, "resolved.yaml")} for log in logs)
    if not told[1]:
        raise FailedError("its beginning has no messages")
    return [
        *(topic for topic in sorted({*told[0], *told[1]}) if told[0].get(topic) != told[1].get(topic)),
        *(name for name in one if one[name] != other[name]),
    ]


def ends_itself(log: Path) -> bool:
    """Whether the scenario has a condition that may end the run before its time."""
    resolved = yaml.safe_load(open_log(log).attachments["resolved.yaml"])
    return resolved["run"].get("until") is not None


def needs_pybullet(log: Path) -> bool:
    """Whether the world of a run is that of PyBullet."""
    resolved = yaml.safe_load(open_log(log).attachments["resolved.yaml"])
    return bool(resolved["environment"]["use"] == "pybullet")


def symaware(*arguments: object, variables: dict[str, str], interpreter: str) -> str:
    """Run the program with no kernels chosen but those given, and return what it printed."""
    return started([interpreter, "-P", "-m", "symaware_cli", *arguments], variables)


@cache
def beginner(interpreter: str) -> subprocess.Popen[str]:
    """Start an interpreter with `BEGIN`; it ends with this process.

    One for all scenarios, since to start it takes as long as many a beginning. That earlier runs in the same process
    change nothing is promised, too.
    """
    return subprocess.Popen(
        [interpreter, "-P", "-c", BEGIN],
        env=clean() | {"PYTHONHASHSEED": "3"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def begun(interpreter: str, scenario: Path, steps: int, log: Path) -> None:
    """Run a number of steps of a scenario with another interpreter."""
    process = beginner(interpreter)
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(BrokenPipeError):  # as if it had ended without an answer
        print(json.dumps([str(scenario), steps, str(log)]), file=process.stdin, flush=True)
    answer = process.stdout.readline()
    if not answer:
        beginner.cache_clear()
        raise FailedError(f"{interpreter} ended with {process.wait()} in its first {steps} steps")
    if failure := json.loads(answer):
        raise FailedError(f"its first {steps} steps failed with {interpreter}: {failure}")


def clean() -> dict[str, str]:
    """The environment with no kernels chosen."""
    return {name: value for name, value in os.environ.items() if name not in processor.VARIABLES}


def started(line: Sequence[object], variables: dict[str, str]) -> str:
    """Run a command with no kernels chosen but those given, and return what it printed."""
    words = list(map(str, line))
    done = subprocess.run(
        words, env=clean() | variables, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    # A run in which a specification is violated has come to its end as well.
    violated = done.returncode == 3 and any(Path(each).name in VIOLATED for each in words)
    if done.returncode and not violated:
        said = f"{done.stdout}{done.stderr}".strip()
        raise FailedError(f"{words[0]} exited with {done.returncode}: {said}")
    return done.stdout


def distance(first: Path, second: Path, until: float) -> tuple[float, float]:
    """The greatest distance between the true positions of an agent in two logs [m], and when it exceeds what may be."""
    logs = [open_log(each) for each in (first, second)]
    greatest, since = 0.0, np.inf
    for group in logs[0].manifest["groups"].values():
        place = group["model"]["position"]
        for agent in group["agents"]:
            one, other = (log.series(agent, "world") for log in logs)
            times, rows, others = np.intersect1d(one.seconds, other.seconds, return_indices=True)
            apart = np.linalg.norm((one.values[rows] - other.values[others])[:, place], axis=1)[times <= until]
            greatest = max(greatest, float(apart.max(initial=0.0)))
            far = np.flatnonzero(apart > TOLERANCE)
            since = min(since, float(times[far[0]])) if far.size else since
    return greatest, since


if __name__ == "__main__":
    main()
