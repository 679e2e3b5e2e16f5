"""Robots of others in each world: ``python benchmarks/robot_files.py FOLDER`` loads every URDF file below a folder.

Each file is the entity of a scenario, by default with a fixed base, which is checked and placed in its world, in a
process of its own with a time limit. The table has a row for each file that is not loaded: the engine, the file, the
outcome (refused, crashed or timed out) and the reason, which names the place in the file. The last lines have the
number of loaded files of each engine.

The scenarios are in the topmost folders below FOLDER, in which ``package://`` finds packages. ``--json`` prints all
outcomes; ``--free`` gives entities a mass, so that their bases move; ``--leave-out`` loads robots without the shapes
whose meshes are missing, as ``missing: leave-out`` asks for.
"""

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import symaware_cli as sa

ENGINES = ("pybullet", "mujoco")


class Outcome(NamedTuple):
    """What came of a file.

    Attributes:
        engine: The world.
        file: The path below the folder.
        outcome: ``loaded``, ``refused``, ``crashed`` or ``timed out``.
        reason: The message of a refusal.
        seconds: How long it took [s].
    """

    engine: str
    file: str
    outcome: str
    reason: str
    seconds: float


def scenario(engine: str, file: str | None, free: bool, missing: str) -> dict[str, Any]:
    """Return a scenario with a robot from a file, or with a ball."""
    urdf = {"file": file, "radius": 1.0, "missing": missing}
    shape: dict[str, Any] = {"urdf": urdf} if file else {"circle": {"radius": 1.0}}
    robot: dict[str, Any] = {"shape": shape, "position": [0, 0, 2]}
    if free:
        robot["mass"] = 1.0
    return {
        "symaware": 1,
        "name": "robot",
        "run": {"duration": 0.02},
        "environment": {"use": engine, "with": {"time_step": 0.01}, "entities": {"robot": robot}},
    }


def load(folder: Path, file: str, engine: str, free: bool, missing: str, answer: Connection) -> None:
    """Load a file and send the outcome and the reason; in a process of its own."""
    try:
        os.chdir(folder)
        sa.scenario(scenario(engine, file, free, missing))
    except sa.ScenarioError as error:
        answer.send(("refused", " ".join(problem.message for problem in error.problems)))
    else:
        answer.send(("loaded", ""))


def outcome(folder: Path, file: str, engine: str, free: bool, missing: str, limit: float) -> Outcome:
    """Load a file in a process of its own, which is ended after a time limit [s]."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    started = time.monotonic()
    what = (folder, file, engine, free, missing, theirs)
    process = multiprocessing.get_context("fork").Process(target=load, args=what)
    process.start()
    theirs.close()
    found, reason = "timed out", f"not loaded after {limit:g} s"
    try:
        if ours.poll(limit):
            found, reason = ours.recv()
    except EOFError:
        process.join()
        found, reason = "crashed", f"exit status {process.exitcode}"
    process.kill()
    process.join()
    return Outcome(engine, file, found, reason, round(time.monotonic() - started, 2))


def main() -> None:
    """Load all files and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engines", nargs="+", default=list(ENGINES), choices=ENGINES)
    parser.add_argument("--free", action="store_true", help="give each entity a mass")
    parser.add_argument("--leave-out", action="store_true", help="load robots without the meshes that are missing")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for each file")
    parser.add_argument("--json", action="store_true", help="print all outcomes")
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    missing = "leave-out" if arguments.leave_out else "refuse"
    for engine in arguments.engines:
        # The processes of the files begin with all modules loaded.
        sa.scenario(scenario(engine, None, False, missing))
    files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.suffix.lower() == ".urdf")
    found = []
    if not arguments.json:
        print("| engine | file | outcome | reason |\n|---|---|---|---|", flush=True)
    for number, file in enumerate(files):
        home, inner = (folder / file.parts[0], Path(*file.parts[1:])) if len(file.parts) > 1 else (folder, file)
        for engine in arguments.engines:
            each = outcome(home, inner.as_posix(), engine, arguments.free, missing, arguments.limit)
            each = each._replace(file=file.as_posix())
            found.append(each)
            if not arguments.json and each.outcome != "loaded":
                print(f"| {engine} | {each.file} | {each.outcome} | {each.reason} |", flush=True)
        print(f"\r{number + 1} of {len(files)}", end="", file=sys.stderr, flush=True)
    if arguments.json:
        print(json.dumps([each._asdict() for each in found], indent=1))
        return
    print()
    for engine in arguments.engines:
        counts = Counter(each.outcome for each in found if each.engine == engine)
        loaded = counts["loaded"]
        others = ", ".join(f"{count} {what}" for what, count in sorted(counts.items()) if what != "loaded")
        print(f"{engine}: {loaded} of {len(files)} loaded ({100.0 * loaded / max(1, len(files)):.1f} %); {others}")


if __name__ == "__main__":
    main()
