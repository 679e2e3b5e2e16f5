"""Mutation testing: small faults, drawn by a seed, put into the package one at a time; tests must notice each of them.

    .venv/bin/python -m fuzzing.mutants [--count 60] [--seed 1] [--output FILE]

Each mutant is one changed operator, constant, condition, result or call in one of `FOLDERS`. First the short tests run
once, in a copy of the checkout where the place of each mutant records which tests reach it. Then each mutant is put
into the copy, and the tests that reach it run in one process, until one of them fails, fails again, and does not fail
without the mutant: first those of its folder for all mutants, then the others for those that are left. A mutant that
no test reaches while it runs, as it is at the level of a module, has all tests of its folder.

The verdicts are in FILE, one JSON object a line, of which the last one of a mutant counts, so that a run that was
stopped continues. What tests reach is beside it, with the suffix `.reached`. Remove both after changes.
"""

from __future__ import annotations

import argparse
import ast
import copy
import inspect
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

PACKAGE = Path("symaware_cli")
FOLDERS = ("awareness", "core", "world", "engine/runtime", "engine/network", "log")
TIME_LIMIT = 1200.0
"""Longest time for the tests of one mutant [s]; a mutant that hangs them counts as killed."""

_SWAPPED: dict[type[ast.AST], Any] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Add, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """A changed place in a module.

    Attributes:
        path: The module.
        line: Where the change begins, from 1.
        start: Its first character in the module.
        end: The first character behind it.
        before: What stands there.
        after: What takes its place.
    """

    path: str
    line: int
    start: int
    end: int
    before: str
    after: str

    @property
    def name(self) -> str:
        """Its place and its change."""
        return f"{self.path}:{self.line}: {self.before} -> {self.after}"

    def applied(self, source: str) -> str:
        """The module with the change."""
        return source[: self.start] + self.after + source[self.end :]


def mutants(path: Path) -> list[Mutant]:
    """All mutants of a module, in the order of their places."""
    source = path.read_text()
    offsets = [0]
    for line in source.splitlines(keepends=True):
        offsets.append(offsets[-1] + len(line.encode()))
    characters = source.encode()

    def place(line: int, column: int) -> int:
        return len(characters[: offsets[line - 1] + column].decode())

    found = []
    for node, after in _changes(ast.parse(source)):
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start, end = place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)
        found.append(Mutant(str(path), node.lineno, start, end, source[start:end], after))
    return sorted(found, key=lambda mutant: (mutant.start, mutant.end, mutant.after))


