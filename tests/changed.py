"""The test modules that concern a change, for developers: `pytest --changed [COMMIT]`.

A module of tests concerns a changed file if it, or a module that it imports, however indirectly, is that file; if it
names the file, or is named after it; or if it names an entry point, such as `perception.range`, that leads there. Names
of rooms are followed to the module that defines them. Other dependencies are not detected: the gate runs all tests.
"""

import ast
import re
import subprocess
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
TESTS = Path(__file__).parent


def add_option(parser: pytest.Parser) -> None:
    """Add `--changed`."""
    text = "only the modules of tests that concern what changed since a commit (HEAD)"
    parser.addoption("--changed", nargs="?", const="HEAD", metavar="COMMIT", help=text)


def leaves_out(config: pytest.Config, path: Path) -> bool:
    """Whether `--changed` leaves out a module of tests."""
    commit = config.getoption("changed", None)
    return commit is not None and path.match("test_*.py") and not concerned(path, changed(commit))


@cache
def changed(commit: str) -> frozenset[Path]:
    """The files that changed since a commit, those that git does not know yet among them."""
    commands = (["diff", "--name-only", commit], ["ls-files", "--others", "--exclude-standard"])
    lines = [
        subprocess.run(["git", *each], cwd=TOP, capture_output=True, text=True, check=True).stdout for each in commands
    ]
    return frozenset(TOP / name for name in "".join(lines).splitlines())


def concerned(test: Path, files: frozenset[Path]) -> bool:
    """Whether a module of tests concerns one of some files."""
    text = test.read_text(encoding="utf-8")
    for file in files:
        if re.search(rf"\b{re.escape(file.name)}\b", text) or f"{test.stem}_".find(f"_{file.stem}_") >= 0:
            return True
    return not files.isdisjoint(_reached_or_named(test))


@cache
def _reached_or_named(test: Path) -> frozenset[Path]:
    """The imports of a module of tests, with those of the targets of the entry points that it names."""
    text = test.read_text(encoding="utf-8")
    named = {path for name, path in entry_points().items() if name in text}
    return reached(test).union(*map(reached, named))


@cache
def reached(path: Path) -> frozenset[Path]:
    """A module and all that it imports, directly or not."""
    found, pending = {path}, [path]
    while pending:
        for each in imported(pending.pop()):
            if each not in found:
                found.add(each)
                pending.append(each)
    return frozenset(found)


@cache
def imported(path: Path) -> frozenset[Path]:
    """The modules of the project that a module imports, also within functions."""
    return frozenset(_imported(ast.parse(path.read_text(encoding="utf-8"))))


def _imported(tree: ast.AST) -> Iterator[Path]:
    for node in ast.walk(tree):
        names: list[tuple[str, str]] = []
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [(node.module, each.name) for each in node.names]
        elif isinstance(node, ast.Import):
            names = [(each.name, "") for each in node.names]
        for module, name in names:
            home = homes(module).get(name, module)
            found = next(filter(None, map(located, (f"{home}.{name}", home))), None)
            if found is not None:
                yield found


@cache
def homes(package: str) -> Mapping[str, str]:
    """The module that defines each name of a room, or of the package itself."""
    place = TOP.joinpath(*package.split("."))
    stub = next((each for each in (place / "__init__.pyi", place / "__init__.py") if each.exists()), None)
    if stub is None:
        return {}
    found: dict[str, str] = {}
    for node in ast.walk(ast.parse(stub.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = f"{package}.{node.module}" if node.level else node.module
            for each in node.names:
                found[each.asname or each.name] = homes(module).get(each.name, module) if module != package else module
    return found


@cache
def located(module: str) -> Path | None:
    """The file of a module of the package, the tests or the fuzzer."""
    parts = module.split(".")
    if parts[0] in ("symaware_cli", "fuzzing"):
        places = [TOP.joinpath(*parts).with_suffix(".py"), TOP.joinpath(*parts, "__init__.py")]
        return next((each for each in places if each.exists()), None)
    # Modules that tests share are found by their names alone.
    return next((each for each in TESTS.rglob(f"{module}.py")), None) if len(parts) == 1 else None


@cache
def entry_points() -> Mapping[str, Path]:
    """The target module of each entry point of the package with a name of several parts."""
    text = (TOP / "pyproject.toml").read_text(encoding="utf-8")
    found = re.findall(r'^"?([\w.-]+)"? = "([\w.]+):\w+"$', text, re.MULTILINE)
    return {name: path for name, module in found if re.search(r"[.-]", name) if (path := located(module)) is not None}
