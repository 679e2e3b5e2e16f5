"""Checks captured states of shipped scenarios at random instants: continuations must equal the uninterrupted run.

    python benchmarks/capture.py [--pairs 50] [--seed 1] [--further 10] [--table benchmarks/RESULTS.md]

Scenarios are processed in random order, which, like the instants, is drawn with the seed. The messages of the log after
the instant, including sequence numbers, must be equal: in a run that continued, was restored and continued again, and
in a run in a new process that loaded the serialised state. Components and worlds that cannot be captured exactly must
refuse.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
from collections import defaultdict
from contextlib import suppress
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import symaware_cli as sa
from symaware_cli.log import Recorder

ROOT = Path(__file__).parents[1]

#: Instants are drawn from at most this number of first steps of a scenario.
MOST_STEPS = 120

BEGIN, END = "<!-- begin: benchmarks/capture.py -->\n", "<!-- end -->\n"


def scenarios() -> dict[Path, int]:
    """Return the number of steps of each shipped scenario whose plugins are installed, by file."""
    files = [*ROOT.glob("scenarios/*.yaml"), *ROOT.glob("scenarios/*.toml"), *ROOT.glob("plugins/*/scenarios/*.yaml")]
    found = {}
    for path in sorted(files):
        with suppress(sa.ScenarioError):
            outline = sa.load(path).outline
            assert outline is not None
            found[path] = outline.steps
    return found


def steps_made(path: Path, most: int) -> int:
    """Return the number of steps that a run makes, at most some: its `until` may end it early."""
    with sa.load(path).start() as simulation:
        return simulation.step(most)


def messages(path: Path, since: int) -> list[tuple[Any, ...]]:
    """Return the messages of a log from a sequence number on, without those of /timing."""
    return [
        (each.sequence, each.time, each.channel.topic, each.data)
        for each in sa.open_log(path).messages()
        if each.channel.topic != "/timing" and each.sequence >= since
    ]


def unbroken(path: Path, instants: list[int], further: int, folder: Path) -> dict[int, Any]:
    """Run a scenario and capture it at each instant; return sequence number and size of each state, or the refusal."""
    scenario, found = sa.load(path), {}
    with scenario.start(output=folder / "whole.mcap") as simulation:
        states, sequences = {}, {}
        for instant in instants:
            simulation.step(instant - simulation.steps)
            try:
                states[instant] = simulation.capture()
            except sa.StateError as error:
                return {each: str(error) for each in instants}
            assert isinstance(simulation._run.recorder, Recorder)
            sequences[instant] = simulation._run.recorder.writer.sequence
        simulation.step(further)
    for instant, state in states.items():
        (folder / f"{instant}.state").write_bytes(state.to_bytes())
        with scenario.start(output=folder / "again.mcap") as simulation:
            simulation.step(instant)
            taken = simulation.capture()
            simulation.step(3)
            simulation.restore(taken)
            simulation.step(further)
        found[instant] = {"sequence": sequences[instant], "bytes": len(state.to_bytes())}
        (folder / "again.mcap").rename(folder / f"{instant}.again.mcap")
    return found


def fresh(path: Path, further: int, folder: Path) -> None:
    """In a new process: continue from each state."""
    for file in sorted(folder.glob("*.state")):
        with sa.load(path).start(output=folder / f"{file.stem}.fresh.mcap") as simulation:
            simulation.restore(sa.SimulationState.from_bytes(file.read_bytes()))
            simulation.step(further)


def compared(path: Path, instants: list[int], further: int) -> list[str]:
    """Return a row of the table for each instant."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = unbroken(path, instants, further, folder)
        if any(isinstance(each, dict) for each in found.values()):
            arguments = ["--fresh", str(path), str(folder), "--further", str(further)]
            subprocess.run([sys.executable, __file__, *arguments], check=True)
        rows = []
        for instant, each in found.items():
            if isinstance(each, str):
                rows.append(f"refused: {each.partition(';')[0]}")
                continue
            whole = messages(folder / "whole.mcap", each["sequence"])
            cells = []
            for kind in ("again", "fresh"):
                log = messages(folder / f"{instant}.{kind}.mcap", each["sequence"])
                # The messages that end a run come last, and are not in the original run.
                last = max(time for _, time, _, _ in log)
                log = [message for message in log if message[1] < last]
                equal = bool(log) and log == whole[: len(log)]
                cells.append(f"{len(log)} equal" if equal else "DIFFER")
            rows.append(f"{cells[0]} | {cells[1]} | {each['bytes']:,}")
        return rows


def main() -> None:
    """Draw pairs, compare, and print the table or write it to a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--further", type=int, default=10)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--fresh", nargs=2, type=Path, metavar=("SCENARIO", "FOLDER"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.fresh:
        fresh(asked.fresh[0], asked.further, asked.fresh[1])
        return
    draw = random.Random(asked.seed)
    drawn: defaultdict[Path, set[int]] = defaultdict(set)
    steps = scenarios()
    order = draw.sample([*steps], len(steps))
    for path in islice(cycle(order), asked.pairs):
        if path not in drawn:
            steps[path] = steps_made(path, min(MOST_STEPS + asked.further + 1, steps[path]))
        instants = range(1, min(MOST_STEPS, steps[path] - asked.further - 1) + 1)
        drawn[path].add(draw.choice([each for each in instants if each not in drawn[path]]))
    lines = [
        "| scenario | step | messages after it, in the process | in a fresh one | bytes |",
        "|---|---|---|---|---|",
    ]
    for path in sorted(drawn):
        chosen = sorted(drawn[path])
        for instant, row in zip(chosen, compared(path, chosen, asked.further), strict=True):
            said = f"{row} | | |" if row.startswith("refused") else f"{row} |"
            lines.append(f"| {path.relative_to(ROOT)} | {instant} | {said}")
            print(lines[-1], file=sys.stderr, flush=True)
    table = "\n".join(lines) + "\n"
    if asked.table:
        before, _, rest = asked.table.read_text().partition(BEGIN)
        asked.table.write_text(before + BEGIN + "\n" + table + "\n" + END + rest.partition(END)[2])
    else:
        print(table)


if __name__ == "__main__":
    main()