def _changes(tree: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Nodes with what may take their places; annotations, errors and what is for types alone are left out."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.Raise | ast.Import | ast.ImportFrom | ast.arguments | ast.JoinedStr | ast.Assert):
            continue
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            for statement in child.body:
                yield from _changes(ast.Module([statement], []))
            continue
        if isinstance(child, ast.AnnAssign):
            if child.value is not None:
                yield from _changes(ast.Expression(child.value))
            continue
        if isinstance(child, ast.expr):
            yield from ((child, f"({ast.unparse(new)})") for new in _expressions(child))
        elif isinstance(child, ast.Return) and child.value is not None and not _is_none(child.value):
            yield child, "return None"
        elif isinstance(child, ast.Expr) and isinstance(child.value, ast.Call):
            yield child, "pass"
        elif isinstance(child, ast.Break | ast.Continue):
            yield child, "break" if isinstance(child, ast.Continue) else "continue"
        yield from _changes(child)


def _expressions(node: ast.expr) -> Iterator[ast.expr]:
    new = copy.deepcopy(node)
    match new:
        case ast.Compare(ops=[operator]) | ast.BinOp(op=operator) | ast.BoolOp(op=operator):
            swapped = _SWAPPED.get(type(operator))
            if swapped is None:
                return
            if isinstance(new, ast.Compare):
                new.ops = [swapped()]
            else:
                new.op = swapped()
            yield new
        case ast.UnaryOp(op=ast.Not()):
            yield new.operand
        case ast.UnaryOp(op=ast.USub()):
            yield new.operand
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.IfExp():
            new.test = ast.UnaryOp(ast.Not(), new.test)
            yield new


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def drawn(count: int, seed: int) -> list[Mutant]:
    """A number of mutants, as many of each folder as of the others."""
    chance = random.Random(seed)
    chosen = []
    for number, folder in enumerate(FOLDERS):
        # Generated code is not ours.
        paths = sorted(path for path in (PACKAGE / folder).rglob("*.py") if not path.name.endswith("_pb2.py"))
        everything = [mutant for path in paths for mutant in mutants(path)]
        share = count // len(FOLDERS) + (number < count % len(FOLDERS))
        chosen += chance.sample(everything, share)
    return chosen


def marked(source: str, chosen: Iterable[Mutant], record: Path) -> str:
    """A module in which the places of some of its mutants call `reach`; no line moves."""
    insertions = []
    for mutant in chosen:
        call = f"__import__('fuzzing.mutants', fromlist=['reach']).reach({str(record)!r}, {mutant.name!r})"
        # Only expressions become expressions in parentheses.
        opening, closing = (f"({call}, ", ")[1]") if mutant.after.startswith("(") else (f"{call}; ", "")
        # At one place, what ends comes before what begins, and what is inside another ends first and begins last.
        insertions += [(mutant.start, 1, -mutant.end, opening), (mutant.end, 0, -mutant.start, closing)]
    for position, _, _, text in sorted(insertions, reverse=True):
        source = source[:position] + text + source[position:]
    return source


def reach(record: str, name: str) -> None:
    """Record that the present test reaches a mutant; not while a module is imported, whichever test is the first."""
    if not sys._getframe(1).f_code.co_flags & inspect.CO_OPTIMIZED:
        return
    line = json.dumps([name, os.environ.get("PYTEST_CURRENT_TEST", "")])
    if line not in _recorded:
        _recorded.add(line)
        with open(record, "a") as file:
            file.write(f"{line}\n")


_recorded: set[str] = set()


def record_reached(chosen: list[Mutant], tree: Path, record: Path) -> None:
    """Run the short tests in a copy of the checkout, and record which of them reach which mutant.

    Tests that fail because of what is inserted have recorded what they reached before.
    """
    record.touch()
    sources = {tree / path: (tree / path).read_text() for path in {mutant.path for mutant in chosen}}
    for module, source in sources.items():
        module.write_text(marked(source, (each for each in chosen if tree / each.path == module), record))
    _run(tree, "-n", "auto")
    for module, source in sources.items():
        module.write_text(source)


def rounds(mutant: Mutant, reached: Iterable[str]) -> list[list[str]]:
    """The tests to try: those that reach a mutant of the folder that mirrors its own, and the others.

    Args:
        mutant: The mutant.
        reached: Values of `PYTEST_CURRENT_TEST` where it was reached. What one test prepares others of its file may
            share, so what prepares a test stands for all of the file.
    """
    path = Path(mutant.path)
    room = next(Path(folder) for folder in FOLDERS if path.is_relative_to(PACKAGE / folder))
    folder = "tests" / room
    tests: dict[str, set[str]] = {}
    for each in filter(None, reached):
        name, _, phase = each.rpartition(" ")
        file = name.partition("::")[0]
        tests.setdefault(file, set()).add(file if phase == "(setup)" else name)
    if not tests:
        return [[str(folder)], []]

    found: tuple[list[str], list[str]] = ([], [])
    for file in sorted(tests, key=lambda file: (not Path(file).stem.startswith(f"test_{path.stem}"), file)):
        other = not Path(file).is_relative_to(folder)
        found[other].extend([file] if file in tests[file] else sorted(tests[file]))
    return list(found)


def verdict(mutant: Mutant, tests: list[str], tree: Path) -> dict[str, object]:
    """Try tests against a mutant in a copy of the checkout.

    A test counts that fails with the mutant, fails with it again, and does not fail without it: on a busy machine tests
    may fail that wait for other processes.
    """
    module = tree / mutant.path
    source = module.read_text()

    def tested(wanted: list[str], changed: str) -> subprocess.CompletedProcess[str]:
        module.write_text(changed)
        try:
            return _tested(wanted, tree)
        finally:
            module.write_text(source)

    unsure: list[str] = []
    while tests:
        try:
            done = tested([*(f"--deselect={each}" for each in unsure), *tests], mutant.applied(source))
        except subprocess.TimeoutExpired:
            return {"killed": True, "by": "the tests hang"}
        if done.returncode in (0, 5):
            break
        if done.returncode == 4 and any("::" in each for each in tests):
            # Tests have other names with the mutant.
            tests = [*dict.fromkeys(each.partition("::")[0] for each in tests)]
            continue
        failed = [line for line in done.stdout.splitlines() if line.startswith("FAILED ")]
        if not failed:
            return {"killed": True, "by": (done.stdout + done.stderr)[-200:]}
        test = failed[0].removeprefix("FAILED ").split(" - ")[0]
        if tested([test], mutant.applied(source)).returncode and not tested([test], source).returncode:
            return {"killed": True, "by": test}
        unsure.append(test)
    return {"killed": False, "by": ""}


def _tested(tests: list[str], tree: Path) -> subprocess.CompletedProcess[str]:
    # They may be more than a command line holds.
    names = tree.with_name("tests.txt")
    names.write_text("\n".join(tests))
    return _run(tree, "-x", "-n", "0", f"@{names}", timeout=TIME_LIMIT)


def _run(tree: Path, *arguments: str, timeout: float | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    environment = dict(os.environ, PYTHONPATH=str(tree))
    environment.pop("PYTEST_ADDOPTS", None)  # what it says of its outcome is read
    return subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, timeout=timeout, check=False
    )


def main() -> None:
    """Draw mutants, try each, and say how many were killed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path(".fuzz/mutants.jsonl"))
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if arguments.output.exists():
        done = {line["mutant"]: line for line in map(json.loads, arguments.output.read_text().splitlines())}
    chosen = drawn(arguments.count, arguments.seed)
    record = arguments.output.with_suffix(".reached").resolve()
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(".", tree, ignore=shutil.ignore_patterns(".git", ".venv", ".fuzz", ".peers", "__pycache__"))
        if not record.exists():
            # What a run that was stopped has recorded is not all.
            record_reached(chosen, tree, Path(folder) / "reached")
            shutil.move(Path(folder) / "reached", record)
        reached: dict[str, list[str]] = {}
        for name, test in map(json.loads, record.read_text().splitlines()):
            reached.setdefault(name, []).append(test)
        # What was tried before counts; the next tests take longer, so they wait until every mutant had the ones before.
        for number in range(2):
            for mutant in chosen:
                name = mutant.name
                if name in done and (done[name]["killed"] or done[name]["rounds"] > number):
                    continue
                tests = rounds(mutant, reached.get(name, ()))[number]
                found = verdict(mutant, tests, tree)
                done[name] = {"mutant": name, **asdict(mutant), **found, "rounds": number + 1, "tests": len(tests)}
                with arguments.output.open("a") as file:
                    file.write(json.dumps(done[name]) + "\n")
                print(f"round {number + 1}: {'killed  ' if found['killed'] else 'survived'} {name}", flush=True)
    for mutant in chosen:
        if not done[mutant.name]["killed"]:
            print(f"SURVIVED {mutant.name}")
    print(f"{sum(bool(done[mutant.name]['killed']) for mutant in chosen)} of {len(chosen)} killed")


if __name__ == "__main__":
    main()
