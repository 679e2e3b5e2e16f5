"""Checks captured states of shipped scenarios at random instants: continuations must equal the uninterrupted run.

    python benchmarks/capture.py [--pairs 50] [--seed 1] [--steps 120] [--further 10] [--table benchmarks/RESULTS.md]

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
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import symaware_cli as sa
from symaware_cli.language.build import build
from symaware_cli.log import Recorder

ROOT = Path(__file__).parents[1]

BEGIN, END = "<!-- begin: benchmarks/capture.py -->\n", "<!-- end -->\n"


def scenarios(draw: random.Random) -> Iterator[Path]:
    """Yield the shipped scenarios whose plugins are installed, in random order."""
    files = [*ROOT.glob("scenarios/*.yaml"), *ROOT.glob("scenarios/*.toml"), *ROOT.glob("plugins/*/scenarios/*.yaml")]
    for path in draw.sample(sorted(files), len(files)):
        with suppress(sa.ScenarioError):
            sa.load(path)
            yield path


def steps_made(path: Path, most: int) -> int:
    """Return the number of steps that a run makes, at most some: its `until` may end it early."""
    scenario = sa.load(path)
    assert scenario.outline is not None
    if build(path).document.run.until is None:
        return min(most, scenario.outline.steps)
    with scenario.start() as simulation:
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


def fresh(folder: Path, further: int) -> None:
    """In a new process: continue from each state of each scenario."""
    for place in sorted(folder.iterdir()):
        scenario = sa.load((place / "scenario").read_text(encoding="utf-8"))
        for file in sorted(place.glob("*.state")):
            with scenario.start(output=place / f"{file.stem}.fresh.mcap") as simulation:
                simulation.restore(sa.SimulationState.from_bytes(file.read_bytes()))
                simulation.step(further)


def compared(found: dict[int, Any], folder: Path) -> list[str]:
    """Return a row of the table for each instant of a scenario; see `unbroken`."""
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


def lines(drawn: Mapping[Path, Collection[int]], further: int) -> Iterator[str]:
    """Yield the lines of the table for some instants of each scenario."""
    with tempfile.TemporaryDirectory() as name:
        found = {}
        for number, path in enumerate(sorted(drawn)):
            folder = Path(name, str(number))
            folder.mkdir()
            (folder / "scenario").write_text(str(path), encoding="utf-8")
            found[path] = unbroken(path, sorted(drawn[path]), further, folder), folder
        # One for all of them: to start it takes as long as to simulate some of them.
        subprocess.run([sys.executable, __file__, "--fresh", name, "--further", str(further)], check=True)
        for path, (states, folder) in found.items():
            for instant, row in zip(states, compared(states, folder), strict=True):
                said = f"{row} | | |" if row.startswith("refused") else f"{row} |"
                yield f"| {path.relative_to(ROOT)} | {instant} | {said}"


def main() -> None:
    """Draw pairs, compare, and print the table or write it to a document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=120, help="instants are among so many first steps of a scenario")
    parser.add_argument("--further", type=int, default=10)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--fresh", type=Path, metavar="FOLDER", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.fresh:
        fresh(asked.fresh, asked.further)
        return
    draw = random.Random(asked.seed)
    drawn: defaultdict[Path, set[int]] = defaultdict(set)
    steps: dict[Path, int] = {}
    for path in islice(cycle(scenarios(draw)), asked.pairs):
        if path not in steps:
            steps[path] = steps_made(path, asked.steps + asked.further + 1)
        instants = range(1, min(asked.steps, steps[path] - asked.further - 1) + 1)
        drawn[path].add(draw.choice([each for each in instants if each not in drawn[path]]))
    head = ["| scenario | step | messages after it, in the process | in a fresh one | bytes |", "|---|---|---|---|---|"]
    table = "\n".join([*head, *lines(drawn, asked.further)]) + "\n"
    if asked.table:
        before, _, rest = asked.table.read_text().partition(BEGIN)
        asked.table.write_text(before + BEGIN + "\n" + table + "\n" + END + rest.partition(END)[2])
    else:
        print(table)


if __name__ == "__main__":
    main()
