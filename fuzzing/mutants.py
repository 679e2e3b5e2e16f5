"""Mutation testing: small faults, drawn by a seed, put into the package one at a time; tests must notice each of them.

    .venv/bin/python -m fuzzing.mutants [--count 60] [--seed 1] [--output FILE]

Each mutant is one changed operator, constant, condition, result or call in `core/`, `runtime/`, `network/` or
`recording/`. The tests that mirror its folder run against a copy of the checkout, those named like its module first,
and stop at the first failure. What survives them is tried with `WIDER`, too. The verdicts stand in FILE, one JSON
object a line; mutants that are in it already are not tried again.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

PACKAGE = Path("symaware_cli")
FOLDERS = ("awareness", "core", "world", "runtime", "network", "recording")
WIDER = ("tests/api", "tests/components", "tests/environments", "tests/scenario", "tests/test_determinism.py")
TIME_LIMIT = 1200.0
"""Longest time for the tests of one mutant [s]; a mutant that hangs them counts as killed."""

_SWAPPED = {
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


def candidates(mutant: Mutant) -> list[list[str]]:
    """The tests to try, in order: those named like the module, those of its folder, and wider ones."""
    path = Path(mutant.path).relative_to(PACKAGE)
    folder = Path("tests") / path.parts[0]
    named = sorted(str(each) for each in Path("tests").rglob(f"test_{path.stem}*.py"))
    return [*([named] if named else []), [str(folder)], list(WIDER)]


def verdict(mutant: Mutant, tree: Path) -> dict[str, object]:
    """Try the tests against a mutant in a copy of the checkout."""
    module = tree / mutant.path
    source = module.read_text()
    module.write_text(mutant.applied(source))
    environment = dict(os.environ, PYTHONPATH=str(tree))
    try:
        for tests in candidates(mutant):
            command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "2", "-p", "no:cacheprovider", *tests]
            try:
                done = subprocess.run(
                    command, cwd=tree, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
                )
            except subprocess.TimeoutExpired:
                return {"killed": True, "by": "the tests hang"}
            if done.returncode not in (0, 5):
                failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return {"killed": True, "by": failed[0] if failed else done.stdout[-200:] + done.stderr[-200:]}
        return {"killed": False, "by": ""}
    finally:
        module.write_text(source)


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
    killed = 0
    chosen = drawn(arguments.count, arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(".", tree, ignore=shutil.ignore_patterns(".git", ".venv", ".fuzz", ".peers", "__pycache__"))
        for number, mutant in enumerate(chosen, 1):
            name = f"{mutant.path}:{mutant.line}: {mutant.before} -> {mutant.after}"
            if name not in done:
                done[name] = {"mutant": name, **asdict(mutant), **verdict(mutant, tree)}
                with arguments.output.open("a") as file:
                    file.write(json.dumps(done[name]) + "\n")
            killed += bool(done[name]["killed"])
            print(f"{number}/{len(chosen)} {'killed  ' if done[name]['killed'] else 'SURVIVED'} {name}", flush=True)
    print(f"{killed} of {len(chosen)} killed")


if __name__ == "__main__":
    main()
